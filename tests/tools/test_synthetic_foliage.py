"""Synthetic captures: pictures, depth, leaf numbers and cameras agree with each other and with the leaves."""

import tomllib

import cv2
import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from usdfoliage.capture.folder.read import read_capture, read_views
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

from tests.support.leaves.captures import exact_leaves, known_foliage
from tools.bench.leaf_truth import read_exact_depth, read_true_leaves
from tools.synthetic.depth import BACKDROP, LEAF, SKY, WOOD, NoiseSettings, degrade_depth
from tools.synthetic.raster import rasterise
from tools.synthetic.scene import SceneSettings, build_scene
from tools.synthetic_foliage import CaptureSettings, make_capture, write_capture


def test_a_triangle_is_seen_where_its_plane_is():
    places = np.array([[1.0, 1.0], [9.0, 1.0], [1.0, 9.0]])
    depth = np.array([2.0, 4.0, 8.0])
    hits = rasterise(places, 1 / depth, np.array([[0, 1, 2]], np.int32), (10, 10))
    rows, columns = np.nonzero(hits.triangle == 0)
    assert (columns + rows + 1 <= 10).all()
    assert len(rows) == 36  # centres inside x, y >= 1, x + y <= 10
    x, y = columns + 0.5, rows + 0.5
    inverse = 1 / 2 + (x - 1) / 8 * (1 / 4 - 1 / 2) + (y - 1) / 8 * (1 / 8 - 1 / 2)
    np.testing.assert_allclose(hits.depth[rows, columns], 1 / inverse, rtol=1e-12)
    weights = hits.weights(places, 1 / depth, np.array([[0, 1, 2]], np.int32))
    np.testing.assert_allclose(weights @ depth, hits.depth[rows, columns], rtol=1e-12)


@given(order=st.permutations(range(3)), shift=st.floats(-4, 12))
def test_the_nearest_triangle_is_seen_whatever_their_order(order, shift):
    corners = np.array([[0.0, 0.0], [20.0, 0.0], [0.0, 20.0]])
    places = np.concatenate([corners, corners, corners + shift])
    inverse = 1 / np.repeat([3.0, 1.0, 2.0], 3)
    triangles = np.arange(9, dtype=np.int32).reshape(3, 3)[list(order)]
    hits = rasterise(places, inverse, triangles, (8, 8))
    seen = np.array([*order, -1])[hits.triangle]
    assert (seen[:7, :7] == 1).all()


def test_what_is_outside_or_has_no_area_is_not_seen():
    places = np.array([[-9.0, -9.0], [-5.0, -9.0], [-9.0, -5.0], [1.0, 1.0], [7.0, 7.0], [4.0, 4.0]])
    hits = rasterise(places, np.ones(6), np.arange(6, dtype=np.int32).reshape(2, 3), (8, 8))
    assert (hits.triangle == -1).all()
    assert (hits.depth == 0).all()


def test_what_is_behind_the_camera_is_not_seen():
    places = np.array([[1.0, 1.0], [7.0, 1.0], [np.nan, np.nan], [1.0, 1.0], [7.0, 1.0], [1.0, 7.0]])
    hits = rasterise(places, np.array([1, 1, -1, 0.5, 0.5, 0.5]), np.arange(6, dtype=np.int32).reshape(2, 3), (8, 8))
    assert set(np.unique(hits.triangle)) == {-1, 1}


def test_every_leaf_pixel_lies_on_its_leaf():
    foliage = known_foliage()
    places = grid_places(np.linspace(-1, 1, 33), np.linspace(0, 1, 33))
    surfaces = evaluate_points(foliage.leaves.parameters, places, placements=foliage.leaves.asset_from_leaf())
    for view, ids in zip(foliage.views, foliage.leaf_ids, strict=True):
        points = view.points()
        for number in np.unique(ids[ids > 0])[::5]:
            leaf_points_m = points[ids == number]
            nearest, _ = cKDTree(surfaces[number - 1]).query(leaf_points_m)
            assert nearest.max() < 0.06 * foliage.truth.length_m[number - 1]


def test_leaves_are_seen_and_stand_apart():
    foliage = known_foliage()
    assert len(foliage.leaves) == 40
    assert (foliage.visible >= 0.5).mean() > 0.8
    ends = foliage.truth.base_m, foliage.truth.apex_m
    np.testing.assert_allclose(np.linalg.norm(ends[1] - ends[0], axis=1), foliage.truth.length_m, rtol=1e-5)
    assert foliage.truth.surface_m[..., 1].min() > 0  # above the ground


def test_pictures_show_green_leaves_where_the_labels_have_them():
    foliage = known_foliage()
    for view, seen in zip(foliage.views, foliage.capture.seen, strict=True):
        assert set(np.unique(seen.label)) <= {SKY, WOOD, LEAF, BACKDROP}
        np.testing.assert_array_equal(seen.label == LEAF, seen.leaf_id > 0)
        assert ((seen.label == SKY) == (view.depth_m == 0)).all()
        mean = view.srgb[seen.label == LEAF].mean(axis=0)
        assert mean[1] > 1.1 * mean[0] > 1.1 * mean[2]


def test_the_same_seed_gives_the_same_capture_and_another_does_not():
    settings = CaptureSettings(scene=SceneSettings(leaves=12, views=1, width_px=80, height_px=60))
    first, second = make_capture(settings), make_capture(settings)
    np.testing.assert_array_equal(first.views[0].srgb, second.views[0].srgb)
    np.testing.assert_array_equal(first.noisy_depth_m[0], second.noisy_depth_m[0])
    other = SceneSettings(leaves=12, views=1, width_px=80, height_px=60, seed=1)
    assert not np.array_equal(build_scene(other).leaves.base_m, build_scene(settings.scene).leaves.base_m)


def test_a_scene_scales_as_a_whole():
    small, large = (
        build_scene(SceneSettings(leaves=20, views=2, width_px=80, height_px=60, length_m=length_m))
        for length_m in (0.07, 0.7)
    )
    np.testing.assert_allclose(10 * small.points_m, large.points_m, rtol=1e-5, atol=1e-6)
    for first, second in zip(small.cameras, large.cameras, strict=True):
        np.testing.assert_allclose(10 * first.position_m, second.position_m, rtol=1e-9)


def test_more_leaves_than_a_view_frames_make_a_longer_bed_and_more_arcs():
    one = build_scene(SceneSettings(leaves=50, views=3, width_px=80, height_px=60, framed_leaves=50))
    four = build_scene(SceneSettings(leaves=200, views=12, width_px=80, height_px=60, framed_leaves=50))
    assert np.ptp(four.points_m[:, 0]) > 2.5 * np.ptp(one.points_m[:, 0])
    assert np.ptp(four.points_m[:, 2]) < 1.5 * np.ptp(one.points_m[:, 2])
    height = [camera.position_m[1] for camera in one.cameras]
    assert [camera.position_m[1] for camera in four.cameras[:3]] == pytest.approx(height)


def test_noise_is_of_its_size_and_holes_lie_beside_edges():
    depth_m = np.full((200, 300), 2.0, np.float32)
    depth_m[:, 150:] = 3.0
    noisy = degrade_depth(depth_m, 400.0, np.random.default_rng(0), NoiseSettings(outliers=0.0, holes=0.0))
    known = noisy > 0
    assert not known[:, 149:151].all()
    assert known[:, :148].all()
    assert known[:, 152:].all()
    assert (noisy - depth_m)[:, :148].std() == pytest.approx(2.0 / 400, rel=0.02)
    assert (noisy - depth_m)[:, 152:].std() == pytest.approx(3.0 / 400, rel=0.02)
    exact = degrade_depth(
        depth_m, 400.0, np.random.default_rng(0), NoiseSettings(sigma=0, outliers=0, edge_holes=0, holes=0)
    )
    np.testing.assert_array_equal(exact, depth_m)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_a_written_capture_reads_as_what_it_was_made_from(tmp_path, up_axis):
    foliage = known_foliage(leaves=12, views=2, size=(160, 120), up_axis=up_axis)
    write_capture(tmp_path / "bed", foliage.capture)
    folder = tmp_path / "bed"
    assert tomllib.loads((folder / "capture.toml").read_text())["up_axis"] == up_axis
    for view, (camera, depth_m) in zip(foliage.views, read_exact_depth(folder), strict=True):
        np.testing.assert_allclose(camera.cam_from_world, view.camera.cam_from_world, atol=1e-12)
        np.testing.assert_array_equal(depth_m, view.depth_m)
        picture = cv2.imread(str(folder / "images" / view.name))[..., ::-1]
        assert np.abs(picture.astype(int) - view.srgb).mean() < 6
    ids = cv2.imread(str(folder / "truth" / "001_leafid.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(ids, foliage.leaf_ids[1])
    with OpenEXR.File(str(folder / "depth_noisy" / "001.exr")) as file:
        np.testing.assert_array_equal(file.channels()["Z"].pixels, foliage.noisy_views[1].depth_m)
    truth = read_true_leaves(folder)
    np.testing.assert_allclose(truth.surface_m, foliage.truth.surface_m)
    up = {"Y": 1, "Z": 2}[up_axis]
    assert truth.surface_m[..., up].min() > 0
    with np.load(folder / "truth" / "leaves.npz") as arrays:
        np.testing.assert_array_equal(exact_leaves(arrays).parameters, foliage.leaves.parameters)
        np.testing.assert_array_equal(arrays["visible_pixels"][:, 1], np.bincount(ids.ravel(), minlength=13)[1:])
    with pytest.raises(FileExistsError, match="not empty"):
        write_capture(folder, foliage.capture)


@pytest.mark.parametrize("depth", ["depth", "depth_noisy"])
def test_the_product_reads_a_written_capture(tmp_path, depth):
    foliage = known_foliage(leaves=12, views=2, size=(160, 120))
    write_capture(tmp_path / "bed", foliage.capture)
    capture = read_capture(tmp_path / "bed", depth=depth)
    read = read_views(capture)
    assert [*capture.remarks, *read.remarks] == []
    for view, made in zip(read.views, foliage.views if depth == "depth" else foliage.noisy_views, strict=True):
        assert view.name == made.name
        np.testing.assert_allclose(view.camera.cam_from_world, made.camera.cam_from_world, atol=1e-12)
        np.testing.assert_array_equal(view.depth_m, made.depth_m)
        assert np.abs(view.srgb.astype(int) - made.srgb).mean() < 6


def test_points_of_the_cameras_are_seen_at_their_places(tmp_path):
    foliage = known_foliage(leaves=12, views=2, size=(160, 120))
    write_capture(tmp_path / "bed", foliage.capture)
    lines = (tmp_path / "bed" / "cameras" / "points3D.txt").read_text().splitlines()[1:]
    images = [line for line in (tmp_path / "bed" / "cameras" / "images.txt").read_text().splitlines() if line[0] != "#"]
    observed = [np.array(line.split(), float).reshape(-1, 3) for line in images[1::2]]
    assert len(lines) > 20
    for line in lines:
        number, x, y, z, *_ = map(float, line.split())
        track = np.array(line.split()[8:], int).reshape(-1, 2)
        assert len(track) > 1
        for image, place in track:
            at_x, at_y, point = observed[image - 1][place]
            assert point == number
            places, _ = foliage.views[image - 1].camera.project(np.array([[x, y, z]]))
            np.testing.assert_allclose(places[0], (at_x, at_y), atol=0.01)


def test_without_a_wall_there_is_sky_without_depth():
    scene = SceneSettings(leaves=12, views=1, width_px=80, height_px=60, wall=False)
    capture = make_capture(CaptureSettings(scene=scene))
    label = capture.seen[0].label
    assert (label == SKY).any()
    assert (capture.views[0].depth_m[label == SKY] == 0).all()
    assert (capture.noisy_depth_m[0][label == SKY] == 0).all()
    assert label[-1, 0] == BACKDROP


def test_leaves_can_be_narrower():
    default, narrow = (
        build_scene(SceneSettings(leaves=12, views=1, width_px=80, height_px=60, width=width)) for width in (1.0, 0.5)
    )
    ratio = leaf_width(narrow.leaves.parameters).mean() / leaf_width(default.leaves.parameters).mean()
    assert 0.4 < ratio < 0.65


@pytest.mark.parametrize(
    "wrong", [{"leaves": 0}, {"views": 0}, {"length_m": 0.0}, {"length_m": float("nan")}, {"width": -1.0}]
)
def test_scenes_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        SceneSettings(**wrong)
