"""The sRGB curve and luminance."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.geometry.color import decode_srgb, encode_srgb, luminance


@pytest.mark.parametrize(
    ("linear", "encoded"),
    [(0.0, 0.0), (1.0, 1.0), (0.0031308, 0.04045), (0.18, 0.461356), (0.2140411, 0.5), (0.001, 0.01292)],
)
def test_known_values_of_the_curve(linear, encoded):
    assert float(encode_srgb(linear)) == pytest.approx(encoded, abs=2e-6)
    assert float(decode_srgb(encoded)) == pytest.approx(linear, abs=2e-6)


@settings(max_examples=50, deadline=None)
@given(x=st.floats(-0.5, 16.0))
def test_round_trip(x):
    assert float(decode_srgb(encode_srgb(x))) == pytest.approx(x, rel=1e-6, abs=1e-6)
    assert float(encode_srgb(decode_srgb(x))) == pytest.approx(x, rel=1e-6, abs=1e-6)


def test_the_curves_are_monotone_through_their_joints_and_past_the_unit_range():
    x = np.concatenate([np.linspace(-0.1, 1.5, 4001), 0.0031308 + np.linspace(-1e-3, 1e-3, 401)])
    x = np.unique(x)
    assert np.all(np.diff(encode_srgb(x)) > 0)
    assert np.all(np.diff(decode_srgb(x)) > 0)


def test_float32_stays_float32_and_the_rest_becomes_float64():
    assert encode_srgb(np.zeros((2, 3), np.float32)).dtype == np.float32
    assert decode_srgb(np.zeros((2, 3), np.float32)).dtype == np.float32
    assert encode_srgb(np.zeros(4, np.float16)).dtype == np.float64
    assert luminance(np.zeros((2, 3), np.float32)).dtype == np.float32


def test_luminance_of_the_primaries_adds_up_to_white():
    np.testing.assert_allclose(luminance(np.eye(3)), [0.2126, 0.7152, 0.0722])
    assert float(luminance([1.0, 1.0, 1.0])) == pytest.approx(1.0)
    assert luminance(np.ones((6, 4, 4, 3))).shape == (6, 4, 4)


def test_luminance_needs_three_channels():
    with pytest.raises(ValueError, match=r"\(\.\.\., 3\), not \(5, 4\)"):
        luminance(np.zeros((5, 4)))
