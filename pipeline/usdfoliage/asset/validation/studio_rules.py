"""The rules of a studio, checked: each has a name, which is that of its findings."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import OpenImageIO as oiio
from pxr import Usd, UsdGeom

from usdfoliage.asset.packages.contents import list_files
from usdfoliage.asset.packages.interface import TILES
from usdfoliage.asset.packed_files import file_of, unpacked
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.asset.validation.instances import iterate_prims
from usdfoliage.asset.validation.studio_profile import StudioRules
from usdfoliage.files.library_text import library_text

VALIDATOR = "studio"
_NO_TEXTURES = (".glslfx", ".mtlx", ".osl", ".html", ".json")  # what an asset may name besides layers and textures


def check_composition(stage: Usd.Stage, rules: StudioRules) -> Iterator[Finding]:
    """What the rules report of an asset in one selection of its variants."""
    plant = stage.GetDefaultPrim()
    if not plant:
        return
    prims = [prim for prim in iterate_prims(stage) if prim.GetPath().HasPrefix(plant.GetPath())]
    if rules.prim_name is not None:
        pattern = re.compile(rules.prim_name)
        for prim in prims:
            if prim != plant and not pattern.fullmatch(prim.GetName()):
                yield _finding(rules, "PrimName", prim, f"its name is no {rules.prim_name}; rename it")
    if rules.kinds:
        for prim in prims:
            kind = Usd.ModelAPI(prim).GetKind()
            if kind and kind not in rules.kinds:
                yield _finding(rules, "Kind", prim, f"has kind {kind}; {_one_of(rules.kinds)} is allowed")
    yield from _check_limits(plant, prims, rules)
    unit, axis = UsdGeom.GetStageMetersPerUnit(stage), str(UsdGeom.GetStageUpAxis(stage))
    if rules.meters_per_unit and not any(abs(unit - each) <= 1e-9 * each for each in rules.meters_per_unit):
        allowed = _one_of([f"{each:g}" for each in rules.meters_per_unit])
        yield _finding(rules, "MetersPerUnit", None, f"metersPerUnit is {unit:g}; {allowed} is allowed")
    if rules.up_axes and axis not in rules.up_axes:
        yield _finding(rules, "UpAxis", None, f"upAxis is {axis}; {_one_of(rules.up_axes)} is allowed")
    for name in rules.variant_sets:
        if name not in plant.GetVariantSets().GetNames():
            yield _finding(rules, "VariantSet", plant, f"has no variant set {name}, which is required")


def check_files(interface: Path, rules: StudioRules) -> Iterator[Finding]:
    """What the rules report of an asset's files."""
    if rules.asset_name is not None and not re.fullmatch(rules.asset_name, interface.stem):
        yield _finding(
            rules, "AssetName", None, f"its name {interface.stem} is no {rules.asset_name}; rename the asset"
        )
    layers, others, _ = list_files(interface)
    sizes = (
        ("LayerCount", _count_layers([file.path for file in layers]), rules.layers, "layers"),
        ("InterfaceSize", layers[0].size_bytes, rules.interface_bytes, "bytes in its interface layer"),
        ("AssetSize", sum(file.size_bytes for file in (*layers, *others)), rules.asset_bytes, "bytes in all files"),
    )
    for rule, measured, allowed, what in sizes:
        if allowed is not None and measured > allowed:
            yield _finding(rules, rule, None, f"has {measured:,} {what}; {allowed:,} are allowed")
    for file in others:
        path = Path(file.path)
        if path.suffix.lower() in _NO_TEXTURES:
            continue
        if rules.texture_formats and path.suffix.lower().removeprefix(".") not in rules.texture_formats:
            text = f"is a {path.suffix or 'file without suffix'}; {_one_of(rules.texture_formats)} is allowed"
            yield _finding(rules, "TextureFormat", file.path, text)
        side = _side_px(file_of(interface, file.path)) if rules.texture_side_px is not None else None
        if side is not None and rules.texture_side_px is not None and side > rules.texture_side_px:
            text = f"is {side:,} pixels along its longer side; {rules.texture_side_px:,} are allowed"
            yield _finding(rules, "TextureSize", file.path, text)


def _count_layers(paths: Sequence[str]) -> int:
    """How many layers are open at once: of tiles only those of the one that has most."""
    parts = [Path(path).parts for path in paths]
    tiles = Counter(each[2] for each in parts if len(each) > 3 and each[:2] == ("payload", TILES))
    return len(paths) - tiles.total() + max(tiles.values(), default=0)


def _check_limits(plant: Usd.Prim, prims: Sequence[Usd.Prim], rules: StudioRules) -> Iterator[Finding]:
    if rules.prims is not None and len(prims) > rules.prims:
        yield _finding(rules, "PrimCount", plant, f"has {len(prims):,} prims; {rules.prims:,} are allowed")
    if rules.points is None and rules.faces is None:
        return
    points, faces = count_drawn(plant)
    for rule, measured, allowed, what in (
        ("PointCount", points, rules.points, "points"),
        ("FaceCount", faces, rules.faces, "faces"),
    ):
        if allowed is not None and measured > allowed:
            yield _finding(rules, rule, plant, f"draws {measured:,} {what}; {allowed:,} are allowed")


def count_drawn(root: Usd.Prim) -> tuple[int, int]:
    """Points and faces that a renderer gets below a prim: those of a prototype once for each of its instances."""
    points = faces = 0
    walk = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies()))
    for prim in walk:
        if prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()
            instancer = UsdGeom.PointInstancer(prim)
            indices = list(instancer.GetProtoIndicesAttr().Get(Usd.TimeCode.EarliestTime()) or ())
            for number, target in enumerate(instancer.GetPrototypesRel().GetForwardedTargets()):
                prototype = prim.GetStage().GetPrimAtPath(target)
                own = count_drawn(prototype) if prototype else (0, 0)
                times = indices.count(number)
                points, faces = points + times * own[0], faces + times * own[1]
        elif prim.IsA(UsdGeom.PointBased):
            points += len(UsdGeom.PointBased(prim).GetPointsAttr().Get(Usd.TimeCode.EarliestTime()) or ())
            counts = UsdGeom.Mesh(prim).GetFaceVertexCountsAttr() if prim.IsA(UsdGeom.Mesh) else None
            faces += len(counts.Get(Usd.TimeCode.EarliestTime()) or ()) if counts else 0
    return points, faces


def _side_px(path: Path) -> int | None:
    """The longer side of a picture; None where it cannot be read, which is another rule's."""
    with unpacked(path) as readable:
        image = oiio.ImageInput.open(str(readable))
        if image is None:
            library_text(oiio.geterror)
            return None
        spec: Any = image.spec()
        image.close()
    return int(max(spec.width, spec.height))


def _finding(rules: StudioRules, rule: str, place: Usd.Prim | str | None, message: str) -> Finding:
    path = str(place.GetPath()) if isinstance(place, Usd.Prim) else place or "/"
    return Finding(severity=rules.severity, validator=VALIDATOR, error=rule, path=path, message=message)


def _one_of(names: Sequence[str]) -> str:
    return " or ".join(names)
