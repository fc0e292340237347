"""Which file an asset is, and which prims of a stage are plants and leaves."""

import logging
import os
import unicodedata
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pxr import Kind, Sdf, Tf, Usd, UsdGeom, UsdUtils

from usdfoliage.asset.look_layer import LEAFY_LODS, LOD, REPRESENTATION, leafy_lods, select_lod
from usdfoliage.asset.schema import LEAF_API, LOBED_LEAF_API, PLANT_API
from usdfoliage.errors import AssetError
from usdfoliage.files.reading import open_regular

logger = logging.getLogger(__name__)

USD_SUFFIXES = (".usda", ".usdc", ".usd", ".usdz")


def usd_files_at_top(folder: Path) -> list[Path]:
    """The USD files at the top of a folder, sorted; an asset has exactly one, its interface layer."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in USD_SUFFIXES and path.is_file())


def find_interface(asset: Path) -> Path:
    """The interface layer of an asset that is named by its folder or by that layer.

    Raises:
        AssetError: There is nothing of that name, or it is no asset.
    """
    check_usd_name(asset)
    if asset.is_file():
        if asset.suffix.lower() not in USD_SUFFIXES:
            raise AssetError(f"{asset} is no USD file", "name an asset's folder or its .usda")
        return asset
    if not asset.is_dir():
        raise AssetError(f"{asset} does not exist", "name an asset's folder or its .usda")
    try:
        layers = usd_files_at_top(asset)
    except OSError as error:
        raise AssetError(f"{asset} cannot be read: {error.strerror}") from error
    if not layers:
        raise AssetError(f"{asset} is no asset: it has no USD file at its top", "name an asset's folder or its .usda")
    if len(layers) > 1:
        names = ", ".join(path.name for path in layers)
        raise AssetError(
            f"{asset} has {len(layers)} USD files at its top ({names}), an asset has one", "name the one meant"
        )
    return layers[0]


def open_layer(path: Path) -> Sdf.Layer:
    """The layer in a file.

    Raises:
        AssetError: It cannot be read as USD: no USD, truncated, damaged, no permission.
    """
    layer, reason = try_layer(path)
    if layer is None:
        raise AssetError(f"{path} cannot be read as USD ({reason})", "write it again")
    return layer


def open_copy(path: Path) -> Sdf.Layer:
    """A copy of a layer, in memory, of what the file holds now; USD may have it open as it was.

    Raises:
        AssetError: It cannot be read as USD.
    """
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path))
    except Tf.ErrorException as error:
        raise AssetError(f"{path} cannot be read as USD", "write the asset again") from error
    if layer is None:
        raise AssetError(f"{path} is missing or no USD", "write the asset again")
    return layer


MISSING = "no such file"
NO_FILE = "no regular file"
NO_TEXT = "no UTF-8"  # USD's messages quote it, and cannot be read then
MAX_DEPTH = 500  # of prims in prims in a text layer: USD's parser and its traversals go down by calling themselves
INCOMPLETE = "prims or properties that it lists are missing"
TOO_DEEP = f"its prims are nested more than {MAX_DEPTH} deep"


def try_layer(path: Path) -> tuple[Sdf.Layer | None, str]:
    """The layer, or None and the reason why it cannot be read."""
    try:
        if path.exists() and not path.is_file():  # USD would wait for a pipe, and read a device for ever
            return None, NO_FILE
        with open_regular(path) as file:
            if path.suffix.lower() != ".usdz" and not file.read(8).startswith(b"PXR-USDC"):
                file.seek(0)
                text = file.read()
                text.decode("utf-8")  # USD reads on where it is not, and fails where the text reaches Python
                if _depth(text) > MAX_DEPTH:
                    return None, TOO_DEEP
        return Sdf.Layer.FindOrOpen(usd_path(path)), "unknown format"
    except UnicodeDecodeError as error:
        return None, f"byte {error.start} is {NO_TEXT}"
    except OSError as error:
        return None, error.strerror or "unreadable"
    except Tf.ErrorException as error:
        return None, first_reason(error)


def _depth(text: bytes) -> int:
    """How deep braces stand in braces; those in texts count too."""
    codes = np.frombuffer(text, np.uint8)
    braces = codes[(codes == ord("{")) | (codes == ord("}"))]
    return int(np.cumsum(np.where(braces == ord("{"), 1, -1)).max(initial=0))


def _is_incomplete(layer: Sdf.Layer) -> bool:
    """Whether a damaged crate lists what it does not hold: USD ends the process where that is asked for."""
    if layer.GetFileFormat().formatId == "usda":  # what a parser made is whole
        return False
    missing: list[Sdf.Path] = []

    def visit(path: Sdf.Path) -> None:
        holds = path.IsPrimPath() or path.IsPrimPropertyPath() or path.IsPrimVariantSelectionPath()
        if path.isEmpty or (holds and layer.GetObjectAtPath(path) is None):
            missing.append(path)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return bool(missing)


def check_layers(root: Sdf.Layer, path: Path) -> None:
    """Refuse what would stop USD itself while it composes a layer; path is what the user calls that.

    Raises:
        AssetError: A layer that it needs is no file, no text, too deep, or lists what it does not hold.
    """
    if _is_incomplete(root):
        raise AssetError(f"{path} cannot be read as USD ({INCOMPLETE})", "write it again")
    for lost, reason in lost_layers(root):
        if reason in (NO_FILE, TOO_DEEP, INCOMPLETE) or reason.endswith(NO_TEXT):
            raise AssetError(f"{path} needs {lost}, which cannot be read as USD ({reason})", "write it again")


def lost_layers(root: Sdf.Layer) -> Iterator[tuple[Path, str]]:
    """USD files that a layer needs, itself or through others, that are missing or cannot be read, and the reason."""
    waiting, seen = [root], {root.identifier}
    while waiting:
        layer = waiting.pop()
        clips = _named_clips(layer)
        for reference in sorted({*layer.GetCompositionAssetDependencies(), *clips}):
            path = Path(layer.ComputeAbsolutePath(reference))
            if str(path) in seen or (path.suffix.lower() not in USD_SUFFIXES and reference not in clips):
                continue
            seen.add(str(path))
            opened, reason = try_layer(path) if os.path.lexists(path) else (None, MISSING)
            if opened is None:
                yield path, reason
            elif _is_incomplete(opened):
                yield path, INCOMPLETE
            else:
                waiting.append(opened)


def _named_clips(layer: Sdf.Layer) -> set[str]:
    """The files with samples, and their manifests, that value clips of a layer name."""
    named: set[str] = set()

    def visit(path: Sdf.Path) -> None:
        is_prim = path.IsPrimPath() or path.IsPrimVariantSelectionPath()
        prim = layer.GetPrimAtPath(path) if is_prim else None
        if prim is None or not prim.HasInfo("clips"):
            return
        for entry in dict(prim.GetInfo("clips")).values():
            if isinstance(entry, dict):
                files = [*(entry.get("assetPaths") or ()), entry.get("manifestAssetPath")]
                named.update(file.path for file in files if isinstance(file, Sdf.AssetPath) and file.path)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return named


def check_usd_name(path: Path) -> None:
    """Refuse a path that USD cannot name a file by, though the file system can.

    Raises:
        AssetError: It has a control character, a backslash, or bytes that are no UTF-8.
    """
    for character in str(path.absolute()):
        if unicodedata.category(character) in ("Cc", "Cs") or character == "\\":
            escaped = ascii(str(path))[1:-1]
            raise AssetError(
                f"{escaped} has {character!a} in its path, which USD cannot read", "rename it, or its folder"
            )


def usd_path(path: Path) -> str:
    """The absolute path by which USD finds the file that the system finds at path.

    For ".." USD goes up by the names, the system from where a symbolic link leads to.
    """
    written, meant = os.path.normpath(path.absolute()), os.path.realpath(path)
    return written if os.path.realpath(written) == meant else meant


def first_reason(error: Exception) -> str:
    """The first of USD's messages, without the source line that raised it."""
    text = " ".join(str(error).split())
    _, _, reason = text.partition(" : '")
    reason = (reason or text).split("' Error in '", 1)[0]
    return reason.rstrip("'") or "no reason given"


def log_diagnostics(diagnostics: UsdUtils.CoalescingDiagnosticDelegate) -> None:
    """Take what USD would print, and put it into the log."""
    for diagnostic in diagnostics.TakeUncoalescedDiagnostics():
        try:
            message = diagnostic.commentary
        except UnicodeDecodeError:  # it quotes a damaged file
            message = f"a message of {diagnostic.sourceFunction} that is no text"
        logger.info("USD: %s", message)


def is_assembly(root: Usd.Prim) -> bool:
    """Whether a root prim is that of a forest, loaded or not."""
    return bool(root) and root.HasAPI(PLANT_API) and Usd.ModelAPI(root).GetKind() == Kind.Tokens.assembly


def refuse_forest(root: Usd.Prim, path: Path) -> None:
    """Refuse a forest where one plant is needed.

    Args:
        root: The root prim of an asset.
        path: What the user calls the asset.

    Raises:
        AssetError: It is a forest.
    """
    if is_assembly(root):
        raise AssetError(f"{path} is a forest, and not one plant", "name the asset of one of its plants")


def find_plants(stage: Usd.Stage) -> list[Usd.Prim]:
    """The plants of a stage, loaded or not, those in instances too; of a forest that alone, and not its prototypes."""
    root = stage.GetDefaultPrim()
    if is_assembly(root):
        return [root]
    return _with_schema(stage, PLANT_API)


def find_leaves(stage: Usd.Stage) -> list[Usd.Prim]:
    """The prims that show leaves, in the stage's order: instancers, or in the variant nurbs every patch; no guides."""
    guide = UsdGeom.Tokens.guide
    return [prim for prim in _with_schema(stage, LEAF_API) if UsdGeom.Imageable(prim).ComputePurpose() != guide]


def require_leaves(stage: Usd.Stage, path: Path) -> list[Usd.Prim]:
    """The prims that hold leaves; path is what the user calls the stage.

    Raises:
        AssetError: There are none, or it is a forest.
    """
    refuse_forest(stage.GetDefaultPrim(), path)
    leaves = find_leaves(stage)
    if not leaves:
        if any(LOBED_LEAF_API in prim.GetAppliedSchemas() for prim in stage.Traverse()):
            what = "which is no Bézier leaf"
            raise AssetError(f"{path} holds a leaf of several lobes, {what}", "name an asset of Bézier leaves")
        plants = find_plants(stage)
        seen = f"a plant without leaves in the selected variants (<{plants[0].GetPath()}>)" if plants else "no plant"
        raise AssetError(f"{path} holds {seen}", "name an asset with leaves, or choose another lod or representation")
    return leaves


def select_leafy_lod(stage: Usd.Stage) -> None:
    """Show the leaves of plants whose selected lod has none; in the session layer, so no file changes."""
    for plant in find_plants(stage):
        variant_sets = plant.GetVariantSets()
        if (
            LOD not in variant_sets.GetNames()
            or variant_sets.GetVariantSelection(LOD) in LEAFY_LODS
            or plant.IsInstanceProxy()
        ):
            continue
        for lod in leafy_lods(plant)[:1]:
            select_lod(plant, lod)


def select_representation(stage: Usd.Stage, name: str) -> None:
    """Show the leaves of every plant of the stage in another form; in the session layer, so no file changes.

    Raises:
        AssetError: A plant has no such variant.
    """
    for plant in find_plants(stage):
        variants = plant.GetVariantSets().GetVariantSet(REPRESENTATION)
        known = variants.GetVariantNames()
        if name not in known:
            raise AssetError(
                f"<{plant.GetPath()}> has no representation {name}; it has {', '.join(known) or 'none to choose from'}"
            )
        if plant.IsInstanceProxy():
            raise AssetError(f"<{plant.GetPath()}> is part of an instance", f"select {name} on the instance itself")
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for plant in find_plants(stage):
            plant.GetVariantSets().SetSelection(REPRESENTATION, name)


def _with_schema(stage: Usd.Stage, schema: str) -> list[Usd.Prim]:
    everything = Usd.PrimIsActive & Usd.PrimIsDefined & ~Usd.PrimIsAbstract
    return [
        prim for prim in stage.Traverse(Usd.TraverseInstanceProxies(everything)) if schema in prim.GetAppliedSchemas()
    ]
