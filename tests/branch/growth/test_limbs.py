"""Limbs that stand elsewhere on their stem, and stems that are kept."""

import numpy as np
import pytest
from usdfoliage.branch.growth.limbs import LimbSettings, move_limbs
from usdfoliage.branch.growth.seen_stems import fair_stems, thick_stems

from tests.support.branch_clouds import line
from tests.support.branch_shapes import plant_of

TREE = plant_of(
    ([[0, 0, 0], [0, 1, 0], [0, 2, 0], [0, 3, 0], [0, 4, 0]], 0.1, None, None),
    ([[0, 1, 0], [1, 2, 0]], [0.05, 0.02], 0, 1),
    ([[0, 2, 0], [0, 3, 1]], [0.05, 0.02], 0, 2),
    ([[1, 2, 0], [1.5, 2.2, 0]], [0.02, 0.01], 1, 1),
)
POINTS_M = np.concatenate(
    [line([0, 0, 0], [0, 4, 0], 81), line([0.3, 1.3, 0], [1, 2, 0], 21), line([0, 2.3, 0.3], [0, 3, 1], 21)]
)


def test_without_spread_nothing_moves():
    skeleton, points_m = move_limbs(TREE, POINTS_M, LimbSettings(), 0.0, 1)
    assert skeleton is TREE
    assert points_m is POINTS_M


def test_limbs_turn_about_their_stem_with_their_points():
    settings = LimbSettings(turn_deg=30, rise=0.0, change=0.0)
    skeleton, points_m = move_limbs(TREE, POINTS_M, settings, 1.0, 1)
    np.testing.assert_array_equal(points_m[:81], POINTS_M[:81])  # of the stem
    assert np.abs(points_m[81:] - POINTS_M[81:]).max() > 0.05
    np.testing.assert_allclose(points_m[:, 1], POINTS_M[:, 1], atol=1e-9)
    np.testing.assert_allclose(np.hypot(*points_m[:, [0, 2]].T), np.hypot(*POINTS_M[:, [0, 2]].T), atol=1e-9)
    np.testing.assert_allclose(skeleton.lengths_m[[0, 1, 3]], TREE.lengths_m[[0, 1, 2]])
    tip_m = skeleton.points_m[skeleton.branch(1)][-1]
    np.testing.assert_allclose(points_m[101], tip_m, atol=1e-9)


def test_limbs_are_left_out_and_doubled_as_often():
    settings = LimbSettings(change=0.5, max_share=1.0)
    counts = np.array([len(move_limbs(TREE, POINTS_M, settings, 1.0, seed)[0]) for seed in range(60)])
    assert set(counts.tolist()) == {1, 3, 5, 7}  # the limbs carry two branches and one
    assert np.mean(counts) == pytest.approx(4, abs=0.8)
    kept = LimbSettings(change=0.5, max_share=0.01)
    assert len(move_limbs(TREE, POINTS_M, kept, 1.0, 1)[0]) == 4


def test_limbs_leave_from_their_stem_where_they_are_raised():
    skeleton, _ = move_limbs(TREE, POINTS_M, LimbSettings(rise=0.3, change=0.0), 1.0, 5)
    leaves_at_m = skeleton.points_m[skeleton.parent_vertex[skeleton.order == 1]]
    np.testing.assert_allclose(leaves_at_m[:, [0, 2]], 0)
    assert leaves_at_m[:, 1].tolist() != [1, 2]


def test_no_limb_of_a_slanting_stem_leads_into_the_ground():
    slanting = plant_of(
        ([[0, 0, 0], [0.5, 0.5, 0], [1.5, 1, 0], [3, 1.5, 0]], 0.1, None, None),
        ([[0.5, 0.5, 0], [0.3, 2, 0], [0, 4, 0]], [0.05, 0.03, 0.02], 0, 1),
    )
    points_m = np.concatenate([line([0, 0, 0], [3, 1.5, 0], 31), line([0.4, 1, 0], [0, 4, 0], 31)])
    settings = LimbSettings(turn_deg=90, rise=0.0, change=0.0)
    turned = [move_limbs(slanting, points_m, settings, 1.0, seed) for seed in range(20)]
    assert min(skeleton.points_m[:, 1].min() for skeleton, _ in turned) >= 0
    assert np.std([skeleton.points_m[-1, 2] for skeleton, _ in turned]) > 0.3  # they turn all the same


def test_thick_stems_end_where_they_are_thin():
    tree = plant_of(
        ([[0, 0, 0], [0, 1, 0], [0, 2, 0], [0, 3, 0]], [0.1, 0.08, 0.05, 0.01], None, None),
        ([[0, 1, 0], [1, 2, 0], [1, 3, 0]], [0.05, 0.04, 0.01], 0, 1),
        ([[0, 3, 0], [1, 4, 0]], [0.05, 0.05], 0, 3),  # beyond where the stem is thin
        ([[1, 3, 0], [1, 4, 0]], [0.01, 0.01], 1, 2),
    )
    stems = thick_stems(tree, 0.04)
    assert stems is not None
    assert stems.counts.tolist() == [3, 2]
    np.testing.assert_array_equal(stems.points_m[-1], [1, 2, 0])
    assert thick_stems(tree, 0.2) is None


def test_stems_lose_short_waves_and_keep_long_ones():
    along_m = np.linspace(0, 10, 401)
    short_m, long_m = 0.02 * np.sin(2 * np.pi * along_m / 0.5), 0.5 * np.sin(2 * np.pi * along_m / 10)
    stem_m = np.column_stack([short_m, along_m, long_m])
    twig_m = stem_m[200] + np.column_stack([along_m[:41], 0 * along_m[:41], short_m[:41]])
    tree = plant_of((stem_m, 0.1, None, None), (twig_m, 0.05, 0, 200))
    fair = fair_stems(tree, 1.0)
    along_stem, amid = fair.points_m[:401], slice(40, 361)
    assert np.abs(along_stem[amid, 0]).max() < 0.02 / 12
    np.testing.assert_allclose(along_stem[:, 2], long_m, atol=0.01)
    np.testing.assert_allclose(along_stem[0], stem_m[0], atol=1e-6)
    np.testing.assert_allclose(fair.points_m[401], along_stem[200], atol=1e-6)
    assert np.abs(fair.points_m[401:][10:31, 2]).max() < np.abs(long_m[200]) + 0.02 / 4
    half = fair_stems(tree, 0.5)  # a wave of that length is half as high
    np.testing.assert_allclose(half.points_m[amid, 0], short_m[amid] / 2, atol=0.002)
    assert fair_stems(tree, 0.0) is tree


def test_stems_without_length_stay():
    point = plant_of(([[0, 0, 0], [0, 0, 0]], 0.1, None, None))
    assert fair_stems(point, 1.0) is point


@pytest.mark.parametrize("wrong", [{"turn_deg": -1.0}, {"change": 0.7}, {"min_share": 0.5}])
def test_settings_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValueError, match="must"):
        LimbSettings(**wrong)
