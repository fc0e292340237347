"""Leaves that lie along a stem and are hardly wider are patches of it."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.branch.model import Skeleton
from usdfoliage.jobs.plant.stages.leaves_on_stems import lie_along_stems
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import slim_leaves
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points

from tests.support.leaves.assets import random_leaves


def a_leaf(width: float) -> Leaves:
    """One leaf of 0.1 m, as wide as that for its length."""
    leaf = replace(random_leaves(1, seed=2), length_m=np.full(1, 0.1))
    return replace(leaf, parameters=slim_leaves(leaf.parameters, width / leaf_width(leaf.parameters)))


def stem_along(leaf: Leaves, radius_m: float, aside_m: float = 0.0) -> Skeleton:
    """A stem along the axis of a leaf, or beside it."""
    places = np.column_stack([np.zeros(20), np.linspace(0, 1, 20)])
    axis_m = evaluate_points(leaf.parameters, places, placements=leaf.asset_from_leaf())[0]
    return Skeleton(
        points_m=axis_m + aside_m * np.array([0.6, 0.0, 0.8]),
        radius_m=np.full(20, radius_m),
        counts=np.array([20], np.int32),
        parent_curve=np.array([-1], np.int32),
        parent_vertex=np.array([-1], np.int32),
        order=np.zeros(1, np.int32),
    )


def test_a_slender_patch_along_a_stem_is_of_the_stem():
    leaf = a_leaf(0.08)
    assert lie_along_stems(leaf, stem_along(leaf, 0.003)).tolist() == [True]


@pytest.mark.parametrize(
    ("width", "radius_m", "aside_m"),
    [(0.5, 0.003, 0.0), (0.08, 0.001, 0.0), (0.08, 0.003, 0.05)],
    ids=["a broad leaf", "a leaf much wider than the stem", "a leaf beside the stem"],
)
def test_a_leaf_stays(width, radius_m, aside_m):
    leaf = a_leaf(width)
    assert lie_along_stems(leaf, stem_along(leaf, radius_m, aside_m)).tolist() == [False]


def test_a_leaf_that_a_stem_crosses_stays():
    leaf = a_leaf(0.1)
    along = stem_along(leaf, 0.004)
    middle_m = along.points_m.mean(axis=0)
    course = along.points_m[-1] - along.points_m[0]
    across = np.cross(course, (0.3, 0.5, 0.8))
    across /= np.linalg.norm(across)
    crossing = replace(along, points_m=middle_m + np.linspace(-0.1, 0.1, 20)[:, None] * across)
    assert lie_along_stems(leaf, crossing).tolist() == [False]


def test_without_leaves_there_is_nothing_to_leave_out():
    leaf = a_leaf(0.1)
    assert lie_along_stems(leaf.take(np.zeros(1, bool)), stem_along(leaf, 0.003)).tolist() == []
