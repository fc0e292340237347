"""Plants of a stage, what can be chosen of them, and their guides. Nothing is changed but the session layer."""

from pxr import Sdf, Usd, UsdGeom

# As authored: where our schemas are not registered, prims do not list them among those applied.
PLANT_API = "FoliagePlantAPI"
LEAF_API = "FoliageLeafAPI"
GUIDES = ("Skeleton", "Cloud", "Cameras")  # below a scope of this name
GUIDE_SCOPE = "guide"
SKELETON, WOOD = "Skeleton", "Branches"
_OURS = "usdfoliage"  # in customData of an opinion that show_guides alone may take back


def find_plants(stage: Usd.Stage) -> list[Usd.Prim]:
    """The plants of a stage, those in instances too; of the instances of one prototype all, for each has its path."""
    everything = Usd.PrimIsActive & Usd.PrimIsDefined & ~Usd.PrimIsAbstract
    return [
        prim
        for prim in stage.Traverse(Usd.TraverseInstanceProxies(everything))
        if PLANT_API in prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    ]


def interface_file(plant: Usd.Prim) -> str:
    """The file that makes a prim a plant, the asset's interface layer; empty where it is in no file."""
    for spec in plant.GetPrimStack():
        schemas = spec.GetInfo("apiSchemas") if spec.HasInfo("apiSchemas") else None
        if schemas is not None and PLANT_API in schemas.GetAddedOrExplicitItems():
            return spec.layer.realPath
    return ""


def one_of_each(plants: list[Usd.Prim]) -> list[Usd.Prim]:
    """The first plant of every asset: edits act on all that are of one."""
    first = {}
    for plant in plants:
        first.setdefault(interface_file(plant) or str(plant.GetPath()), plant)
    return list(first.values())


def find_leaves(plant: Usd.Prim) -> list[Usd.Prim]:
    """The instancers of leaves that edits act on, in the variants that are selected."""
    return [
        prim
        for prim in Usd.PrimRange(plant, Usd.TraverseInstanceProxies())
        if prim.IsA(UsdGeom.PointInstancer)
        and LEAF_API in prim.GetPrimTypeInfo().GetAppliedAPISchemas()
        and UsdGeom.Imageable(prim).ComputePurpose() != UsdGeom.Tokens.guide
    ]


def variants(plant: Usd.Prim) -> dict[str, tuple[list[str], str]]:
    """The variants of each set of a plant, and the one that is selected."""
    sets = plant.GetVariantSets()
    return {
        name: (list(sets.GetVariantSet(name).GetVariantNames()), sets.GetVariantSet(name).GetVariantSelection())
        for name in sets.GetNames()
    }


def select_variant(stage: Usd.Stage, name: str, chosen: str, interface: str | None = None) -> int:
    """Select a variant, in the session layer, on every plant that has it; returns how many these are.

    A plant inside an instance keeps what its prototype has.

    Args:
        interface: Only on plants of the asset with this interface layer.
    """
    paths = [
        plant.GetPath()
        for plant in find_plants(stage)
        if chosen in plant.GetVariantSets().GetVariantSet(name).GetVariantNames()
        and not plant.IsInstanceProxy()
        and (interface is None or interface_file(plant) == interface)
    ]
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for path in paths:
            stage.GetPrimAtPath(path).GetVariantSets().SetSelection(name, chosen)
    return len(paths)


def guide_prims(stage: Usd.Stage) -> dict[str, list[Sdf.Path]]:
    """All prims that stand in scopes of guides, by their names."""
    found: dict[str, list[Sdf.Path]] = {}
    walk = iter(stage.Traverse())
    for prim in walk:
        if prim.GetParent().GetName() == GUIDE_SCOPE and prim.IsA(UsdGeom.Imageable):
            found.setdefault(prim.GetName(), []).append(prim.GetPath())
            walk.PruneChildren()
    return found


def show_guides(stage: Usd.Stage, visible: set[str]) -> None:
    """Hide, in the session layer, the guides of other names; with none to show leave all as the asset has them.

    A skeleton lies within the wood, which is hidden for as long as the skeleton is visible.
    """
    guides = guide_prims(stage)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for name, paths in guides.items():
            for path in paths:
                visibility = UsdGeom.Imageable(stage.GetPrimAtPath(path)).CreateVisibilityAttr()
                if not visible:
                    visibility.Clear()
                else:
                    visibility.Set(UsdGeom.Tokens.inherited if name in visible else UsdGeom.Tokens.invisible)
    for path in guides.get(SKELETON, ()):
        _show_wood(stage, path.GetParentPath().GetParentPath(), SKELETON not in visible)


def _show_wood(stage: Usd.Stage, geo: Sdf.Path, visible: bool) -> None:
    """Hide the wood below a plant's geo, or take that back; opinions of the user in the session layer stay."""
    session = stage.GetSessionLayer()
    for prim in Usd.PrimRange(stage.GetPrimAtPath(geo)):
        if prim.GetName() != WOOD or not prim.IsA(UsdGeom.Imageable):
            continue
        spec = session.GetAttributeAtPath(prim.GetPath().AppendProperty(UsdGeom.Tokens.visibility))
        if spec is not None and _OURS not in spec.customData:
            continue
        if not visible:
            with Usd.EditContext(stage, session):
                attribute = UsdGeom.Imageable(prim).CreateVisibilityAttr(UsdGeom.Tokens.invisible)
                attribute.SetCustomDataByKey(_OURS, True)
        elif spec is not None:
            owner = spec.owner
            owner.RemoveProperty(spec)
            session.ScheduleRemoveIfInert(owner)
