"""Distances of the pieces of a mesh, against all pairs of points and triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage._native import piece_gaps

from tests.support.branch_shapes import BOX, QUADS

TRIANGLES = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
EDGES = np.concatenate([np.stack([TRIANGLES[:, k], TRIANGLES[:, (k + 1) % 3]], axis=1) for k in range(3)])


def gaps(boxes, **options):
    """Of every box to all others."""
    count = len(boxes)
    points = np.concatenate(boxes)
    return piece_gaps(
        points,
        np.concatenate([TRIANGLES + 8 * k for k in range(count)]).astype(np.int32),
        np.repeat(np.arange(count, dtype=np.int32), 8),
        asked_edges=np.concatenate([EDGES + 8 * k for k in range(count)]).astype(np.int32),
        asked_first=np.arange(count + 1, dtype=np.int64) * len(EDGES),
        asked_pieces=np.arange(count, dtype=np.int32),
        **{"near_enough": 0.0, "through": True, "threads": 0, **options},
    )


def distance(point, a, b, c):
    """Of a point to a triangle, by its plane and its three sides."""
    normal = np.cross(b - a, c - a)
    normal = normal / np.linalg.norm(normal)
    foot = point - ((point - a) @ normal) * normal
    sides = ((a, b), (b, c), (c, a))
    if all(np.cross(end - start, foot - start) @ normal >= 0 for start, end in sides):
        return abs((point - a) @ normal)
    shares = [np.clip((point - s) @ (e - s) / ((e - s) @ (e - s)), 0, 1) for s, e in sides]
    return min(np.linalg.norm(point - s - share * (e - s)) for (s, e), share in zip(sides, shares, strict=True))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_gaps_are_those_of_all_pairs(seed):
    rng = np.random.default_rng(seed)
    boxes = [0.3 * rng.uniform(0.2, 1) * BOX + rng.uniform(0, 1.5, 3) for _ in range(4)]
    found = gaps(boxes, through=False)
    for own, box in enumerate(boxes):
        others = [other[TRIANGLES] for k, other in enumerate(boxes) if k != own]
        wanted = min(distance(p, *t) for p in box for t in np.concatenate(others))
        assert found[own] == pytest.approx(wanted, abs=1e-12)


def test_a_box_that_sticks_in_another_has_no_gap_though_its_corners_are_far():
    post = BOX * [0.1, 0.1, 4] + [0.45, 0.45, -2]
    assert gaps([BOX, post])[1] == 0
    assert gaps([BOX, post], through=False)[1] == pytest.approx(1)
    assert gaps([BOX, BOX + np.array([3, 0, 0])]).tolist() == pytest.approx([2, 2])


def test_one_piece_is_infinitely_far_from_all_others():
    assert gaps([BOX]).tolist() == [np.inf]


def test_what_is_near_enough_is_not_looked_at_again():
    two = [BOX, BOX + np.array([1.5, 0.3, 0])]
    assert gaps(two, near_enough=10.0).max() < 10
    assert np.array_equal(gaps(two, threads=1), gaps(two, threads=2))
