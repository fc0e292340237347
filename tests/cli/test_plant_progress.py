"""Progress of builds in logs, where there is no terminal."""

import pytest
from usdfoliage.cli import plant_progress
from usdfoliage.cli.plant_progress import PlantBar, estimate_left


def test_a_log_gets_a_line_now_and_then(monkeypatch, capsys):
    now_s = [100.0]
    monkeypatch.setattr(plant_progress.time, "monotonic", lambda: now_s[0])
    with PlantBar() as bar:
        for second in range(61):
            now_s[0] = 100.0 + second
            bar.show("fern", "matching", second / 100)
    streams = capsys.readouterr()
    assert streams.out == ""
    assert streams.err.splitlines() == [
        "fern: matching, 20% done in 20 s, about 80 s left",
        "fern: matching, 40% done in 40 s, about 60 s left",
        "fern: matching, 60% done in 60 s, about 40 s left",
    ]


@pytest.mark.parametrize("done", [2, 5, 20, 49])
def test_what_comes_before_the_work_and_a_slow_first_plant_do_not_count_for_the_others(done):
    """Fifty plants of 3 s, before which 30 s go by, and the first of which takes 12 s."""
    ends_s = [100.0 + 30 + 12 + 3 * number for number in range(50)]
    begun = [(131.0, 0.003)]
    samples = begun + [(ends_s[number], (number + 1) / 50) for number in range(done)]
    left_s = estimate_left(samples, samples[-1][0])
    assert left_s == pytest.approx(3 * (50 - done), rel=0.05)


def test_without_enough_work_done_nothing_is_estimated():
    assert estimate_left([], 10.0) is None
    assert estimate_left([(10.0, 0.01)], 20.0) is None
    assert estimate_left([(10.0, 0.5)], 20.0) is None


def test_time_goes_on_while_the_share_stands_still():
    samples = [(0.0, 0.1), (10.0, 0.2)]
    assert estimate_left(samples, 10.0) == pytest.approx(80)
    assert estimate_left(samples, 30.0) == pytest.approx(240)
