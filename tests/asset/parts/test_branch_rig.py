"""A rig of branches in USD, moved by USD's own skinning."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt
from scipy.spatial.transform import Rotation
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.branch.motion.rig import RigSettings, build_rig
from usdfoliage.branch.motion.skinning import pose_joints, skin_points
from usdfoliage.branch.motion.surface_places import cage_places
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.jobs.branches.motion import BranchMotion, rig_branches

from tests.support.branch_motions import surfaces_of, write_moving
from tests.support.branch_shapes import fork
from tests.support.usd_values import composed

MESH, JOINTS, ANIMATION = (f"/fork/geo/render/{name}" for name in ("Branches", "Rig/Joints", "Rig/Animation"))
SWAY = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=6, swing_rad=0.3))


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    return write_moving(tmp_path_factory.mktemp("still"), "fork", fork(), BranchMotion(rig=RigSettings()))


@pytest.fixture(scope="module")
def swaying(tmp_path_factory):
    return write_moving(tmp_path_factory.mktemp("swaying"), "fork", fork(), SWAY)


def open_rigged(asset, branches="all"):
    stage = Usd.Stage.Open(str(asset))
    stage.SetEditTarget(stage.GetSessionLayer())
    stage.GetDefaultPrim().GetVariantSet("rig").SetVariantSelection("skel")
    stage.GetDefaultPrim().GetVariantSet("branches").SetVariantSelection(branches)
    return stage


def skin(stage, time=Usd.TimeCode.Default()):
    """Where USD's own skinning takes the points of the surface."""
    cache = UsdSkel.Cache()
    root = UsdSkel.Root(stage.GetPrimAtPath("/fork/geo/render"))
    assert cache.Populate(root, Usd.PrimDefaultPredicate)
    (binding,) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    (target,) = binding.GetSkinningTargets()
    transforms = cache.GetSkelQuery(binding.GetSkeleton()).ComputeSkinningTransforms(time)
    points = Vt.Vec3fArray(UsdGeom.Mesh(stage.GetPrimAtPath(MESH)).GetPointsAttr().Get())
    assert target.ComputeSkinnedPoints(transforms, points, time)
    return np.array(points)


def test_without_a_choice_the_asset_is_what_it_is_without_a_rig(tmp_path, still):
    plain = write_moving(tmp_path / "plain", "fork", fork(), BranchMotion())
    assert composed(Usd.Stage.Open(str(still))) == composed(Usd.Stage.Open(str(plain)))
    assert not Usd.Stage.Open(str(still)).HasAuthoredTimeCodeRange()
    assert not (plain.parent / "payload" / "rig.usdc").exists()


def test_the_rig_makes_the_render_scope_a_root_of_joints_and_surface(still):
    stage = open_rigged(still)
    assert not stage.GetCompositionErrors()
    assert UsdSkel.Root.Find(stage.GetPrimAtPath(MESH)).GetPath() == Sdf.Path("/fork/geo/render")
    joints = UsdSkel.Skeleton(stage.GetPrimAtPath(JOINTS))
    assert list(joints.GetJointsAttr().Get()) == ["branch_0", "branch_0/branch_1", "branch_0/branch_1/branch_2"]
    assert UsdSkel.Topology(joints.GetJointsAttr().Get()).Validate()[0]
    assert UsdGeom.Imageable(joints).ComputePurpose() == UsdGeom.Tokens.default_  # Blender leaves guides out
    assert joints.GetBindTransformsAttr().Get()[1].ExtractTranslation() == Gf.Vec3d(0, 1, 0)
    assert stage.GetPrimAtPath("/fork").GetTypeName() == "Xform"


def test_validation_finds_no_error_in_any_variant(still, swaying):
    for asset in (still, swaying):
        report = validate_asset(asset)
        assert len(report.selections) == 4
        assert [finding for finding in report.findings if finding.severity == "error"] == []


@pytest.mark.parametrize("branches", ["all", "order1"])
def test_at_rest_every_surface_stays(still, branches):
    stage = open_rigged(still, branches)
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(MESH)).GetPointsAttr().Get())
    weights = UsdSkel.BindingAPI(stage.GetPrimAtPath(MESH)).GetJointWeightsPrimvar()
    assert len(weights.Get()) == len(points) * weights.GetElementSize()
    assert skin(stage) == pytest.approx(points, abs=1e-6)


def test_a_joint_turns_its_branch_and_what_that_carries(still):
    stage = open_rigged(still)
    plant = fork()
    rig = build_rig(plant)
    angle_rad = 0.7
    turn = rig.rest[1, :3, :3] @ Rotation.from_rotvec(rig.axes[1].T @ [0, 0, angle_rad]).as_matrix()
    animation = UsdSkel.Animation(stage.GetPrimAtPath(ANIMATION))
    rotations = animation.GetRotationsAttr().Get()
    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    rotations[1] = Gf.Quatf(w, x, y, z)
    animation.GetRotationsAttr().Set(rotations)
    there = skin(stage)
    cage = surfaces_of(plant).whole
    places = cage_places(cage, plant)
    turned = Rotation.from_rotvec([0, 0, angle_rad]).as_matrix()
    expected = [0, 1, 0] + (cage.points_m - [0, 1, 0]) @ turned.T
    free = (places.curve == 2) | ((places.curve == 1) & (places.arc_m > rig.leaves_m[1] + rig.blend_m[1]))
    assert free.sum() > 20
    assert there[free] == pytest.approx(expected[free], abs=1e-6)
    assert there[places.curve == 0] == pytest.approx(cage.points_m[places.curve == 0], abs=1e-6)


def test_sway_is_a_loop_of_frames_within_the_authored_bounds(swaying):
    stage = open_rigged(swaying)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (1, 6, 24)
    plant = fork()
    surfaces = surfaces_of(plant)
    rigged = rig_branches(plant, surfaces, SWAY, seed=0)
    extent = np.array(UsdSkel.Root(stage.GetPrimAtPath("/fork/geo/render")).GetExtentAttr().Get())
    hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint())[:2]
    moved = 0.0
    for frame in range(1, 7):
        there = skin(stage, frame)
        expected = skin_points(
            rigged.rig,
            rigged.skins["all"],
            surfaces.whole.points_m,
            pose_joints(rigged.rig, rigged.sway_rad[frame - 1]),
        )
        assert there == pytest.approx(expected, abs=1e-5)
        for box in (extent, hint):
            assert (there >= box[0] - 1e-5).all()
            assert (there <= box[1] + 1e-5).all()
        moved = max(moved, np.abs(there - surfaces.whole.points_m).max())
    assert moved > 0.1
    assert skin(stage) == pytest.approx(surfaces.whole.points_m, abs=1e-6)  # at rest outside time


def test_a_baked_rig_is_the_skinned_surface(swaying):
    stage = open_rigged(swaying)
    expected = skin(stage, 3)
    assert UsdSkel.BakeSkinning(stage.Traverse())
    baked = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(MESH)).GetPointsAttr().Get(3))
    assert baked == pytest.approx(expected, abs=1e-5)
