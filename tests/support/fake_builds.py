"""Builds of tasks that do next to nothing, for tests of what runs them; workers find these functions by their names."""

import os
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.executors import Done, TaskOrder, Wanted
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.tasks import BuildPlan, Task

DIAMOND = {"a": [], "b": ["a"], "c": ["a"], "d": ["b", "c"]}


def fake_plant(folder: Path, name: str, tasks: dict[str, Sequence[str]]) -> Wanted:
    """A plant whose tasks need each other as given; what they do is written into folder."""
    made = {
        task: Task(name=task, stage=task, needs=tuple(needs), key=task, estimate_s=1.0) for task, needs in tasks.items()
    }
    request = BuildRequest(
        capture=folder / "capture", output=folder / "out", name=name, settings=BuildSettings(), work=folder / "work"
    )
    return Wanted(request=request, plan=BuildPlan(tasks=made, last=()), tasks=made)


def write_line(order: TaskOrder) -> Done:
    """Note that the task ran; those named bad fail, those named fault break."""
    log = order.request.capture.parent / "log"
    with log.open("a") as file:
        file.write(f"{order.request.name} {order.name} {os.getpid()}\n")
    if order.name.startswith("fault"):
        raise ZeroDivisionError("a fault of ours")
    error = "bad data" if order.name.startswith("bad") else ""
    return Done(name=order.name, seconds=0.1, was_run=True, error=error)


def kill_once(order: TaskOrder) -> Done:
    """The same, but the worker is killed the first time that it does a task named killer."""
    mark = order.request.capture.parent / f"{order.request.name} {order.name} killed"
    if order.name.startswith("killer") and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return write_line(order)


def kill_always(order: TaskOrder) -> Done:
    """The same, each time."""
    if order.name.startswith("killer"):
        time.sleep(0.2)  # so that others run
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.1)
    return write_line(order)


def sleep_long(order: TaskOrder) -> Done:
    """Note the task, and do not end."""
    write_line(order)
    time.sleep(600)
    raise AssertionError


def lines_of(folder: Path) -> list[tuple[str, str]]:
    """Plants and tasks that ran, in their order."""
    log = folder / "log"
    return [(line.split()[0], line.split()[1]) for line in log.read_text().splitlines()] if log.exists() else []


def next_of(plants: Sequence[Wanted]) -> Callable[[], Wanted | None]:
    left = list(plants)
    return lambda: left.pop(0) if left else None


def in_order(done: Sequence[str], tasks: dict[str, list[str]]) -> bool:
    return all(done.index(need) < done.index(name) for name, needs in tasks.items() for need in needs)


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def wait_until(holds: Callable[[], bool], timeout_s: float = 60.0) -> None:
    end = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < end, "it does not happen"
        time.sleep(0.05)
