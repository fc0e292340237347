"""What stands out of a crown, on tubes through a sphere."""

import numpy as np
import pytest
from usdfoliage.crown.bare_faces import find_bare_faces

from tests.support.crown_shapes import ellipsoid_radius

CENTER = np.array([1.0, 5.0, -2.0])


def ball(radius_m=2.0, size=17):
    """Radius and centre of a crown."""
    return ellipsoid_radius((radius_m,) * 3, size).astype(np.float32), CENTER


def tube(first, last, rings, sides=4, radius_m=0.01):
    """Quads along a line between two places from the crown's centre; points, counts, vertices."""
    first, last = np.array(first, float), np.array(last, float)
    along = (last - first) / np.linalg.norm(last - first)
    across = np.linalg.svd(along[None])[2][1:]
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = radius_m * (np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1])
    points = (first + np.linspace(0, 1, rings)[:, None] * (last - first))[:, None] + ring
    low = sides * np.arange(rings - 1)[:, None] + np.arange(sides)
    high = sides * np.arange(rings - 1)[:, None] + (np.arange(sides) + 1) % sides
    quads = np.stack([low, high, high + sides, low + sides], axis=-1).reshape(-1, 4)
    return points.reshape(-1, 3) + CENTER, np.full(len(quads), 4), quads.ravel()


def test_a_trunk_ends_as_deep_in_the_crown_as_was_asked():
    points, counts, vertices = tube((0, -4, 0), (0, 1, 0), rings=501)
    for sunk in (0.0, 0.15, 0.5):
        kept = find_bare_faces(points, counts, vertices, *ball(), sunk)
        seen = points[np.unique(vertices[np.repeat(kept, counts)]), 1] - CENTER[1]
        assert seen.min() == pytest.approx(-4)
        assert seen.max() == pytest.approx(-2 * (1 - sunk), abs=0.011)  # a ring is 0.01 m


def test_what_stays_below_the_surface_is_left_out():
    shallow = tube((-0.9, -1.6, 0), (0.9, -1.6, 0), rings=50)  # nowhere farther than 1.84 from the centre
    assert not find_bare_faces(*shallow, *ball()).any()
    deep = tube((0, 0, 0), (0, 1, 0), rings=50)  # through the centre itself
    assert not find_bare_faces(*deep, *ball()).any()


def test_of_several_branches_those_alone_are_kept_that_come_out():
    parts = [
        tube((0, -4, 0), (0, 1, 0), rings=40),
        tube((0, 0, 1.8), (1.0, 0, 1.5), rings=40),
        tube((3, 0, 0), (4, 0, 0), rings=9),
    ]
    first = np.cumsum([0] + [len(points) for points, _, _ in parts])
    points, counts = (np.concatenate([part[number] for part in parts]) for number in (0, 1))
    vertices = np.concatenate([part[2] + start for part, start in zip(parts, first, strict=False)])
    kept = np.split(
        find_bare_faces(points, counts, vertices, *ball()), np.cumsum([len(part[1]) for part in parts])[:-1]
    )
    assert kept[0].any()
    assert not kept[0].all()
    assert not kept[1].any()
    assert kept[2].all()


def test_faces_of_any_size_and_none_at_all_are_borne():
    points = CENTER + np.array([[3, 0, 0], [3, 1, 0], [3, 0, 1], [0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0.1, 0.1]])
    kept = find_bare_faces(points, np.array([3, 4]), np.array([0, 1, 2, 3, 4, 5, 6]), *ball())
    assert kept.tolist() == [True, False]
    assert find_bare_faces(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int), *ball()).shape == (0,)


def test_a_depth_that_cannot_be_is_refused():
    for sunk in (-0.1, 1.0, np.nan):
        with pytest.raises(ValueError, match="sunk"):
            find_bare_faces(*tube((0, -4, 0), (0, 1, 0), rings=4), *ball(), sunk)
