"""Looks of a whole plant, and what baking carries over."""

import numpy as np
import pytest
from plant_assets import RUN, round_crown, write_whole_plant
from pxr import Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.look import open_asset, write_look_layer
from usdfoliage.asset.other_parts import read_other_parts
from usdfoliage.asset.plant_package import write_plant_asset
from usdfoliage.asset.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation import validate_asset
from usdfoliage.errors import AssetError
from usdfoliage.jobs.leaf_bake import BakeRequest, bake_asset
from usdfoliage.leaf.edits import LeafEdits

WIDE = LeafEdits(width=8.0)


@pytest.fixture
def asset(tmp_path):
    return write_whole_plant(tmp_path / "oak")


def select(interface, **variants):
    layer = Sdf.Layer.FindOrOpen(str(interface))
    for name, variant in variants.items():
        layer.rootPrims[0].variantSelections[name] = variant
    layer.Save()


def show(stage, lod):
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        stage.GetDefaultPrim().GetVariantSet("lod").SetVariantSelection(lod)


@pytest.mark.parametrize("selected", ["leaves", "crown"])
def test_a_look_acts_in_every_lod_with_leaves_and_widens_its_hint_alone(asset, tmp_path, selected):
    select(asset, lod=selected)
    look = write_look_layer(tmp_path / "look.usda", asset, WIDE)
    plain, edited = open_asset(asset), open_asset(look)
    for lod in ("leaves", "both", "auto", "crown"):
        show(plain, lod)
        show(edited, lod)
        before, after = (
            np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint()) for stage in (plain, edited)
        )
        leaves = edited.GetPrimAtPath("/oak/geo/render/Leaves")
        if lod == "crown":
            assert not (leaves and leaves.IsDefined())
        else:
            assert leaves.GetAttribute("primvars:leaf:edit:width").Get() == 8
        if lod in ("crown", "auto"):  # in auto the crown is wider than the leaves
            assert np.array_equal(before, after)
        else:
            assert before.shape == after.shape
            wider = (after != before).any(axis=1)
            assert wider.any()
            assert set(np.flatnonzero(wider)) <= ({2, 3} if lod == "both" else {0, 1})


def test_a_look_of_a_whole_plant_is_sound(asset, tmp_path):
    look = write_look_layer(tmp_path / "look.usda", asset, LeafEdits(width=1.5))
    report = validate_asset(look, read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []


@pytest.mark.parametrize("selected", ["leaves", "both", "crown"])
def test_baking_carries_branches_crown_and_thumbnail_over(asset, tmp_path, selected):
    select(asset, lod=selected, branches="order1")
    look = write_look_layer(tmp_path / "look.usda", asset, LeafEdits(width=1.5))
    request = BakeRequest(
        asset=look, output=tmp_path / "ash", name=None, representations=None, resolution=None, source="bezier"
    )
    made = bake_asset(request).asset
    asset.parent.rename(tmp_path / "gone")
    if selected == "leaves":
        report = validate_asset(made, read_profile(default_profile()))
        assert [finding for finding in report.findings if not finding.accepted] == []
    old, new = open_asset(tmp_path / "gone"), open_asset(made)
    assert new.GetDefaultPrim().GetVariantSet("lod").GetVariantSelection() == selected
    assert new.GetDefaultPrim().GetVariantSet("branches").GetVariantSelection() == "order1"
    assert (made.parent / "thumbnails" / "ash.png").is_file()
    for stage in (old, new):
        show(stage, "both")
    for part in ("geo/render/Branches", "geo/guide/Skeleton", "geo/proxy/Crown"):
        before, after = old.GetPrimAtPath(f"/oak/{part}"), new.GetPrimAtPath(f"/ash/{part}")
        for attribute in before.GetAuthoredAttributes():
            held = attribute.Get()
            if isinstance(held, Sdf.AssetPath):
                assert after.GetAttribute(attribute.GetName()).Get().resolvedPath.startswith(str(made.parent))
            else:
                assert after.GetAttribute(attribute.GetName()).Get() == held
    bound, _ = UsdShade.MaterialBindingAPI(new.GetPrimAtPath("/ash/geo/proxy/Crown")).ComputeBoundMaterial()
    assert bound.GetPath() == Sdf.Path("/ash/mtl/Crown")


def test_a_crown_takes_the_place_of_another(asset, tmp_path):
    parts = read_other_parts(asset)
    assert parts is not None
    assert parts.crown_m is not None
    folder = tmp_path / "new"
    folder.mkdir()
    made = write_plant_asset(
        folder, "oak", provenance=RUN, asset_from_capture=np.eye(4), branches=parts, crown=round_crown(16)
    )
    stage = open_asset(made)
    show(stage, "crown")
    assert (
        len(UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/proxy/Crown")).GetPointsAttr().Get()) == 6 * 14**2 + 12 * 14 + 8
    )
    assert not stage.GetPrimAtPath("/oak/mtl/Leaf")
    show(stage, "leaves")
    assert not stage.GetPrimAtPath("/oak/geo/render/Leaves")
    assert stage.GetPrimAtPath("/oak/geo/render/Branches")


def test_parts_are_read_of_one_plant(tmp_path):
    scene = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    scene.DefinePrim("/nothing")
    scene.Save()
    with pytest.raises(AssetError, match="holds 0 plants"):
        read_other_parts(tmp_path / "scene.usda")
