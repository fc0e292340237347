"""Tasks of builds in their order: in this process, or on any executor of concurrent.futures.

graphlib decides which task is ready. A worker that dies loses only its task, which is done again.
"""

import graphlib
import heapq
import logging
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from typing import Generic

from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.task_request import R
from usdfoliage.jobs.plant.tasks import BuildPlan, Task
from usdfoliage.remarks import Remedy

logger = logging.getLogger(__name__)

MAX_TRIES = 4  # of a task whose worker died: then it is the task that kills workers
_ALONE = 2  # tries after which a task has all workers for itself: who else ran when they died is no longer suspected
_POLL_S = 1.0  # how often it is asked how many workers there are


@dataclass(frozen=True, kw_only=True)
class Done:
    """What became of a task."""

    name: str
    seconds: float  # 0 where another run had done it meanwhile
    was_run: bool
    spare: bool = False  # it was not done, since all that would be made of it is there
    lost: bool = False  # it was not done, since what it needs is gone: plan again
    error: str = ""  # what the user's data or set-up lack
    remedy: Remedy = ()  # what to do about it
    fault: str = ""  # a fault of ours, with its traceback

    @property
    def is_good(self) -> bool:
        return not (self.lost or self.error or self.fault)


@dataclass(frozen=True, kw_only=True)
class TaskOrder(Generic[R]):
    """A task of a plant, as it is sent to a worker."""

    request: R
    name: str
    key: str  # of its result, by which a worker sees that it plans the same
    threads: int
    poor_mark: int = 0  # of the poor stamp that was there when the build began: only that one is done again


RunTask = Callable[[TaskOrder[R]], Done]


@dataclass(frozen=True, kw_only=True)
class Wanted(Generic[R]):
    """A plant of which tasks are to be done."""

    request: R
    plan: BuildPlan
    tasks: Mapping[str, Task]
    poor_marks: Mapping[str, int] = field(default_factory=dict)  # as TaskOrder's, by task


# Gives the next plant, None where there is none (yet): so that a library is not planned before anything runs.
NextPlant = Callable[[], Wanted[R] | None]


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Those who do tasks for this process."""

    open_executor: Callable[[], Executor]  # another one when that breaks; who has made them ends them
    count: Callable[[], int]  # tasks that they can do at once now; FoliageError where there is no hope of any


def run_here(wanted: Wanted[R], run: RunTask[R], threads: int = 0) -> Iterator[Done]:
    """One task after the other, in this process; ends after a task that failed for what nothing can be done."""
    sorter = sort_tasks(wanted)
    while sorter.is_active():
        for name in sorter.get_ready():
            done = run(_order(wanted, name, threads))
            yield done
            if not done.is_good:
                return
            sorter.done(name)


def run_on(next_plant: NextPlant[R], run: RunTask[R], workers: Workers, threads: int) -> Iterator[tuple[int, Done]]:
    """Tasks of several plants on an executor, as soon as those that they need are done, the first plants first.

    Args:
        next_plant: Asked for another plant whenever a worker has nothing to do. One whose task fails gets no more
            workers; the others go on.
        run: What a worker does.
        workers: Who.
        threads: Of each task.

    Yields:
        The number of a plant, in the order in which they were given, and what became of one of its tasks.

    Raises:
        FoliageError: There are no workers any more.
    """
    plants: list[tuple[Wanted[R], graphlib.TopologicalSorter[str]]] = []
    ready: list[tuple[int, int, str]] = []  # a heap: the plant, when the task was ready, its name
    running: dict[Future[Done], tuple[int, int, str]] = {}
    tries: dict[tuple[int, str], int] = {}
    stopped: set[int] = set()
    count = 0

    def add_ready(number: int) -> None:
        nonlocal count
        for name in plants[number][1].get_ready():
            heapq.heappush(ready, (number, count, name))
            count += 1

    executor = workers.open_executor()
    while True:
        room = workers.count()
        is_broken = False
        while len(running) < room and not is_broken:
            if not ready:
                wanted = next_plant()
                if wanted is None:
                    break
                plants.append((wanted, sort_tasks(wanted)))
                add_ready(len(plants) - 1)
                continue
            number, _, name = ready[0]
            if number in stopped:
                heapq.heappop(ready)
                continue
            alone = tries.get((number, name), 0) >= _ALONE
            if running and (alone or any(tries.get((n, each), 0) >= _ALONE for n, _, each in running.values())):
                break
            try:
                future = executor.submit(run, _order(plants[number][0], name, threads))
            except BrokenProcessPool:
                is_broken = True
            else:
                running[future] = heapq.heappop(ready)
        if not running and not is_broken:
            if not ready:
                return
            time.sleep(_POLL_S)
            continue
        for future in wait(running, timeout=_POLL_S, return_when=FIRST_COMPLETED).done:
            number, when, name = running.pop(future)
            try:
                done = future.result()
            except Exception as error:  # noqa: BLE001  # whatever a worker raises
                is_broken |= isinstance(error, BrokenProcessPool)
                tries[number, name] = tries.get((number, name), 0) + 1
                given_up = _give_up(name, error, tries[number, name])
                if given_up is None:
                    logger.warning("the worker of %s was lost; it is done again", name)
                    heapq.heappush(ready, (number, when, name))
                    continue
                done = given_up
            if done.is_good:
                plants[number][1].done(name)
                add_ready(number)
            else:
                stopped.add(number)
            yield number, done
        if is_broken and isinstance(executor, ProcessPoolExecutor):
            for task in running.values():  # all that ran in it is lost with it
                heapq.heappush(ready, task)
            running.clear()
            executor.shutdown(wait=True, cancel_futures=True)
            executor = workers.open_executor()


def sort_tasks(wanted: Wanted[R]) -> "graphlib.TopologicalSorter[str]":
    """The tasks of a plant, prepared to be asked which are ready."""
    sorter: graphlib.TopologicalSorter[str] = graphlib.TopologicalSorter()
    for name, task in wanted.tasks.items():
        sorter.add(name, *(need for need in task.needs if need in wanted.tasks))
    sorter.prepare()
    return sorter


def _give_up(name: str, error: Exception, tries: int) -> Done | None:
    """What became of a task whose worker did not answer; None where it is worth another try."""
    # Dask raises KilledWorker after it has tried several times itself.
    killed = type(error).__name__ == "KilledWorker"
    if killed or isinstance(error, BrokenProcessPool | CancelledError):
        if not killed and tries < MAX_TRIES:
            return None
        text = f"{name} was given up: its worker was killed each time that it was tried; is there enough memory?"
        return Done(name=name, seconds=0.0, was_run=False, error=text)
    if isinstance(error, FoliageError | ImportError):
        text = f"{name} could not be given to a worker: {error}; is the same version of usdfoliage installed there?"
        return Done(name=name, seconds=0.0, was_run=False, error=text)
    text = "".join(traceback.format_exception(error))
    return Done(name=name, seconds=0.0, was_run=False, fault=text)


def _order(wanted: Wanted[R], name: str, threads: int) -> TaskOrder[R]:
    return TaskOrder(
        request=wanted.request,
        name=name,
        key=wanted.tasks[name].key,
        threads=threads,
        poor_mark=wanted.poor_marks.get(name, 0),
    )
