"""Closed cubic B-splines and their reversal."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.leaf.lobed.spline import evaluate_closed, reverse_closed, subdivide_closed


@given(count=st.integers(4, 40), seed=st.integers(0, 1000))
def test_the_reversal_of_a_subdivision_is_what_was_subdivided(count, seed):
    control = np.random.default_rng(seed).normal(size=(count, 2))
    fine = subdivide_closed(control)
    np.testing.assert_allclose(reverse_closed(fine), control, atol=1e-12)
    np.testing.assert_allclose(evaluate_closed(fine, 3), evaluate_closed(control, 6), atol=1e-12)


def test_a_spline_of_points_on_a_line_stays_on_it():
    control = np.column_stack([np.arange(8.0), 2 * np.arange(8.0)])
    points = evaluate_closed(control, 5)
    np.testing.assert_allclose(points[:, 1], 2 * points[:, 0])
