"""Native samples of leaves' points against the same written plainly in numpy."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from usdfoliage import _native

BITS = 6


def thin(indices, max_count):
    rank, count = np.arange(len(indices)), max(len(indices), 1)
    kept = min(len(indices), max_count)
    return indices[(rank * kept) // count != ((rank - 1) * kept) // count]


def curve(points):
    extent = max(np.ptp(points, axis=0).max(), np.finfo(float).tiny)
    cell = ((points - points.min(axis=0)) / extent * (2**BITS - 1)).astype(int)
    return sum(((cell[:, axis] >> bit) & 1) << (3 * bit + axis) for bit in range(BITS) for axis in range(3))


def sample(points, edge, offsets, interior, max_edge, before, apart):
    chosen, alone, ends = [], [], [0]
    for first, last in pairwise(offsets):
        own = np.arange(first, last)[np.isfinite(points[first:last]).all(axis=1)]
        order = np.concatenate(
            [thin(own[edge[own] == 1], before * max_edge), thin(own[edge[own] == 0], before * interior)]
        )
        if len(order):
            order = order[np.argsort(curve(points[order]), kind="stable")]
        kept = np.concatenate([thin(order[edge[order] == 0], interior), thin(order[edge[order] == 1], max_edge)])
        picked = order[np.isin(order, kept)]
        far = np.zeros(len(picked), bool)
        if len(picked) > 4:
            distance = cKDTree(points[picked]).query(points[picked], k=5)[0][:, 4]
            far = distance > apart * np.median(distance)
        chosen.append(picked)
        alone.append(far)
        ends.append(ends[-1] + len(picked))
    return np.concatenate(chosen), np.concatenate(alone), np.array(ends)


def clouds(rng, sizes):
    points = np.concatenate([rng.normal(size=(size, 3)) * (1, 0.3, 0.05) + rng.normal(size=3) for size in sizes])
    points[rng.random(len(points)) < 0.05] += 3
    points[rng.random(len(points)) < 0.02, 1] = np.nan
    edge = (rng.random(len(points)) < 0.2).astype(np.uint8)
    return points, edge, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


def sampled(points, edge, offsets, interior, max_edge, before, threads):
    chosen = _native.SampleSettings(interior=interior, edge=max_edge, before_spread=before, apart=3.0)
    return _native.sample_leaf_points(points, edge, offsets, settings=chosen, threads=threads)


@settings(max_examples=25)
@given(
    st.lists(st.integers(0, 400), min_size=1, max_size=5),
    st.integers(1, 120),
    st.integers(1, 50),
    st.integers(1, 4),
    st.integers(0, 2**32 - 1),
)
def test_the_points_are_those_of_plain_python(sizes, interior, max_edge, before, seed):
    points, edge, offsets = clouds(np.random.default_rng(seed), sizes)

    found = sampled(points, edge, offsets, interior, max_edge, before, 2)

    index, apart, ends = sample(points, edge, offsets, interior, max_edge, before, 3.0)
    assert np.array_equal(found.index, index)
    assert np.array_equal(found.apart, apart)
    assert np.array_equal(found.offsets, ends)


@pytest.mark.parametrize("threads", [2, 5])
def test_threads_change_nothing(threads):
    points, edge, offsets = clouds(np.random.default_rng(1), [300] * 20)
    one, more = (sampled(points, edge, offsets, 50, 20, 4, count) for count in (1, threads))
    for name in ("index", "apart", "offsets"):
        assert np.array_equal(getattr(one, name), getattr(more, name))


def test_points_in_one_place_do_not_lie_apart():
    points = np.ones((30, 3))
    found = sampled(points, np.zeros(30, np.uint8), np.array([0, 30], np.int64), 20, 5, 4, 1)
    assert len(found.index) == 20
    assert not found.apart.any()
