"""A plant as one layer: one form of it, at rest, with nothing of what was left out."""

from pxr import Usd, UsdGeom
from usdfoliage.asset.export.flat import flatten_plant, select_variants

from tests.support.plant_assets import write_whole_plant


def paths(stage: Usd.Stage) -> set[str]:
    return {str(prim.GetPath()) for prim in stage.Traverse() if prim.IsA(UsdGeom.Gprim)}


def test_of_a_form_and_its_proxy_the_form_stays(tmp_path):
    stage = Usd.Stage.Open(str(write_whole_plant(tmp_path / "oak")))
    plant = stage.GetDefaultPrim()
    for lod in ("both", "leaves"):
        select_variants(plant, lod, "mesh")
        flat = flatten_plant(plant, "ash", keep_skeleton=False)
        assert paths(flat) == {"/ash/geo/render/Leaves", "/ash/geo/render/Branches"}
        purposes = {UsdGeom.Imageable(prim).ComputePurpose() for prim in flat.Traverse()}
        assert purposes == {"default"}


def test_a_crown_and_a_skeleton_stay_where_they_are_asked_for(tmp_path):
    stage = Usd.Stage.Open(str(write_whole_plant(tmp_path / "oak")))
    plant = stage.GetDefaultPrim()
    select_variants(plant, "leaves", "mesh")
    flat = flatten_plant(plant, "oak", keep_skeleton=True)
    assert "/oak/geo/guide/Skeleton" in paths(flat)
    assert UsdGeom.Imageable(flat.GetPrimAtPath("/oak/geo/guide/Skeleton")).ComputePurpose() == "guide"
    assert flat.GetPrimAtPath("/oak/geo/guide/Skeleton").GetAttribute("foliage:parentCurve").Get() is not None
    select_variants(plant, "crown", "mesh")
    assert "/oak/geo/proxy/Crown" in paths(flatten_plant(plant, "oak", keep_skeleton=True))


def test_targets_lead_to_what_is_there(tmp_path):
    stage = Usd.Stage.Open(str(write_whole_plant(tmp_path / "oak")))
    plant = stage.GetDefaultPrim()
    select_variants(plant, "leaves", "mesh")
    flat = flatten_plant(plant, "ash", keep_skeleton=False)
    root = flat.GetDefaultPrim()
    assert not root.GetRelationship("foliage:crown")
    assert Usd.CollectionAPI.Get(root, "leaves")
    assert not root.HasAPI(Usd.CollectionAPI, "crown")
    for prim in flat.Traverse():
        for relationship in prim.GetRelationships():
            assert all(flat.GetObjectAtPath(target) for target in relationship.GetTargets())
