"""Progress of steps and of parts."""

import pytest
from usdfoliage.progress import PartCounter, follow_step, progress_in_step, progress_of_shares


def test_a_step_is_reported_from_start_to_end_and_timed():
    reported, seconds = [], {}
    with follow_step("fit", seconds, lambda name, share: reported.append((name, share))) as report:
        report(1, 4)
        report(0, 0)
    assert reported == [("fit", 0.0), ("fit", 0.25), ("fit", 0.0), ("fit", 1.0)]
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


def test_parts_are_reported_as_a_step_and_shares_as_parts():
    steps, parts = [], []
    report = progress_in_step("fit", lambda name, share: steps.append((name, share)))
    assert report is not None
    report(1, 4)
    report(0, 0)
    assert steps == [("fit", 0.25), ("fit", 0.0)]
    assert progress_in_step("fit", None) is None
    progress_of_shares(lambda done, total: parts.append((done, total)))("wood", 0.5)
    assert parts == [(500, 1000)]


def test_pieces_of_work_add_up():
    parts = []
    counter = PartCounter(lambda done, total: parts.append((done, total)), 10)
    counter.add()
    report = counter.next_piece(4)
    assert report is not None
    report(1, 2)
    report(0, 0)
    report(2, 2)
    counter.add(5)
    counter.add()  # more than was thought
    assert parts == [(1, 10), (3, 10), (1, 10), (5, 10), (10, 10), (10, 10)]
    assert PartCounter(None, 10).next_piece(4) is None
    PartCounter(None, 10).add()
