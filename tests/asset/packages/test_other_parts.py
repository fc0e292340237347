"""Branches that travel into an asset with other leaves."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.packages.branch_package import write_branch_asset
from usdfoliage.asset.packages.other_parts import find_other_parts, read_other_parts, write_leaves_beside
from usdfoliage.asset.packages.plant_package import write_plant_asset
from usdfoliage.asset.parts.branch_part import BranchAssetSettings
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.parts.leaf_part import BranchLeaves, LeafAssetSettings
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.errors import AssetError

from tests.support.branch_shapes import fork
from tests.support.leaves.assets import random_leaves, two_leaves
from tests.support.plant_assets import fork_branches, round_crown, some_leaves

RUN = Provenance(capture="fork.ply", generator="test", seed=0, input_sha256="")


@pytest.fixture
def plant(tmp_path):
    """The interface layer of a fork with a picture of bark, two orders, and a range of time."""
    cv2.imwrite(str(tmp_path / "rough bark.png"), np.full((4, 4, 3), 90, np.uint8))
    skeleton = fork()
    folder = tmp_path / "fork"
    folder.mkdir()
    interface = write_branch_asset(
        folder,
        "fork",
        SkeletonPrim(skeleton=skeleton),
        BranchSurfaces(whole=build_branch_cage(skeleton), by_order=((1, build_branch_cage(skeleton.up_to_order(1))),)),
        RUN,
        np.eye(4),
        BranchAssetSettings(texture=tmp_path / "rough bark.png"),
        foliage=BranchLeaves(leaves=two_leaves()),
    )
    layer = Sdf.Layer.FindOrOpen(str(interface))
    layer.startTimeCode, layer.endTimeCode = 1, 48
    layer.GetPrimAtPath("/fork").variantSelections["branches"] = "order1"
    layer.Save()
    return interface


def rewrite(plant, folder, name, leaves):
    folder.mkdir()
    stage = Usd.Stage.Open(str(plant))
    others = find_other_parts(stage.GetDefaultPrim(), plant)
    return write_leaves_beside(folder, name, leaves, others, RUN, LeafAssetSettings(representations=("bezier", "mesh")))


def test_branches_are_the_same_under_another_name(plant, tmp_path):
    leaves = random_leaves(7)
    made = Usd.Stage.Open(str(rewrite(plant, tmp_path / "new", "ash", leaves)))
    old = Usd.Stage.Open(str(plant))
    root = made.GetDefaultPrim()
    assert root.GetName() == "ash"
    assert root.GetRelationship("foliage:skeleton").GetTargets() == [Sdf.Path("/ash/geo/guide/Skeleton")]
    for part in ("geo/render/Branches", "geo/guide/Skeleton"):
        before, after = old.GetPrimAtPath(f"/fork/{part}"), made.GetPrimAtPath(f"/ash/{part}")
        assert before.GetTypeName() == after.GetTypeName()
        for attribute in before.GetAuthoredAttributes():
            assert after.GetAttribute(attribute.GetName()).Get() == attribute.Get()
    bound, _ = UsdShade.MaterialBindingAPI(made.GetPrimAtPath("/ash/geo/render/Branches")).ComputeBoundMaterial()
    assert bound.GetPath() == Sdf.Path("/ash/mtl/Bark")
    source, _, _ = bound.ComputeSurfaceSource()
    assert source.GetPath() == Sdf.Path("/ash/mtl/Bark/PreviewSurface")
    file = UsdShade.Shader(made.GetPrimAtPath("/ash/mtl/Bark/Texture")).GetInput("file").Get()
    assert file.resolvedPath.startswith(str(tmp_path / "new" / "maps"))
    positions = UsdGeom.PointInstancer(made.GetPrimAtPath("/ash/geo/render/Leaves")).GetPositionsAttr().Get()
    assert np.array(positions) == pytest.approx(leaves.base_m)


def test_variants_selections_and_times_are_kept(plant, tmp_path):
    interface = rewrite(plant, tmp_path / "new", "fork", two_leaves())
    layer = Sdf.Layer.FindOrOpen(str(interface))
    assert (layer.startTimeCode, layer.endTimeCode) == (1, 48)
    stage = Usd.Stage.Open(layer)
    sets = stage.GetDefaultPrim().GetVariantSets()
    assert sorted(sets.GetNames()) == ["branches", "lod", "representation"]
    assert sets.GetVariantSelection("branches") == "order1"
    assert sets.GetVariantSelection("representation") == "bezier"
    assert sorted(sets.GetVariantSet("branches").GetVariantNames()) == ["all", "order1"]
    assert sorted(sets.GetVariantSet("representation").GetVariantNames()) == ["bezier", "mesh"]


def test_the_new_asset_is_sound_without_the_old_one(plant, tmp_path):
    interface = rewrite(plant, tmp_path / "new", "ash", random_leaves(5))
    plant.parent.rename(tmp_path / "gone")
    report = validate_asset(interface)
    assert [str(finding) for finding in report.findings if finding.severity == "error"] == []


def test_branches_of_a_scene_are_not_guessed_at(plant, tmp_path):
    scene = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    scene.DefinePrim("/hedge").GetReferences().AddReference(str(plant))
    with pytest.raises(AssetError, match="has branches besides its leaves"):
        find_other_parts(scene.GetPrimAtPath("/hedge"), tmp_path / "scene.usda")


def test_hints_hold_every_surface_and_leaves_that_there_are_none_of(tmp_path):
    """A fork beside the origin: its surfaces of several orders reach differently far; no leaves are at the origin."""
    parts = fork_branches(tmp_path / "fork", at_m=(5.0, 0.0, 3.0))
    assert len(parts.extents_m) == len(next(each for each in parts.sets if each.name == "branches").variants) >= 2
    folder = tmp_path / "oak"
    folder.mkdir()
    nothing = some_leaves(2, "bezier", "mesh")
    nothing = replace(nothing, leaves=nothing.leaves.take(np.zeros(0, np.int64)))
    asset = write_plant_asset(
        folder,
        "oak",
        provenance=RUN,
        asset_from_capture=np.eye(4),
        branches=parts,
        foliage=nothing,
        crown=round_crown(),
    )
    findings = validate_asset(asset, read_profile(default_profile())).findings
    assert [finding for finding in findings if not finding.accepted] == []
    assert not (folder / "payload" / "leaves.usdc").exists()
    assert len(read_other_parts(asset).extents_m) == len(parts.extents_m)
    (tmp_path / "again").mkdir()
    beside = write_leaves_beside(tmp_path / "again", "oak", nothing.leaves, parts, RUN)
    findings = validate_asset(beside, read_profile(default_profile())).findings
    assert [finding for finding in findings if "ExtentsHint" in finding.error or finding.severity == "error"] == []
