"""Hulls of crowns: closed, seen from outside, around all of the crown, and close to it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.geometry.crown_hull import divided_icosahedron, fit_crown_hull
from usdfoliage.geometry.cubemap import face_directions


def bumpy(seed: int, size: int = 24) -> np.ndarray:
    """A star-shaped crown of smooth random waves."""
    direction = face_directions(size)
    wave = np.random.default_rng(seed).normal(0, 3, (6, 3))
    return 2 + 0.25 * np.cos(direction @ wave.T).sum(axis=-1)


def distance_along(hull, center_m: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(D,) how far the hull is from the centre along unit directions (D, 3)."""
    corners = hull.points_m[hull.faces] - center_m
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    plane = np.einsum("fc,fc->f", normal, corners[:, 0])
    shares = np.einsum("fij,dj->dfi", np.linalg.inv(np.swapaxes(corners, 1, 2)), direction)
    inside = shares.min(axis=2) >= -1e-9
    away = plane / np.maximum(direction @ normal.T, 1e-12)
    return np.where(inside, away, np.inf).min(axis=1)


@given(st.integers(0, 500), st.integers(0, 2))
def test_a_hull_holds_its_crown(seed, divisions):
    radius_m, center_m = bumpy(seed), np.array([0.5, 3.0, -1.0])
    hull = fit_crown_hull(radius_m, center_m, divisions)
    direction = face_directions(radius_m.shape[1]).reshape(-1, 3)
    assert (distance_along(hull, center_m, direction) >= radius_m.reshape(-1) * 0.9999).all()
    assert np.linalg.norm(hull.points_m - center_m, axis=1).max() < 1.7 * radius_m.max()


@pytest.mark.parametrize(("divisions", "faces"), [(0, 20), (1, 80), (2, 320)])
def test_a_hull_is_closed_and_turned_outwards(divisions, faces):
    points, triangles = divided_icosahedron(divisions)
    assert len(triangles) == faces
    assert (np.linalg.det(points[triangles]) > 0).all()
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_around_a_ball_it_is_nearly_the_ball():
    hull = fit_crown_hull(np.full((6, 16, 16), 3.0), np.zeros(3), 1)
    reach = np.linalg.norm(hull.points_m, axis=1)
    assert reach.min() > 3.0
    assert reach.max() < 3.0 * 1.25


@pytest.mark.parametrize("size", [8, 16, 32])
def test_of_a_crown_with_a_spike_no_vertex_is_far_away(size):
    radius_m = np.full((6, size, size), 1.0)
    radius_m[0, size // 2 - 2 : size // 2 + 2, size // 2 - 2 : size // 2 + 2] = 4.0
    hull = fit_crown_hull(radius_m, np.zeros(3), 1)
    assert np.linalg.norm(hull.points_m, axis=1).max() < 1.7 * 4.0
    direction = face_directions(size).reshape(-1, 3)
    assert (distance_along(hull, np.zeros(3), direction) >= radius_m.reshape(-1) * 0.9999).all()


def test_around_a_slim_crown_it_is_slim():
    direction = face_directions(24)
    radius_m = 1 / np.sqrt(direction[..., 0] ** 2 + (direction[..., 1] / 4) ** 2 + direction[..., 2] ** 2)
    hull = fit_crown_hull(radius_m, np.zeros(3), 1)
    corners = hull.points_m[hull.faces]
    volume = np.linalg.det(corners).sum() / 6
    assert volume < 0.15 * 4 / 3 * np.pi * 4.2**3  # of the ball around it
