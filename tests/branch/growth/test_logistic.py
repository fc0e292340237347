"""Logistic growth, after equations 6 and 7."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from usdfoliage.branch.growth.logistic import LogisticSettings, cycles_until, growth_units, longest_path


def test_the_paper_s_plant_begins_at_2_m_and_ends_at_10():
    settings = LogisticSettings(longest=10 / 0.05, initial_share=0.2)
    assert longest_path(0, settings) == pytest.approx(2 / 0.05)
    assert longest_path(100, settings) == pytest.approx(10 / 0.05)
    # Half of it where (H_max / H_0 - 1) e^(-rho t) is 1, and there it grows fastest: rho H_max / 4.
    half = np.log(4) / 0.3
    assert longest_path(half, settings) == pytest.approx(100)
    assert growth_units(half, settings) == pytest.approx(0.3 * 200 / 4)
    assert growth_units(half + np.array([-1.0, 1.0]), settings).max() < growth_units(half, settings)


@pytest.mark.parametrize(("share", "cycles"), [(0.0, 0), (0.2, 0), (0.5, 4), (1.0, 35)])
def test_the_cycles_until_a_share_is_reached_are_those_of_the_longest_path(share, cycles):
    settings = LogisticSettings(longest=200.0, initial_share=0.2)
    assert cycles_until(share, settings) == cycles
    assert longest_path(cycles, settings) <= 200 * max(share, 0.2) + 1e-9
    if 0.2 < share < 1:
        assert longest_path(cycles + 1, settings) > 200 * share


@given(
    cycle=st.floats(0, 40),
    longest=st.floats(1, 1e4),
    share=st.floats(0.01, 0.9),
    units=st.floats(0.05, 2),
)
def test_units_are_the_growth_of_the_longest_path(cycle, longest, share, units):
    settings = LogisticSettings(longest=longest, initial_share=share, initial_units=units)
    step = 1e-4
    slope = (longest_path(cycle + step, settings) - longest_path(cycle - step, settings)) / (2 * step)
    assert growth_units(cycle, settings) == pytest.approx(slope, rel=1e-3, abs=1e-6 * longest)


@pytest.mark.parametrize(
    "wrong", [{"longest": 0}, {"longest": np.nan}, {"initial_share": 1}, {"initial_share": 0}, {"initial_units": 0}]
)
def test_what_cannot_grow_is_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        LogisticSettings(**wrong)
