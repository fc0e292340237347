"""The native UV mapping itself, against the same written plainly, and what the package never lets through."""

import numpy as np
import pytest
from usdfoliage import _native
from usdfoliage.leaf.shape.variation import vary_leaves

from tests.support.leaves.clouds import surface_points
from tests.support.leaves.fit_reference import ellipse_leaf, leaf_frame, map_points


def native_map(leaf, half_width, points, lines):
    uv, line, weights = np.empty((len(points), 2)), np.empty(len(points), np.int32), np.empty((lines, 2))
    _native.map_leaf_points(leaf, points, half_width=half_width, uv=uv, line=line, weights=weights)
    return uv, line, weights


@pytest.mark.parametrize("bend", [0.0, 0.15])
def test_the_mapping_is_the_same_as_written_plainly(bend):
    points, normals = surface_points(vary_leaves(1, np.random.default_rng(3))[0], 500, np.random.default_rng(0))
    base, axes, length, half_width = leaf_frame(points, normals)
    local = (points - base) @ axes.T / length
    leaf = ellipse_leaf(half_width)
    leaf[:2, 0] = bend, bend / 2

    uv, line, weights = native_map(leaf, half_width, local, 20)

    expected_uv, expected_line, expected_weights = map_points(leaf, half_width, local, 20)
    assert np.array_equal(line, expected_line)
    on = line >= 0
    assert uv[on] == pytest.approx(expected_uv[on], abs=1e-6)
    assert weights == pytest.approx(expected_weights, abs=1e-6)


def test_scanlines_of_a_flat_ellipse():
    half_width = 0.2
    u, v = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(0.005, 0.995, 100))
    points = np.column_stack([(u * 2 * half_width * np.sqrt(v * (1 - v))).ravel(), v.ravel(), np.zeros(v.size)])

    uv, line, weights = native_map(ellipse_leaf(half_width), half_width, points, 10)

    assert uv[:, 1] == pytest.approx(v.ravel(), abs=1e-9)  # across a straight axis v is y
    assert np.array_equal(line, np.minimum(v.ravel() * 10, 9).astype(int))
    assert np.abs(uv[:, 0]).max() <= 1
    assert (weights > 0.9).all()  # the points reach the ellipse everywhere
    assert np.sign(uv[:, 0]) == pytest.approx(np.sign(np.round(points[:, 0], 12)))


def test_a_half_that_falls_short_of_the_ellipse_weighs_less():
    half_width = 0.2
    u, v = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(0.005, 0.995, 100))
    hidden = (u > 0.25) & (v > 0.5)
    x = u * 2 * half_width * np.sqrt(v * (1 - v))
    points = np.column_stack([x[~hidden], v[~hidden], np.zeros((~hidden).sum())])

    uv, line, weights = native_map(ellipse_leaf(half_width), half_width, points, 10)

    assert weights[5:, 0] == pytest.approx(0.27, abs=0.08)  # eq. 10: x_s / (x_s + x_e)
    assert (weights[5:, 1] > 0.9).all()
    assert uv[(line >= 5), 0].max() < 0.5  # what is seen of it is not taken for all of it


def test_an_output_that_cannot_be_written_in_place_is_refused():
    points, uv, line, weights = np.zeros((4, 3)), np.empty((4, 2), np.float32), np.empty(4, np.int32), np.empty((8, 2))
    with pytest.raises(TypeError):
        _native.map_leaf_points(np.zeros((7, 3)), points, half_width=0.2, uv=uv, line=line, weights=weights)
    offsets, centers, half_axes, angles = np.array([0, 4]), np.empty((1, 2), np.float32), np.empty((1, 2)), np.empty(1)
    with pytest.raises(TypeError):
        _native.enclosing_ellipses(
            points[:, :2].copy(),
            offsets,
            tolerance=1e-6,
            centers=centers,
            half_axes=half_axes,
            angles=angles,
            threads=1,
        )
