"""The opinions of a look and the specs that they stand at, in plain USD.

Nothing but pxr is imported, not even of this package: usd_plugins/usdviewFoliage loads this file by itself, in programs
that may have neither numpy nor the rest of usdfoliage, so that a look is made up in one place.
"""

import os
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence

from pxr import Gf, Sdf, Usd, UsdGeom, Vt

EditValue = float | tuple[float, float, float]

REPRESENTATION = "representation"  # the variant set of a plant that chooses what its leaves are
BEZIER = "bezier"  # its variant that edits act on
LOD = "lod"  # the variant set that chooses which of its parts are shown
LEAFY_LODS = ("leaves", "both", "auto")  # those with leaves, where a plant has any
LOOK_OF = "lookOf"  # of a look's record: the asset's interface layer, as seen from the look
LOOK_PRIM = "lookPrim"  # the one placement that it is for
CUSTOM_DATA_KEY = "usdfoliage"  # of a layer's customLayerData; a layer of ours has it

# Leaf lengths on every side of the leaves. Storm culls each leaf by the prototype's extent. Edits of several looks add
# up, but only the extent of the strongest look counts, and edits authored by hand widen no extent.
PROTOTYPE_MARGIN = 1.0

_VISIBLE = 2  # of extentsHint's pairs of corners, a pair a purpose: the first two, default and render, may hold leaves
_SLACK = 1e-5  # of the size: what edits and parameters lose as float32
_SMALLEST = 1.401298464324817e-45  # float32 above 0

# Every edit and its primvar. The names are those of usdfoliage.leaf.shape.edits.LeafEdits.
EDITS: Mapping[str, str] = {
    "width": "leaf:edit:width",
    "axis1": "leaf:edit:axis1",
    "axis2": "leaf:edit:axis2",
    "silhouette1": "leaf:edit:silhouette1",
    "silhouette2": "leaf:edit:silhouette2",
    "silhouette3": "leaf:edit:silhouette3",
    "curl": "leaf:edit:curl",
    "jitter_amplitude": "leaf:edit:jitterAmplitude",
    "jitter_frequency": "leaf:edit:jitterFrequency",
}


def author_edit(prim: Usd.Prim, name: str, value: EditValue) -> None:
    """One edit, by the name of its primvar (EDITS)."""
    primvars = UsdGeom.PrimvarsAPI(prim)
    if isinstance(value, tuple):
        primvar = primvars.CreatePrimvar(name, Sdf.ValueTypeNames.Float3, UsdGeom.Tokens.constant)
        primvar.Set(Gf.Vec3f(*map(float, value)))
    else:
        primvars.CreatePrimvar(name, Sdf.ValueTypeNames.Float, UsdGeom.Tokens.constant).Set(float(value))


def author_edits(
    stage: Usd.Stage, path: Sdf.Path, edits: Mapping[str, EditValue], stored: Mapping[str, EditValue]
) -> None:
    """Author in a look the edits that leaves at path shall have in the end, where they have others without the look."""
    for name, primvar in EDITS.items():
        if name in edits and not same_value(edits[name], stored.get(name)):
            author_edit(stage.OverridePrim(path), primvar, edits[name])


def same_value(first: EditValue | None, second: EditValue | None) -> bool:
    """Whether two edits are one in USD, which keeps them as float32."""
    if first is None or second is None or isinstance(first, tuple) != isinstance(second, tuple):
        return first is second
    if isinstance(first, tuple):
        return bool(Gf.Vec3f(*first) == Gf.Vec3f(*second))  # type: ignore[misc]
    return bool(Gf.Vec2f(first, 0) == Gf.Vec2f(second, 0))


def find_class(plant: Usd.Prim) -> Sdf.Path | None:
    """The class that a plant inherits from outside, through which a look reaches it; None where there is none."""
    inherited = plant.GetInherits().GetAllDirectInherits()
    return next((path for path in inherited if not path.HasPrefix(plant.GetPath())), None)


def placement_class(class_path: Sdf.Path, placement: Sdf.Path) -> Sdf.Path:
    """A class for one placement: it reaches into an instance, where opinions of the placement itself do not."""
    placements = class_path.GetParentPath().AppendChild(f"{class_path.name}_placements")
    return placement.ReplacePrefix(Sdf.Path.absoluteRootPath, placements)


def path_between(target: str, folder: str) -> str:
    """The relative path from a look's folder to a file, beginning with ./ or ../; both are given as absolute paths."""
    relative = os.path.relpath(target, folder)
    return relative if relative.startswith("..") else f"./{relative}"


def build_look(
    plant: Usd.Prim,
    class_path: Sdf.Path,
    look_of: str,
    author_leaves: Callable[[Usd.Stage], None],
    placement: str | None = None,
) -> Sdf.Layer:
    """A layer, in memory, with the edits of leaves as opinions of a plant's class.

    Args:
        plant: Composed, where its leaves can be edited.
        class_path: From find_class or placement_class.
        look_of: The asset's interface layer, as seen from where the look will lie.
        author_leaves: Called with the look's stage to author the edits of the leaves that plant now has (author_edits),
            and how far they then reach (widen_extents): once, or once in each lod that shows leaves, selected on plant
            in its stage's session layer; what it authors lies in the variants of the leaves.
        placement: The one prim that the look is for, where class_path is a class of its own.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.documentation = f"A look of {plant.GetName()}: sublayer it into a scene that has this asset."
    stage = Usd.Stage.Open(layer)
    for prefix in class_path.GetPrefixes():
        stage.CreateClassPrim(prefix)
    record = {LOOK_OF: look_of}
    if placement:
        record[LOOK_PRIM] = placement
        stage.OverridePrim(placement).GetInherits().AddInherit(class_path)
    layer.customLayerData = {CUSTOM_DATA_KEY: record}
    for _ in _each_leafy_lod(stage, class_path, plant):
        if REPRESENTATION in plant.GetVariantSets().GetNames():
            for _ in each_variant(stage, class_path, REPRESENTATION, [BEZIER]):
                author_leaves(stage)
        else:
            author_leaves(stage)
    return layer


def leafy_lods(plant: Usd.Prim) -> list[str]:
    """The lods of a plant that show leaves; none where it has nothing to choose."""
    variant_sets = plant.GetVariantSets()
    known = variant_sets.GetVariantSet(LOD).GetVariantNames() if LOD in variant_sets.GetNames() else []
    return [lod for lod in LEAFY_LODS if lod in known]


def select_lod(plant: Usd.Prim, lod: str) -> None:
    """Show other parts of a plant; in the session layer."""
    stage = plant.GetStage()
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        plant.GetVariantSets().SetSelection(LOD, lod)


def _each_leafy_lod(stage: Usd.Stage, class_path: Sdf.Path, plant: Usd.Prim) -> Iterator[None]:
    """Author in the class once, or once in each lod that shows leaves, if the plant has others besides: there they
    are no prims, and its extentsHint is another in each."""
    variant_sets = plant.GetVariantSets()
    if LOD not in variant_sets.GetNames() or len(variant_sets.GetVariantSet(LOD).GetVariantNames()) < 2:
        yield
        return
    for lod in each_variant(stage, class_path, LOD, leafy_lods(plant)):
        select_lod(plant, lod)
        yield


def each_variant(stage: Usd.Stage, path: Sdf.Path, name: str, variants: Sequence[str]) -> Iterator[str]:
    """Go through the variants of a set of the prim at path; what is authored meanwhile lies within each. None is left
    selected: a layer that has a set of the same name again follows the selection of who refers to it.
    """
    variant_set = stage.GetPrimAtPath(path).GetVariantSets().AddVariantSet(name)
    for variant in variants:
        variant_set.AddVariant(variant)
        variant_set.SetVariantSelection(variant)
        with variant_set.GetVariantEditContext():
            yield variant
    variant_set.ClearVariantSelection()


def widen_extents(
    stage: Usd.Stage,
    class_path: Sdf.Path,
    plant: Usd.Prim,
    instancer: Usd.Prim,
    in_leaf_space: Gf.Range3d,
    among_leaves: Gf.Range3d,
) -> None:
    """Author the extents that edited leaves outgrow: of the prototypes, of the instancer, of the plant.

    None becomes smaller than the asset has it, for a renderer without our shader draws leaves without the edits. Those
    of the prototypes get the margin that the asset gives them, for other looks may act besides this one.

    Args:
        stage: Of the look.
        class_path: What stands in the look for the plant.
        plant: Composed, without the look.
        instancer: Its leaves.
        in_leaf_space: Holds every edited leaf in leaf space.
        among_leaves: Holds all edited leaves in the space of the instancer.
    """
    margin = Gf.Vec3d(PROTOTYPE_MARGIN)
    with_margin = Gf.Range3d(in_leaf_space.min - margin, in_leaf_space.max + margin)
    for target in UsdGeom.PointInstancer(instancer).GetPrototypesRel().GetForwardedTargets():
        prototype = instancer.GetStage().GetPrimAtPath(target)
        for gprim in Usd.PrimRange(prototype) if prototype else ():
            if UsdGeom.Gprim(gprim):
                _widen(stage, class_path, plant, UsdGeom.Gprim(gprim), in_leaf_space, with_margin)
    _widen(stage, class_path, plant, UsdGeom.Boundable(instancer), among_leaves, among_leaves)
    matrix, _ = UsdGeom.XformCache().ComputeRelativeTransform(instancer, plant)
    _widen_hint(stage, class_path, plant, Gf.BBox3d(among_leaves, matrix).ComputeAlignedRange())


def _widen(
    stage: Usd.Stage,
    class_path: Sdf.Path,
    plant: Usd.Prim,
    boundable: UsdGeom.Boundable,
    needed: Gf.Range3d,
    wanted: Gf.Range3d,
) -> None:
    """Where the extent does not hold what is needed, author one that holds what is wanted."""
    corners = boundable.GetExtentAttr().Get()
    is_box = (
        isinstance(corners, Vt.Vec3fArray) and len(corners) == 2
    )  # else it is for validators, as one that is missing
    extent = _range(corners) if is_box else needed
    if _contains(extent, needed):
        return
    over = stage.OverridePrim(boundable.GetPath().ReplacePrefix(plant.GetPath(), class_path))
    UsdGeom.Boundable(over).CreateExtentAttr(_outward_corners(Gf.Range3d.GetUnion(extent, wanted)))


def _widen_hint(stage: Usd.Stage, class_path: Sdf.Path, plant: Usd.Prim, needed: Gf.Range3d) -> None:
    """The same for extentsHint, a pair of corners a purpose; an empty purpose has its corners swapped."""
    attribute = UsdGeom.ModelAPI(plant).GetExtentsHintAttr()
    hint = attribute.Get() if attribute and attribute.HasAuthoredValue() else None
    hint = list(hint) if isinstance(hint, Vt.Vec3fArray) else []
    pairs = [hint[first : first + 2] for first in range(0, len(hint) - 1, 2)]
    grown = [number < _VISIBLE and not _range(pair).IsEmpty() for number, pair in enumerate(pairs)]
    if all(_contains(_range(pair), needed) for pair, grows in zip(pairs, grown, strict=True) if grows):
        return
    wider = [
        _outward_corners(Gf.Range3d.GetUnion(_range(pair), needed)) if grows else pair
        for pair, grows in zip(pairs, grown, strict=True)
    ]
    over = stage.OverridePrim(class_path)
    attribute = over.CreateAttribute("extentsHint", Sdf.ValueTypeNames.Float3Array, custom=False)
    attribute.Set([corner for pair in wider for corner in pair])


def _contains(extent: Gf.Range3d, needed: Gf.Range3d) -> bool:
    slack = Gf.Vec3d(_SLACK * max(needed.GetSize()))
    return bool(Gf.Range3d(extent.min - slack, extent.max + slack).Contains(needed))


def _range(corners: Sequence[Gf.Vec3f]) -> Gf.Range3d:
    return Gf.Range3d(Gf.Vec3d(corners[0]), Gf.Vec3d(corners[1]))


def _outward_corners(extent: Gf.Range3d) -> list[Gf.Vec3f]:
    """Two corners as USD wants them, rounded outwards."""
    return [
        Gf.Vec3f(*(_float32(number, up=False) for number in extent.min)),
        Gf.Vec3f(*(_float32(number, up=True) for number in extent.max)),
    ]


def _float32(number: float, *, up: bool) -> float:
    """The nearest float32 that is not below a number, or not above it."""
    (near,) = struct.unpack("<f", struct.pack("<f", number))
    if near >= number if up else near <= number:
        return float(near)
    if near == 0:
        return _SMALLEST if up else -_SMALLEST
    (bits,) = struct.unpack("<i", struct.pack("<f", near))
    (beyond,) = struct.unpack("<f", struct.pack("<i", bits + (1 if (near > 0) == up else -1)))
    return float(beyond)
