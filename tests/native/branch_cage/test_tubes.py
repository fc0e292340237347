"""The native functions of tubes against what they compute, written plainly."""

import numpy as np
import pytest
from usdfoliage import _native
from usdfoliage.branch.cage.rings import GROWTH, LONG, MAX_SAMPLES, PER_INTERVAL, STEADY
from usdfoliage.branch.cage.tubes import find_paths, pack_paths

from tests.support import tube_reference as plain
from tests.support.branch_shapes import random_tree

SEEDS = range(6)


def tubes_of(seed):
    return pack_paths(find_paths(random_tree(seed, max_branches=12, wild=seed % 2 == 1))[0])


def places_of(tubes, seed, count=9000):
    """Tubes and arcs: ends and vertices of axes among them, and places beyond both ends."""
    rng = np.random.default_rng(seed)
    tube = rng.integers(0, len(tubes), count)
    arc = rng.uniform(-0.1, 1.1, count) * tubes.length_m[tube]
    at_vertex = rng.random(count) < 0.2
    arc[at_vertex] = tubes.arc_m[tubes.first[tube] + rng.integers(0, tubes.counts[tube])][at_vertex]
    return tube, arc


@pytest.mark.parametrize("seed", SEEDS)
def test_places_on_axes_are_the_same(seed):
    tubes = tubes_of(seed)
    tube, arc = places_of(tubes, seed)
    for found, expected in zip(tubes.axis(tube, arc), plain.axis(tubes, tube, arc), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_tangents_and_frames_are_the_same(seed):
    tubes = tubes_of(seed)
    tube, arc = places_of(tubes, seed)
    arc = np.clip(arc, 0, tubes.length_m[tube])
    reach = np.random.default_rng(seed).uniform(0.001, 0.3, len(tube))
    tangent = tubes.tangents(tube, arc, reach)
    np.testing.assert_allclose(tangent, plain.tangents(tubes, tube, arc, reach), rtol=1e-9, atol=1e-9)
    first, second = tubes.frames(tube, arc, tangent)
    for found, expected in zip((first, second), plain.frames(tubes, tube, arc, tangent), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.cross(first, second), tangent, atol=1e-9)


def test_an_axis_that_comes_back_has_the_direction_of_its_segment():
    there_and_back = np.array([[0.0, 0, 0], [0, 1, 0], [1e-3, 0, 0]])
    arc = np.array([0, 1, 2.0])
    direction = np.array([[0.0, 1, 0], [0, -1, 0], [0, -1, 0]])
    axes = _native.TubeAxes(
        points_m=there_and_back,
        radius_m=np.full(3, 0.1),
        arc_m=arc,
        direction=direction,
        first=np.array([0]),
        counts=np.array([3]),
    )
    places = np.zeros(2, int), np.array([0.95, 1.05])
    tangent = _native.tube_tangents(axes, *places, reach_m=np.full(2, 0.5), threads=0)
    np.testing.assert_allclose(tangent, [[0, 1, 0], [0, -1, 0]], atol=0.2)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_nearest_places_are_the_same(seed):
    tubes = tubes_of(seed)
    tube, arc = places_of(tubes, seed, 200)
    at = tubes.segment(tube, np.clip(arc, 0, tubes.length_m[tube]))
    places = tubes.axis(tube, arc)[0] + np.random.default_rng(seed).normal(size=(200, 3)) * 0.2
    near = _native.tube_nearest(tubes.axes, tube, at, places_m=places, max_steps=400, threads=0)
    found, on = (near.points_m, near.arc_m, near.radius_m), near.at
    for one, other in zip(found, plain.nearest(tubes, tube, at, places), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    # At a corner either of its segments is right.
    np.testing.assert_array_less(tubes.arc_m[on] - 1e-9, found[1])
    np.testing.assert_array_less(found[1], tubes.arc_m[on + 1] + 1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_gaps_are_filled_as_in_the_reference(seed):
    tubes = tubes_of(seed)
    rng = np.random.default_rng(seed)
    tube = np.sort(rng.integers(0, len(tubes), 150))
    ends = np.sort(rng.random((150, 2)), axis=1) * tubes.length_m[tube][:, None]
    spacing = np.where(rng.random((150, 2)) < 0.5, np.inf, rng.uniform(0.01, 0.1, (150, 2)))
    gaps = np.column_stack([ends[:, 0], np.maximum(np.diff(ends)[:, 0], 1e-4), spacing])
    expected = plain.fill_gaps(tubes, tube, gaps, 0.05, 30.0)
    low, length, below, above = np.ascontiguousarray(gaps.T)
    added = _native.fill_gaps(
        tubes.axes,
        _native.RingGaps(tube=tube, low_m=low, length_m=length, below_m=below, above_m=above),
        turned_rad=tubes.turned_rad,
        settings=_native.RingSpacingSettings(
            tolerance=0.05,
            longest=30.0,
            growth=GROWTH,
            steady=STEADY,
            long_segment=LONG,
            max_reach_m=0.25 * tubes.stride_m,
            min_samples=PER_INTERVAL,
            max_samples=MAX_SAMPLES,
        ),
        threads=0,
    )
    gap, arc = added.gap, added.arc_m
    np.testing.assert_array_equal(gap, [number for number, _ in expected])
    np.testing.assert_allclose(arc, [place for _, place in expected], rtol=1e-9)
    assert len(gap)


@pytest.mark.parametrize("seed", SEEDS)
def test_rings_in_bends_are_made_smaller_as_in_the_reference(seed):
    tubes = tubes_of(seed)
    count = 4000
    tube, arc = places_of(tubes, seed, count)
    order = np.lexsort([arc, tube])
    tube, arc = tube[order], np.clip(arc, 0, tubes.length_m[tube])[order]
    arc += 1e-6 * np.arange(count)
    center, radius = tubes.axis(tube, arc)
    tangent = tubes.tangents(tube, arc, radius)
    angles = np.linspace(0, 2 * np.pi, 7)[:-1] + np.random.default_rng(seed).uniform(0, 1, (count, 1))
    first, second = tubes.frames(tube, arc, tangent)
    rings = tube, center, tangent, first, second, angles
    rounded = _native.round_rings(
        _native.RingCircles(
            tube=tube,
            center_m=center,
            tangent=tangent,
            first=first,
            second=second,
            angles_rad=angles,
            radius_m=radius,
        ),
        at_vertices=1.002,
        threads=0,
    )
    points, found = rounded.points_m, rounded.radius_m
    expected_points, expected = plain.round_rings(*rings, radius, 1.002)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    np.testing.assert_allclose(points, expected_points, rtol=1e-9, atol=1e-12)
    assert (found < radius).any()


@pytest.mark.parametrize("seed", range(10))
def test_starts_are_bent_as_in_the_reference(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 30))
    points = np.cumsum(rng.normal(size=(count, 3)), axis=0)
    radius = rng.uniform(0.1, 1, count)
    step, kept, fade = rng.normal(size=3), float(rng.uniform(0, 2)), float(rng.uniform(0.1, 20))
    expected = plain.bend_start(points, radius, step, kept, fade, 8, 0.02)
    settings = _native.StartBendSettings(kept_m=kept, fade_m=fade, samples=8, min_apart=0.02)
    bent = _native.bend_start(points, radius, step_m=step, settings=settings)
    found = bent.old_arc_m, bent.points_m, bent.radius_m, bent.moved_m, bent.new_arc_m
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
