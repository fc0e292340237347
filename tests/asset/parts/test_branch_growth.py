"""The growth of branches as time samples."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.jobs.branches.motion import BranchMotion

from tests.support.branch_motions import write_moving
from tests.support.branch_shapes import fork

FRAMES = 5
MESH, SKELETON = "/fork/geo/render/Branches", "/fork/geo/guide/Skeleton"


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    return write_moving(tmp_path_factory.mktemp("growing"), "fork", fork(), BranchMotion(growth_frames=FRAMES))


def open_growing(asset, **selections):
    stage = Usd.Stage.Open(str(asset))
    stage.SetEditTarget(stage.GetSessionLayer())
    for name, chosen in {"growth": "growing", **selections}.items():
        stage.GetDefaultPrim().GetVariantSet(name).SetVariantSelection(chosen)
    return stage


def test_the_plant_stands_still_until_growth_is_chosen(asset):
    stage = Usd.Stage.Open(str(asset))
    assert stage.GetDefaultPrim().GetVariantSet("growth").GetVariantSelection() == "still"
    assert UsdGeom.Mesh(stage.GetPrimAtPath(MESH)).GetPointsAttr().GetNumTimeSamples() == 0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (1, FRAMES, 24)


@pytest.mark.parametrize("branches", ["all", "order1"])
def test_the_last_frame_is_the_plant(asset, branches):
    still = open_growing(asset, growth="still", branches=branches)
    growing = open_growing(asset, branches=branches)
    for path, name in ((MESH, "points"), (MESH, "extent"), (SKELETON, "points"), (SKELETON, "widths")):
        attribute = growing.GetPrimAtPath(path).GetAttribute(name)
        assert attribute.GetTimeSamples() == [1, 2, 3, 4, 5]
        expected = np.array(still.GetPrimAtPath(path).GetAttribute(name).Get())
        assert np.array_equal(np.array(attribute.Get(FRAMES)), expected)
        assert np.array_equal(np.array(attribute.Get()), expected)  # and outside time


def test_every_frame_has_its_extents_and_is_within_the_next(asset):
    stage = open_growing(asset)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(MESH))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath(SKELETON))
    hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint())
    before = 0.0
    for frame in range(1, FRAMES + 1):
        points, widths = np.array(mesh.GetPointsAttr().Get(frame)), np.array(curves.GetWidthsAttr().Get(frame))
        assert np.isfinite(points).all()
        assert (widths > 0).all()
        for prim, box in ((mesh, hint[:2]), (curves, hint[6:])):
            extent = np.array(prim.GetExtentAttr().Get(frame))
            assert extent == pytest.approx(np.array(UsdGeom.Boundable.ComputeExtentFromPlugins(prim, frame)))
            assert (extent[0] >= box[0] - 1e-5).all()
            assert (extent[1] <= box[1] + 1e-5).all()
        volume = np.prod(np.ptp(points.astype(float), axis=0))
        assert volume > before
        before = volume


def test_validation_finds_no_error_in_any_variant(asset):
    report = validate_asset(asset)
    assert len(report.selections) == 4
    assert [finding for finding in report.findings if finding.severity == "error"] == []


def test_a_rig_and_growth_may_be_chosen_together(tmp_path):
    motion = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=3), growth_frames=FRAMES)
    asset = write_moving(tmp_path / "both", "fork", fork(), motion)
    stage = open_growing(asset, rig="skel")
    assert not stage.GetCompositionErrors()
    assert stage.GetEndTimeCode() == FRAMES  # of the longer one
    assert stage.GetPrimAtPath("/fork/geo/render").GetTypeName() == "SkelRoot"
    assert UsdGeom.Mesh(stage.GetPrimAtPath(MESH)).GetPointsAttr().GetNumTimeSamples() == FRAMES


def test_the_same_plant_makes_the_same_bytes(tmp_path):
    motion = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=3), growth_frames=3)
    one, two = (write_moving(tmp_path / name, "fork", fork(), motion).parent / "payload" for name in ("one", "two"))
    for layer in ("rig.usdc", "growth.usdc"):
        assert (one / layer).read_bytes() == (two / layer).read_bytes()
