"""Steps are told and timed."""

import pytest
from usdfoliage.steps import follow_step


def test_a_step_is_told_from_start_to_end_and_timed():
    told, seconds = [], {}
    with follow_step("fit", seconds, lambda name, share: told.append((name, share))) as report:
        report(1, 4)
        report(0, 0)
    assert told == [("fit", 0.0), ("fit", 0.25), ("fit", 0.0), ("fit", 1.0)]
    assert list(seconds) == ["fit"]
    assert seconds["fit"] >= 0


def test_nobody_need_listen():
    seconds = {}
    with follow_step("fit", seconds, None) as report:
        report(1, 4)
    assert "fit" in seconds


def test_a_step_that_fails_did_not_end():
    seconds = {}
    with pytest.raises(ValueError, match="no"), follow_step("fit", seconds, None):
        raise ValueError("no")
    assert seconds == {}
