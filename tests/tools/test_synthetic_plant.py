"""The synthetic plant: pictures, depth, cameras and truth agree with each other."""

import tomllib
from dataclasses import replace

import cv2
import numpy as np
import OpenEXR
import pytest
from scipy.spatial import cKDTree
from usdfoliage.branch.distances import distances_to_surface
from usdfoliage.branch.model import Skeleton
from usdfoliage.capture.folder.read import read_capture
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

from tests.support.plant_captures import known_plant, write_known_plant
from tools.synthetic.depth import BACKDROP, LEAF, SKY, WOOD
from tools.synthetic.plant import PlantSettings, build_plant
from tools.synthetic.truth import UP_AXES
from tools.synthetic_plant import PlantCaptureSettings, make_plant_capture, write_plant_capture

TINY = PlantSettings(views=2, width_px=60, height_px=80, leaves=20)


def files_of(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("size", [(180, 240), (240, 180), (90, 240)])
def test_every_camera_sees_the_whole_plant_and_as_large_as_it_can(size):
    plant = build_plant(replace(TINY, views=5, width_px=size[0], height_px=size[1]))
    margins = []
    for camera in plant.scene.cameras:
        places, depth_m = camera.project(plant.scene.points_m)
        assert (depth_m > 0).all()
        margins.append(np.minimum(places.min(axis=0), size - places.max(axis=0)) / size)
    assert np.min(margins) == pytest.approx(0.04, abs=0.001)


def test_cameras_stand_all_around_at_two_heights():
    position = np.array([camera.position_m for camera in build_plant(replace(TINY, views=12)).scene.cameras])
    turn = np.sort(np.arctan2(position[:, 0], position[:, 2]))
    assert np.diff(turn).max() == pytest.approx(2 * np.pi / 12)
    assert len(np.unique(np.round(position[:, 1], 6))) == 2


def test_depth_lies_on_wood_leaves_and_ground():
    capture = known_plant()
    scene, skeleton = capture.plant.scene, capture.plant.skeleton
    places = grid_places(np.linspace(-1, 1, 17), np.linspace(0, 1, 25))
    leaves_m = evaluate_points(scene.leaves.parameters, places, placements=scene.leaves.asset_from_leaf())
    petioles_m = scene.leaves.base_m - 0.07 * scene.leaves.asset_from_leaf()[:, :, 1]
    for view, seen in zip(capture.views[:3], capture.seen, strict=False):
        assert (view.depth_m[seen.label == SKY] == 0).all()
        at = {}
        for label in (WOOD, LEAF, BACKDROP):
            rows, columns = np.nonzero((seen.label == label) & (view.depth_m > 0))
            middles = np.column_stack([columns, rows]) + 0.5
            at[label] = view.camera.unproject(middles, view.depth_m[rows, columns]) @ UP_AXES["Z"]  # Y up
        assert len(at[WOOD]) > 300
        assert len(at[LEAF]) > 300
        assert np.abs(at[BACKDROP][:, 1]).max() < 1e-4
        assert cKDTree(leaves_m.reshape(-1, 3)).query(at[LEAF])[0].max() < 0.012
        of_branch = distances_to_surface(at[WOOD], skeleton, 0.004) < 0.003
        of_petiole = cKDTree(petioles_m).query(at[WOOD])[0] < 0.02
        assert (of_branch | of_petiole).all()
        assert of_branch.mean() > 0.8


def test_the_truth_is_in_the_frame_of_the_cameras(tmp_path):
    capture = write_known_plant(tmp_path / "plant", masks=True)
    folder = tmp_path / "plant"
    assert tomllib.loads((folder / "capture.toml").read_text())["up_axis"] == "Z"
    with np.load(folder / "truth" / "skeleton.npz") as truth:
        points, radius = truth["points"], truth["radius"]
        skeleton = Skeleton(
            points_m=points,
            radius_m=radius,
            counts=truth["counts"],
            parent_curve=truth["parent_curve"],
            parent_vertex=truth["parent_vertex"],
            order=truth["order"],
        )
    assert set(skeleton.order) == {0, 1, 2}
    assert points[:, 2].min() == 0  # the foot, Z up
    with np.load(folder / "truth" / "leaves.npz") as truth:
        base, branch, vertices = truth["base"], truth["branch"], truth["vertices"]
    assert distances_to_surface(base.astype(np.float64), skeleton, 0.004).max() < 0.03  # a petiole away from the bark
    assert (skeleton.order[branch] > 0).any()
    top = max(points[:, 2].max(), vertices[:, 2].max())
    assert top == pytest.approx(1.4, rel=0.1)
    for number in (0, 2, 4, 6):
        view, seen = capture.views[number], capture.seen[number]
        with OpenEXR.File(str(folder / "truth" / "depth" / f"{number:03d}.exr")) as file:
            np.testing.assert_array_equal(file.channels()["Z"].pixels, view.depth_m)
        places, depth_m = view.camera.project(vertices)
        column, row = np.floor(places).astype(int).T
        before = view.depth_m[row, column]
        visible = np.abs(depth_m - before) < 0.01
        assert 0.2 < visible.mean() < 1
        label = cv2.imread(str(folder / "truth" / f"{number:03d}_label.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(label, seen.label)
        mask = cv2.imread(str(folder / "masks" / f"{number:03d}.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(mask > 0, np.isin(label, (WOOD, LEAF)))


def test_leaves_are_green_and_bark_and_ground_have_detail():
    capture = known_plant()
    view, seen = capture.views[0], capture.seen[0]  # a low one, before sky
    mean = view.srgb[seen.label == LEAF].mean(axis=0)
    assert mean[1] > 1.1 * mean[0] > 1.1 * mean[2]
    grey = cv2.cvtColor(view.srgb, cv2.COLOR_RGB2GRAY).astype(float)
    for label in (WOOD, BACKDROP):
        assert grey[seen.label == label].std() > 8
    assert np.ptp(np.quantile(grey[seen.label == SKY], (0.1, 0.9))) < 8  # pixels at the edges of leaves are mixed


def test_leaves_are_as_many_as_asked_for_and_large_enough_to_be_seen():
    plant = build_plant(PlantSettings())
    assert 150 <= len(plant.scene.leaves) <= 240
    assert len(build_plant(TINY).scene.leaves) == 20
    apex = plant.scene.leaves.asset_from_leaf() @ np.array([0, 1, 0, 1])
    lengths = []
    for camera in plant.scene.cameras:
        start, end = (camera.project(ends)[0] for ends in (plant.scene.leaves.base_m, apex))
        lengths.append(np.linalg.norm(end - start, axis=1))
    assert (np.max(lengths, axis=0) >= 20).mean() > 0.95


def test_the_same_seed_makes_the_same_bytes_and_another_does_not(tmp_path):
    settings = PlantCaptureSettings(plant=TINY, masks=True)
    for name in ("first", "second"):
        write_plant_capture(tmp_path / name / "plant", make_plant_capture(settings))
    assert files_of(tmp_path / "first") == files_of(tmp_path / "second")
    other = build_plant(replace(TINY, seed=1))
    assert not np.array_equal(other.skeleton.radius_m, build_plant(TINY).skeleton.radius_m)
    with pytest.raises(FileExistsError, match="not empty"):
        write_plant_capture(tmp_path / "first", make_plant_capture(settings))


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_the_product_reads_photographs_and_cameras_and_finds_no_depth(tmp_path, up_axis):
    capture = make_plant_capture(PlantCaptureSettings(plant=TINY, up_axis=up_axis))
    write_plant_capture(tmp_path / "plant", capture)
    read = read_capture(tmp_path / "plant")
    assert [each.text for each in read.remarks] == ["2 of 2 views without a depth map: 000.jpg, 001.jpg"]
    assert {path.name for path in (tmp_path / "plant").iterdir()} == {"images", "cameras", "capture.toml", "truth"}


@pytest.mark.parametrize("wrong", [{"leaves": 0}, {"views": 0}, {"height_m": 0.0}, {"height_m": float("nan")}])
def test_a_plant_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        PlantSettings(**wrong)
