"""Tasks in their order, here and on workers, some of which are killed."""

import multiprocessing
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.executors import Done, TaskOrder, Wanted, Workers, run_here, run_on
from usdfoliage.jobs.plant.processes import open_processes

from tests.support.fake_builds import (
    DIAMOND,
    fake_plant,
    in_order,
    is_alive,
    kill_always,
    kill_once,
    lines_of,
    next_of,
    wait_until,
    write_line,
)


def threads(count: int) -> Workers:
    return Workers(open_executor=lambda: ThreadPoolExecutor(count), count=lambda: count)


def test_here_every_task_comes_after_those_that_it_needs(tmp_path):
    done = [each.name for each in run_here(fake_plant(tmp_path, "p", DIAMOND), write_line)]
    assert sorted(done) == ["a", "b", "c", "d"]
    assert in_order(done, DIAMOND)


def test_here_nothing_runs_after_a_task_that_failed(tmp_path):
    plant = fake_plant(tmp_path, "p", {"a": [], "bad": ["a"], "z": ["bad"]})
    done = list(run_here(plant, write_line))
    assert [each.name for each in done] == ["a", "bad"]
    assert done[-1].error == "bad data"


@given(needs=st.lists(st.sets(st.integers(0, 6)), min_size=1, max_size=7), count=st.integers(1, 4))
def test_workers_do_every_task_once_and_after_its_needs(tmp_path_factory, needs, count):
    tasks = {f"t{k}": [f"t{n}" for n in sorted(task_needs) if n < k] for k, task_needs in enumerate(needs)}
    folder = tmp_path_factory.mktemp("plant")
    plants = [fake_plant(folder, name, tasks) for name in ("p", "q")]
    done = list(run_on(next_of(plants), write_line, threads(count), 1))
    for number in (0, 1):
        own = [each.name for place, each in done if place == number]
        assert sorted(own) == sorted(tasks)
        assert in_order(own, tasks)


def test_a_plant_that_fails_does_not_stop_another(tmp_path):
    plants = [
        fake_plant(tmp_path, "p", {"a": [], "bad": ["a"], "z": ["bad"]}),
        fake_plant(tmp_path, "q", DIAMOND),
        fake_plant(tmp_path, "r", {"fault": [], "z": ["fault"]}),
    ]
    done = list(run_on(next_of(plants), write_line, threads(2), 1))
    assert [each.name for place, each in done if place == 0] == ["a", "bad"]
    assert {each.name for place, each in done if place == 1} == set(DIAMOND)
    (fault,) = [each for place, each in done if place == 2]
    assert "ZeroDivisionError" in fault.fault


def test_the_next_plant_is_asked_for_only_when_a_worker_has_nothing_to_do(tmp_path):
    asked: list[int] = []

    def next_plant() -> Wanted | None:
        asked.append(len(lines_of(tmp_path)))
        return fake_plant(tmp_path, f"p{len(asked)}", {"a": [], "b": ["a"]}) if len(asked) < 3 else None

    list(run_on(next_plant, write_line, threads(1), 1))
    assert asked[:3] == [0, 2, 4]


def test_without_workers_there_is_an_error(tmp_path):
    def none() -> int:
        raise FoliageError("no workers")

    workers = Workers(open_executor=lambda: ThreadPoolExecutor(1), count=none)
    with pytest.raises(FoliageError, match="no workers"):
        list(run_on(next_of([fake_plant(tmp_path, "p", DIAMOND)]), write_line, workers, 1))


def test_a_task_whose_process_is_killed_is_done_again(tmp_path):
    tasks = {"a": [], "killer": ["a"], "other": ["a"], "z": ["killer", "other"]}
    with open_processes(2) as workers:
        done = [each for _, each in run_on(next_of([fake_plant(tmp_path, "p", tasks)]), kill_once, workers, 1)]
    assert all(each.is_good for each in done)
    assert sorted(each.name for each in done) == sorted(tasks)
    assert not multiprocessing.active_children()


def test_a_task_that_kills_its_process_each_time_is_given_up_and_no_other(tmp_path):
    plants = [
        fake_plant(tmp_path, "p", {"killer": [], "z": ["killer"]}),
        fake_plant(tmp_path, "q", {f"t{k}": [f"t{k - 1}"] if k else [] for k in range(8)}),
    ]
    with open_processes(2) as workers:
        done = list(run_on(next_of(plants), kill_always, workers, 1))
    (given_up,) = [each for place, each in done if place == 0]
    assert given_up.name == "killer"
    assert "killed each time" in given_up.error
    assert [each.name for place, each in done if place == 1] == [f"t{k}" for k in range(8)]


PARENT = """
import faulthandler
import signal
import sys
from pathlib import Path
from tests.support.fake_builds import fake_plant, sleep_long
from usdfoliage.jobs.plant.executors import run_on
from usdfoliage.jobs.plant.processes import open_processes

if __name__ == "__main__":
    faulthandler.register(signal.SIGUSR1)  # prints where it hangs
    plants = [fake_plant(Path(sys.argv[1]), "p", {"a": [], "b": []})]
    with open_processes(2) as workers:
        list(run_on(lambda: plants.pop() if plants else None, sleep_long, workers, 1))
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_no_process_outlives_the_one_that_opened_it(tmp_path, number):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    parent = subprocess.Popen([sys.executable, str(script), str(tmp_path)], stderr=subprocess.PIPE)
    try:
        wait_until(lambda: len(lines_of(tmp_path)) == 2)
        pids = [int(line.split()[2]) for line in (tmp_path / "log").read_text().splitlines()]
        assert all(is_alive(pid) for pid in pids)
        parent.send_signal(number)
        try:
            parent.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            parent.send_signal(signal.SIGUSR1)
            time.sleep(2)
            parent.kill()
            alive = [pid for pid in pids if is_alive(pid)]
            pytest.fail(f"it goes on, and of its processes {alive}: {parent.communicate(timeout=10)[1].decode()}")
        wait_until(lambda: not any(is_alive(pid) for pid in pids))
    finally:
        parent.kill()
        parent.communicate()


def test_orders_name_the_result_that_is_wanted(tmp_path):
    seen: list[TaskOrder] = []

    def note(order: TaskOrder) -> Done:
        seen.append(order)
        return Done(name=order.name, seconds=0.0, was_run=False)

    list(run_here(fake_plant(tmp_path, "p", {"a": []}), note, threads=3))
    assert [(order.name, order.key, order.threads) for order in seen] == [("a", "a", 3)]
