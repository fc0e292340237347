"""A sway as value clips: the samples of a sway with time samples, again and again."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.export.source import check_exportable
from usdfoliage.asset.locate import check_layers
from usdfoliage.asset.packages.other_parts import find_other_parts, write_leaves_beside
from usdfoliage.asset.parts.copied_parts import lost_leaf_motion
from usdfoliage.asset.parts.leaf_part import LeafAssetSettings
from usdfoliage.asset.parts.sway_clips import LOOPS, loop_times
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.errors import AssetError
from usdfoliage.jobs.branches.motion import BranchMotion
from usdfoliage.leaf.shape.edits import LeafEdits, apply_edits

from tests.support.branch_motions import leaves_on, write_moving
from tests.support.branch_shapes import fork

FRAMES = 4
SWAY = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=FRAMES, swing_rad=0.3))
CLIPS = replace(SWAY, sway_clips=True)
FORMS = ("bezier", "nurbs", "mesh")
MOVING = {
    "bezier": [("render/Leaves", name) for name in ("positions", "orientations", "orientationsf", "extent")],
    "nurbs": [("render/Leaves/leaf_03", "xformOp:transform")],
    "mesh": [],
}


@pytest.fixture(scope="module")
def grown():
    return leaves_on(fork(), *FORMS)


@pytest.fixture(scope="module")
def assets(tmp_path_factory, grown):
    """With time samples, and with clips."""
    folder = tmp_path_factory.mktemp("sways")
    return [write_moving(folder / name, "fork", fork(), SWAY if name == "samples" else CLIPS, grown)
            for name in ("samples", "clips")]  # fmt: skip


def open_swaying(asset, representation="bezier", prim="/fork"):
    stage = Usd.Stage.Open(str(asset))
    stage.SetEditTarget(stage.GetSessionLayer())
    sets = stage.GetPrimAtPath(prim).GetVariantSets()
    sets.SetSelection("rig", "skel")
    sets.SetSelection("representation", representation)
    return stage


def values(stage, representation, time, prim="/fork"):
    """All that moves, as rows of numbers."""
    found = []
    for path, name in [("render/Rig/Animation", "rotations"), *MOVING[representation]]:
        attribute = stage.GetPrimAtPath(f"{prim}/geo/{path}").GetAttribute(name)
        value = attribute.Get(time)
        assert value is not None
        rows = np.array([[*each.imaginary, each.real] for each in value]) if "rot" in name else np.array(value)
        found.append(rows.astype(float))
    return found


@pytest.mark.parametrize("representation", FORMS)
def test_clips_hold_what_time_samples_hold_in_every_loop(assets, representation):
    samples, clips = (open_swaying(asset, representation) for asset in assets)
    for loop in (0, 1, LOOPS - 1):
        for frame in range(1, FRAMES + 1):
            expected = values(samples, representation, frame)
            found = values(clips, representation, frame + loop * FRAMES)
            for was, now in zip(expected, found, strict=True):
                assert np.array_equal(was, now)
    at_rest = (values(stage, representation, Usd.TimeCode.Default()) for stage in (samples, clips))
    for was, now in zip(*at_rest, strict=True):
        assert np.array_equal(was, now)


def test_the_last_frame_goes_over_into_the_first(assets):
    clips = open_swaying(assets[1])
    (_, last, *_), (_, first, *_) = values(clips, "bezier", FRAMES), values(clips, "bezier", 1)
    (_, between, *_), (_, next_first, *_) = values(clips, "bezier", FRAMES + 0.5), values(clips, "bezier", FRAMES + 1)
    assert between == pytest.approx((last + first) / 2, abs=1e-6)
    assert np.array_equal(next_first, first)
    assert np.abs(last - first).max() > 0.01


def test_a_loop_is_one_frame_longer_than_its_samples():
    assert np.array(loop_times(3, loops=2)).tolist() == [[1, 1], [4, 4], [4, 1], [7, 4]]


def test_a_shot_shifts_the_sway_of_one_placement(tmp_path, assets):
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    for name, shift in (("early", 0), ("late", 2)):
        plant = shot.DefinePrim(f"/{name}")
        plant.GetReferences().AddReference(str(assets[1]))
        plant.GetVariantSets().SetSelection("rig", "skel")
        if shift:
            for which in ("sway", "leafSway"):
                moved = Usd.ClipsAPI(shot.OverridePrim(f"/{name}/geo"))
                moved.SetClipTimes([(1, 1 + shift), (3, 5), (3, 1), (7, 5)], which)
    for time in (1, 2, 3, 4):
        late = values(shot, "bezier", time, "/late")
        early = values(shot, "bezier", time + 2, "/early")
        for was, now in zip(early, late, strict=True):
            assert np.array_equal(was, now)


def test_native_instances_sway(tmp_path, assets):
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    for name in ("one", "two"):
        plant = shot.DefinePrim(f"/{name}")
        plant.GetReferences().AddReference(str(assets[1]))
        plant.GetVariantSets().SetSelection("rig", "skel")
        plant.SetInstanceable(True)
    assert len(shot.GetPrototypes()) == 1
    samples = open_swaying(assets[0])
    for time in (2, 3 + FRAMES):
        expected = values(samples, "bezier", (time - 1) % FRAMES + 1)
        for was, now in zip(expected, values(shot, "bezier", time, "/two"), strict=True):
            assert np.array_equal(was, now)


def test_branches_without_leaves_sway(tmp_path):
    asset = write_moving(tmp_path / "bare", "fork", fork(), CLIPS)
    assert [each for each in validate_asset(asset).findings if each.severity == "error"] == []
    stage = Usd.Stage.Open(str(asset))
    stage.GetDefaultPrim().GetVariantSets().SetSelection("rig", "skel")
    rotations = stage.GetPrimAtPath("/fork/geo/render/Rig/Animation").GetAttribute("rotations")
    assert rotations.GetNumTimeSamples() > 0


def rewrite(asset, folder, leaves, *representations):
    """The asset's other parts with these leaves, in a new asset called ash."""
    stage = Usd.Stage.Open(str(asset))
    others = find_other_parts(stage.GetDefaultPrim(), asset)
    assert others is not None
    run = Provenance(capture="plant.ply", generator="test", seed=0, input_sha256="")
    folder.mkdir()
    return write_leaves_beside(folder, "ash", leaves, others, run, LeafAssetSettings(representations=representations))


def test_fewer_representations_keep_no_variant_of_the_others(tmp_path, assets, grown):
    swaying = Usd.Stage.Open(str(rewrite(assets[1], tmp_path / "ash", grown.foliage.leaves, "bezier", "mesh")))
    swaying.GetDefaultPrim().GetVariantSets().SetSelection("rig", "skel")
    names = swaying.GetDefaultPrim().GetVariantSet("representation").GetVariantNames()
    assert sorted(names) == ["bezier", "mesh"]


def copy_asset(asset: Path, folder: Path) -> Path:
    shutil.copytree(asset.parent, folder)
    return folder / asset.name


@pytest.mark.parametrize("elsewhere", ["../../../secret.usda", "/etc/passwd"])
def test_a_copy_names_its_own_clips_whatever_the_original_names(tmp_path, assets, grown, elsewhere):
    asset = copy_asset(assets[1], tmp_path / "given")
    layer = Sdf.Layer.FindOrOpen(str(asset.parent / "payload" / "rig_clips.usda"))
    geometry = layer.GetPrimAtPath("/fork/geo")
    entry = dict(dict(geometry.GetInfo("clips"))["sway"])
    entry["manifestAssetPath"] = Sdf.AssetPath(elsewhere)
    entry["assetPaths"] = Sdf.AssetPathArray([Sdf.AssetPath(elsewhere)])
    geometry.SetInfo("clips", {"sway": entry})
    layer.Save()
    made = rewrite(asset, tmp_path / "ash", grown.foliage.leaves, *FORMS)
    text = (made.parent / "payload" / "rig_clips.usda").read_text()
    assert elsewhere not in text
    assert "./clips/rig_clips.usdc" in text
    assert [each for each in validate_asset(made).findings if each.severity == "error"] == []


def test_clips_that_cannot_be_read_are_a_finding(tmp_path, assets):
    asset = copy_asset(assets[1], tmp_path / "given")
    file = asset.parent / "payload" / "clips" / "rig_clips_manifest.usda"
    file.write_text("no USD")
    (finding,) = validate_asset(asset).findings
    assert (finding.severity, finding.path) == ("error", "payload/clips/rig_clips_manifest.usda")
    file.unlink()
    os.mkfifo(file)
    (finding,) = validate_asset(asset).findings
    assert "regular file" in finding.message
    for read in (
        lambda: check_layers(Sdf.Layer.FindOrOpen(str(asset)), asset),
        lambda: check_exportable(asset, "0.1.0"),
    ):
        with pytest.raises(AssetError, match="regular file"):
            read()


def test_no_sample_is_anywhere_else(assets):
    payload = assets[1].parent / "payload"
    for path in payload.glob("*.usd*"):
        assert Sdf.Layer.OpenAsAnonymous(str(path)).ListAllTimeSamples() == [], path.name
    still = Usd.Stage.Open(str(assets[1]))
    for prim in still.Traverse():
        assert [name.GetName() for name in prim.GetAttributes() if name.GetNumTimeSamples()] == []


def test_validation_finds_no_error_in_any_variant(assets):
    findings = validate_asset(assets[1]).findings
    assert [finding for finding in findings if finding.severity == "error"] == []


def test_clips_go_with_leaves_whose_shape_alone_changes(tmp_path, assets, grown):
    leaves = grown.foliage.leaves
    wider = replace(leaves, parameters=apply_edits(leaves.parameters, LeafEdits(width=1.5)))
    stage = Usd.Stage.Open(str(assets[1]))
    others = find_other_parts(stage.GetDefaultPrim(), assets[1])
    assert others is not None
    run = Provenance(capture="plant.ply", generator="test", seed=0, input_sha256="")
    made = {}
    for name, kept in (("ash", wider), ("bare", leaves.take(np.arange(5)))):
        (tmp_path / name).mkdir()
        made[name] = write_leaves_beside(
            tmp_path / name, name, kept, others, run, LeafAssetSettings(representations=FORMS)
        )
    assert [lost_leaf_motion(others, tmp_path / name) for name in ("ash", "bare")] == [False, True]
    old = open_swaying(assets[1])
    for name, moved in (("ash", True), ("bare", False)):
        new = open_swaying(made[name], prim=f"/{name}")
        assert not new.GetCompositionErrors()
        prim = UsdGeom.PointInstancer(new.GetPrimAtPath(f"/{name}/geo/render/Leaves"))
        assert (prim.GetPositionsAttr().GetNumTimeSamples() > 0) == moved
        rotations = new.GetPrimAtPath(f"/{name}/geo/render/Rig/Animation").GetAttribute("rotations")
        assert rotations.Get(2) == old.GetPrimAtPath("/fork/geo/render/Rig/Animation").GetAttribute("rotations").Get(2)
    ash, fork_ = (
        np.array(stage.GetPrimAtPath(path).GetAttribute("extent").Get(6))
        for stage, path in (
            (open_swaying(made["ash"], prim="/ash"), "/ash/geo/render/Leaves"),
            (old, "/fork/geo/render/Leaves"),
        )
    )
    assert np.ptp(ash, axis=0)[0] > np.ptp(fork_, axis=0)[0]


def test_the_same_leaves_make_the_same_bytes(tmp_path, assets, grown):
    again = write_moving(tmp_path / "again", "fork", fork(), CLIPS, grown)
    for path in assets[1].parent.rglob("*clips*.usd*"):
        assert (again.parent / path.relative_to(assets[1].parent)).read_bytes() == path.read_bytes()
