"""Ground: found under trees on level and on tilted ground, and not where a tree was cut out."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.branch.tracing.ground import GroundSettings, find_ground

from tests.support.branch_clouds import cloud_of, cone, ground, small_tree

TREE = cloud_of(small_tree(), 4000, noise_m=0.002)


def crown(low_m: float, high_m: float, count: int = 20_000) -> np.ndarray:
    """Leaves in a crown that is cut off flat below."""
    rng = np.random.default_rng(4)
    turn, away = rng.uniform(0, 2 * np.pi, count), 1.5 * np.sqrt(rng.uniform(0, 1, count))
    return np.column_stack([away * np.cos(turn), rng.uniform(low_m, high_m, count), away * np.sin(turn)])


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.2, 0.0), (-0.1, 0.3), (0.35, 0.35)])
def test_the_ground_under_a_tree_is_its_plane(slope):
    below = ground(6, slope=slope)
    found = find_ground(np.concatenate([TREE, below]))
    assert found.plane == pytest.approx([*slope, 0], abs=0.015)
    assert found.points[len(TREE) :].mean() > 0.99
    # Of the tree only its foot lies in the layer.
    assert (TREE[found.points[: len(TREE)], 1] < 0.12).all()


def test_what_lies_below_the_ground_goes_with_it():
    below = ground(6)
    hole = np.random.default_rng(1).uniform([-3, -0.5, -3], [3, -0.1, 3], (10, 3))
    found = find_ground(np.concatenate([TREE, below, hole]))
    assert found.points[-10:].all()


@examples(max_examples=15)
@given(turn=st.floats(0, 2 * np.pi), far_m=st.floats(-1000, 1000), scale=st.floats(0.5, 3))
def test_where_the_plant_stands_and_how_large_it_is_does_not_matter(turn, far_m, scale):
    points_m = np.concatenate([TREE, ground(6, slope=(0.1, 0.2))])
    about_y = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    found = find_ground(scale * points_m @ about_y.T + far_m)
    true_m = scale * points_m[:, 1] - scale * points_m[:, [0, 2]] @ [0.1, 0.2]  # height above the plane
    assert found.points[np.abs(true_m) < 0.01 * scale].all()
    assert not found.points[true_m > 0.12 * scale].any()


def test_the_ground_of_a_plant_at_map_coordinates_is_found():
    points_m = np.concatenate([TREE, ground(6, slope=(0.1, 0.2))])
    near, far = find_ground(points_m), find_ground(np.add(points_m, [485_000, 40, 5_400_000]))
    assert (near.points == far.points).mean() > 0.999


@pytest.mark.parametrize(
    "points_m",
    [
        TREE,
        TREE[TREE[:, 1] > 1],
        np.concatenate([cone([0, 0, 0], [0, 3, 0], 0.15, 3000), crown(2.5, 5)]),
        crown(2.5, 5, 200_000),
        cone([0, 0, 0], [0, 4, 0], 0.3, 8000),
        np.concatenate([TREE, ground(6, slope=(1.0, 0.0))]),
        np.ones((1, 3)),
        np.ones((50, 3)),
        np.linspace([0, 0, 0], [0, 1, 0], 50),
    ],
    ids=[
        "cut out",
        "cut above its foot",
        "a crown flat below, on a trunk",
        "a dense crown flat below",
        "a stem",
        "a slope too steep",
        "one point",
        "one place",
        "upright",
    ],
)
def test_where_there_is_no_ground_none_is_found(points_m):
    found = find_ground(points_m)
    assert found.plane is None
    assert not found.points.any()
    assert found.points.shape == (len(points_m),)


@pytest.mark.xfail(strict=True, reason="cells are chosen by their lowest point, so that few points make a layer")
def test_a_sparse_crown_that_is_flat_below_has_no_ground():
    assert not find_ground(crown(2.5, 5)).points.any()


def test_ground_alone_is_ground():
    assert find_ground(ground(4)).points.mean() > 0.99


@pytest.mark.parametrize("change", [{"cell_of_extent": 0.0}, {"layer_of_height": 0.0}, {"min_cells": 2}])
def test_settings_that_call_nothing_ground_are_refused(change):
    with pytest.raises(ValueError, match="shares must be above 0"):
        GroundSettings(**change)
