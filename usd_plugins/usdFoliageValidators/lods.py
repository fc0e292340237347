"""Validators of the lods of a whole plant, and of its collections.

As those of usdFoliageValidators.asset they look only at a stage whose root layer is an asset.
"""

from collections.abc import Sequence

from pxr import Sdf, Usd, UsdGeom

from usdFoliageValidators.asset import plant_of
from usdFoliageValidators.findings import Findings, error

LOD = "lod"
RENDER, PROXY = "geo/render", "geo/proxy"  # below the plant
# What each lod shows; a studio may have others of its own.
PARTS_OF_LODS = {"leaves": (RENDER,), "both": (RENDER, PROXY), "crown": (PROXY,), "auto": (RENDER, PROXY)}


def check_asset_lods(stage: Usd.Stage, _time: object) -> Findings:
    """The selected lod shows its parts and no others, purposes are in both, and auto is one that UsdLod reads."""
    plant = plant_of(stage)
    lod = _selected(plant)
    if plant is None or lod not in PARTS_OF_LODS:
        return []
    findings: Findings = []
    known = set(plant.GetVariantSets().GetVariantSet(LOD).GetVariantNames())
    if {"leaves", "crown"} <= known and "both" not in known:
        text = "has the lods leaves and crown and no both; author it, for shots select it by name"
        findings.append(error(plant, "LodMissing", text))
    if not plant.IsLoaded():
        return findings
    for part in (RENDER, PROXY):
        prim = plant.GetPrimAtPath(part)
        has = bool(prim and prim.IsDefined() and prim.GetChildren())
        if has and part not in PARTS_OF_LODS[lod]:
            text = f"is shown in the lod {lod}, which is to be without it; refer to its layer in another lod"
            findings.append(error(prim, "LodExtra", text))
        elif not has and part in PARTS_OF_LODS[lod]:
            text = f"has nothing at {part} in the lod {lod}; refer to the layer that has it"
            findings.append(error(plant, "LodIncomplete", text))
    findings += _check_purposes(plant, lod)
    if lod == "auto" and not findings:
        findings += _check_items(plant)
    return findings


def check_asset_collections(stage: Usd.Stage, _time: object) -> Findings:
    """What the plant's collections include lies inside the plant, and exists where the selected lod shows it."""
    plant = plant_of(stage)
    if plant is None:
        return []
    findings: Findings = []
    lod = _selected(plant)
    for collection in Usd.CollectionAPI.GetAll(plant):
        for target in collection.GetIncludesRel().GetTargets():
            name = f"collection:{collection.GetName()}:includes"
            if not target.HasPrefix(plant.GetPath()):
                text = f"targets <{target}>, outside the plant, which is lost where the asset is referenced"
                findings.append(error(plant, "CollectionOutside", text, name))
            elif plant.IsLoaded() and not stage.GetPrimAtPath(target.GetPrimPath()) and _is_in_lod(plant, target, lod):
                text = f"targets <{target}>, which does not exist; correct the path or drop the target"
                findings.append(error(plant, "CollectionTargetMissing", text, name))
    return findings


def _selected(plant: Usd.Prim | None) -> str:
    sets = plant.GetVariantSets() if plant is not None else None
    return str(sets.GetVariantSelection(LOD)) if sets is not None and LOD in sets.GetNames() else ""


def _is_in_lod(plant: Usd.Prim, path: Sdf.Path, lod: str) -> bool:
    parts = [part for part in (RENDER, PROXY) if path.HasPrefix(plant.GetPath().AppendPath(part))]
    return not parts or lod not in PARTS_OF_LODS or parts[0] in PARTS_OF_LODS[lod]


def _check_purposes(plant: Usd.Prim, lod: str) -> Findings:
    findings: Findings = []
    for part, purpose in ((RENDER, UsdGeom.Tokens.render), (PROXY, UsdGeom.Tokens.proxy)):
        prim = plant.GetPrimAtPath(part)
        if not prim:
            continue
        attribute = UsdGeom.Imageable(prim).GetPurposeAttr()
        kinds = (UsdGeom.Tokens.render, UsdGeom.Tokens.proxy)
        purposed = attribute and attribute.HasAuthoredValue() and attribute.Get() in kinds
        if lod == "both" and (not purposed or attribute.Get() != purpose):
            text = f"has not the purpose {purpose} in the lod both, so crown and leaves are drawn over each other"
            findings.append(error(prim, "PurposeMissing", text, "purpose"))
        elif lod == "auto" and purposed:  # AssetPurposes reports it in the others, where it stands alone
            text = f"is {attribute.Get()} in the lod {lod}, which is blank where that purpose is off; leave it default"
            findings.append(error(prim, "PurposeInLod", text, "purpose"))
    render = plant.GetPrimAtPath(RENDER)
    if lod == "both" and render and not findings and not UsdGeom.Imageable(render).ComputeProxyPrim():
        text = "leads to no prim of purpose proxy; author it, so that applications know what stands for the plant"
        findings.append(error(render, "ProxyPrim", text, "proxyPrim"))
    return findings


def _check_items(plant: Usd.Prim) -> Findings:
    """By the names of UsdLod's properties: the schemas came with USD 26.08."""
    root = plant.GetPrimAtPath(Sdf.Path(RENDER).GetParentPath())
    if "LODRootAPI" not in root.GetAppliedSchemas():
        return [error(root, "LodRoot", "has no LODRootAPI in the lod auto, so no renderer chooses; apply it")]
    items = [f"{root.GetName()}/{child.GetName()}" for child in root.GetChildren()]
    if items != [RENDER, PROXY]:
        text = f"has the children {', '.join(items)} in the lod auto; its items are {RENDER} and {PROXY}, in this order"
        return [error(root, "LodItems", text)]
    findings: Findings = []
    if UsdGeom.Imageable(root.GetChildren()[1]).ComputeVisibility() != UsdGeom.Tokens.invisible:
        text = "is visible in the lod auto; author it invisible, for renderers that do not choose"
        findings.append(error(root.GetChildren()[1], "LodVisible", text, "visibility"))
    relationship = root.GetRelationship("lod:heuristics")
    targets: Sequence[Sdf.Path] = relationship.GetForwardedTargets() if relationship else []
    if not targets:
        findings.append(error(root, "LodHeuristic", "names no heuristic; target one", "lod:heuristics"))
    for target in targets:
        prim = root.GetStage().GetPrimAtPath(target)
        if not prim or target.HasPrefix(root.GetPath()):
            wrong = "would be an item itself" if prim else "does not exist"
            text = f"targets <{target}>, which {wrong}; put it beside geo"
            findings.append(error(root, "LodHeuristic", text, "lod:heuristics"))
            continue
        thresholds = prim.GetAttribute("thresholds").Get() or ()
        if not prim.GetAttribute("lod:domain").Get():
            text = "is not authored, so no renderer knows that the heuristic is its own; author imaging"
            findings.append(error(prim, "LodDomain", text, "lod:domain"))
        if len(thresholds) != len(items) - 1 or not all(value > 0 for value in thresholds):
            text = f"has {len(thresholds)} values; {len(items) - 1} above 0 is needed between {len(items)} items"
            findings.append(error(prim, "LodThresholds", text, "thresholds"))
    return findings
