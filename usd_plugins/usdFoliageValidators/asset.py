"""Validators of the layout of an asset: interface, paths, bounds, purposes.

They look only at a stage whose root layer is an asset: a root prim of that very layer has FoliagePlantAPI. A shot that
references assets is none of theirs.
"""

import os
from collections.abc import Iterator
from pathlib import Path

from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdUtils

from usdFoliageValidators.findings import Findings, error, warning

USD_SUFFIXES = (".usda", ".usd", ".usdc", ".usdz")
TILES = "tiles"  # below the root of a forest: its parts, each behind a payload of its own
HINT_SLACK = 1e-4  # of the bounds' size; hints are float32


def plant_of(stage: Usd.Stage) -> Usd.Prim | None:
    """The root prim that makes the stage's root layer an asset, None where it is none."""
    for spec in stage.GetRootLayer().rootPrims:
        applied = spec.GetInfo("apiSchemas")
        if applied and "FoliagePlantAPI" in applied.GetAppliedItems():
            return stage.GetPrimAtPath(spec.path)
    return None


def is_forest(plant: Usd.Prim) -> bool:
    """Whether the root prim of an asset is that of a forest."""
    return bool(Usd.ModelAPI(plant).GetKind() == Kind.Tokens.assembly)


def check_asset_interface(stage: Usd.Stage, _time: object) -> Findings:
    """The interface layer: defaultPrim, kind, unit, up axis, one payload, alone at the top of its folder.

    A forest in tiles has one payload for each tile instead.
    """
    plant = plant_of(stage)
    if plant is None:
        return []
    layer = stage.GetRootLayer()
    findings: Findings = []
    if layer.defaultPrim != plant.GetName():
        value = f"is {layer.defaultPrim}" if layer.defaultPrim else "is not authored"
        text = f"is not the layer's defaultPrim, which {value}; author {plant.GetName()} as defaultPrim"
        findings.append(error(plant, "DefaultPrim", text))
    kind = Usd.ModelAPI(plant).GetKind()
    if kind not in (Kind.Tokens.component, Kind.Tokens.assembly):
        text = f"has kind {kind or 'none'}; a plant is a component, and a forest an assembly: author that"
        findings.append(error(plant, "Kind", text))
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage) or UsdGeom.GetStageMetersPerUnit(stage) != 1:
        findings.append(
            error(plant, "MetersPerUnit", "is in a layer whose metersPerUnit is not 1; scale the plant and author 1")
        )
    if not stage.HasAuthoredMetadata("upAxis") or UsdGeom.GetStageUpAxis(stage) != UsdGeom.Tokens.y:
        findings.append(error(plant, "UpAxis", "is in a layer whose upAxis is not Y; turn the plant and author Y"))
    spec = layer.GetPrimAtPath(plant.GetPath())
    payloads = spec.payloadList.GetAppliedItems()
    tiles = spec.nameChildren.get(TILES) if kind == Kind.Tokens.assembly and not payloads else None
    if tiles is not None and tiles.nameChildren:
        for tile in tiles.nameChildren:
            count = len(tile.payloadList.GetAppliedItems())
            if count != 1:
                text = f"has {count} payloads; author one for each tile"
                findings.append(error(stage.GetPrimAtPath(tile.path), "Payload", text))
    elif len(payloads) != 1:
        text = f"has {len(payloads)} payloads; author one, which loads all that is heavy"
        findings.append(error(plant, "Payload", text))
    for name in plant.GetVariantSets().GetNames():
        variants = plant.GetVariantSets().GetVariantSet(name)
        if variants.GetVariantSelection() not in variants.GetVariantNames():
            text = (
                f"selects {variants.GetVariantSelection() or 'nothing'} in the variant set {name}; select one of "
                f"{', '.join(variants.GetVariantNames())}"
            )
            findings.append(error(plant, "VariantSelection", text))
    if layer.realPath:
        others = sorted(
            path.name
            for path in Path(layer.realPath).parent.iterdir()
            if path.suffix.lower() in USD_SUFFIXES and path.name != Path(layer.realPath).name
        )
        if others:
            text = f"shares its folder with {', '.join(others)}; move these below, as only the interface is at the top"
            findings.append(error(plant, "FolderTop", text))
    return findings


def check_asset_paths(stage: Usd.Stage, _time: object) -> Findings:
    """Every path in the asset's layers is relative and stays inside the asset's folder."""
    plant = plant_of(stage)
    if plant is None:
        return []
    findings: Findings = []
    folder = Path(stage.GetRootLayer().realPath).parent if stage.GetRootLayer().realPath else None
    for layer, path in _paths_of_layers(stage.GetRootLayer(), folder):
        place = layer.GetDisplayName()
        if Path(path).is_absolute() or ":" in path.split("/", 1)[0] or path.startswith("\\"):
            text = f"{place} names {path}, which is not relative and breaks when the asset moves; make it relative"
            findings.append(error(plant, "PathNotRelative", text))
        elif folder is not None and not _is_inside(layer, path, folder):
            if is_forest(plant) and Path(path).suffix.lower() in USD_SUFFIXES:
                continue  # the assets of its plants lie in a library
            text = f"{place} names {path}, outside the asset's folder; copy the file into the folder and name that"
            findings.append(error(plant, "PathOutside", text))
        elif path.endswith(".glslfx") and not _is_glslfx(layer, path):
            text = f"{place} names {path}, which is no glslfx with a surfaceShader; write the asset again"
            findings.append(error(plant, "ShaderSource", text))
        elif not path.startswith(("./", "../")):
            text = f"{place} names {path}, which is looked for on the search path too; write ./{path}"
            findings.append(warning(plant, "PathSearched", text))
    return findings


def check_asset_bounds(stage: Usd.Stage, _time: object) -> Findings:
    """The interface has an extentsHint, and while the payload is loaded what it draws lies inside."""
    plant = plant_of(stage)
    if plant is None:
        return []
    attribute = UsdGeom.ModelAPI(plant).GetExtentsHintAttr()
    hint = attribute.Get(Usd.TimeCode.EarliestTime()) if attribute and attribute.HasAuthoredValue() else None
    if not hint or len(hint) % 2:
        text = "is not authored; an unloaded asset has no bounds without it: author UsdGeomModelAPI.ComputeExtentsHint"
        return [error(plant, "ExtentsHintMissing", text, "extentsHint")]
    if not plant.IsLoaded():
        return []
    findings: Findings = []
    for number, purpose in enumerate(UsdGeom.Imageable.GetOrderedPurposeTokens()):
        cache = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), [purpose], useExtentsHint=False)
        bounds = cache.ComputeUntransformedBound(plant).ComputeAlignedRange()
        if bounds.IsEmpty():
            continue
        hinted = Gf.Range3d()
        if 2 * number + 1 < len(hint):
            hinted = Gf.Range3d(Gf.Vec3d(hint[2 * number]), Gf.Vec3d(hint[2 * number + 1]))
        slack = Gf.Vec3d(HINT_SLACK * max(bounds.GetSize()))
        if hinted.IsEmpty() or not Gf.Range3d(hinted.min - slack, hinted.max + slack).Contains(bounds):
            text = (
                f"does not contain what has purpose {purpose}, {_span(bounds)}; it holds {_span(hinted)}: author it "
                "again with UsdGeomModelAPI.ComputeExtentsHint"
            )
            findings.append(error(plant, "ExtentsHintTooSmall", text, "extentsHint"))
    return findings


def check_asset_purposes(stage: Usd.Stage, _time: object) -> Findings:
    """A purpose is authored on Scopes only, and render and proxy only where both are there."""
    plant = plant_of(stage)
    if plant is None:
        return []
    findings: Findings = []
    seen: dict[str, Usd.Prim] = {}
    present = Usd.PrimIsActive & Usd.PrimIsDefined & ~Usd.PrimIsAbstract  # loaded or not
    for prim in Usd.PrimRange(plant, present):
        attribute = prim.GetAttribute("purpose")
        if not attribute or not attribute.HasAuthoredValue():
            continue
        purpose = str(attribute.Get())
        if prim.GetTypeName() not in ("Scope", "SkelRoot"):  # a rig makes the Scope a SkelRoot
            text = f"is authored on a {prim.GetTypeName() or 'prim without type'}; author it on the Scope above"
            findings.append(error(prim, "PurposeNotOnScope", text, "purpose"))
        elif any(UsdGeom.Imageable(below) for below in prim.GetAllChildren()):
            seen.setdefault(purpose, prim)
    for purpose, counterpart in (("render", "proxy"), ("proxy", "render")):
        if purpose in seen and counterpart not in seen and plant.IsLoaded():
            text = (
                f"is {purpose} while nothing in this variant selection is {counterpart}, so the asset is blank where "
                f"{purpose} is off; leave the purpose default"
            )
            findings.append(error(seen[purpose], "PurposeAlone", text, "purpose"))
    return findings


def _paths_of_layers(root: Sdf.Layer, folder: Path | None) -> Iterator[tuple[Sdf.Layer, str]]:
    """Every path that the asset's layers author, in unselected variants too, with the layer; each layer once."""
    waiting, seen = [root], {root.identifier}
    while waiting:
        layer = waiting.pop(0)
        for path in _authored_paths(layer):
            yield layer, path
            if folder is None or Path(path).suffix.lower() not in USD_SUFFIXES or not _is_inside(layer, path, folder):
                continue
            try:
                below = Sdf.Layer.FindOrOpenRelativeToLayer(layer, path)
            except Tf.ErrorException:  # USD's own CompositionErrorTest reports what cannot be read
                below = None
            if below and below.identifier not in seen:
                seen.add(below.identifier)
                waiting.append(below)


def _authored_paths(layer: Sdf.Layer) -> list[str]:
    found: list[str] = []

    def note(path: str) -> str:
        if path and path not in found:
            found.append(path)
        return path

    copy = Sdf.Layer.CreateAnonymous(".usda")
    copy.TransferContent(layer)
    UsdUtils.ModifyAssetPaths(copy, note)
    return found


def _is_inside(layer: Sdf.Layer, path: str, folder: Path) -> bool:
    if not layer.realPath or Path(path).is_absolute():
        return False
    # Not by Path.resolve, which refuses links that lead to themselves.
    place = os.path.realpath(Path(layer.realPath).parent / path)
    return Path(place).is_relative_to(os.path.realpath(folder))


def _is_glslfx(layer: Sdf.Layer, path: str) -> bool:
    """Whether a glslfx source begins like one and names a surface shader; a missing file is another rule's."""
    file = Path(layer.realPath).parent / path
    if not layer.realPath or not file.is_file():
        return True
    text = file.read_text(encoding="utf-8", errors="replace")
    return text.startswith("-- glslfx") and '"surfaceShader"' in text


def _span(bounds: Gf.Range3d) -> str:
    if bounds.IsEmpty():
        return "nothing"
    return " to ".join("(" + ", ".join(f"{x:.4g}" for x in corner) + ")" for corner in (bounds.min, bounds.max))
