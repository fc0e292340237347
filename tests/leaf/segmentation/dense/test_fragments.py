"""Pieces of leaves: which to try as one, and their points put together."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.points import LeafPoints
from usdfoliage.leaf.segmentation.dense.fragments import append_points, join_points, pair_fragments

from tests.support.leaves.proposals import flat_leaves, proposed

LENGTH_M = 0.1
PER_POINT = ("points_m", "normals", "kind", "point_view")


def strips(*spans_m, seed: int = 0, count: int = 600) -> LeafPoints:
    """Points of flat pieces 4 cm wide: (from, to) along y, then where they begin along x, if not at 0."""
    rng = np.random.default_rng(seed)
    points = [
        np.column_stack(
            [
                rng.uniform(0, 0.4 * LENGTH_M, count) + (rest[0] if rest else 0),
                rng.uniform(begin, end, count),
                np.zeros(count),
            ]
        )
        for begin, end, *rest in spans_m
    ]
    return made_points(points)


def made_points(parts) -> LeafPoints:
    sizes = [len(part) for part in parts]
    total = sum(sizes)
    return LeafPoints(
        points_m=np.concatenate([*parts, np.zeros((0, 3))]),
        normals=np.tile([0.0, 0, 1], (total, 1)),
        kind=(np.arange(total) % 3).astype(np.uint8),
        point_view=(np.arange(total) % 5).astype(np.int32),
        offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        confidence=np.linspace(0.9, 0.1, len(parts)),
        view=np.arange(len(parts), dtype=np.int32),
    )


def part(points: LeafPoints, leaf: int, name: str):
    return getattr(points, name)[points.offsets[leaf] : points.offsets[leaf + 1]]


def pairs_of(points: LeafPoints, lengths_m, length_m: float = LENGTH_M):
    leaves = flat_leaves(np.zeros((len(points), 3)), np.asarray(lengths_m, float))
    return pair_fragments(proposed(leaves), points, length_m).tolist()


def test_halves_of_one_leaf_are_a_pair():
    assert pairs_of(strips((0, 0.05), (0.052, 0.1)), [0.05, 0.05]) == [[0, 1]]


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_scale_does_not_matter(scale):
    points = strips((0, 0.05), (0.052, 0.1), (0.16, 0.2))
    scaled = made_points([part(points, leaf, "points_m") * scale for leaf in range(3)])
    assert pairs_of(scaled, np.array([0.05, 0.05, 0.05]) * scale, LENGTH_M * scale) == [[0, 1]]


def test_two_whole_leaves_are_none():
    assert pairs_of(strips((0, 0.13), (0.002, 0.13, 0.041)), [0.13, 0.13]) == []  # side by side
    assert pairs_of(strips((0, 0.1), (0.101, 0.2)), [0.1, 0.1]) == []  # one after the other


def test_a_gap_parts_leaves_and_pieces_too_long_together_are_none():
    assert pairs_of(strips((0, 0.03), (0.06, 0.09)), [0.03, 0.03]) == []
    assert pairs_of(strips((0, 0.09), (0.091, 0.18)), [0.09, 0.09]) == []


def test_every_pair_once_and_in_order():
    points = strips((0, 0.03), (0.031, 0.06), (0.061, 0.09), (1.0, 1.05))
    assert pairs_of(points, [0.03, 0.03, 0.03, 0.05]) == [[0, 1], [1, 2]]


def test_leaves_without_points_and_lone_leaves_have_no_pair():
    assert pairs_of(made_points([]), []) == []
    assert pairs_of(strips((0, 0.05)), [0.05]) == []
    nothing = np.zeros((0, 3))
    half, rest = (part(strips((0, 0.05), (0.051, 0.1)), leaf, "points_m") for leaf in (0, 1))
    assert pairs_of(made_points([nothing, half, nothing, rest]), [0.05] * 4) == [[1, 3]]
    assert pairs_of(made_points([nothing, half]), [0.05] * 2) == []


@settings(max_examples=40, deadline=None)
@given(
    sizes=st.lists(st.integers(0, 6), min_size=1, max_size=6),
    pairs=st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), max_size=6),
    seed=st.integers(0, 1000),
)
def test_joined_points_are_those_of_both(sizes, pairs, seed):
    rng = np.random.default_rng(seed)
    points = made_points([rng.normal(size=(size, 3)) for size in sizes])
    pairs = np.array(pairs, np.int64).reshape(-1, 2) % len(sizes)
    joined = join_points(points, pairs)
    assert len(joined) == len(pairs)
    for number, (first, second) in enumerate(pairs):
        for name in PER_POINT:
            both = np.concatenate([part(points, first, name), part(points, second, name)])
            assert np.array_equal(part(joined, number, name), both)
        assert joined.confidence[number] == min(points.confidence[[first, second]])
        assert joined.view[number] == points.view[first]


@settings(max_examples=40, deadline=None)
@given(sizes=st.lists(st.integers(0, 5), max_size=5), more=st.lists(st.integers(0, 5), max_size=5))
def test_appended_points_follow_the_first(sizes, more):
    rng = np.random.default_rng(0)
    first, second = (made_points([rng.normal(size=(size, 3)) for size in some]) for some in (sizes, more))
    both = append_points(first, second)
    assert len(both) == len(first) + len(second)
    for leaf in range(len(both)):
        source, number = (first, leaf) if leaf < len(first) else (second, leaf - len(first))
        for name in PER_POINT:
            assert np.array_equal(part(both, leaf, name), part(source, number, name))
        assert both.confidence[leaf] == source.confidence[number]
        assert both.view[leaf] == source.view[number]
