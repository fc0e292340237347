"""The fringe of background that has the depth of what stands before it, against a plain reference."""

import numpy as np
import pytest
from usdfoliage import _native

RADIUS, GAP, CONTRAST, NEARER = 3, 0.02, 24.0, 0.4
SETTINGS = _native.FringeSettings(fringe_px=RADIUS, gap=GAP, fringe_contrast=CONTRAST, fringe_nearer=NEARER)


def find(depth_m, srgb, threads=1):
    return _native.find_fringe(depth_m, srgb, settings=SETTINGS, threads=threads)


def reference(depth_m, srgb):
    height, width = depth_m.shape
    fringe = np.zeros((height, width), np.uint8)
    for row in range(height):
        for column in range(width):
            own_m = depth_m[row, column]
            if own_m <= 0:
                continue
            square = (
                slice(max(0, row - RADIUS), row + RADIUS + 1),
                slice(max(0, column - RADIUS), column + RADIUS + 1),
            )
            near, colors = depth_m[square], srgb[square].astype(float)
            behind = (near <= 0) | (near > own_m * (1 + GAP))
            surface = (near >= own_m * (1 - GAP)) & ~behind
            if behind.sum() * 10 < behind.size:
                continue
            own, of_surface, of_behind = srgb[row, column], colors[surface].mean(0), colors[behind].mean(0)
            distinct = np.abs(of_surface - of_behind).sum() >= CONTRAST
            fringe[row, column] = distinct and np.abs(own - of_behind).sum() < NEARER * np.abs(own - of_surface).sum()
    return fringe


def twig(contrast=150):
    """A twig of 3 columns, whose depth reaches 3 further on both sides."""
    depth_m = np.zeros((20, 30), np.float32)
    depth_m[:, 10:19] = 1
    srgb = np.full((20, 30, 3), 40, np.uint8)
    srgb[:, 13:16, 1] += contrast
    return depth_m, srgb


def test_a_twig_keeps_its_depth_and_its_fringe_does_not():
    depth_m, srgb = twig()
    for _ in range(3):
        depth_m[find(depth_m, srgb) != 0] = 0
    assert (depth_m[:, 13:16] > 0).all()
    assert not depth_m[:, :13].any()
    assert not depth_m[:, 16:].any()


def test_where_colors_are_similar_there_is_no_fringe():
    depth_m, srgb = twig(contrast=20)
    assert not find(depth_m, srgb).any()


def test_what_lies_farther_is_behind_and_what_is_nearer_is_not():
    depth_m, srgb = twig()
    depth_m[depth_m == 0] = 2.0  # a wall
    assert find(depth_m, srgb).any()
    depth_m[depth_m == 2] = 0.5  # the surface is seen through a slit
    assert not find(depth_m, srgb)[depth_m == 1].any()


@pytest.mark.parametrize("seed", range(4))
def test_as_the_reference_and_for_any_threads(seed):
    rng = np.random.default_rng(seed)
    depth_m = rng.choice(np.array([0, 1, 1.01, 1.5, 2], np.float32), (23, 31))
    srgb = rng.choice(np.array([30, 34, 200], np.uint8), (23, 31, 1), p=[0.4, 0.4, 0.2]) + np.zeros(3, np.uint8)
    srgb[depth_m == 0] //= 3
    found = find(depth_m, srgb)
    assert found.any()
    np.testing.assert_array_equal(found, reference(depth_m, srgb))
    np.testing.assert_array_equal(found, find(depth_m, srgb, threads=3))
