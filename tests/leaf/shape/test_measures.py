"""Lengths, widths and areas whose answer is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from usdfoliage.leaf.shape import measures
from usdfoliage.leaf.shape.measures import leaf_area, leaf_width
from usdfoliage.leaf.shape.surface import evaluate_grid, evaluate_points, grid_places
from usdfoliage.leaf.shape.variation import default_leaf, vary_leaves

from tests.support.leaves.shapes import flat_leaf, random_leaves
from tools.synthetic.curve_lengths import curve_length

MEASURES = (leaf_area, leaf_width)


def axis_length(leaves):
    return curve_length(leaves, 0.0)


def silhouette_length(leaves):
    return curve_length(leaves, -1.0) + curve_length(leaves, 1.0)


LENGTHS = (axis_length, silhouette_length)


@settings(max_examples=20, deadline=None)
@given(width=st.floats(0.01, 2.0))
def test_a_flat_leaf(width):
    leaf = flat_leaf(width=width)

    # Each inner Bernstein polynomial of a quartic has the integral 1/5, all three of them at v = 1/2 the sum 7/8.
    assert leaf_area(leaf)[0] == pytest.approx(2 * width * 3 / 5, rel=1e-12)
    assert leaf_width(leaf)[0] == pytest.approx(2 * width * 7 / 8, rel=1e-12)
    assert axis_length(leaf)[0] == pytest.approx(1, rel=1e-12)
    arc = quad(lambda v: np.hypot(1, width * 4 * ((1 - v) ** 3 - v**3)), 0, 1)[0]
    assert silhouette_length(leaf)[0] == pytest.approx(2 * arc, rel=1e-9 if width < 0.5 else 1e-5)


def test_a_bent_flat_leaf_is_only_as_wide_as_before():
    straight, tilted = flat_leaf(), flat_leaf()
    tilted[0, 5], tilted[0, 6], tilted[0, 2:5, 2] = 0.1, 0.2, 0.3  # either half tilted up by 3 in 4: 5 for 4

    assert leaf_area(tilted)[0] == pytest.approx(1.25 * leaf_area(straight)[0], rel=1e-3)
    assert leaf_width(tilted)[0] == pytest.approx(leaf_width(straight)[0], rel=1e-12)


def test_an_axis_close_to_a_half_circle():
    # From (0, 0) to (0, 1): the cubic that is closest to a half circle of radius 1/2, off it by less than 1 %.
    leaf = flat_leaf()
    leaf[0, 0], leaf[0, 1] = (2 / 3, 0, 0), (2 / 3, 1, 0)

    assert axis_length(leaf)[0] == pytest.approx(np.pi / 2, rel=0.01)
    chords = evaluate_points(leaf, grid_places(0.0, np.linspace(0, 1, 20001)))[0]
    assert axis_length(leaf)[0] == pytest.approx(np.linalg.norm(np.diff(chords, axis=0), axis=1).sum(), rel=1e-7)


def test_natural_leaves_against_triangles_and_chords():
    leaves = vary_leaves(5, np.random.default_rng(3))
    points = evaluate_grid(leaves, np.linspace(-1, 1, 201), np.linspace(0, 1, 401)).points

    first = np.cross(points[:, 1:, :-1] - points[:, :-1, :-1], points[:, 1:, 1:] - points[:, :-1, :-1])
    second = np.cross(points[:, 1:, 1:] - points[:, :-1, :-1], points[:, :-1, 1:] - points[:, :-1, :-1])
    triangles = sum(np.linalg.norm(half, axis=-1).sum(axis=(1, 2)) / 2 for half in (first, second))
    assert leaf_area(leaves) == pytest.approx(triangles, rel=1e-4)
    chords = np.linalg.norm(np.diff(points[:, :, [0, -1]], axis=1), axis=-1).sum(axis=(1, 2))
    assert silhouette_length(leaves) == pytest.approx(chords, rel=1e-4)
    across = np.linalg.norm(points[:, :, -1] - points[:, :, 0], axis=-1).max(axis=1)
    assert leaf_width(leaves) == pytest.approx(across, rel=1e-4)
    assert (leaf_width(leaves) >= across - 1e-9).all()


def test_blocks_give_the_same(monkeypatch):
    leaves = random_leaves(50, spread=0.3)
    whole = [measure(leaves) for measure in MEASURES]
    monkeypatch.setattr(measures, "BLOCK", 7)

    for measure, expected in zip(MEASURES, whole, strict=True):
        assert measure(leaves) == pytest.approx(expected, rel=1e-14)


def test_no_leaves_and_leaves_of_no_width():
    thin = flat_leaf(width=0.0)

    assert all(measure(np.zeros((0, 7, 3))).shape == (0,) for measure in LENGTHS + MEASURES)
    assert [float(measure(thin)[0]) for measure in LENGTHS + MEASURES] == pytest.approx([1, 2, 0, 0], abs=1e-12)
    assert all(np.isfinite(measure(default_leaf()[None])).all() for measure in LENGTHS + MEASURES)
