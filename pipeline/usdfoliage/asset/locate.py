"""Which file an asset is, and which prims of a stage are plants and leaves."""

import os
from collections.abc import Iterator
from pathlib import Path

from pxr import Sdf, Tf, Usd, UsdGeom

from usdfoliage.asset.look_layer import REPRESENTATION
from usdfoliage.asset.schema import LEAF_API, PLANT_API
from usdfoliage.errors import AssetError

USD_SUFFIXES = (".usda", ".usdc", ".usd", ".usdz")


def usd_files_at_top(folder: Path) -> list[Path]:
    """The USD files at the top of a folder, sorted; an asset has exactly one, its interface layer."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in USD_SUFFIXES and path.is_file())


def find_interface(asset: Path) -> Path:
    """The interface layer of an asset that is named by its folder or by that layer.

    Raises:
        AssetError: There is nothing of that name, or it is no asset.
    """
    if asset.is_file():
        if asset.suffix.lower() not in USD_SUFFIXES:
            raise AssetError(f"{asset} is no USD file; name an asset's folder or its .usda")
        return asset
    if not asset.is_dir():
        raise AssetError(f"{asset} does not exist; name an asset's folder or its .usda")
    try:
        layers = usd_files_at_top(asset)
    except OSError as error:
        raise AssetError(f"{asset} cannot be read: {error.strerror}") from error
    if not layers:
        raise AssetError(f"{asset} is no asset: it has no USD file at its top; name an asset's folder or its .usda")
    if len(layers) > 1:
        names = ", ".join(path.name for path in layers)
        raise AssetError(
            f"{asset} has {len(layers)} USD files at its top ({names}), an asset has one; name the one meant"
        )
    return layers[0]


def open_layer(path: Path) -> Sdf.Layer:
    """The layer in a file.

    Raises:
        AssetError: It cannot be read as USD: no USD, truncated, damaged, no permission.
    """
    layer, reason = try_layer(path)
    if layer is None:
        raise AssetError(f"{path} cannot be read as USD ({reason}); write it again")
    return layer


MISSING = "no such file"


def try_layer(path: Path) -> tuple[Sdf.Layer | None, str]:
    """The layer, or None and the reason why it cannot be read."""
    try:
        with path.open("rb") as file:
            if path.suffix.lower() != ".usdz" and not file.read(8).startswith(b"PXR-USDC"):
                file.seek(0)
                file.read().decode("utf-8")  # USD reads on where it is not, and fails where the text reaches Python
        return Sdf.Layer.FindOrOpen(usd_path(path)), "unknown format"
    except UnicodeDecodeError as error:
        return None, f"byte {error.start} is no UTF-8"
    except OSError as error:
        return None, error.strerror or "unreadable"
    except Tf.ErrorException as error:
        return None, first_reason(error)


def lost_layers(root: Sdf.Layer) -> Iterator[tuple[Path, str]]:
    """USD files that a layer needs, itself or through others, that are missing or cannot be read, and the reason."""
    waiting, seen = [root], {root.identifier}
    while waiting:
        layer = waiting.pop()
        for reference in sorted(layer.GetCompositionAssetDependencies()):
            path = Path(layer.ComputeAbsolutePath(reference))
            if str(path) in seen or path.suffix.lower() not in USD_SUFFIXES:
                continue
            seen.add(str(path))
            opened, reason = try_layer(path) if path.is_file() else (None, MISSING)
            if opened is None:
                yield path, reason
            else:
                waiting.append(opened)


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


def find_plants(stage: Usd.Stage) -> list[Usd.Prim]:
    """The plants of a stage, loaded or not, those in instances too."""
    return _with_schema(stage, PLANT_API)


def find_leaves(stage: Usd.Stage) -> list[Usd.Prim]:
    """The prims that show leaves, in the stage's order: instancers, or in the variant nurbs every patch; no guides."""
    guide = UsdGeom.Tokens.guide
    return [prim for prim in _with_schema(stage, LEAF_API) if UsdGeom.Imageable(prim).ComputePurpose() != guide]


def require_leaves(stage: Usd.Stage, path: Path) -> list[Usd.Prim]:
    """The prims that hold leaves; path is what the user calls the stage.

    Raises:
        AssetError: There are none.
    """
    leaves = find_leaves(stage)
    if not leaves:
        plants = find_plants(stage)
        seen = f"a plant without leaves in the selected variants (<{plants[0].GetPath()}>)" if plants else "no plant"
        raise AssetError(f"{path} holds {seen}; name an asset with leaves, or choose another lod or representation")
    return leaves


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
            raise AssetError(f"<{plant.GetPath()}> is part of an instance; select {name} on the instance itself")
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for plant in find_plants(stage):
            plant.GetVariantSets().SetSelection(REPRESENTATION, name)


def _with_schema(stage: Usd.Stage, schema: str) -> list[Usd.Prim]:
    everything = Usd.PrimIsActive & Usd.PrimIsDefined & ~Usd.PrimIsAbstract
    return [
        prim for prim in stage.Traverse(Usd.TraverseInstanceProxies(everything)) if schema in prim.GetAppliedSchemas()
    ]
