"""An asset as one layer: the chosen variants alone, no arcs, no schemas of ours, one purpose."""

from collections.abc import Iterable, Mapping
from typing import Any

from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdUtils

from usdfoliage.asset.locate import log_diagnostics
from usdfoliage.asset.look_layer import LOD, REPRESENTATION
from usdfoliage.asset.schema import SCHEMAS

_STILL: Mapping[str, str] = {"rig": "none", "growth": "still"}  # variant sets of what moves, and their pose of rest
_GUIDES = "geo/guide"


def select_variants(plant: Usd.Prim, lod: str, representation: str) -> None:
    """Show one form of a plant, at rest, in the session layer; what it has no set or variant for stays."""
    wanted = {LOD: lod, REPRESENTATION: representation, **_STILL}
    stage = plant.GetStage()
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for _ in range(2):  # sets may lie in variants of the set lod
            sets = plant.GetVariantSets()
            for name, variant in wanted.items():
                if name in sets.GetNames() and variant in sets.GetVariantSet(name).GetVariantNames():
                    sets.SetSelection(name, variant)


def flatten_plant(plant: Usd.Prim, name: str, *, keep_skeleton: bool) -> Usd.Stage:
    """A stage in memory that holds the plant and nothing else, as it is composed now.

    Asset paths in it are absolute. What has a purpose is drawn everywhere afterwards, but for guides, which go; with
    keep_skeleton the curves of the skeleton stay, the one guide then.

    Args:
        plant: A prim of a stage, loaded.
        name: Of the root prim.
        keep_skeleton: Whether the curves of the branches stay.
    """
    source = plant.GetStage()
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # USD would print them
    flat = source.Flatten(addSourceFileComment=False)
    log_diagnostics(diagnostics)
    layer = Sdf.Layer.CreateAnonymous(f"{name}.usdc")
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(source))
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(source))
    root = Sdf.Path(f"/{name}")
    with Sdf.ChangeBlock():
        Sdf.CopySpec(flat, plant.GetPath(), layer, root)
    stage.SetDefaultPrim(stage.GetPrimAtPath(root))
    _drop_guides(stage, root, keep_skeleton)
    _drop_purposes(stage, keep=root.AppendPath(_GUIDES))
    _drop_schemas(layer)
    drop_empty_scopes(stage)
    drop_lost_targets(stage)
    return stage


def _drop_guides(stage: Usd.Stage, root: Sdf.Path, keep_skeleton: bool) -> None:
    guides = stage.GetPrimAtPath(root.AppendPath(_GUIDES))
    if not guides:
        return
    for prim in list(guides.GetAllChildren()):
        if not (keep_skeleton and prim.IsA(UsdGeom.BasisCurves)):
            stage.RemovePrim(prim.GetPath())


def _drop_purposes(stage: Usd.Stage, keep: Sdf.Path) -> None:
    """One form is left, which a purpose could only hide: of a render form and its proxy the former."""
    tokens = UsdGeom.Tokens
    purposes = {prim.GetPath(): UsdGeom.Imageable(prim).GetPurposeAttr().Get() for prim in stage.Traverse()}
    if tokens.render in purposes.values():
        for path in [path for path, purpose in purposes.items() if purpose == tokens.proxy]:
            stage.RemovePrim(path)
    for prim in stage.Traverse():
        if prim.GetPath() != keep:
            prim.RemoveProperty(UsdGeom.Tokens.purpose)
            prim.RemoveProperty("proxyPrim")


def _drop_schemas(layer: Sdf.Layer) -> None:
    """Applied schemas of ours go, their values stay, as attributes of nobody's schema."""

    def visit(path: Sdf.Path) -> None:
        if path.IsPrimPath():
            _drop_applied(layer.GetPrimAtPath(path))
        elif path.IsPrimPropertyPath():
            spec = layer.GetPropertyAtPath(path)
            if spec.name.startswith("foliage:") or spec.name.startswith("primvars:leaf:"):
                spec.custom = True

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)


def _drop_applied(spec: Sdf.PrimSpec) -> None:
    for arc in ("inheritPaths", "variantSetNames", "variantSelection"):
        if spec.HasInfo(arc):
            spec.ClearInfo(arc)
    if spec.HasInfo("apiSchemas"):
        names = [name for name in spec.GetInfo("apiSchemas").GetAddedOrExplicitItems() if name not in SCHEMAS]
        set_applied(spec, names)


def listed_schemas(prim: Usd.Prim) -> list[str]:
    """The applied schemas of a prim, those that USD does not know too."""
    listed = prim.GetMetadata("apiSchemas")
    return list(listed.GetAddedOrExplicitItems()) if listed else []


def set_applied(spec: Sdf.PrimSpec, names: Iterable[str]) -> None:
    """The applied schemas of a prim; names that no plug-in here knows are as good as others."""
    applied = list(names)
    if applied:
        spec.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=applied))
    elif spec.HasInfo("apiSchemas"):
        spec.ClearInfo("apiSchemas")


def drop_empty_scopes(stage: Usd.Stage) -> None:
    """Scopes without anything in them go, with those that are then empty."""
    for prim in reversed(list(stage.Traverse())):
        if prim.GetTypeName() == "Scope" and not prim.GetAllChildren():
            stage.RemovePrim(prim.GetPath())


def drop_lost_targets(stage: Usd.Stage) -> None:
    """Relationships and collections lead to what is there, or are not there."""
    for prim in stage.Traverse():
        for relationship in list(prim.GetRelationships()):
            targets = relationship.GetTargets()
            there = [target for target in targets if stage.GetObjectAtPath(target)]
            if targets and not there:
                prim.RemoveProperty(relationship.GetName())
            elif there != targets:
                relationship.SetTargets(there)
        for collection in Usd.CollectionAPI.GetAllCollections(prim):
            if not collection.GetIncludesRel().GetTargets():
                drop_collection(prim, collection.GetName())


def drop_collection(prim: Usd.Prim, name: str) -> None:
    """Remove a collection, its schema and its properties."""
    for entry in list(prim.GetAuthoredPropertiesInNamespace(["collection", name])):
        prim.RemoveProperty(entry.GetName())
    prim.RemoveAPI(Usd.CollectionAPI, name)


def finish_root(root: Usd.Prim, file: str, kind: str = Kind.Tokens.component) -> None:
    """What the root has in an export: its kind, its name and version, the box of what is below it."""
    model = Usd.ModelAPI(root)
    name, version = model.GetAssetName(), model.GetAssetVersion()
    root.ClearMetadata("assetInfo")
    model.SetKind(kind)
    model.SetAssetIdentifier(Sdf.AssetPath(f"./{file}"))
    model.SetAssetName(name or root.GetName())
    if version:
        model.SetAssetVersion(version)
    geometry = UsdGeom.ModelAPI.Apply(root)
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    geometry.SetExtentsHint(_hint(cache.ComputeUntransformedBound(root).ComputeAlignedRange()))
    for attribute in root.GetAuthoredAttributes():  # cards show the whole plant, and not the form that is exported
        if attribute.GetName().startswith("model:card") or attribute.GetName() == "model:drawMode":
            root.RemoveProperty(attribute.GetName())
    spec = root.GetStage().GetRootLayer().GetPrimAtPath(root.GetPath())
    set_applied(spec, [each for each in listed_schemas(root) if each != "AssetPreviewsAPI"])


def _hint(box: Any) -> list[Gf.Vec3f]:
    if box.IsEmpty():
        return [Gf.Vec3f(0), Gf.Vec3f(0)]
    return [Gf.Vec3f(*box.GetMin()), Gf.Vec3f(*box.GetMax())]
