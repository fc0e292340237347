"""How much there is to draw, and how it is drawn so that Storm holds it and ends soon."""

import math
from dataclasses import dataclass

MAX_FACES = 2_750_000  # of refined subdivision surfaces at once: 2.7 million were drawn, of 3.5 million Storm fails
MANY = 100_000  # triangles, from which on a larger picture costs less than several samples of a pixel
MAX_TRIANGLES = 20_000_000  # beyond them plants are drawn in a lighter form
CARD_TRIANGLES = 12
LEVEL, RELIEF = "level", "relief"  # variant set of a forest, and the variant that has the fewest faces
LOD = "lod"  # that of a plant
MAX_SIDE_PX = 8192  # as the product has it, whose pictures may be no larger
MAX_PIXELS = 1 << 25
REFINED_BY = 0.1  # of complexity, a level: each divides a face into four


@dataclass(frozen=True)
class Weight:
    """What a stage has to draw, repeated as often as instancers and instances repeat it."""

    triangles: int = 0  # of surfaces that are drawn as they are
    cage_faces: int = 0  # of subdivision surfaces, before they are refined

    def __add__(self, other: "Weight") -> "Weight":
        return Weight(self.triangles + other.triangles, self.cage_faces + other.cage_faces)

    def times(self, count: int) -> "Weight":
        return Weight(self.triangles * count, self.cage_faces * count)

    def drawn(self, level: int) -> int:
        """Triangles, with subdivision surfaces refined so many times."""
        return self.triangles + 2 * self.cage_faces * 4**level


def is_drawn_as_cards(prim, time) -> bool:
    """Whether a prim's own draw mode is cards, and counts: it does for models."""
    if prim.IsPseudoRoot() or not prim.IsModel():
        return False
    return prim.GetAttribute("model:drawMode").Get(time) == "cards"


def weigh(stage, time, purposes: list[str]) -> Weight:
    """What is drawn of a stage; what is invisible, or of another purpose, does not count."""
    from pxr import UsdGeom

    known: dict[str, Weight] = {}

    def of_prototype(prim) -> Weight:
        key = str(prim.GetPath())
        if key not in known:
            known[key] = Weight()  # a prototype that holds itself would never end
            known[key] = of(prim)
        return known[key]

    def of(prim) -> Weight:
        imageable = UsdGeom.Imageable(prim)
        if imageable:
            if imageable.GetVisibilityAttr().Get(time) == UsdGeom.Tokens.invisible:
                return Weight()
            if prim.IsA(UsdGeom.Gprim) and imageable.ComputePurpose() not in purposes:
                return Weight()
        if is_drawn_as_cards(prim, time):
            return Weight(triangles=CARD_TRIANGLES)
        if prim.IsInstance():
            return of_prototype(prim.GetPrototype())
        if prim.IsA(UsdGeom.PointInstancer):
            return of_instancer(prim)
        total = of_mesh(prim) if prim.IsA(UsdGeom.Mesh) else Weight()
        if prim.IsA(UsdGeom.NurbsPatch):  # Storm draws the net of its control points
            u, v = (prim.GetAttribute(f"{axis}VertexCount").Get(time) or 1 for axis in "uv")
            total = Weight(triangles=2 * max(u - 1, 0) * max(v - 1, 0))
        for child in prim.GetChildren():
            total = total + of(child)
        return total

    def of_mesh(prim) -> Weight:
        mesh = UsdGeom.Mesh(prim)
        counts = mesh.GetFaceVertexCountsAttr().Get(time) or ()
        corners = len(mesh.GetFaceVertexIndicesAttr().Get(time) or ())
        if mesh.GetSubdivisionSchemeAttr().Get(time) == UsdGeom.Tokens.none:
            return Weight(triangles=max(0, corners - 2 * len(counts)))
        return Weight(cage_faces=len(counts))

    def of_instancer(prim) -> Weight:
        instancer = UsdGeom.PointInstancer(prim)
        paths = instancer.GetPrototypesRel().GetForwardedTargets()
        repeats = [0] * len(paths)
        indices = instancer.GetProtoIndicesAttr().Get(time) or ()
        hidden = set(instancer.GetInvisibleIdsAttr().Get(time) or ())
        ids = (instancer.GetIdsAttr().Get(time) or range(len(indices))) if hidden else ()
        if len(ids) == len(indices):
            indices = (index for index, name in zip(indices, ids, strict=True) if name not in hidden)
        for index in indices:
            if 0 <= index < len(repeats):
                repeats[index] += 1
        total = Weight()
        for path, count in zip(paths, repeats, strict=True):
            prototype = stage.GetPrimAtPath(path)
            if prototype and count:
                total = total + of_prototype(prototype).times(count)
        return total

    return of(stage.GetPseudoRoot())


def choose_complexity(weight: Weight, wanted: float) -> float:
    """The wanted complexity, or the greatest below it at which Storm holds the refined surfaces."""
    level = max(0, round((wanted - 1.0) / REFINED_BY))
    while level and weight.cage_faces * 4**level > MAX_FACES:
        level -= 1
    return min(wanted, 1.0 + REFINED_BY * level)


def choose_scale(weight: Weight, complexity: float, samples: int, sizes_px: list[tuple[int, int]]) -> int:
    """By how much pictures are drawn larger, with one sample of a pixel, instead of with several; 1: they are not."""
    scale = math.ceil(math.sqrt(samples))
    if weight.drawn(max(0, round((complexity - 1.0) / REFINED_BY))) < MANY or scale == 1:
        return 1
    fits = all(scale * max(size) <= MAX_SIDE_PX and scale**2 * size[0] * size[1] <= MAX_PIXELS for size in sizes_px)
    return scale if fits else 1


def lighten(stage, time, purposes: list[str], chosen: list[str]) -> tuple[Weight, str]:
    """How much there is to draw, in a lighter form where it is too much, and that form; empty for what it was.

    Plants of a forest become reliefs unless its level is among the variant sets that the user has chosen. What is too
    much still becomes cards or crowns, unless the lod is.
    """
    weight, lighter = weigh(stage, time, purposes), ""
    for sets, draw in (({LEVEL, LOD}, draw_reliefs), ({LOD}, draw_lighter)):
        if weight.drawn(0) > MAX_TRIANGLES and sets.isdisjoint(chosen):
            form = draw(stage)
            weight, lighter = (weigh(stage, time, purposes), form) if form else (weight, lighter)
    return weight, lighter


def draw_lighter(stage) -> str:
    """Draw every plant of a stage as its cards, or as its crown where none has cards; returns the form, or nothing.

    A plant alone is looked at from near: it is drawn as its crown, or as it is. Opinions go to the stage's edit target.
    """
    from pxr import Sdf, Usd

    layer = stage.GetEditTarget().GetLayer()
    _open_groups(stage, layer)
    found = [prim for prim in stage.Traverse() if _has_cards(prim)]
    is_alone = len(found) == 1 and not found[0].IsInstance() and not _is_repeated(found[0])
    if not found or is_alone:
        return _draw_crowns(stage)
    # Cards are drawn of models, whose parents are groups.
    above = {path for prim in found for path in prim.GetPath().GetParentPath().GetPrefixes()}
    groups = [path for path in above if not Usd.ModelAPI(stage.GetPrimAtPath(path)).IsGroup()]
    with Sdf.ChangeBlock():  # else the stage is composed anew for each of thousands of plants
        for prim in found:
            spec = Sdf.CreatePrimInLayer(layer, prim.GetPath())
            mode = Sdf.AttributeSpec(spec, "model:drawMode", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform)
            mode.default = "cards"
            spec.SetInfo("kind", "component")
        for path in groups:
            Sdf.CreatePrimInLayer(layer, path).kind = "group"
    return "cards"


def draw_reliefs(stage) -> str:
    """Draw the plants of forests as hulls whose shader draws crowns; returns the form, or nothing without a forest."""
    paths = [prim.GetPath() for prim in stage.Traverse() if RELIEF in prim.GetVariantSet(LEVEL).GetVariantNames()]
    for path in paths:
        stage.GetPrimAtPath(path).GetVariantSet(LEVEL).SetVariantSelection(RELIEF)
    return RELIEF if paths else ""


def _has_cards(prim) -> bool:
    return prim.GetAttribute("model:cardTextureXPos").HasAuthoredValue()


def _open_groups(stage, layer) -> None:
    """Make instances of whole groups of plants none: what is inside an instance takes no opinion."""
    from pxr import Sdf, Usd

    while True:
        groups = set()
        prims = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
        for prim in prims:
            if not _has_cards(prim):
                continue
            prims.PruneChildren()
            above = prim.GetParent()
            while prim.IsInstanceProxy() and above.IsInstanceProxy():
                above = above.GetParent()
            if prim.IsInstanceProxy():
                groups.add(above.GetPath())
        if not groups:
            return
        with Sdf.ChangeBlock():
            for path in groups:
                Sdf.CreatePrimInLayer(layer, path).instanceable = False


def _is_repeated(prim) -> bool:
    """Whether a prim is below a PointInstancer, as its prototypes are."""
    from pxr import UsdGeom

    while prim and not prim.IsA(UsdGeom.PointInstancer):
        prim = prim.GetParent()
    return bool(prim)


def _draw_crowns(stage) -> str:
    with_crown = [prim.GetPath() for prim in stage.Traverse() if "crown" in prim.GetVariantSet("lod").GetVariantNames()]
    for path in with_crown:
        stage.GetPrimAtPath(path).GetVariantSet("lod").SetVariantSelection("crown")
    return "crown" if with_crown else ""
