"""Leaves that lie along a stem and are hardly wider are patches of it."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.branch.model import Skeleton
from usdfoliage.jobs.plant.stages.leaves_on_stems import find_dull_slivers, lie_along_stems
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


GREEN, DULL, YOUNG, SHADED = (0.20, 0.42, 0.03), (0.04, 0.05, 0.01), (0.36, 0.60, 0.05), (0.02, 0.06, 0.0)


def leaves_of(count: int, width: float, *others: tuple[float, tuple[float, float, float]]) -> Leaves:
    """So many green leaves of this width, of which some are more yellow, and others of their own width and colour."""
    leaves = random_leaves(count + len(others), seed=2)
    wide = np.append(np.full(count, width), [own for own, _ in others])
    hues = np.array(GREEN) + np.linspace(-1, 1, count)[:, None] * (0.03, -0.03, 0.01)
    return replace(
        leaves,
        parameters=np.concatenate(
            [slim_leaves(own[None], w / leaf_width(own[None])) for own, w in zip(leaves.parameters, wide, strict=True)]
        ),
        color=np.concatenate([hues, np.array([color for _, color in others]).reshape(-1, 3)]),
    )


@pytest.mark.parametrize("width", [0.08, 0.28], ids=["a thin line", "a stem with what is beside it"])
def test_a_narrow_leaf_of_a_duller_colour_is_a_piece_of_a_stem(width):
    assert np.flatnonzero(find_dull_slivers(leaves_of(12, 0.5, (width, DULL)))).tolist() == [12]


@pytest.mark.parametrize(
    ("width", "color"),
    [(0.08, GREEN), (0.08, SHADED), (0.3, YOUNG), (0.45, DULL)],
    ids=["green", "in the shade", "young", "as wide as the others"],
)
def test_other_narrow_or_dull_leaves_are_leaves(width, color):
    assert not find_dull_slivers(leaves_of(12, 0.5, (width, color))).any()


def test_leaves_of_a_grass_are_no_slivers():
    assert not find_dull_slivers(leaves_of(12, 0.06, (0.06, DULL))).any()


def test_slivers_are_not_known_without_colours_or_among_few_leaves():
    leaves = leaves_of(12, 0.5, (0.08, DULL))
    assert not find_dull_slivers(replace(leaves, color=None)).any()
    assert not find_dull_slivers(leaves.take(np.arange(13) > 5)).any()
    assert find_dull_slivers(leaves.take(np.zeros(13, bool))).tolist() == []
