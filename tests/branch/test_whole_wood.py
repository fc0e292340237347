import numpy as np
import pytest
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.whole_wood import measure_wholeness
from usdfoliage.geometry.smooth_mesh import refine_smooth

from tests.support.branch_shapes import fork


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
