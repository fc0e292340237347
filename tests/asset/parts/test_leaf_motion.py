"""Leaves that follow their branches: time samples, and joints, over every representation."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdSkel, Vt
from scipy.spatial.transform import Rotation
from usdfoliage.asset.packages.other_parts import find_other_parts, write_leaves_beside
from usdfoliage.asset.parts.copied_parts import lost_leaf_motion
from usdfoliage.asset.parts.leaf_part import LeafAssetSettings
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.asset.variants import REPRESENTATIONS
from usdfoliage.branch.motion.leaf_motion import UNBORN
from usdfoliage.branch.motion.rig import RigSettings, skin_places
from usdfoliage.branch.motion.skinning import pose_joints, skin_points
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.jobs.branches.motion import BranchMotion, rig_branches
from usdfoliage.leaf.shape.edits import LeafEdits, apply_edits
from usdfoliage.leaf.shape.mesh import LeafMeshSettings

from tests.support.branch_motions import leaves_on, surfaces_of, write_moving
from tests.support.branch_shapes import fork

RUN = Provenance(capture="plant.ply", generator="test", seed=0, input_sha256="")
FRAMES = 5
MOTION = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=4, swing_rad=0.3), growth_frames=FRAMES)
LEAVES = "/fork/geo/render/Leaves"
PLACE = ("positions", "scales", "orientations", "orientationsf")


@pytest.fixture(scope="module")
def grown():
    return leaves_on(fork(), *REPRESENTATIONS)


@pytest.fixture(scope="module")
def asset(tmp_path_factory, grown):
    return write_moving(tmp_path_factory.mktemp("moving"), "fork", fork(), MOTION, grown)


def choose(asset, **selections):
    stage = Usd.Stage.Open(str(asset))
    stage.SetEditTarget(stage.GetSessionLayer())
    for name, chosen in selections.items():
        stage.GetDefaultPrim().GetVariantSet(name).SetVariantSelection(chosen)
    return stage


def instancer(stage):
    leaves = UsdGeom.PointInstancer(stage.GetPrimAtPath(LEAVES))
    assert leaves
    return leaves


def array(prim, name, time=Usd.TimeCode.Default()):
    return np.array(prim.GetPrim().GetAttribute(name).Get(time))


def drawn_points(stage, time):
    """All points of the prototype at every leaf."""
    leaves = instancer(stage)
    matrices = np.array(leaves.ComputeInstanceTransformsAtTime(time, time))
    points = array(UsdGeom.Mesh(stage.GetPrimAtPath(f"{LEAVES}/Prototypes/Leaf")), "points").astype(float)
    return np.einsum("pc,ncr->npr", points, matrices[:, :3, :3]) + matrices[:, None, 3, :3]


def test_nothing_has_time_samples_until_it_is_chosen(asset):
    for representation in REPRESENTATIONS:
        stage = choose(asset, representation=representation)
        for each in Usd.PrimRange(stage.GetPrimAtPath(LEAVES)):
            assert [name.GetName() for name in each.GetAttributes() if name.GetNumTimeSamples()] == []


def test_leaves_grow_to_what_they_are(asset, grown):
    stage, still = choose(asset, growth="growing"), choose(asset)
    prim, rest = instancer(stage), instancer(still)
    length_m = grown.foliage.leaves.length_m
    for name in ("positions", "scales", "extent"):
        assert prim.GetPrim().GetAttribute(name).GetTimeSamples() == [1, 2, 3, 4, 5]
        assert np.array_equal(array(prim, name, FRAMES), array(rest, name))
        assert np.array_equal(array(prim, name), array(rest, name))
    for name in ("orientations", "orientationsf"):  # leaves do not turn
        assert prim.GetPrim().GetAttribute(name).GetNumTimeSamples() == 0
    shares = np.array([array(prim, "scales", frame)[:, 0] / length_m for frame in range(1, FRAMES + 1)])
    assert shares[0] == pytest.approx(UNBORN)  # the trunk has only begun
    assert (shares > 0).all()
    assert (np.diff(shares, axis=0) >= -1e-6).all()
    assert shares[-1] == pytest.approx(1)
    assert array(prim, "positions", 1)[:, 1].max() < 0.5


def test_every_frame_of_growth_is_in_its_extent(asset):
    stage = choose(asset, growth="growing")
    hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint())[:2]
    for frame in range(1, FRAMES + 1):
        points, extent = drawn_points(stage, frame), array(instancer(stage), "extent", frame)
        places = array(instancer(stage), "positions", frame)
        for box in (extent, hint):
            assert (places >= box[0] - 1e-5).all()
            assert (places <= box[1] + 1e-5).all()
        assert np.ptp(extent, axis=0) == pytest.approx(np.ptp(points.reshape(-1, 3), axis=0), rel=0.3)


def test_leaves_sway_with_their_twigs(asset, grown):
    stage = choose(asset, rig="skel")
    rigged = rig_branches(fork(), surfaces_of(fork()), MOTION, seed=0)
    skin = skin_places(rigged.rig, grown.places.branch, grown.places.arc_m)
    leaves = grown.foliage.leaves
    hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint())[:2]
    root = array(UsdSkel.Root(stage.GetPrimAtPath("/fork/geo/render")), "extent")
    prim, still = instancer(stage), choose(asset)
    for name in PLACE:
        assert prim.GetPrim().GetAttribute(name).GetTimeSamples() == ([] if name == "scales" else [1, 2, 3, 4])
        assert np.array_equal(array(prim, name), array(instancer(still), name))  # at rest outside time
    # What ends a twig alone turns as its joint does, base and apex.
    alone = np.flatnonzero(np.isclose(skin.weights[:, 0], 1))
    apex_m = leaves.base_m + leaves.length_m[:, None] * Rotation.from_quat(leaves.orientation).apply([0, 1, 0])
    moved = 0.0
    for frame in range(1, 5):
        posed = pose_joints(rigged.rig, rigged.sway_rad[frame - 1])
        there_m = array(prim, "positions", frame)
        assert there_m == pytest.approx(skin_points(rigged.rig, skin, leaves.base_m, posed), abs=1e-5)
        turns = array(prim, "orientationsf", frame)
        assert np.abs(turns - array(prim, "orientations", frame)).max() < 2e-3
        there_apex_m = there_m + leaves.length_m[:, None] * Rotation.from_quat(turns).apply([0, 1, 0])
        expected = skin_points(rigged.rig, skin, apex_m, posed)
        assert there_apex_m[alone] == pytest.approx(expected[alone], abs=1e-5)
        extent = array(prim, "extent", frame)
        for box in (extent, hint, root):
            for point_m in (there_m, there_apex_m):
                assert (point_m >= box[0] - 1e-5).all()
                assert (point_m <= box[1] + 1e-5).all()
        moved = max(moved, np.abs(there_m - leaves.base_m).max())
    assert len(alone) > 3
    assert moved > 0.1


@pytest.mark.parametrize("representation", ["mesh", "subdiv"])
def test_meshes_of_leaves_are_skinned(asset, grown, representation):
    stage = choose(asset, rig="skel", representation=representation)
    root = UsdSkel.Root(stage.GetPrimAtPath("/fork/geo/render"))
    cache = UsdSkel.Cache()
    assert cache.Populate(root, Usd.PrimDefaultPredicate)
    (binding,) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    targets = {str(target.GetPrim().GetPath()): target for target in binding.GetSkinningTargets()}
    assert set(targets) == {LEAVES, "/fork/geo/render/Branches"}
    transforms = cache.GetSkelQuery(binding.GetSkeleton()).ComputeSkinningTransforms(2)
    still = array(stage.GetPrimAtPath(LEAVES), "points")
    points = Vt.Vec3fArray.FromNumpy(still)
    assert targets[LEAVES].ComputeSkinnedPoints(transforms, points, 2)
    there = np.array(points)
    bezier = choose(asset, rig="skel")
    leaves = instancer(bezier)
    box = array(root, "extent")
    assert (there >= box[0] - 1e-5).all()
    assert (there <= box[1] + 1e-5).all()
    # The bases are as far from their leaves' points as at rest: none was torn off.
    each, at_rest = (points.reshape(len(grown.places), -1, 3).mean(axis=1) for points in (there, still))
    away = np.linalg.norm(each - array(leaves, "positions", 2), axis=1)
    assert away == pytest.approx(np.linalg.norm(at_rest - array(leaves, "positions"), axis=1), abs=2e-3)


@pytest.mark.parametrize("chosen", [{"rig": "skel"}, {"growth": "growing"}])
def test_patches_are_where_the_instancer_has_its_leaves(asset, chosen):
    stage, bezier = choose(asset, representation="nurbs", **chosen), choose(asset, **chosen)
    leaves = instancer(bezier)
    patches = stage.GetPrimAtPath(LEAVES).GetChildren()
    for frame in (1, 3, 4):
        expected = np.array(leaves.ComputeInstanceTransformsAtTime(frame, frame))
        found = np.array([UsdGeom.Xformable(patch).GetLocalTransformation(frame) for patch in patches])
        assert found == pytest.approx(expected, abs=1e-6)
    assert UsdGeom.Xformable(patches[0]).GetLocalTransformation() != UsdGeom.Xformable(
        patches[0]
    ).GetLocalTransformation(1)


@pytest.mark.parametrize("representation", ["mesh", "subdiv"])
def test_meshes_of_leaves_are_there_at_last(asset, representation):
    stage = choose(asset, growth="growing", representation=representation)
    prim = UsdGeom.Imageable(stage.GetPrimAtPath(LEAVES))
    seen = [prim.ComputeVisibility(frame) for frame in (1, FRAMES - 0.5, FRAMES, FRAMES + 3)]
    assert seen == ["invisible", "invisible", "inherited", "inherited"]
    assert prim.ComputeVisibility() == "inherited"


def test_a_rig_without_a_sway_binds_meshes_alone(tmp_path):
    asset = write_moving(tmp_path / "still", "fork", fork(), BranchMotion(rig=RigSettings()), leaves_on(fork(), "mesh"))
    stage = choose(asset, rig="skel")
    assert UsdSkel.BindingAPI(stage.GetPrimAtPath(LEAVES)).GetSkeletonRel().GetTargets() == [
        Sdf.Path("/fork/geo/render/Rig/Joints")
    ]
    bezier = write_moving(tmp_path / "bezier", "fork", fork(), BranchMotion(rig=RigSettings()), leaves_on(fork()))
    stage = choose(bezier, rig="skel")
    assert instancer(stage).GetPositionsAttr().GetNumTimeSamples() == 0


def test_both_may_be_chosen_together(asset):
    stage = choose(asset, rig="skel", growth="growing")
    prim = instancer(stage)
    assert prim.GetScalesAttr().GetNumTimeSamples() == FRAMES
    assert prim.GetOrientationsfAttr().GetNumTimeSamples() == 4


def test_validation_finds_no_error_in_any_variant(tmp_path):
    asset = write_moving(tmp_path / "fork", "fork", fork(), MOTION, leaves_on(fork()))
    report = validate_asset(asset)
    assert len(report.selections) == 8
    assert [finding for finding in report.findings if finding.severity == "error"] == []


def test_the_same_leaves_make_the_same_bytes(tmp_path, asset):
    again = write_moving(tmp_path / "fork", "fork", fork(), MOTION, leaves_on(fork(), *REPRESENTATIONS))
    for layer in ("rig_leaves.usdc", "growth_leaves.usdc", "leaves.usdc"):
        assert (again.parent / "payload" / layer).read_bytes() == (asset.parent / "payload" / layer).read_bytes()


def bake(asset, folder, name, leaves, **settings):
    folder.mkdir()
    stage = Usd.Stage.Open(str(asset))
    others = find_other_parts(stage.GetDefaultPrim(), asset)
    made = write_leaves_beside(folder, name, leaves, others, RUN, LeafAssetSettings(**settings))
    return made, lost_leaf_motion(others, folder)


def test_motion_stays_with_leaves_whose_shape_alone_changes(tmp_path, asset, grown):
    leaves = grown.foliage.leaves
    wider = replace(leaves, parameters=apply_edits(leaves.parameters, LeafEdits(width=1.5)))
    made, lost = bake(asset, tmp_path / "new", "ash", wider)
    assert not lost
    for chosen in ({"rig": "skel"}, {"growth": "growing"}, {}):
        new, old = choose(made, **chosen), choose(asset, **chosen)
        prim = new.GetPrimAtPath("/ash/geo/render/Leaves")
        for name in PLACE:
            for time in (1, 3, Usd.TimeCode.Default()):
                assert np.array_equal(array(prim, name, time), array(instancer(old), name, time))
    mesh = choose(made, rig="skel", representation="mesh")
    binding = UsdSkel.BindingAPI(mesh.GetPrimAtPath("/ash/geo/render/Leaves"))
    assert binding.GetSkeletonRel().GetTargets() == [Sdf.Path("/ash/geo/render/Rig/Joints")]
    for chosen in ({"rig": "skel"}, {"growth": "growing"}):
        new, old = choose(made, **chosen), choose(asset, **chosen)
        prim = new.GetPrimAtPath("/ash/geo/render/Leaves")
        for frame in (2, 4):
            wide, narrow = array(prim, "extent", frame), array(instancer(old), "extent", frame)
            assert np.ptp(wide, axis=0)[0] > np.ptp(narrow, axis=0)[0]
            assert wide == pytest.approx(narrow, abs=0.1)  # about a leaf's length


def test_other_leaves_stand_still(tmp_path, asset, grown):
    made, lost = bake(asset, tmp_path / "fewer", "ash", grown.foliage.leaves.take(np.arange(5)))
    assert lost
    for chosen in ({"rig": "skel"}, {"growth": "growing"}):
        stage = choose(made, **chosen)
        assert not stage.GetCompositionErrors()
        prim = UsdGeom.PointInstancer(stage.GetPrimAtPath("/ash/geo/render/Leaves"))
        assert len(prim.GetPositionsAttr().Get(2)) == 5
        assert prim.GetPositionsAttr().GetNumTimeSamples() == 0
    finer = LeafMeshSettings(across=8, along=20)
    assert bake(asset, tmp_path / "finer", "ash", grown.foliage.leaves, mesh=finer)[1]
    made, lost = bake(asset, tmp_path / "bezier", "ash", grown.foliage.leaves, representations=("bezier",), mesh=finer)
    assert not lost
    assert choose(made).GetDefaultPrim().GetVariantSet("representation").GetVariantNames() == ["bezier"]


def test_leaves_are_read_as_they_are_at_rest(asset, grown):
    stage = choose(asset, growth="growing")
    read = read_leaves(stage.GetPrimAtPath(LEAVES)).leaves
    assert read.base_m == pytest.approx(grown.foliage.leaves.base_m)
    assert read.length_m == pytest.approx(grown.foliage.leaves.length_m)
