"""Envelopes of other trees: what they keep, and how they spread."""

import numpy as np
import pytest
from usdfoliage.branch.growth.envelope import (
    Envelope,
    EnvelopeSettings,
    draw_envelope,
    measure_tree_place,
    warp_points,
    warp_skeleton,
)

from tests.support.branch_shapes import fork

ROOT_M = np.array([[2.0, 0.5, -1.0]])


def cylinder(count: int = 4000) -> np.ndarray:
    """Points in an upright cylinder of radius 1 and height 4 above the root."""
    rng = np.random.default_rng(0)
    turn, out, up = rng.uniform(0, 2 * np.pi, count), np.sqrt(rng.random(count)), rng.uniform(0, 4, count)
    up[:2] = 0, 4
    return ROOT_M + np.column_stack([out * np.cos(turn), up, out * np.sin(turn)])


def test_without_spread_nothing_moves():
    points_m = cylinder()
    envelope = draw_envelope(EnvelopeSettings(), 0.0, 7)
    assert envelope.size == 1
    np.testing.assert_allclose(
        warp_points(points_m, measure_tree_place(points_m, ROOT_M), envelope), points_m, atol=1e-12
    )


def test_the_root_stays_and_the_height_has_its_factor():
    points_m = cylinder()
    place = measure_tree_place(points_m, ROOT_M)
    for seed in range(20):
        envelope = draw_envelope(EnvelopeSettings(), 2.0, seed)
        np.testing.assert_allclose(warp_points(ROOT_M, place, envelope), ROOT_M, atol=1e-12)
        up_m = warp_points(points_m, place, envelope)[:, 1] - ROOT_M[0, 1]
        assert up_m.max() == pytest.approx(4 * envelope.height)
        order = np.argsort(points_m[:, 1])
        assert (np.diff(up_m[order]) >= 0).all()  # nothing is folded


def test_the_first_of_several_roots_stays():
    points_m = cylinder()
    roots_m = np.stack([ROOT_M[0], ROOT_M[0] + [1.5, 0.0, 0.0]])
    place = measure_tree_place(points_m, roots_m)
    for seed in range(5):
        moved_m = warp_points(roots_m, place, draw_envelope(EnvelopeSettings(), 1.0, seed))
        np.testing.assert_allclose(moved_m[0], ROOT_M[0], atol=1e-12)


def test_radii_have_their_factor_above_the_foot():
    points_m = cylinder()
    place = measure_tree_place(points_m, ROOT_M)
    moved_m = warp_points(points_m, place, Envelope(crown=1.3)) - ROOT_M
    before_m = points_m - ROOT_M
    above = before_m[:, 1] > 0.5
    wider = np.hypot(*moved_m[above][:, [0, 2]].T) / np.hypot(*before_m[above][:, [0, 2]].T)
    np.testing.assert_allclose(wider, 1.3)


def test_a_mirrored_tree_is_the_same_in_a_mirror():
    points_m = np.concatenate([cylinder(), [[3.0, 2.5, -0.5]]])
    place = measure_tree_place(points_m, ROOT_M)
    own = points_m[-1] - ROOT_M[0]
    mirrored = warp_points(points_m[-1:], place, Envelope(mirrored=True))[0] - ROOT_M[0]
    np.testing.assert_allclose(mirrored, [own[0], own[1], -own[2]], atol=1e-9)


def test_a_lean_is_the_slope_of_the_stem():
    points_m = cylinder()
    top_m = np.add(ROOT_M, [0.0, 4.0, 0.0])
    lean = Envelope(lean=np.array([0.1, 0.0]))
    moved_m = warp_points(top_m, measure_tree_place(points_m, ROOT_M), lean)
    np.testing.assert_allclose(moved_m, np.add(top_m, [0.4, 0, 0]), atol=1e-12)


def test_heights_and_crowns_spread_as_is_set():
    settings = EnvelopeSettings(height=0.1, crown=0.12, lean_deg=2.5)
    drawn = [draw_envelope(settings, 1.0, seed) for seed in range(400)]
    for values, deviation in (([each.height for each in drawn], 0.1), ([each.crown for each in drawn], 0.12)):
        assert np.mean(values) == pytest.approx(1, abs=4 * deviation / 20)
        assert np.std(values) == pytest.approx(deviation, rel=0.15)
    lean_deg = np.degrees(np.arctan([np.linalg.norm(each.lean) for each in drawn]))
    assert np.sqrt(np.mean(lean_deg**2)) == pytest.approx(2.5, rel=0.15)
    angle, share = np.random.default_rng(1).uniform(0, [[2 * np.pi], [1]], (2, 300))
    around, up = np.arange(4), np.cos(np.pi * share[:, None] * np.arange(3))
    logs = [
        np.einsum("na,ah,nh->n", np.cos(angle[:, None] * around), each.outline[0], up)
        + np.einsum("na,ah,nh->n", np.sin(angle[:, None] * around), each.outline[1], up)
        for each in drawn
    ]
    assert np.std(logs) == pytest.approx(settings.outline, rel=0.15)


def test_the_same_seed_is_the_same_tree_and_another_one_another():
    points_m = cylinder()
    place = measure_tree_place(points_m, ROOT_M)
    one, again, other = (
        warp_points(points_m, place, draw_envelope(EnvelopeSettings(), 1.0, seed)) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 0.1


def test_branches_go_with_their_points():
    skeleton = fork()
    envelope = draw_envelope(EnvelopeSettings(), 1.0, 3)
    place = measure_tree_place(skeleton.points_m, skeleton.points_m[:1])
    warped = warp_skeleton(skeleton, place, envelope)  # its forks are checked as it is made
    np.testing.assert_allclose(warped.points_m, warp_points(skeleton.points_m, place, envelope))
    np.testing.assert_allclose(warped.radius_m, envelope.size * skeleton.radius_m)


@pytest.mark.parametrize(
    "wrong", [{"height": -0.1}, {"crown": 0.9}, {"lean_deg": 60.0}, {"bend": float("nan")}, {"rise": 2.0}]
)
def test_amounts_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValueError, match="must"):
        EnvelopeSettings(**wrong)
