"""Measures of leaves against true ones: known errors give known numbers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.model import Leaves

from tests.support.leaves.captures import known_foliage
from tools.bench.leaf_truth import TruthSettings, match_leaves, move_leaves, score_leaves


def joined(*parts: Leaves) -> Leaves:
    names = ("parameters", "base_m", "orientation", "length_m", "phase")
    return Leaves(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def turned_round(leaves: Leaves) -> Leaves:
    """End for end about the middle, as a fit that takes the apex for the base."""
    matrix = leaves.asset_from_leaf()
    half = Rotation.from_rotvec([0, 0, np.pi])
    return replace(
        leaves,
        base_m=leaves.base_m + matrix[:, :, 1],
        orientation=(Rotation.from_quat(leaves.orientation) * half).as_quat(),
    )


def test_the_true_leaves_are_all_found():
    foliage = known_foliage()
    scores = score_leaves(foliage.truth, foliage.visible, foliage.leaves)
    assert (scores.recall, scores.precision, scores.f1, scores.matched) == (1, 1, 1, 40)
    assert scores.distance_percent < 1.2  # points against points
    assert scores.distance_mm < 1.2 * 0.7
    assert scores.axis_error_deg == pytest.approx(0, abs=1e-3)
    assert scores.base_right == 1
    assert scores.tip_error_percent == pytest.approx(0, abs=1e-3)
    assert scores.length_error == pytest.approx(0, abs=1e-5)
    assert (scores.duplicates, scores.poor) == (0, 0)


def test_missing_leaves_cost_recall_and_invented_ones_precision():
    foliage = known_foliage()
    half = foliage.leaves.take(np.arange(0, 40, 2))
    far = replace(half, base_m=half.base_m + 100.0)
    scores = score_leaves(foliage.truth, np.ones(40), joined(half, far))
    assert scores.recall == pytest.approx(0.5)
    assert scores.precision == pytest.approx(0.5)
    assert scores.f1 == pytest.approx(0.5)


def test_hidden_leaves_are_not_missed():
    foliage = known_foliage()
    visible = np.where(np.arange(40) < 10, 0.3, 0.9)
    scores = score_leaves(foliage.truth, visible, foliage.leaves.take(np.arange(10, 40)))
    assert scores.visible == 30
    assert scores.recall == 1


def test_duplicates_are_counted():
    foliage = known_foliage()
    scores = score_leaves(foliage.truth, foliage.visible, joined(foliage.leaves, foliage.leaves.take([3, 4])))
    assert scores.matched == 40
    assert scores.duplicates == 2
    assert scores.precision == pytest.approx(40 / 42)


def test_ends_axes_and_lengths_have_their_errors():
    foliage = known_foliage()
    angle = np.radians(5)
    turn = (Rotation.from_quat(foliage.leaves.orientation) * Rotation.from_rotvec([0, 0, angle])).as_quat()
    bent = replace(foliage.leaves, orientation=turn, length_m=1.04 * foliage.leaves.length_m)
    scores = score_leaves(foliage.truth, np.full(40, 0.5), bent)
    assert scores.axis_error_deg == pytest.approx(5, abs=0.01)
    assert scores.length_ratio == pytest.approx(1.04, abs=1e-4)
    assert scores.length_error == pytest.approx(0.04, abs=1e-4)
    assert scores.half_hidden == scores.matched
    assert scores.half_hidden_length_error == pytest.approx(0.04, abs=1e-4)
    apex_error = np.hypot(1.04 * np.cos(angle) - 1, 1.04 * np.sin(angle))
    assert scores.tip_error_percent == pytest.approx(100 * apex_error / 2, abs=0.01)


def test_a_leaf_with_exchanged_ends_is_found_but_not_its_base():
    foliage = known_foliage()
    some = np.arange(0, 40, 4)
    mixed = joined(turned_round(foliage.leaves.take(some)), foliage.leaves.take(np.setdiff1d(np.arange(40), some)))
    scores = score_leaves(foliage.truth, foliage.visible, mixed, TruthSettings(max_distance=0.2))
    assert scores.matched == 40
    assert scores.base_right == pytest.approx(0.75)
    assert scores.axis_error_deg == pytest.approx(0, abs=1e-3)
    assert scores.tip_error_percent == pytest.approx(0, abs=1e-3)


def test_a_shift_is_measured_in_millimetres_and_percent():
    foliage = known_foliage()
    normal = foliage.leaves.asset_from_leaf()[:, :, 2]
    lifted = replace(foliage.leaves, base_m=foliage.leaves.base_m + 0.05 * normal)
    scores = score_leaves(foliage.truth, foliage.visible, lifted)
    assert 3 < scores.distance_percent < 5.2  # leaves are not flat, so the nearest point is less far
    assert scores.distance_mm == pytest.approx(scores.distance_percent / 100 * 70, rel=0.15)


def test_nothing_found_scores_nothing():
    foliage = known_foliage()
    scores = score_leaves(foliage.truth, foliage.visible, foliage.leaves.take(np.arange(0)))
    assert (scores.found, scores.matched, scores.recall) == (0, 0, 0)
    assert np.isnan(scores.precision)
    assert np.isnan(scores.distance_mm)


def test_scores_do_not_depend_on_the_frame():
    foliage = known_foliage()
    similarity = np.eye(4)
    similarity[:3, :3] = 3 * Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix()
    similarity[:3, 3] = 5, -2, 1
    rng = np.random.default_rng(0)
    shaken = replace(foliage.leaves, base_m=foliage.leaves.base_m + rng.normal(0, 0.002, (40, 3)))
    there = move_leaves(shaken, similarity)
    points = {
        name: getattr(foliage.truth, name) @ similarity[:3, :3].T + similarity[:3, 3]
        for name in ("base_m", "apex_m", "visible_m", "surface_m")
    }
    truth = replace(foliage.truth, length_m=3 * foliage.truth.length_m, **points)
    here, moved = match_leaves(foliage.truth, shaken), match_leaves(truth, there)
    np.testing.assert_array_equal(here.found, moved.found)
    np.testing.assert_allclose(here.distance, moved.distance, rtol=1e-9)
