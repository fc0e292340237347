"""How few vertices keep the silhouettes of a crown."""

import numpy as np
import pytest
from usdfoliage.geometry.crown_mesh import build_crown_mesh
from usdfoliage.geometry.crown_mesh_size import MeshSizeSettings, choose_mesh_size, draw_silhouette
from usdfoliage.geometry.cubemap import face_directions


def crown(bumps: float, size: int = 65):
    """A ball of radius 1 with so many bumps around and along it."""
    x, y, z = np.moveaxis(face_directions(size), -1, 0)
    return 1 + 0.2 * np.cos(bumps * np.arctan2(z, x)) * np.cos(bumps * np.arcsin(np.clip(y, -1, 1)))


def test_the_silhouette_of_a_ball_is_a_disc():
    mesh = build_crown_mesh(np.ones((6, 33, 33)), np.zeros(3), 33)
    for turn in (np.eye(3), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])):
        covered = draw_silhouette(mesh, turn, 1.25, 500)
        assert covered.sum() == pytest.approx(np.pi * 200**2, rel=0.01)
        assert np.argwhere(covered).mean(axis=0) == pytest.approx([250, 250], abs=1)


def test_a_ball_needs_few_vertices_and_a_rough_crown_more():
    smooth, rough = (choose_mesh_size(crown(bumps)) for bumps in (1, 12))
    assert smooth <= 17 < rough <= 65


def test_the_chosen_mesh_keeps_every_silhouette_and_the_next_coarser_one_does_not():
    radius_m, settings = crown(8), MeshSizeSettings(sizes=(9, 17, 33, 49), finest=65)
    size = choose_mesh_size(radius_m, settings)
    assert size in (17, 33)
    exact, chosen, coarser = (build_crown_mesh(radius_m, np.zeros(3), n) for n in (65, size, size // 2 + 1))
    turn = np.eye(3)
    wanted, got, less = (draw_silhouette(mesh, turn, 1.3, 400) for mesh in (exact, chosen, coarser))
    assert (wanted & got).sum() / (wanted | got).sum() >= 0.98
    assert (wanted & less).sum() < (wanted & got).sum()


def test_no_mesh_is_finer_than_its_map():
    assert choose_mesh_size(crown(12, size=9)) == 9
