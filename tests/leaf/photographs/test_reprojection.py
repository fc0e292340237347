"""Leaves drawn into pictures cover the pixels that they should, at the depth that they have."""

import cv2
import numpy as np
import pytest
from usdfoliage.leaf.photographs.reprojection import DrawSettings, draw_leaf_ids, project_axes
from usdfoliage.leaf.shape.variation import default_leaf

from tests.support.leaves.pictures import front_camera, place_leaves, project_silhouettes
from tests.support.leaves.shapes import flat_leaf, random_leaves

CAMERA = front_camera()


def test_pixels_inside_the_silhouette_are_drawn_and_no_others():
    leaves = place_leaves(flat_leaf(), [(0.0, -0.1, 0.0)], length_m=0.2)
    drawn = draw_leaf_ids(leaves, CAMERA, DrawSettings(along=96))

    polygon = project_silhouettes(leaves, CAMERA, 96)[0]
    area = cv2.contourArea(polygon.astype(np.float32))
    assert np.sum(drawn.ids == 0) == pytest.approx(area, rel=0.01)
    rows, columns = np.nonzero(drawn.ids == 0)
    outside = [
        cv2.pointPolygonTest(polygon.astype(np.float32), (x + 0.5, y + 0.5), True)
        for y, x in zip(rows, columns, strict=True)
    ]
    assert min(outside) > -0.05


@pytest.mark.parametrize("tilt_deg", [0.0, 50.0, -65.0])
def test_depth_is_that_of_the_plane_of_a_flat_leaf(tilt_deg):
    leaves = place_leaves(flat_leaf(), [(0.02, -0.05, 0.1)], length_m=0.2, tilt_deg=tilt_deg)
    drawn = draw_leaf_ids(leaves, CAMERA)

    rows, columns = np.nonzero(drawn.ids == 0)
    assert len(rows) > 200
    points = CAMERA.unproject(np.column_stack([columns, rows]) + 0.5, drawn.depth_m[rows, columns].astype(np.float64))
    normal = leaves.asset_from_leaf()[0, :, 2] / 0.2
    assert (points - leaves.base_m[0]) @ normal == pytest.approx(0, abs=1e-6)


def test_the_nearer_leaf_is_seen_whatever_the_order():
    base = np.array([(0.0, -0.1, 0.0), (0.01, -0.09, 0.2)])
    near_last = draw_leaf_ids(place_leaves(default_leaf(), base, length_m=0.2), CAMERA)
    near_first = draw_leaf_ids(place_leaves(default_leaf(), base[::-1], length_m=0.2), CAMERA)

    alone = draw_leaf_ids(place_leaves(default_leaf(), base[1:], length_m=0.2), CAMERA)
    assert (near_last.ids[alone.ids == 0] == 1).all()
    assert set(np.unique(near_last.ids)) == {-1, 0, 1}
    assert np.array_equal(near_last.depth_m, near_first.depth_m)
    assert np.array_equal(near_last.ids == 1, near_first.ids == 0)


def test_of_leaves_equally_near_the_first_is_seen():
    twice = place_leaves(default_leaf(), [(0.0, -0.1, 0.0)] * 2, length_m=0.2)

    assert set(np.unique(draw_leaf_ids(twice, CAMERA).ids)) == {-1, 0}


def test_nothing_is_drawn_without_leaves_or_behind_the_camera():
    behind = place_leaves(default_leaf(), [(0.0, 0.0, 1.5)])
    for leaves in (behind, behind.take([False])):
        drawn = draw_leaf_ids(leaves, CAMERA)
        assert drawn.ids.shape == drawn.depth_m.shape == (180, 240)
        assert (drawn.ids == -1).all()
        assert (drawn.depth_m == 0).all()
    assert np.isnan(project_axes(behind, CAMERA)).all()


def test_a_leaf_around_the_camera_loses_only_what_lies_behind():
    leaves = place_leaves(flat_leaf(), [(0.0, -0.1, 0.0)], length_m=2.0, tilt_deg=80.0)

    drawn = draw_leaf_ids(leaves, CAMERA)
    assert (drawn.ids == 0).any()
    assert drawn.depth_m[drawn.ids == 0].min() > 0


def test_threads_change_nothing():
    leaves = place_leaves(random_leaves(60), np.random.default_rng(1).normal(size=(60, 3)) * 0.1)
    one, many = (draw_leaf_ids(leaves, CAMERA, threads=threads) for threads in (1, 5))

    assert np.array_equal(one.ids, many.ids)
    assert np.array_equal(one.depth_m, many.depth_m)


def test_axes_run_from_base_to_apex():
    leaves = place_leaves(default_leaf(), [(0.03, -0.05, 0.1)], turn_deg=30.0)
    ends = np.concatenate([leaves.base_m, leaves.asset_from_leaf() @ [0, 1, 0, 1]])

    assert project_axes(leaves, CAMERA)[0, [0, -1]] == pytest.approx(CAMERA.project(ends)[0])


def test_wrong_numbers_of_cells_are_refused():
    leaves = place_leaves(default_leaf(), [(0, 0, 0)])
    for make in (lambda: DrawSettings(across=3), lambda: DrawSettings(along=1)):
        with pytest.raises(ValueError, match="not"):
            make()
    with pytest.raises(ValueError, match="steps must be 1 or more, not 0"):
        project_axes(leaves, CAMERA, 0)
