"""An asset of a whole plant, by its composed values."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLod, UsdMedia, UsdShade
from usdfoliage.asset.packages.plant_package import PlantAssetSettings, write_plant_asset
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset

from tests.support.plant_assets import RUN, some_leaves, write_whole_plant

LODS = ["auto", "both", "crown", "leaves"]


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    return write_whole_plant(tmp_path_factory.mktemp("plant") / "oak")


def open_with(asset, **selections):
    session = Sdf.Layer.CreateAnonymous(".usda")
    spec = Sdf.CreatePrimInLayer(session, "/oak")
    for name, variant in selections.items():
        spec.variantSelections[name] = variant
    return Usd.Stage.Open(Sdf.Layer.FindOrOpen(str(asset)), session)


def drawn(stage):
    parts = ("geo/render/Leaves", "geo/render/Branches", "geo/proxy/Crown", "geo/guide/Skeleton")
    return {part.rsplit("/", 1)[1] for part in parts if stage.GetPrimAtPath(f"/oak/{part}")}


def used_layers(stage):
    return {layer.realPath.rsplit("/", 1)[-1] for layer in stage.GetUsedLayers() if layer.realPath}


@pytest.mark.parametrize(
    ("lod", "expected"),
    [
        ("leaves", {"Leaves", "Branches", "Skeleton"}),
        ("both", {"Leaves", "Branches", "Skeleton", "Crown"}),
        ("crown", {"Crown"}),
        ("auto", {"Leaves", "Branches", "Crown"}),
    ],
)
def test_each_lod_has_its_parts_and_opens_no_others(asset, lod, expected):
    stage = open_with(asset, lod=lod, representation="mesh", branches="order1")
    assert drawn(stage) == expected
    used = used_layers(stage)
    assert ("crown.usdc" in used) == ("Crown" in expected)
    assert ("branches_order1.usdc" in used) == ("leaves_mesh.usdc" in used) == ("Leaves" in expected)
    assert not used & {"branches.usdc", "leaves_nurbs.usdc", "leaves_subdiv.usdc"}


def test_leaves_come_first_and_all_sets_are_seen_unloaded(asset):
    stage = Usd.Stage.Open(str(asset), Usd.Stage.LoadNone)
    plant = stage.GetDefaultPrim()
    sets = plant.GetVariantSets()
    assert {name: sorted(sets.GetVariantSet(name).GetVariantNames()) for name in sets.GetNames()} == {
        "lod": LODS,
        "representation": ["bezier", "mesh", "nurbs", "subdiv"],
        "branches": ["all", "order1"],
    }
    chosen = {name: sets.GetVariantSelection(name) for name in sets.GetNames()}
    assert chosen == {"lod": "leaves", "representation": "bezier", "branches": "all"}


@pytest.mark.parametrize(
    ("parts", "lods"),
    [
        ({"crown": False}, ["leaves"]),
        ({"leaves": False}, LODS),
        ({"branches": False}, LODS),
        ({"leaves": False, "branches": False}, ["crown"]),
    ],
)
def test_only_lods_with_content_are_offered(tmp_path, parts, lods):
    stage = Usd.Stage.Open(str(write_whole_plant(tmp_path / "oak", **parts)))
    lod = stage.GetDefaultPrim().GetVariantSet("lod")
    assert sorted(lod.GetVariantNames()) == lods
    assert lod.GetVariantSelection() == ("leaves" if "leaves" in lods else "crown")


def test_a_plant_of_no_parts_is_refused(tmp_path):
    with pytest.raises(ValueError, match="none of them was given"):
        write_plant_asset(tmp_path, "oak", provenance=RUN, asset_from_capture=np.eye(4))


@pytest.mark.parametrize("lod", LODS)
def test_purposes_are_authored_in_both_alone(asset, lod):
    stage = open_with(asset, lod=lod)
    purposes = {
        str(UsdGeom.Imageable(prim).ComputePurpose())
        for prim in stage.Traverse()
        if prim.IsA(UsdGeom.Boundable) and not prim.GetPath().HasPrefix("/oak/geo/guide")
    }
    assert purposes == ({"render", "proxy"} if lod == "both" else {"default"})
    render = stage.GetPrimAtPath("/oak/geo/render")
    proxy_prim = UsdGeom.Imageable(render).ComputeProxyPrim() if render else None
    assert (proxy_prim[0].GetPath() if proxy_prim else None) == (Sdf.Path("/oak/geo/proxy") if lod == "both" else None)


@pytest.mark.parametrize("lod", LODS)
def test_the_hint_of_each_lod_is_what_it_draws_by_purpose(asset, lod):
    stage = open_with(asset, lod=lod, representation="mesh")  # which has the leaves as a guide too
    hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint()).reshape(-1, 2, 3)
    unloaded = Usd.Stage.Open(stage.GetRootLayer(), stage.GetSessionLayer(), Usd.Stage.LoadNone)
    assert np.array_equal(hint.reshape(-1, 3), UsdGeom.ModelAPI(unloaded.GetDefaultPrim()).GetExtentsHint())
    if lod == "auto":  # UsdLod may show what is invisible in the file
        stage.SetEditTarget(stage.GetSessionLayer())
        UsdGeom.Imageable(stage.GetPrimAtPath("/oak/geo/proxy")).MakeVisible()
    for number, purpose in enumerate(("default", "render", "proxy", "guide")):
        box = Gf.Range3d()
        for form in ("mesh", "relief", "leaves"):
            holder = stage.GetPrimAtPath("/oak/geo/proxy")
            if holder:
                holder.GetVariantSets().GetVariantSet("crown").SetVariantSelection(form)
            cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [purpose])
            box.UnionWith(cache.ComputeUntransformedBound(stage.GetDefaultPrim()).ComputeAlignedRange())
        if number >= len(hint) or (hint[number, 0] > hint[number, 1]).any():
            assert box.IsEmpty()
        else:  # around the leaves it is that of all representations
            assert (hint[number, 0] <= np.array(box.min) + 1e-5).all()
            assert (hint[number, 1] >= np.array(box.max) - 1e-5).all()
            assert np.prod(np.ptp(hint[number], axis=0)) < 1.2 * np.prod(box.GetSize())


def test_unknowing_renderers_see_leaves_in_auto_and_the_items_are_in_order(asset):
    stage = open_with(asset, lod="auto")
    root = stage.GetPrimAtPath("/oak/geo")
    assert root.HasAPI(UsdLod.RootAPI)
    assert [item.GetName() for item in root.GetChildren()] == ["render", "proxy"]
    assert UsdGeom.Imageable(stage.GetPrimAtPath("/oak/geo/render/Leaves")).ComputeVisibility() == "inherited"
    assert UsdGeom.Imageable(stage.GetPrimAtPath("/oak/geo/proxy/Crown")).ComputeVisibility() == "invisible"


def test_auto_goes_from_leaves_to_crown_where_a_leaf_is_two_pixels(asset):
    stage = open_with(asset, lod="auto")
    root = stage.GetPrimAtPath("/oak/geo")
    (target,) = UsdLod.RootAPI(root).GetLodHeuristicsRel().GetTargets()
    assert not target.HasPrefix("/oak/geo")
    heuristic = UsdLod.ScreenSizeHeuristic(stage.GetPrimAtPath(target))
    assert heuristic.GetLodDomainAttr().Get() == "imaging"
    leaf_m = np.median(some_leaves().leaves.length_m)
    low, high = np.array(heuristic.GetExtentAttr().Get())
    fov_rad = np.radians(30)
    switch_m = leaf_m / 2 * 1080 / (2 * np.tan(fov_rad / 2))  # there a leaf is two pixels long
    xf = UsdGeom.XformCache().GetLocalToWorldTransform(root)
    lods = []
    for factor in (0.2, 0.95, 1.05, 1.2, 5):
        frustum = Gf.Frustum()
        frustum.SetPerspective(30, True, 1920 / 1080, 0.1, 1e5)  # the vertical angle
        frustum.SetPosition(Gf.Vec3d(*map(float, (low + high) / 2)) + Gf.Vec3d(0, 0, float(factor * switch_m)))
        lods.append(heuristic.ComputeLOD(frustum, xf))
    assert lods[:2] == [0, 0]
    assert 0 < lods[2] < 1  # blended, down to 0.8 of the area
    assert lods[3:] == [1, 1]


def test_collections_have_the_parts_they_are_named_after(asset):
    stage = open_with(asset, lod="both")
    plant = stage.GetDefaultPrim()
    for name, path in (
        ("leaves", "/oak/geo/render/Leaves"),
        ("branches", "/oak/geo/render/Branches"),
        ("crown", "/oak/geo/proxy/Crown"),
    ):
        query = Usd.CollectionAPI(plant, name).ComputeMembershipQuery()
        members = {str(path) for path in Usd.CollectionAPI.ComputeIncludedPaths(query, stage)}
        assert path in members
        assert all(member.startswith(path) for member in members)


def test_materials_of_all_parts_are_bound(asset):
    stage = open_with(asset, lod="both", representation="mesh")
    for part, material in (
        ("geo/render/Leaves", "Leaf"),
        ("geo/render/Branches", "Bark"),
        ("geo/proxy/Crown", "Crown"),
    ):
        bound, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(f"/oak/{part}")).ComputeBoundMaterial()
        assert bound.GetPath() == Sdf.Path(f"/oak/mtl/{material}")
    bark = UsdShade.Shader(stage.GetPrimAtPath("/oak/mtl/Bark/Texture")).GetInput("file").Get()
    assert bark.resolvedPath == str(asset.parent / "maps" / bark.path.rsplit("/", 1)[1])


def test_the_thumbnail_is_found_from_the_asset(asset):
    stage = Usd.Stage.Open(str(asset), Usd.Stage.LoadNone)
    plant = stage.GetDefaultPrim()
    image = UsdMedia.AssetPreviewsAPI(plant).GetDefaultThumbnails().defaultImage
    assert image.path == "./thumbnails/oak.png"
    assert image.resolvedPath == str(asset.parent / "thumbnails" / "oak.png")


def test_the_asset_is_sound_in_every_selection(asset):
    report = validate_asset(asset, read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []
    assert len(report.selections) == 3 * 4 * 2 + 1  # the crown is the same in all of the other sets


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_same_plant_is_the_same_bytes(asset, tmp_path):
    assert contents(asset.parent) == contents(write_whole_plant(tmp_path / "oak").parent)


def test_settings_that_cannot_be_are_refused():
    for bad in ({"crown_mesh_size": 1}, {"switch_leaf_px": 0.0}, {"picture_px": (0, 5)}, {"switch_size": 1.0}):
        with pytest.raises(ValueError, match=r"crown_mesh_size|pixels|switch_size"):
            PlantAssetSettings(**bad)
