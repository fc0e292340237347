"""How long tasks are thought to take: as long as others of their stage in the same work folder."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from usdfoliage.files.hashing import digest_text
from usdfoliage.jobs.plant.store import Stamp, Store, read_stamp, write_stamp
from usdfoliage.jobs.plant.tasks import BuildPlan, Task
from usdfoliage.jobs.plant.times import expect_times

PLAN = BuildPlan(
    tasks={
        task.name: task
        for task in (
            Task(name="matching-1/2", stage="matching", chunk=1, chunks=2, key="m", estimate_s=8.0),
            Task(name="matching-2/2", stage="matching", chunk=1, chunks=2, round=1, key="n", estimate_s=8.0),
            Task(name="crown", stage="crown", key="c", estimate_s=40.0),
            Task(name="report", stage="report", key="r", estimate_s=20.0),
        )
    },
    last=("report",),
)


def finish(store: Store, number: int, name: str, seconds: float, estimate_s: float, *, poor: bool = False) -> None:
    step = name.split("/")[0]
    stamp = Stamp(
        key=f"{number:032x}",
        name=name,
        stage=step.split("-")[0],
        step=step,
        seconds=seconds,
        estimate_s=estimate_s,
        files=(),
        poor=poor,
    )
    write_stamp(store, stamp)


def expected(store: Store) -> dict[str, float]:
    return {name: task.estimate_s for name, task in expect_times(PLAN, store).tasks.items()}


def test_in_a_new_work_folder_the_size_alone_counts(tmp_path: Path) -> None:
    assert expect_times(PLAN, Store(folder=tmp_path)) == PLAN


def test_the_median_of_a_stage_counts_scaled_by_size_where_size_is_known(tmp_path: Path) -> None:
    store = Store(folder=tmp_path)
    for number, (seconds, estimate_s) in enumerate([(1.0, 2.0), (9.0, 3.0), (400.0, 4.0)]):
        finish(store, number, f"matching-1/{number + 1}", seconds, estimate_s)
    for number, seconds in enumerate([30.0, 70.0, 900.0]):
        finish(store, 10 + number, "crown", seconds, 10.0)  # as an earlier version estimated it
    assert expected(store) == {
        "matching-1/2": pytest.approx(8.0 * 3.0),
        "matching-2/2": 8.0,  # another round
        "crown": 70.0,
        "report": 20.0,
    }


def test_stamps_of_an_earlier_version_have_their_stage_in_the_name_alone(tmp_path: Path) -> None:
    store = Store(folder=tmp_path)
    finish(store, 1, "matching-1/2", 6.0, 2.0)
    path = store.stamp(f"{1:032x}")
    stamp = json.loads(path.read_text())["stamp"]
    body = {name: value for name, value in stamp.items() if name not in ("stage", "step")}
    path.write_text(json.dumps({"stamp": body, "seal": digest_text(json.dumps(body, sort_keys=True))}, indent=1))
    read = read_stamp(store, f"{1:032x}")
    assert read is not None
    assert (read.stage, read.step) == ("matching", "matching-1")
    assert expected(store)["matching-1/2"] == pytest.approx(8.0 * 3.0)


def test_damaged_and_poor_results_have_no_time(tmp_path: Path) -> None:
    store = Store(folder=tmp_path)
    finish(store, 1, "crown", 3.0, 40.0, poor=True)
    finish(store, 2, "report", 5.0, 0.0)
    finish(store, 3, "report", float("nan"), 20.0)
    store.stamp("4").write_bytes(b'{"stamp": {"name": "crown", "seconds": ')
    store.stamp("5").mkdir()
    assert expect_times(PLAN, store) == PLAN


def test_a_new_result_is_heard_of_and_time_decides_no_key(tmp_path: Path) -> None:
    store = Store(folder=tmp_path)
    finish(store, 1, "crown", 100.0, 40.0)
    first = expect_times(PLAN, store)
    assert first.tasks["crown"].estimate_s == 100.0
    finish(store, 2, "crown", 50.0, 40.0)
    os.utime(tmp_path / "tasks", (1, 1))  # a file system's clock may be too coarse for this test
    second = expect_times(PLAN, store)
    assert second.tasks["crown"].estimate_s == 75.0
    assert [replace(task, estimate_s=0.0) for task in second.tasks.values()] == [
        replace(task, estimate_s=0.0) for task in PLAN.tasks.values()
    ]
