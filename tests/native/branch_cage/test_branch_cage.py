"""The native kernels of branch cages against what they compute, written plainly."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage import _native
from usdfoliage.branch.cage.exits import THICKEST, _Nearest, _walk
from usdfoliage.branch.cage.holes import MIN_COLUMN, RELAXED, TIGHTEST
from usdfoliage.branch.cage.tubes import find_paths, pack_paths

from tests.support import cage_reference as plain
from tests.support.branch_shapes import random_tree

WANT = [field.name for field in fields(plain.Want)]


def tubes_of(seed, max_branches=12):
    return pack_paths(find_paths(random_tree(seed, max_branches=max_branches))[0])


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 60))
def test_holes_find_the_same_places(seed, count):
    rng = np.random.default_rng(seed)
    parents = np.sort(rng.integers(0, 4, count))
    across = rng.uniform(0.002, 0.03, count)
    half = rng.uniform(0.4, 1.4, count)
    values = [rng.uniform(0, 1, count), rng.uniform(-4, 4, count), half, 0.9 * half, 0.8 * half]
    values += [2 * across, 1.2 * across, across, np.full(count, 0.04)]
    wants = np.stack(values, axis=1).reshape(-1, 9)
    tubes = 4 + count  # four that carry all others
    start, end = np.full(tubes, 0.02), np.full(tubes, 0.95)
    phases = np.where(rng.random(tubes) < 0.5, np.nan, rng.uniform(-3, 3, tubes))
    gone = (rng.random(tubes) < 0.1).astype(np.uint8)
    steep = np.array([[0.3, 0.35], [0.6, 0.61]])
    steep_first = np.array([0, 2] + [2] * (tubes - 1))
    want_first = np.searchsorted(parents, np.arange(tubes + 1))
    arcs_of, azimuth, half, tight, end_half, half_block, along, across, parent_radius = np.ascontiguousarray(wants.T)
    places = _native.place_holes(
        _native.HoleTubes(
            start_m=start,
            end_m=end,
            length_m=np.ones(tubes),
            phase_rad=phases,
            steep_m=steep,
            steep_first=steep_first,
            gone=gone,
        ),
        _native.HoleWants(
            tube=np.arange(4, tubes),
            first=want_first,
            arc_m=arcs_of,
            azimuth_rad=azimuth,
            half_rad=half,
            tight_rad=tight,
            end_half_rad=end_half,
            half_block_m=half_block,
            half_along_m=along,
            half_across_m=across,
            parent_radius_m=parent_radius,
        ),
        settings=_native.HoleSettings(tightest=TIGHTEST, relaxed=RELAXED, min_column_rad=MIN_COLUMN),
    )
    hole = np.column_stack([places.arc_m, places.azimuth_rad, places.half_along_m, places.half_across_m])
    by_tube = {}
    for number, parent in enumerate(parents.tolist()):
        by_tube.setdefault(parent, []).append(
            (4 + number, plain.Want(**dict(zip(WANT, [number, *wants[number].tolist()], strict=True))))
        )
    kept = [None if np.isnan(phase) else phase for phase in phases]
    steep_of = {0: [tuple(pair) for pair in steep.tolist()]}
    expected, turns, lost = plain.place_all(
        by_tube, start, end, np.ones(tubes), kept, steep_of, set(np.flatnonzero(gone).tolist())
    )
    np.testing.assert_array_equal(places.block_tube, [tube for tube, _, _ in expected])
    np.testing.assert_allclose(
        places.block_arcs_m,
        np.reshape(
            [(block.low_m, (block.low_m + block.high_m) / 2, block.high_m) for _, block, _ in expected], (-1, 3)
        ),
    )
    members = [
        (each, n, s) for n, (_, b, c) in enumerate(expected) for each, s in zip(b.members, c.sectors, strict=True)
    ]
    np.testing.assert_array_equal(places.want, [each.exit for each, _, _ in members])
    np.testing.assert_array_equal(places.block, [number for _, number, _ in members])
    np.testing.assert_array_equal(places.sector, [where for _, _, where in members])
    expected_holes = [(each.arc_m, each.azimuth_rad, each.half_along_m, each.half_across_m) for each, _, _ in members]
    np.testing.assert_allclose(hole, np.reshape(expected_holes, (-1, 4)), atol=1e-12)
    np.testing.assert_array_equal(places.turn_tube, [tube for tube, _, _ in turns])
    np.testing.assert_allclose(places.turn_arc_m, [arc for _, arc, _ in turns])
    np.testing.assert_allclose(places.turn_angles_rad, [angles for _, _, angles in turns], atol=1e-12)
    np.testing.assert_array_equal(np.sort(places.homeless), sorted(lost))


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_same_quads_cross(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(120, 3))
    faces = rng.integers(0, 120, (60, 4))
    faces = faces[[len(set(face)) == 4 for face in faces.tolist()]]
    counts = np.array([len(faces) // 2, len(faces) - len(faces) // 2 + 5])
    fork_faces = np.concatenate([np.arange(len(faces)), np.arange(5)])
    found = _native.find_fork_crossings(
        points, faces, fork_faces=fork_faces, fork_first=np.concatenate([[0], np.cumsum(counts)]), threads=2
    )
    named = {tuple(sorted(pair)) for pair in fork_faces[found].tolist()}
    assert len(named) == len(found)
    fork = np.repeat([0, 1], counts)
    one, two = np.triu_indices(len(fork_faces), 1)
    together = (fork[one] == fork[two]) & (fork_faces[one] != fork_faces[two])
    pairs = np.stack([fork_faces[one], fork_faces[two]], axis=1)[together]
    expected = pairs[plain.crossing_quads(points, faces, pairs)]
    assert named == {tuple(sorted(pair)) for pair in expected.tolist()}
    assert named


def test_limits_are_pulled_to_the_same_places():
    rng = np.random.default_rng(3)
    cube = np.array([(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])
    faces = np.concatenate([cube, cube + 8])
    aims, center = rng.normal(size=(2, 16, 3))
    tangents = rng.normal(size=(16, 3))
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    tangents[::3] = 0
    swell, gain = rng.uniform(-1, 1, (16, 2)), rng.uniform(0, 1, 16)
    expected = plain.pull_limit(faces, aims, tangents, swell, center, 5, gain)
    found = _native.pull_limit(
        faces,
        _native.LimitAims(aims_m=aims, tangents=tangents, swell=swell, center_m=center, gain=gain),
        rounds=5,
        farthest=plain.FARTHEST,
        threads=2,
    )
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("seed", [1, 3, 5, 6, 7])
@pytest.mark.parametrize("thickest", [None, THICKEST])
def test_tubes_walk_out_as_far(seed, thickest):
    tubes = tubes_of(seed)
    tube = np.flatnonzero(tubes.parent >= 0)
    assert len(tube)
    zero, clear = np.zeros(len(tube)), np.full(len(tube), 0.2)
    one, two = (_Nearest.start(tubes, tube, tubes.parent[tube]) for _ in range(2))
    arc, done = _walk(tubes, one, zero, clear, thickest)
    expected, came_out, at = plain.walk(tubes, two, zero, clear, thickest)
    np.testing.assert_allclose(arc, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(done, came_out)
    np.testing.assert_array_equal(one.at, at)


@pytest.mark.parametrize("seed", range(4))
def test_references_are_carried_as_in_plain_python(seed):
    tubes = tubes_of(seed)
    expected = np.zeros_like(tubes.reference)
    expected[tubes.first] = tubes.reference[tubes.first]
    plain.carry_references(tubes.direction, tubes.first, tubes.counts, expected)
    np.testing.assert_allclose(tubes.reference, expected, atol=1e-9)
    np.testing.assert_allclose(np.sum(tubes.reference * tubes.direction, axis=1), 0, atol=1e-12)
