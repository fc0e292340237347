"""How far a build is while steps of a task follow each other."""

from types import SimpleNamespace

import pytest
from usdfoliage.jobs.plant import meter as meter_module
from usdfoliage.jobs.plant.meter import Meter


def test_a_task_of_several_steps_goes_on_with_its_time(monkeypatch):
    now_s = [50.0]
    monkeypatch.setattr(meter_module.time, "monotonic", lambda: now_s[0])
    reported = []
    meter = Meter(2, lambda plant, what, share: reported.append((plant, what, share)))
    tasks = {"sketch": SimpleNamespace(estimate_s=30.0), "report": SimpleNamespace(estimate_s=10.0)}
    meter.add(SimpleNamespace(request=SimpleNamespace(name="oak"), tasks=tasks))
    show = meter.step(0, "sketch")
    for taken_s, step in ((0, "tree"), (10, "tree"), (30, "leaves"), (300, "asset")):
        now_s[0] = 50.0 + taken_s
        show(step, 0.0)
    shares = [share for _, _, share in reported]
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert shares[2] == pytest.approx(0.5 * 0.5 * 30 / 40)  # half of the task, of one of two plants
    assert shares[3] < 0.5 * 30 / 40
    show("sketch", 0.25)  # a task that counts itself
    assert reported[-1] == ("oak", "sketch", pytest.approx(0.25 * 0.5 * 30 / 40))
