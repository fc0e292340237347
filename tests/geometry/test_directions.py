"""Directions across others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.geometry.directions import two_across, unit_vectors, vectors_across

vectors = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-2)


@given(along=vectors, towards=vectors)
def test_a_vector_across_is_unit_and_at_right_angles(along, towards):
    unit = unit_vectors(np.array([along]))
    across = vectors_across(unit, np.array([towards]))
    assert np.linalg.norm(across) == pytest.approx(1)
    assert np.sum(across * unit) == pytest.approx(0, abs=1e-9)
    if np.linalg.norm(np.cross(unit, towards)) > 1e-3:
        assert np.sum(across * towards) == pytest.approx(0, abs=1e-9)


def test_there_is_one_across_parallel_directions():
    up = np.array([[0.0, 1.0, 0.0]])
    assert np.linalg.norm(vectors_across(up, up)) == pytest.approx(1)
    assert np.linalg.norm(vectors_across(up, 0 * up)) == pytest.approx(1)


@given(along=vectors)
def test_two_across_and_a_direction_turn_right(along):
    unit = unit_vectors(np.array([along]))
    first, second = two_across(unit)
    np.testing.assert_allclose(np.linalg.det(np.concatenate([unit, first, second])), 1)
    np.testing.assert_allclose(
        np.concatenate([unit, first, second]) @ np.concatenate([unit, first, second]).T, np.eye(3), atol=1e-12
    )
    assert not np.any(two_across(np.zeros((1, 3))))
