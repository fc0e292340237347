"""Spurs: what never leaves the stem that it springs from is no branch, and its points are the stem's."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.axes import find_axes
from usdfoliage.branch.tracing.reconstruct import reconstruct_branches
from usdfoliage.branch.tracing.sections import SectionTree
from usdfoliage.branch.tracing.spurs import absorb_spurs, find_spurs

from tests.support.branch_clouds import cone, line
from tests.support.branch_shapes import plant_of

STEM = (line([0, 0, 0], [0, 2, 0], 11), 0.1, None, 0)  # a vertex every 0.2 m
FORK = 2


def spurs_of(*branches: tuple, beyond_m: float = 0.03) -> list[bool]:
    skeleton = plant_of(STEM, *branches)
    return find_spurs(skeleton, np.full(len(skeleton.points_m), beyond_m)).tolist()


def from_stem(*points_m) -> tuple:
    return ([STEM[0][FORK], *points_m], 0.01, 0, FORK)


@pytest.mark.parametrize(("away_m", "is_spur"), [(0.05, True), (0.129, True), (0.131, False), (0.5, False)])
def test_what_runs_along_a_stem_is_a_spur_up_to_how_far_it_must_come_out(away_m, is_spur):
    assert spurs_of(from_stem([0, 0.6, away_m], [0, 1.5, away_m])) == [False, is_spur]


def test_a_branch_that_comes_out_somewhere_is_none_though_it_comes_back():
    assert spurs_of(from_stem([0.1, 0.6, 0], [0.2, 0.8, 0], [0.1, 1.0, 0])) == [False, False]


def test_above_its_tip_and_where_it_is_thin_a_stem_has_less_inside():
    thins = (STEM[0], np.linspace(0.1, 0.01, 11), None, 0)
    beside = plant_of(thins, from_stem([0.07, 0.5, 0]), from_stem([0.07, 0.5, 0], [0.07, 1.8, 0]))
    assert find_spurs(beside, np.zeros(len(beside.points_m))).tolist() == [False, True, False]
    assert spurs_of(from_stem([0, 2.1, 0]), from_stem([0, 2.2, 0])) == [False, True, False]


def test_what_carries_a_branch_that_comes_out_stays_and_what_a_spur_carries_goes():
    inside = from_stem([0.05, 0.6, 0])
    out = ([[0.05, 0.6, 0], [0.6, 0.6, 0]], 0.005, 1, 1)
    along = ([[0.05, 0.6, 0], [0.05, 1.4, 0.05]], 0.005, 1, 1)
    assert spurs_of(inside, out) == [False, False, False]
    assert spurs_of(inside, along) == [False, True, True]
    assert spurs_of(inside, out, along) == [False, False, False, False]


def test_the_points_of_a_spur_are_the_stems_at_their_height():
    stem_m, beside_m = line([0, 0, 0], [0, 5, 0], 6), line([0.2, 2, 0], [0.2, 4, 0], 3)
    nodes_m = np.concatenate([stem_m, beside_m, [[0.3, 4, 0]]])
    parent = np.array([-1, 0, 1, 2, 3, 4, 1, 6, 7, 8], np.int32)
    sections = SectionTree(
        center_m=nodes_m, points=np.ones(10, np.int32), parent=parent, section=np.arange(10, dtype=np.int32)
    )
    axes = find_axes(nodes_m, parent, 1.0)
    assert [axes.axis(number).tolist() for number in range(len(axes))] == [[0, 1, 2, 3, 4, 5], [1, 6, 7, 8, 9]]
    absorbed, kept = absorb_spurs(nodes_m, sections, axes, np.array([False, True]))
    assert kept.tolist() == [True] * 6 + [False] * 4
    assert absorbed.section.tolist() == [0, 1, 2, 3, 4, 5, 2, 3, 4, 4]
    assert absorbed.parent.tolist() == [-1, 0, 1, 2, 3, 4]
    assert absorbed.points.tolist() == [1, 1, 2, 2, 3, 1]
    np.testing.assert_allclose(absorbed.center_m[:, 0], [0, 0, 0.1, 0.1, 0.5 / 3, 0])
    same, kept = absorb_spurs(nodes_m, sections, axes, np.zeros(2, bool))
    assert kept.all()
    np.testing.assert_array_equal(same.section, sections.section)
    np.testing.assert_allclose(same.center_m, nodes_m)


def test_a_thick_stem_has_little_but_its_branch():
    """Points at random all around a thick stem, where slices fall apart: without this there were 91 branches."""
    stem_m = cone([0, 0, 0], [0, 5, 0], (0.1, 0.07), 12_000, 4, 0.004)
    branch_m = cone([0.08, 2.5, 0], [1.7, 4, 0], (0.05, 0.03), 3_000, 5, 0.001)
    skeleton = reconstruct_branches(np.concatenate([stem_m, branch_m]), np.zeros((1, 3))).skeleton
    assert not find_spurs(skeleton, 0.1 * skeleton.radius_m).any()
    tips_m = skeleton.points_m[skeleton.first + skeleton.counts - 1]
    for tip_m in ([0, 5, 0], [1.7, 4, 0]):
        assert np.linalg.norm(tips_m - tip_m, axis=1).min() < 0.15
    assert len(skeleton) <= 20
