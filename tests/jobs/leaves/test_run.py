"""What the job of leaves does with numbers and pictures, without a file; and once with Storm."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.capture.view import View
from usdfoliage.errors import PreviewError
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.leaves.page import (
    certainty_histograms,
    certainty_rows,
    draw_mean_leaf,
    leaf_histograms,
    measure_rows,
)
from usdfoliage.jobs.leaves.pictures import (
    draw_candidates,
    draw_fitted,
    draw_refined,
    draw_superpixels,
    label_points,
    prepare_points,
    thin_points,
)
from usdfoliage.jobs.leaves.run import encode_texture, finish_leaves, median_color, place_plant
from usdfoliage.jobs.leaves.settings import LeavesRunSettings
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.preview.recorder import find_interpreter
from usdfoliage.jobs.report.pictures import leaf_palette, pick_pixels, shrink_camera, shrink_to, shrink_view
from usdfoliage.jobs.report.table import choose_evenly
from usdfoliage.jobs.work.settings_file import set_everywhere
from usdfoliage.leaf.model import LeafOrigin
from usdfoliage.leaf.photographs.average_texture import AverageTexture
from usdfoliage.leaf.points import LeafPoints, no_points
from usdfoliage.leaf.shape.bounds import leaf_bounds_m
from usdfoliage.leaf.shape.jitter import NO_JITTER

from tests.support.leaves.assets import random_leaves
from tests.support.leaves.captures import known_foliage

Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@pytest.fixture(scope="module")
def bed():
    return known_foliage()


# Where a plant stands


@pytest.mark.parametrize("turned", [np.eye(4), Z_UP])
def test_a_plant_stands_on_the_ground_over_the_origin(turned):
    leaves = random_leaves(20, facts=True)
    matrix = place_plant(leaves, turned)
    np.testing.assert_array_equal(matrix[:3, :3], turned[:3, :3])
    placed = finish_leaves(leaves, matrix, np.arange(20, dtype=np.int32))
    low, high = leaf_bounds_m(placed, NO_JITTER)
    assert low[1] == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose((low + high)[[0, 2]], 0, atol=1e-9)
    np.testing.assert_allclose(placed.base_m, leaves.base_m @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-12)


def test_no_plant_stays_where_it_is():
    np.testing.assert_array_equal(place_plant(random_leaves(0), Z_UP), Z_UP)
    assert len(finish_leaves(random_leaves(0, facts=True), Z_UP, np.arange(3, dtype=np.int32))) == 0


def test_leaves_name_the_photograph_of_the_capture_not_of_the_run():
    leaves = replace(random_leaves(4, facts=True), view=np.array([0, 2, -1, 1], np.int32))
    assert finish_leaves(leaves, np.eye(4), np.array([5, 7, 9], np.int32)).view.tolist() == [5, 9, -1, 7]


# The texture


def test_the_texture_is_written_as_it_is_displayed():
    import cv2

    rgba = np.zeros((16, 16, 4), np.float32)
    rgba[..., :3] = (0.25, 0.5, 0.125)
    rgba[8:, :, 3] = 1
    rgba[:8, :, :3] = 1.0  # where nothing is of it
    texture = AverageTexture(rgba=rgba, leaves=3)
    assert median_color(texture) == pytest.approx((0.25, 0.5, 0.125))
    decoded = cv2.imdecode(np.frombuffer(encode_texture(texture), np.uint8), cv2.IMREAD_UNCHANGED)
    assert decoded[0, 0].tolist() == [255, 255, 255, 0]
    assert decoded[15, 15].tolist() == [99, 188, 137, 255]  # blue, green, red, alpha


def test_a_texture_without_color_divides_nothing_by_zero():
    assert min(median_color(AverageTexture(rgba=np.zeros((16, 16, 4), np.float32), leaves=0))) > 0


# Settings


def test_a_setting_is_set_wherever_it_is():
    changed = set_everywhere(LeavesRunSettings(), "seed", 3)
    assert (changed.capture.sky.seed, changed.capture.depth.seed) == (3, 3)
    assert set_everywhere(changed, "seed", 0) == LeavesRunSettings()
    assert set_everywhere(changed, "no such setting", 7) == changed


# Pictures


def test_colors_of_leaves_can_be_distinguished():
    palette = leaf_palette(300).astype(int)
    assert palette.shape == (300, 3)
    for step in (1, 2, 3):
        assert np.abs(palette[step:] - palette[:-step]).sum(axis=1).min() > 60
    assert leaf_palette(0).shape == (0, 3)


@settings(max_examples=25, deadline=None)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    at=st.tuples(*[st.floats(-5, 5)] * 3),
    size=st.tuples(st.integers(40, 400), st.integers(40, 400)),
    longest=st.integers(20, 500),
)
def test_a_shrunk_camera_sees_the_same_in_another_frame(turn, at, size, longest):
    camera = Pinhole(
        width_px=size[0],
        height_px=size[1],
        focal_px=(200.0, 210.0),
        center_px=(size[0] / 3, size[1] / 2),
        cam_from_world=np.column_stack([Rotation.from_rotvec(turn).as_matrix(), [0.1, 0.2, 5.0]]),
    )
    stage_from_world = np.eye(4)
    stage_from_world[:3, :3] = Rotation.from_rotvec(turn[::-1]).as_matrix()
    stage_from_world[:3, 3] = at
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    shrunk = shrink_camera(camera, longest, stage_from_world)
    assert max(shrunk.width_px, shrunk.height_px) == min(longest, max(size))
    seen, depth_m = camera.project(points)
    again, depth_again_m = shrunk.project(points @ stage_from_world[:3, :3].T + stage_from_world[:3, 3])
    share = np.array([shrunk.width_px / size[0], shrunk.height_px / size[1]])
    np.testing.assert_allclose(again, seen * share, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(depth_again_m, depth_m, atol=1e-9)
    assert shrink_to(np.zeros((size[1], size[0], 3), np.uint8), longest).shape[:2] == (
        shrunk.height_px,
        shrunk.width_px,
    )


def square(depth_m=2.0) -> tuple[View, LeafPoints]:
    """A grey wall seen from its front, and every second point of a square before it, of 20 by 20 pixels."""
    camera = Pinhole(
        width_px=80, height_px=60, focal_px=(80.0, 80.0), center_px=(40.0, 30.0), cam_from_world=np.eye(4)[:3]
    )
    wall_m = np.full((60, 80), 3.0, np.float32)
    wall_m[20:40, 10:30] = depth_m
    view = View(name="a.png", camera=camera, srgb=np.full((60, 80, 3), 200, np.uint8), depth_m=wall_m)
    x, y = np.meshgrid(np.arange(10, 30, 2) + 0.5, np.arange(20, 40, 2) + 0.5)
    points = camera.unproject(np.column_stack([x.ravel(), y.ravel()]), np.full(100, 2.0))
    return view, LeafPoints(
        points_m=points,
        normals=np.tile([0.0, 0.0, -1.0], (100, 1)),
        kind=np.zeros(100, np.uint8),
        point_view=np.zeros(100, np.int32),
        offsets=np.array([0, 100]),
        confidence=np.ones(1),
        view=np.zeros(1, np.int32),
    )


def test_points_fill_the_leaf_they_are_of():
    view, points = square()
    drawn = prepare_points(points)
    labels = label_points(drawn, view, 0)
    assert (labels[21:38, 11:28] == 0).all()
    assert np.count_nonzero(labels == 0) <= 20 * 20  # gaps are filled, and nothing grows
    picture = draw_refined(view, 0, drawn)
    assert (picture[50, 70] == 90).all()  # shaded where nothing is
    assert (picture[30, 20] != picture[50, 70]).any()


def test_thinned_points_fill_the_same_leaves():
    view, points = square()
    two = replace(
        points,
        offsets=np.array([0, 10, 10, 100]),
        confidence=np.ones(3),
        view=np.zeros(3, np.int32),
        kind=np.arange(100).astype(np.uint8),
    )
    thinned = thin_points(two, 30)
    assert thinned.offsets.tolist() == [0, 10, 10, 40]
    assert thinned.kind.tolist() == [*range(10), *range(10, 100, 3)]
    np.testing.assert_array_equal(thinned.points_m, points.points_m[thinned.kind])
    few = label_points(prepare_points(thin_points(points, 25)), view, 0)
    assert np.mean((few == 0) == (label_points(prepare_points(points), view, 0) == 0)) > 0.97


def test_size_and_spacing_are_measured_from_the_points():
    _, points = square()
    drawn = prepare_points(points)
    side = 2.0 * 18 / 80
    assert drawn.size_m == pytest.approx([4 * side / 12**0.5], rel=0.15)
    assert drawn.spacing_m == pytest.approx([2.0 * 2 / 80], rel=0.15)
    assert drawn.middle_m == pytest.approx(points.points_m.mean(axis=0)[None])


@given(moved=st.permutations(range(3)))
def test_the_nearest_points_are_seen(moved):
    view, points = square()
    away = np.array([1.0, 0.9, 0.8])[moved]
    all_three = replace(
        points,
        points_m=np.concatenate([points.points_m * share for share in away]),
        normals=np.tile(points.normals, (3, 1)),
        kind=np.tile(points.kind, 3),
        point_view=np.tile(points.point_view, 3),
        offsets=np.array([0, 100, 200, 300]),
        confidence=np.ones(3),
        view=np.zeros(3, np.int32),
    )
    labels = label_points(prepare_points(all_three), view, 0)
    assert set(np.unique(labels)) == {-1, moved.index(2)}


def test_points_that_another_view_saw_may_be_hidden_in_this_one():
    view, points = square(depth_m=1.0)  # something stands before the square
    drawn = prepare_points(points)
    assert (label_points(drawn, view, 1) == -1).all()
    assert (label_points(drawn, view, 0) >= 0).any()  # this one saw them itself
    view, points = square()
    assert (label_points(prepare_points(points), view, 1) >= 0).any()


def test_pictures_of_nothing(bed):
    view, _ = square()
    none = no_points()
    labels = np.zeros((60, 80), np.int32)
    for picture in (
        draw_superpixels(view, labels - 1),
        draw_candidates(view, labels, np.zeros(0)),
        draw_refined(view, 0, prepare_points(none)),
        draw_fitted(view, random_leaves(0), np.zeros(0, np.int64), np.zeros(0)),
    ):
        np.testing.assert_array_equal(picture, np.full((60, 80, 3), 90))


def test_superpixels_are_edged():
    view, _ = square()
    labels = np.repeat(np.arange(80, dtype=np.int32)[None] // 20, 60, axis=0)
    picture = draw_superpixels(view, labels)
    assert (picture[:, [19, 39, 59]] == (255, 210, 60)).all()
    assert (picture[:, [10, 30, 50, 70]] == 200).all()


def test_fitted_leaves_are_drawn_where_the_photograph_shows_them(bed):
    view, ids = bed.views[0], bed.leaf_ids[0]
    picture = draw_fitted(view, bed.leaves, np.arange(len(bed.leaves)), np.ones(len(bed.leaves)))
    shaded = np.rint(view.srgb * 0.45).astype(int)
    drawn = np.abs(picture.astype(int) - shaded).max(axis=2) > 2
    leaf = ids > 0
    assert np.count_nonzero(drawn & leaf) / np.count_nonzero(drawn | leaf) > 0.9


def test_dots_are_hollow_where_the_base_is_a_guess(bed):
    view, number = bed.views[0], np.arange(len(bed.leaves))
    sure, guessed = (
        draw_fitted(view, bed.leaves, number, np.full(len(bed.leaves), certainty), threads=1)
        for certainty in (0.99, 0.6)
    )
    changed = (sure != guessed).any(axis=2)
    places, _ = view.camera.project(bed.leaves.base_m)
    rows, columns = np.nonzero(changed)
    away = np.linalg.norm(np.column_stack([columns, rows])[:, None] + 0.5 - places, axis=2).min(axis=1)
    assert changed.any()
    assert np.nanmax(away) < 5
    red = [np.count_nonzero((picture == (255, 60, 40)).all(axis=2)) for picture in (sure, guessed)]
    assert red[1] < 0.6 * red[0]


@pytest.mark.parametrize("longest", [211, 479, 2000])
def test_a_shrunk_view_shows_the_same(bed, longest):
    view = bed.views[0]
    small = shrink_view(view, longest)
    assert max(small.depth_m.shape) == min(longest, max(view.depth_m.shape))
    ids = pick_pixels(bed.leaf_ids[0], small.depth_m.shape)
    share = np.mean(bed.leaf_ids[0] > 0)
    assert np.mean(ids > 0) == pytest.approx(share, rel=0.03)
    # Depth unprojects to the surfaces of which it is.
    rows, columns = np.nonzero((small.depth_m > 0) & (ids > 0))
    points = small.camera.unproject(np.column_stack([columns, rows]) + 0.5, small.depth_m[rows, columns].astype(float))
    places, depth_m = view.camera.project(points)
    same = np.abs(depth_m - view.depth_m[tuple(places.astype(int).T[::-1])]) < 1e-6
    assert np.mean(same) > 0.99  # not where a pixel's centre lies on the border of two


# The report's figures


@pytest.mark.parametrize(
    ("length_m", "text"),
    [
        (0.07, "70 (70 to 70) mm"),
        (0.9, "900 (900 to 900) mm"),
        (0.9999, "1 (1 to 1) m"),
        (1.234, "1.23 (1.23 to 1.23) m"),
    ],
)
def test_lengths_are_written_in_a_readable_unit(length_m, text):
    leaves = replace(random_leaves(5), length_m=np.full(5, length_m))
    assert measure_rows(leaves)[0].value == text
    assert leaf_histograms(leaves)[0].title == f"length in {text.split()[-1]}"


def test_guesses_of_the_base_are_counted():
    certainty = np.array([0.5, 0.7, 0.949, 0.95, 1.0])
    (row,) = certainty_rows(certainty)
    assert "3 of 5 leaves are below 0.95" in row.remark
    (histogram,) = certainty_histograms(certainty)
    assert (histogram.low, histogram.high, sum(histogram.heights)) == ("0.5", "1", 5)
    assert certainty_rows(np.zeros(0)) == certainty_histograms(np.zeros(0)) == []


def test_figures_of_leaves():
    leaves = random_leaves(50, facts=True)
    assert [row.name for row in measure_rows(leaves)] == [
        "length",
        "width / length",
        "residual",
        "residual / length",
        "confidence",
    ]
    for histogram in leaf_histograms(leaves):
        assert sum(histogram.heights) == 50
    assert measure_rows(random_leaves(0)) == leaf_histograms(random_leaves(0)) == []
    counted = replace(leaves, origin=np.repeat([LeafOrigin.FOUND, LeafOrigin.COMPLETED], [38, 12]).astype(np.int32))
    row = measure_rows(counted)[-1]
    assert (row.name, row.value) == ("leaves by origin", "38 found, 12 completed")


def test_the_mean_leaf_is_drawn_inside_its_box():
    drawing = draw_mean_leaf(random_leaves(5))
    places = np.array([[float(n) for n in place.split(",")] for line in drawing.lines for place in line.points.split()])
    assert (places >= 0).all()
    assert (places <= (drawing.width, drawing.height)).all()


@pytest.mark.parametrize(
    ("count", "max_count", "chosen"), [(3, 12, [0, 1, 2]), (10, 4, [0, 3, 6, 9]), (5, 1, [0]), (5, 0, [])]
)
def test_an_even_selection_of_views_is_chosen(count, max_count, chosen):
    assert choose_evenly(count, max_count) == chosen


# Storm


@pytest.mark.preview
def test_storm_draws_leaves_where_the_camera_sees_them(bed, tmp_path):
    from tests.support.leaves.assets import write_spray

    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    matrix = place_plant(bed.leaves, np.eye(4))
    interface = write_spray(
        tmp_path / "spray", finish_leaves(bed.leaves, matrix, np.arange(4)), representations=("bezier",)
    )
    view = bed.views[1]
    pinhole = shrink_camera(view.camera, 360, matrix)
    (picture,) = draw_views(interface, [PreviewView(output=tmp_path / "a.png", pinhole=pinhole)], PreviewSettings())
    drawn = picture[..., 3] > 0.5
    # Twigs and stalks of the capture hide next to nothing.
    rows, columns = ((np.arange(size) + 0.5) * 480 / 360 for size in drawn.shape)
    leaf = bed.leaf_ids[1][rows.astype(int)[:, None], columns.astype(int)] > 0
    assert np.count_nonzero(drawn & leaf) / np.count_nonzero(drawn | leaf) > 0.85
