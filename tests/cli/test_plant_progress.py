"""Progress of builds in logs, where there is no terminal."""

from usdfoliage.cli import plant_progress
from usdfoliage.cli.plant_progress import PlantBar


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
