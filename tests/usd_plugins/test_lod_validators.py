"""The validators of lods and collections, on a whole plant that is broken in a session layer."""

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdLod, UsdValidation

from tests.support.plant_assets import write_whole_plant

NAMES = ("AssetLods", "AssetCollections")


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    return write_whole_plant(tmp_path_factory.mktemp("plant") / "oak")


def found(stage):
    """(error, place) of what both find."""
    registry = UsdValidation.ValidationRegistry()
    validators = [registry.GetOrLoadValidatorByName(f"usdFoliageValidators:{name}") for name in NAMES]
    problems = UsdValidation.ValidationContext(validators=validators).Validate(stage)
    places = []
    for problem in problems:
        (site,) = problem.GetSites()
        path = site.GetProperty().GetPath() if site.IsProperty() else site.GetPrim().GetPath()
        assert problem.GetMessage().startswith(f"<{path}> ")
        places.append((problem.GetName(), str(path)))
    return sorted(places)


def opened(asset, lod, load=Usd.Stage.LoadAll):
    session = Sdf.Layer.CreateAnonymous(".usda")
    Sdf.CreatePrimInLayer(session, "/oak").variantSelections["lod"] = lod
    stage = Usd.Stage.Open(Sdf.Layer.FindOrOpen(str(asset)), session, load)
    stage.SetEditTarget(session)
    return stage


@pytest.mark.parametrize("lod", ["leaves", "both", "crown", "auto"])
def test_a_good_plant_has_no_findings(asset, lod):
    assert found(opened(asset, lod)) == []
    assert found(opened(asset, lod, Usd.Stage.LoadNone)) == []


def turn_off(path):
    return lambda stage: stage.GetPrimAtPath(path).SetActive(False)


def add(path):
    return lambda stage: UsdGeom.Mesh.Define(stage, path)


def purpose(path, value):
    return lambda stage: UsdGeom.Imageable(stage.GetPrimAtPath(path)).CreatePurposeAttr(value)


def set_heuristic(name, value):
    return lambda stage: stage.GetPrimAtPath("/oak/lod/ScreenSize").GetAttribute(name).Set(value)


def heuristics(*paths):
    def break_it(stage):
        stage.GetPrimAtPath("/oak/geo").GetRelationship("lod:heuristics").SetTargets([Sdf.Path(path) for path in paths])

    return break_it


def heuristic_as_item(stage):
    stage.GetPrimAtPath("/oak/geo").GetRelationship("lod:heuristics").SetTargets(["/oak/geo/render/ScreenSize"])
    UsdLod.ScreenSizeHeuristic.Define(stage, "/oak/geo/render/ScreenSize")


def include(*targets):
    def break_it(stage):
        Usd.CollectionAPI(stage.GetDefaultPrim(), "leaves").GetIncludesRel().SetTargets(list(targets))

    return break_it


@pytest.mark.parametrize(
    ("lod", "break_it", "finding"),
    [
        ("leaves", turn_off("/oak/geo/render"), ("LodIncomplete", "/oak")),
        ("crown", turn_off("/oak/geo/proxy/Crown"), ("LodIncomplete", "/oak")),
        ("both", turn_off("/oak/geo/proxy"), ("LodIncomplete", "/oak")),
        ("leaves", add("/oak/geo/proxy/Crown"), ("LodExtra", "/oak/geo/proxy")),
        ("crown", add("/oak/geo/render/Leaves"), ("LodExtra", "/oak/geo/render")),
        ("auto", purpose("/oak/geo/proxy", "proxy"), ("PurposeInLod", "/oak/geo/proxy.purpose")),
        ("both", purpose("/oak/geo/render", "default"), ("PurposeMissing", "/oak/geo/render.purpose")),
        (
            "both",
            lambda stage: stage.GetPrimAtPath("/oak/geo/render").GetRelationship("proxyPrim").SetTargets([]),
            ("ProxyPrim", "/oak/geo/render.proxyPrim"),
        ),
        (
            "auto",
            lambda stage: stage.GetPrimAtPath("/oak/geo").RemoveAPI(UsdLod.RootAPI),
            ("LodRoot", "/oak/geo"),
        ),
        ("auto", lambda stage: stage.GetPrimAtPath("/oak/geo/guide").SetActive(True), ("LodItems", "/oak/geo")),
        ("auto", add("/oak/geo/more"), ("LodItems", "/oak/geo")),
        (
            "auto",
            lambda stage: stage.GetPrimAtPath("/oak/geo/proxy").GetAttribute("visibility").Set("inherited"),
            ("LodVisible", "/oak/geo/proxy.visibility"),
        ),
        ("auto", heuristics(), ("LodHeuristic", "/oak/geo.lod:heuristics")),
        ("auto", heuristics("/oak/lod/Nothing"), ("LodHeuristic", "/oak/geo.lod:heuristics")),
        ("auto", heuristic_as_item, ("LodHeuristic", "/oak/geo.lod:heuristics")),
        ("auto", set_heuristic("lod:domain", ""), ("LodDomain", "/oak/lod/ScreenSize.lod:domain")),
        ("auto", set_heuristic("thresholds", [0.5, 0.1]), ("LodThresholds", "/oak/lod/ScreenSize.thresholds")),
        ("leaves", include("/elm"), ("CollectionOutside", "/oak.collection:leaves:includes")),
        (
            "both",
            include("/oak/geo/render/Petals"),
            ("CollectionTargetMissing", "/oak.collection:leaves:includes"),
        ),
    ],
)
def test_each_rule_finds_what_is_broken(asset, lod, break_it, finding):
    stage = opened(asset, lod)
    break_it(stage)
    assert finding in found(stage)


def test_a_lod_that_is_missing_is_found(asset):
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(asset)))
    spec = layer.GetPrimAtPath("/oak")
    lods = spec.variantSets["lod"]
    lods.RemoveVariant(lods.variants["both"])
    spec.payloadList.ClearEdits()
    stage = Usd.Stage.Open(layer)
    assert ("LodMissing", "/oak") in found(stage)


def test_a_collection_may_name_what_another_lod_shows(asset):
    stage = opened(asset, "crown")
    include("/oak/geo/render/Petals")(stage)
    assert found(stage) == []
