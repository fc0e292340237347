"""Looks of a whole plant, and what baking carries over."""

import shutil

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.looks.look import open_asset, write_look_layer
from usdfoliage.asset.packages.other_parts import read_other_parts
from usdfoliage.asset.packages.plant_package import write_plant_asset
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.errors import AssetError
from usdfoliage.geometry.crown_cage import build_crown_cage
from usdfoliage.jobs.edits.bake import BakeRequest, bake_asset
from usdfoliage.leaf.shape.edits import LeafEdits

from tests.support.leaves.commands import files
from tests.support.plant_assets import RUN, high_crown, round_crown, write_whole_plant

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
            value = attribute.Get()
            if isinstance(value, Sdf.AssetPath):
                assert after.GetAttribute(attribute.GetName()).Get().resolvedPath.startswith(str(made.parent))
            else:
                assert after.GetAttribute(attribute.GetName()).Get() == value
    bound, _ = UsdShade.MaterialBindingAPI(new.GetPrimAtPath("/ash/geo/proxy/Crown")).ComputeBoundMaterial()
    assert bound.GetPath() == Sdf.Path("/ash/mtl/Crown")


def bake(asset, output, name="oak"):
    request = BakeRequest(asset=asset, output=output, name=name, representations=None, resolution=None, source="bezier")
    return bake_asset(request)


@pytest.fixture
def older(tmp_path):
    """An asset as it was written before crowns were shown with the trunk below them, and one of today."""
    today = write_whole_plant(tmp_path / "oak", crown=high_crown())
    shutil.copytree(today.parent, tmp_path / "older")
    payload = tmp_path / "older" / "payload"
    (payload / "branches_bare.usdc").unlink()
    text = (payload / "payload.usda").read_text()
    (payload / "payload.usda").write_text(
        "".join(line for line in text.splitlines(keepends=True) if "branches_bare" not in line)
    )
    return tmp_path / "older" / "oak.usda", today


def test_baking_an_older_asset_puts_its_crown_on_the_trunk(older, tmp_path):
    made = [bake(asset, tmp_path / name) for asset, name in zip(older, ("a", "b"), strict=True)]
    assert files(made[0].asset.parent) == files(made[1].asset.parent)
    assert "payload/branches_bare.usdc" in files(made[0].asset.parent)
    stage = open_asset(bake(older[0], tmp_path / "c", "ash").asset)
    show(stage, "crown")
    bound, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/ash/geo/proxy/Branches")).ComputeBoundMaterial()
    assert bound.GetPath() == Sdf.Path("/ash/mtl/Bark")
    assert [any(remark.code == "trunk-shown-with-crown" for remark in each.remarks) for each in made] == [True, False]


def test_a_crown_to_the_ground_and_one_without_branches_are_baked_without_a_note(tmp_path):
    for name, branches in (("whole", True), ("leafy", False)):
        made = bake(write_whole_plant(tmp_path / name, branches=branches), tmp_path / f"{name}_baked")
        assert made.remarks == ()
        assert not (made.asset.parent / "payload" / "branches_bare.usdc").exists()


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (lambda folder: (folder / "maps" / "oak_crown_radius.exr").unlink(), "oak_crown_radius.exr cannot be read"),
        (
            lambda folder: shutil.copy(*(folder / "maps" / f"oak_crown_{which}.exr" for which in ("color", "radius"))),
            "oak_crown_radius.exr holds no radii",
        ),
        (
            lambda folder: clear_value(folder / "payload" / "crown.usdc", "/oak/geo/proxy/Crown.foliage:crown:center"),
            "crown.usdc lacks the radius map or the centre",
        ),
    ],
)
def test_an_older_asset_whose_crown_has_no_radius_is_refused(older, tmp_path, break_it, message):
    break_it(older[0].parent)
    with pytest.raises(AssetError, match=message):
        bake(older[0], tmp_path / "baked")
    assert not (tmp_path / "baked").exists()


def clear_value(path, attribute):
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.GetAttributeAtPath(attribute).ClearDefaultValue()
    layer.Save()


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
    cage_m = build_crown_cage(
        round_crown(16).radius_m, round_crown(16).center_m, 13
    ).points_m  # as few as keep it round
    np.testing.assert_array_equal(
        UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/proxy/Crown")).GetPointsAttr().Get(), cage_m
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
