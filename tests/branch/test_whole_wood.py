import numpy as np
import pytest
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.whole_wood import bare_lengths, measure_wholeness
from usdfoliage.geometry.smooth_mesh import refine_smooth

from tests.support.branch_shapes import fork, plant_of


def surface(skeleton):
    cage = build_branch_cage(skeleton)
    return refine_smooth(cage.points_m, cage.faces, 2)


def test_a_whole_plant_has_one_piece_and_no_bare_axis():
    found = measure_wholeness(fork(), *surface(fork()))
    assert (found.pieces, found.afloat, found.bare) == (1, 0, 0)


def test_an_axis_without_surface_is_bare():
    found = measure_wholeness(fork(), *surface(fork().up_to_order(0)))
    twig = np.sqrt(0.5)
    assert found.bare == pytest.approx((0.85 + twig) / (3 + twig), abs=0.05)  # the branch begins inside of the trunk


def test_a_piece_beside_the_rest_is_afloat():
    points, faces = surface(fork())
    other = points[faces].reshape(-1, 3).min(axis=0) - points.max(axis=0) - 0.4
    moved = np.concatenate([points, points + other])
    found = measure_wholeness(fork(), moved, np.concatenate([faces, faces + len(points)]))
    assert (found.pieces, found.afloat) == (2, 1)
    assert found.widest_gap_m > 0.3


def test_a_branch_does_not_cover_its_own_tip():
    """However thick it is below: it would be bare only where it is long."""
    axis = np.array([[0, 0.0, 0], [0, 1.0, 0], [0, 1.3, 0]])
    short = plant_of((axis[:2], np.array([0.3, 0.3]), None, 0))
    whole = plant_of((axis, np.array([0.3, 0.3, 0.1]), None, 0))
    points, faces = surface(short)
    points[:, 1] *= 0.8 / points[:, 1].max()
    (bare_m,) = bare_lengths(whole, points, faces, edges=0.0)
    above = np.linspace(1.0, 1.3, 10001)
    radius = 0.3 - (above - 1.0) / 0.3 * 0.2
    assert bare_m == pytest.approx(0.3 * (above - 0.8 > 2 * radius).mean(), abs=0.05)
    assert bare_m > 0.05
