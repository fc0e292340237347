"""Places on polylines that are nearest to points, against all segments in numpy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage._native import beyond_lines, nearest_on_lines

LINES = (np.array([[0, 0, 0], [0, 2, 0], [1, 2, 0]], float), np.array([[5, 0, 0], [5, 0, 4]], float))
POINTS = np.concatenate(LINES)
FIRST, COUNTS = np.array([0, 3], np.int32), np.array([3, 2], np.int32)


def on_segments(points, place):
    """Share and distance of a place for each segment."""
    step = np.diff(points, axis=0)
    share = np.clip(((place - points[:-1]) * step).sum(axis=1) / (step**2).sum(axis=1), 0, 1)
    return share, np.linalg.norm(place - points[:-1] - share[:, None] * step, axis=1)


def test_the_nearest_place_is_on_the_line_that_is_named():
    places = np.array([[1.0, 1.0, 0], [1, 1, 0], [0.5, 3, 0], [9, 2, 0]])
    line = np.array([0, 1, 0, 0], np.int32)
    segment, share = nearest_on_lines(POINTS, FIRST, COUNTS, places=places, line=line, threads=1)
    assert segment.tolist() == [0, 3, 1, 1]  # of two that are equally near, the first
    np.testing.assert_allclose(share, [0.5, 0, 0.5, 1])


def test_beyond_a_line_that_thins_counts_from_its_surface():
    radius = np.array([0.4, 0.4, 0.4, 0.5, 0.1])
    places = np.array([[5, 1, 2], [5, 0.1, 0], [5, 0, 6]], float)
    found = beyond_lines(POINTS, FIRST, COUNTS, places=places, line=np.ones(3, np.int32), radius=radius, threads=0)
    np.testing.assert_allclose(found, [1 - 0.3, 0.1 - 0.5, 2 - 0.1])


@given(st.integers(0, 2**32 - 1))
def test_any_lines_are_as_in_numpy(seed):
    random = np.random.default_rng(seed)
    counts = random.integers(2, 9, 5).astype(np.int32)
    first = (np.cumsum(counts) - counts).astype(np.int32)
    points, radius = random.normal(size=(counts.sum(), 3)), random.uniform(0, 1, counts.sum())
    line, places = random.integers(0, 5, 40).astype(np.int32), random.normal(size=(40, 3))
    segment, share = nearest_on_lines(points, first, counts, places=places, line=line, threads=0)
    beyond = beyond_lines(points, first, counts, places=places, line=line, radius=radius, threads=0)
    for k in range(40):
        own = slice(first[line[k]], first[line[k]] + counts[line[k]])
        shares, away = on_segments(points[own], places[k])
        assert away[segment[k] - own.start] == pytest.approx(away.min())
        assert share[k] == pytest.approx(shares[segment[k] - own.start])
        reach = (1 - shares) * radius[own][:-1] + shares * radius[own][1:]
        assert beyond[k] == pytest.approx((away - reach).min())
