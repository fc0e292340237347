"""How few vertices keep the silhouettes of a crown."""

import numpy as np
import pytest
from usdfoliage.geometry.crown_cage import build_crown_cage, crown_limit
from usdfoliage.geometry.crown_mesh import build_crown_mesh
from usdfoliage.geometry.crown_mesh_size import MeshSizeSettings, choose_mesh_size, draw_silhouette, spread_turns
from usdfoliage.geometry.cubemap import face_directions
from usdfoliage.geometry.picture_agreement import silhouette_iou


def crown(bumps: float, size: int = 65):
    """A ball of radius 1 with so many bumps around and along it."""
    x, y, z = np.moveaxis(face_directions(size), -1, 0)
    return 1 + 0.2 * np.cos(bumps * np.arctan2(z, x)) * np.cos(bumps * np.arcsin(np.clip(y, -1, 1)))


def test_the_silhouette_of_a_ball_is_a_disc():
    mesh = build_crown_mesh(np.ones((6, 33, 33)), np.zeros(3), 33)
    for turn in (np.eye(3), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])):
        covered = draw_silhouette(mesh.points_m, mesh.face_vertices, turn, 1.25, 500)
        assert covered.sum() == pytest.approx(np.pi * 200**2, rel=0.01)
        assert np.argwhere(covered).mean(axis=0) == pytest.approx([250, 250], abs=1)


def test_a_ball_needs_few_vertices_and_a_rough_crown_more():
    smooth, rough = (choose_mesh_size(crown(bumps)) for bumps in (1, 12))
    assert smooth <= 17 < rough <= 65


def test_the_chosen_cage_keeps_every_silhouette_drawn_as_it_is_and_subdivided_and_the_next_coarser_one_does_not():
    radius_m, settings = crown(5), MeshSizeSettings(sizes=(9, 17, 33, 49), finest=65)
    size = choose_mesh_size(radius_m, settings)
    assert size in (33, 49)
    exact = build_crown_mesh(radius_m, np.zeros(3), 65)
    turns = spread_turns(settings.views)
    wanted = [draw_silhouette(exact.points_m, exact.face_vertices, turn, 1.3, 400) for turn in turns]
    drawn = {}
    for n in (size, {33: 17, 49: 33}[size]):
        cage = build_crown_cage(radius_m, np.zeros(3), n)
        drawn[n] = [
            min(
                silhouette_iou(draw_silhouette(*surface, turn, 1.3, 400), silhouette)
                for turn, silhouette in zip(turns, wanted, strict=True)
            )
            for surface in ((cage.points_m, cage.face_vertices), crown_limit(cage, 2))
        ]
    chosen, coarser = drawn.values()
    assert chosen[1] >= 0.98
    assert chosen[0] >= 0.97 > coarser[0]
    assert chosen[1] > chosen[0]  # nearer where it is subdivided


def test_no_mesh_is_finer_than_its_map():
    assert choose_mesh_size(crown(12, size=9)) == 9


def test_a_crown_too_rough_for_any_cage_gets_the_finest_whose_surface_is_near_enough():
    radius_m = crown(12)
    chosen = MeshSizeSettings(sizes=(9, 17, 25), finest=33, min_iou=0.5, min_cage_iou=0.999)
    assert choose_mesh_size(radius_m, chosen) == 25
    assert choose_mesh_size(radius_m, MeshSizeSettings(sizes=(9, 17, 25), finest=33, min_iou=0.9999)) == 33
