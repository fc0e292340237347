"""Collective edits: what each operation does to the leaf, and how edits add up and undo each other."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from usdfoliage.leaf.shape.edits import (
    NEUTRAL,
    LeafEdits,
    apply_edits,
    bend_axis,
    compose_edits,
    curl,
    invert_edits,
    jitter_silhouette,
    scale_width,
    shift_silhouette,
    skew_axis,
    slim_leaves,
)
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_grid

from tests.support.leaves.assets import random_leaves

FEW = settings(max_examples=40, deadline=None)
U = np.linspace(-1, 1, 9)
V = np.linspace(0, 1, 11)

numbers = st.floats(-2, 2, allow_subnormal=False)
vectors = st.tuples(numbers, numbers, numbers)


def edits(widths=st.floats(0.1, 8)):
    return st.builds(
        LeafEdits,
        width=widths,
        axis1=vectors,
        axis2=vectors,
        silhouette1=vectors,
        silhouette2=vectors,
        silhouette3=vectors,
        curl=vectors,
        jitter_amplitude=st.floats(0, 0.2),
        jitter_frequency=st.floats(0.5, 40),
    )


wild_leaves = hnp.arrays(np.float64, (2, 7, 3), elements=st.floats(-3, 3))


def flat_leaf():
    """A straight, flat leaf whose axis runs evenly, so that A(v) = (0, v, 0)."""
    leaf = np.zeros((1, 7, 3))
    leaf[0, 0] = 0, 1 / 3, 0
    leaf[0, 1] = 0, 2 / 3, 0
    leaf[0, 2:5, 0] = 0.25, 0.5, 0.75
    leaf[0, 2:5, 1] = 0.2, 0.3, 0.1
    return leaf


def points(leaf, edit, **kwargs):
    jitter = Jitter(amplitude=edit.jitter_amplitude, frequency=edit.jitter_frequency)
    return evaluate_grid(apply_edits(leaf, edit), U, V, jitter, **kwargs).points


def test_neutral_edits_change_nothing_and_copy():
    leaf = flat_leaf()
    edited = apply_edits(leaf, NEUTRAL)
    np.testing.assert_array_equal(edited, leaf)
    assert not np.shares_memory(edited, leaf)


def test_no_leaves_stay_no_leaves():
    assert apply_edits(np.empty((0, 7, 3)), scale_width(NEUTRAL, 2)).shape == (0, 7, 3)


def test_width_scales_a_flat_leaf_exactly():
    leaf = flat_leaf()
    wide = points(leaf, scale_width(NEUTRAL, 2))
    np.testing.assert_array_equal(wide[..., 0], 2 * points(leaf, NEUTRAL)[..., 0])
    np.testing.assert_array_equal(wide[..., 1:], points(leaf, NEUTRAL)[..., 1:])


def test_width_0_makes_a_line_of_a_flat_leaf():
    assert not points(flat_leaf(), scale_width(NEUTRAL, 0))[..., 0].any()


def test_skewing_the_axis_moves_the_whole_leaf_in_its_plane():
    bent = points(flat_leaf(), skew_axis(NEUTRAL, 0.2, 0.0))
    middle = 5  # v = 0.5, where the curve is moved by 3/4 of what its two control points are
    assert bent[0, middle, 4, 0] == pytest.approx(0.15)
    assert not bent[..., 2].any()
    assert bent[0, middle, 8, 0] + bent[0, middle, 0, 0] > 0.1  # no longer the mirror image of each other


def test_one_axis_point_may_be_moved_alone():
    assert skew_axis(NEUTRAL, 0.1, 0.2, points=(1,)) == LeafEdits(axis1=(0.1, 0.2, 0.0))
    assert bend_axis(NEUTRAL, 0.3, points=(2,)) == LeafEdits(axis2=(0.0, 0.0, 0.3))


def test_bending_the_axis_lifts_all_curves_between_base_and_apex_equally():
    leaf = flat_leaf()
    bent, flat = points(leaf, bend_axis(NEUTRAL, 0.4)), points(leaf, NEUTRAL)
    assert bent[0, 5, 4, 2] == pytest.approx(0.3)
    np.testing.assert_allclose(bent[..., :2], flat[..., :2], atol=1e-15)


def test_a_silhouette_point_moves_both_halves_and_the_curves_between():
    leaf = flat_leaf()
    moved = points(leaf, shift_silhouette(NEUTRAL, 2, 0.1, 0.06, -0.2)) - points(leaf, NEUTRAL)
    weight = 6 * V**2 * (1 - V) ** 2  # of the middle control point in the quartic
    np.testing.assert_allclose(moved[0, :, 8], weight[:, None] * (0.06, 0.1, -0.2), atol=1e-15)
    np.testing.assert_allclose(moved[0, :, 0], weight[:, None] * (-0.06, 0.1, -0.2), atol=1e-15)
    np.testing.assert_allclose(moved[0, :, 6, 0], weight * 0.06 / 2, atol=1e-15)  # u = 1/2
    np.testing.assert_allclose(moved[0, :, 4], 0, atol=1e-15)  # not the axis


def test_curl_raises_each_curve_by_itself():
    edit = curl(NEUTRAL, 0.1, -0.2, 0.3)
    lifted = apply_edits(flat_leaf(), edit)[0]
    np.testing.assert_array_equal(lifted[5], [0.1] * 3)
    np.testing.assert_array_equal(lifted[6], [-0.2] * 3)
    np.testing.assert_array_equal(lifted[2:5, 2], [0.3] * 3)


def test_jitter_waves_the_silhouette_and_not_the_axis():
    leaf = flat_leaf()
    moved = points(leaf, jitter_silhouette(NEUTRAL, 0.05, 6)) - points(leaf, NEUTRAL)
    assert np.abs(moved[0, :, 8, 0]).max() > 0.01
    np.testing.assert_allclose(moved[0, :, 0, 0], -moved[0, :, 8, 0], atol=1e-15)
    assert not moved[0, :, 4].any()


def test_operations_add_up_and_jitter_replaces():
    edit = scale_width(scale_width(NEUTRAL, 2), 3)
    edit = shift_silhouette(scale_width(shift_silhouette(edit, 1, 0.1, 0.1), 2), 1, 0.1, 0.1)
    assert edit.width == 12
    assert edit.silhouette1 == pytest.approx((0.2, 0.3, 0.0))  # the first shift was widened with the leaf
    edit = jitter_silhouette(jitter_silhouette(edit, 0.1, 4), 0.02, 9)
    assert (edit.jitter_amplitude, edit.jitter_frequency) == (0.02, 9)
    assert jitter_silhouette(edit, 0).jitter_amplitude == 0


def test_a_silhouette_point_may_leave_the_leaf_and_come_back():
    leaf = flat_leaf()
    out = apply_edits(leaf, shift_silhouette(NEUTRAL, 3, 0.6, 0))
    assert out[0, 4, 0] == pytest.approx(1.35)
    np.testing.assert_allclose(apply_edits(out, shift_silhouette(NEUTRAL, 3, -0.6, 0)), leaf, atol=1e-15)


@FEW
@given(leaf=wild_leaves, first=edits(), second=edits())
def test_one_edit_after_the_other_is_their_composition(leaf, first, second):
    both = compose_edits(first, second)
    np.testing.assert_allclose(
        apply_edits(leaf, both), apply_edits(apply_edits(leaf, first), second), rtol=1e-13, atol=1e-12
    )
    assert both.jitter_amplitude == (second.jitter_amplitude or first.jitter_amplitude)


@FEW
@given(first=edits(), second=edits(), third=edits())
def test_it_does_not_matter_which_edits_are_composed_first(first, second, third):
    left = compose_edits(compose_edits(first, second), third)
    right = compose_edits(first, compose_edits(second, third))
    for name in LeafEdits.__dataclass_fields__:
        assert getattr(left, name) == pytest.approx(getattr(right, name), rel=1e-12, abs=1e-11)


@FEW
@given(edit=edits())
def test_neutral_edits_compose_to_the_other(edit):
    assert compose_edits(NEUTRAL, edit) == edit
    frequency = edit.jitter_frequency if edit.jitter_amplitude else NEUTRAL.jitter_frequency
    assert compose_edits(edit, NEUTRAL) == replace(edit, jitter_frequency=frequency)


@FEW
@given(leaf=wild_leaves, edit=edits())
def test_the_inverse_takes_an_edit_back_in_either_order(leaf, edit):
    inverse = invert_edits(edit)
    np.testing.assert_allclose(apply_edits(apply_edits(leaf, edit), inverse), leaf, rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(apply_edits(apply_edits(leaf, inverse), edit), leaf, rtol=1e-13, atol=1e-12)
    assert inverse.jitter_amplitude == 0  # there is nothing in the parameters to take back
    np.testing.assert_allclose(
        apply_edits(leaf, invert_edits(inverse)), apply_edits(leaf, edit), rtol=1e-13, atol=1e-12
    )


def test_the_inverse_of_nothing_is_nothing():
    assert invert_edits(NEUTRAL) == NEUTRAL
    assert not any(np.signbit(invert_edits(NEUTRAL).curl))  # nor is it written as -0


@pytest.mark.parametrize("width", [0.0, 1e-310])
def test_a_leaf_without_width_cannot_be_inverted(width):
    with pytest.raises(ValueError, match="every leaf a line"):
        invert_edits(scale_width(NEUTRAL, width))


@FEW
@given(leaf=wild_leaves, edit=edits(st.floats(0, 8)), phase=st.floats(0, 64))
def test_base_and_apex_stay_under_every_edit(leaf, edit, phase):
    at = points(leaf, edit, phase=np.array([phase, 0.0]))
    assert np.isfinite(at).all()
    np.testing.assert_allclose(at[:, 0], 0, atol=1e-15)
    np.testing.assert_allclose(at[:, -1], np.broadcast_to((0, 1, 0), (2, len(U), 3)), atol=1e-14)


@FEW
@given(leaf=wild_leaves, edit=edits(st.floats(0, 8)))
def test_a_straight_axis_keeps_the_halves_mirror_images(leaf, edit):
    leaf[:, 0:2, 0] = 0
    edit = replace(edit, axis1=(0.0, *edit.axis1[1:]), axis2=(0.0, *edit.axis2[1:]))
    at = points(leaf, edit)
    mirrored = at[:, :, ::-1] * (-1, 1, 1)
    np.testing.assert_allclose(at, mirrored, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("operation", "neutral"),
    [
        (scale_width(NEUTRAL, 1), True),
        (scale_width(NEUTRAL, 1.5), False),
        (skew_axis(NEUTRAL, 0, 0), True),
        (skew_axis(NEUTRAL, 0, 0.1), False),
        (shift_silhouette(NEUTRAL, 3, 0, 0), True),
        (shift_silhouette(NEUTRAL, 3, 0, 0, 0.1), False),
        (bend_axis(NEUTRAL, 0.1), False),
        (curl(NEUTRAL, 0, 0, 0.1), False),
        (jitter_silhouette(NEUTRAL, 0, 20), True),
        (jitter_silhouette(NEUTRAL, 0.1), False),
    ],
)
def test_operations_by_nothing_are_neutral(operation, neutral):
    assert (replace(operation, jitter_frequency=NEUTRAL.jitter_frequency) == NEUTRAL) is neutral


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: LeafEdits(width=-1), "width must be 0 or more"),
        (lambda: LeafEdits(width=float("nan")), "width must be 0 or more"),
        (lambda: LeafEdits(axis1=(0, float("inf"), 0)), "axis1 must be three finite numbers"),
        (lambda: LeafEdits(curl=(0.1, 0.2)), "curl must be three finite numbers"),
        (lambda: jitter_silhouette(NEUTRAL, -0.1), "jitter_amplitude must be 0 or more"),
        (lambda: jitter_silhouette(NEUTRAL, 0.1, 0), "jitter_frequency must be above 0"),
        (lambda: shift_silhouette(NEUTRAL, 4, 0, 0), "silhouette points are 1, 2 and 3"),
        (lambda: bend_axis(NEUTRAL, 0.1, points=(3,)), "axis points are 1 and 2"),
        (lambda: skew_axis(NEUTRAL, 0.1, 0.1, points=()), "axis points are 1 and 2"),
    ],
)
def test_what_cannot_be_is_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_a_slim_leaf_is_nearer_to_the_line_from_base_to_apex():
    leaves = random_leaves(200, seed=4).parameters
    leaves[:100, :2] = (0, 1 / 3, 0), (0, 2 / 3, 0)
    factors = np.linspace(0.05, 1, 200)
    slim = slim_leaves(leaves, factors)
    before, after = (evaluate_grid(each, U, V).points for each in (leaves, slim))
    np.testing.assert_allclose(after[:100, ..., 1], before[:100, ..., 1], atol=1e-12)
    for side in (0, 2):  # exactly, where the axis is straight
        scaled = factors[:100, None, None] * before[:100, ..., side]
        np.testing.assert_allclose(after[:100, ..., side], scaled, atol=1e-12)
    np.testing.assert_array_less(leaf_width(slim[:-1]), leaf_width(leaves[:-1]) + 1e-9)
    np.testing.assert_array_equal(slim[-1], leaves[-1])


def test_no_leaf_folds_that_gets_slim():
    bent = random_leaves(300, seed=5).parameters
    bent[:, :2, 0] += 0.3
    bent[:, 5:] += 0.1
    slim = slim_leaves(bent, np.tile([0.05, 0.3, 0.8], 100))
    assert not (find_folds(slim) & ~find_folds(bent)).any()
    assert (np.abs(slim - bent).max(axis=(1, 2)) > 0).mean() > 0.9
