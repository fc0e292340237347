"""Where branches spring from: straight from the parent's axis, in the direction in which they come out of it."""

import numpy as np
import pytest
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.attachments import settle_attachments

from tests.support.branch_shapes import plant_of

UP_M = np.column_stack([np.zeros(41), np.linspace(0, 4, 41), np.zeros(41)])
FORK = 20  # at 2 m


def limb(angle_deg: float, springs_m: float, knee: bool = True) -> np.ndarray:
    """An axis at an angle to the stem that points back to a height of it; with a knee it begins level at the fork."""
    angle = np.radians(angle_deg)
    along_m = np.arange(0, 2, 0.05)[:, None] * [np.sin(angle), np.cos(angle), 0]
    line_m = along_m + np.array([0, springs_m, 0])
    inside = np.linalg.norm(line_m[:, [0, 2]], axis=1) < 0.2
    if not knee:
        return line_m
    level_m = np.column_stack([np.linspace(0, 0.2, 5), np.full(5, UP_M[FORK, 1]), np.zeros(5)])
    return np.concatenate([level_m, line_m[~inside & (line_m[:, 1] > UP_M[FORK, 1])]])


def stem_with(*limbs: tuple) -> Skeleton:
    return plant_of((UP_M, 0.2, None, None), *limbs)


@pytest.mark.parametrize("springs_m", [1.7, 1.8, 1.9])
def test_a_knee_becomes_straight(springs_m):
    settled = settle_attachments(stem_with((limb(45, springs_m), 0.05, 0, FORK)))
    assert settled.points_m[settled.parent_vertex[1], 1] == pytest.approx(springs_m, abs=0.051)
    path_m = np.diff(settled.points_m[settled.branch(1)], axis=0)
    path_m /= np.linalg.norm(path_m, axis=1, keepdims=True)
    assert (path_m @ [np.sqrt(0.5), np.sqrt(0.5), 0]).min() > np.cos(np.radians(12))
    assert settled.counts[1] < len(limb(45, springs_m))


def test_a_limb_beside_its_stem_springs_two_radii_below():
    points_m = np.concatenate([[[0, 2, 0]], np.column_stack([np.full(20, 0.25), np.linspace(2, 4, 20), np.zeros(20)])])
    settled = settle_attachments(stem_with((points_m, 0.05, 0, FORK)))
    assert settled.points_m[settled.parent_vertex[1], 1] == pytest.approx(1.6, abs=0.051)


def test_a_level_branch_stays():
    level_m = limb(90, 2.0, knee=False)
    settled = settle_attachments(stem_with((level_m, 0.05, 0, FORK)))
    assert settled.parent_vertex[1] == FORK
    np.testing.assert_allclose(settled.points_m[settled.branch(1), 1], 2, atol=1e-12)


def test_what_sprang_inside_the_stem_springs_where_its_branch_comes_out():
    limb_m = limb(45, 1.8)
    twig_m = limb_m[2] + np.outer(np.arange(4), [0, 0, 0.3])
    settled = settle_attachments(stem_with((limb_m, 0.05, 0, FORK), (twig_m, 0.01, 1, 2)))
    assert settled.parent_curve.tolist() == [-1, 0, 1]
    outside = settled.first[1] + 1
    assert settled.parent_vertex[2] == outside
    assert np.linalg.norm(settled.points_m[outside, [0, 2]]) > 0.2


def test_a_branch_that_never_comes_out_keeps_its_place():
    inside_m = np.array([[0, 2, 0], [0.05, 2.1, 0], [0.1, 2.2, 0]])
    settled = settle_attachments(stem_with((inside_m, 0.01, 0, FORK)))
    np.testing.assert_array_equal(settled.points_m[settled.branch(1)], inside_m)


def test_no_branch_springs_where_its_parent_does():
    limb_m = limb(45, 1.8)
    twig_m = limb_m[1] + np.outer(np.arange(6), [0.0, 0.4, 0.4])
    settled = settle_attachments(stem_with((limb_m, 0.05, 0, FORK), (twig_m, 0.01, 1, 1)))
    assert settled.parent_vertex[2] > settled.first[1]


def test_a_plant_without_branches_stays():
    assert len(settle_attachments(stem_with())) == 1
