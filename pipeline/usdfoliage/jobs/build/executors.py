"""Where the tasks of a build run: in this process, in processes of this machine, or on the workers of a Dask scheduler.

All run the same function, run_named_task, through the interface of concurrent.futures; which task is ready is told by
graphlib. A worker that dies takes nothing along but its task, which is done again.
"""

import graphlib
import logging
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass

from usdfoliage.errors import FoliageError
from usdfoliage.jobs.build.call import BuildRequest
from usdfoliage.jobs.build.tasks import BuildPlan, Task

logger = logging.getLogger(__name__)

MOST_TRIES = 4  # of a task whose worker died: then it is the task that kills workers


@dataclass(frozen=True, kw_only=True)
class Done:
    """What became of a task."""

    name: str
    seconds: float  # 0 where another run had done it meanwhile
    was_run: bool
    lost: bool = False  # it was not done, since what it needs is gone: plan again
    error: str = ""  # what the user's data or set-up lack
    fault: str = ""  # a fault of ours, with its traceback

    @property
    def is_good(self) -> bool:
        return not (self.lost or self.error or self.fault)


@dataclass(frozen=True, kw_only=True)
class TaskOrder:
    """A task of a plant, as a worker anywhere is told of it."""

    request: BuildRequest
    name: str
    key: str  # of its result, by which a worker sees that it plans the same
    threads: int


RunTask = Callable[[TaskOrder], Done]


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """A plant of which tasks are to be done."""

    request: BuildRequest
    plan: BuildPlan
    tasks: Mapping[str, Task]


def run_here(wanted: Wanted, run: RunTask, threads: int = 0) -> Iterator[Done]:
    """One task after the other, in this process; ends after a task that failed for what nothing can be done."""
    sorter = _sort(wanted)
    while sorter.is_active():
        for name in sorter.get_ready():
            done = run(_order(wanted, name, threads))
            yield done
            if not done.is_good:
                return
            sorter.done(name)


def run_on(
    plants: Sequence[Wanted], run: RunTask, open_executor: Callable[[], Executor], threads: int, at_once: int
) -> Iterator[tuple[int, Done]]:
    """Tasks of several plants on an executor, as soon as those that they need are done.

    Args:
        plants: A plant whose task fails gets no more; the others go on.
        run: What a worker does.
        open_executor: Makes the executor, and another when that breaks.
        threads: Of each task.
        at_once: Tasks that are handed over at a time.

    Yields:
        The number of a plant, and what became of one of its tasks.
    """
    sorters = [_sort(each) for each in plants]
    ready: list[tuple[int, str]] = []
    running: dict[Future[Done], tuple[int, str]] = {}
    tries: dict[tuple[int, str], int] = {}
    stopped: set[int] = set()
    executor = open_executor()
    try:
        while True:
            for number, sorter in enumerate(sorters):
                if number not in stopped and sorter.is_active():
                    ready.extend((number, name) for name in sorter.get_ready())
            while ready and len(running) < at_once:
                number, name = ready.pop(0)
                if number in stopped:
                    continue
                order = _order(plants[number], name, threads)
                try:
                    running[executor.submit(run, order)] = number, name
                except BrokenProcessPool:
                    ready.insert(0, (number, name))
                    break
            if not running and not ready:
                return
            broken = not running
            finished = wait(running, return_when=FIRST_COMPLETED).done if running else set()
            for future in finished:
                number, name = running.pop(future)
                try:
                    done = future.result()
                except Exception as error:
                    if not _is_lost_worker(error):
                        raise
                    broken = True
                    tries[number, name] = tries.get((number, name), 0) + 1
                    logger.warning("the worker of %s was lost (%s); it is done again", name, error or "killed")
                    if tries[number, name] >= MOST_TRIES:
                        text = f"{name} was given up: its worker was lost {MOST_TRIES} times; is there enough memory?"
                        stopped.add(number)
                        yield number, Done(name=name, seconds=0.0, was_run=False, error=text)
                    else:
                        ready.insert(0, (number, name))
                    continue
                yield number, done
                if not done.is_good:
                    stopped.add(number)
                else:
                    sorters[number].done(name)
            if broken and isinstance(executor, ProcessPoolExecutor):
                # All that ran in it is lost with it.
                for number, name in running.values():
                    ready.insert(0, (number, name))
                running.clear()
                executor.shutdown(wait=True, cancel_futures=True)
                executor = open_executor()
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


def open_processes(jobs: int) -> ProcessPoolExecutor:
    """Processes of this machine; each begins anew, for OpenGL, USD and threads do not survive a fork."""
    return ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"))


def threads_each(jobs: int) -> int:
    """Threads of a task where so many run at once."""
    return max(1, (os.cpu_count() or 1) // jobs)


@contextmanager
def connect_dask(scheduler: str, timeout_s: float = 30.0) -> Iterator[tuple[Callable[[], Executor], int]]:
    """The workers of a Dask scheduler as an executor, and how many threads of work they have.

    Raises:
        FoliageError: There is no Dask, no scheduler at that address, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise FoliageError("--scheduler needs Dask; install it with: pip install 'usdfoliage[dask]'") from error
    try:
        client = Client(scheduler, timeout=timeout_s, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise FoliageError(
            f"no Dask scheduler answers at {scheduler}: {error}; start one with: dask scheduler"
        ) from error
    try:
        start = time.monotonic()
        while not client.scheduler_info()["workers"]:
            if time.monotonic() - start > timeout_s:
                raise FoliageError(
                    f"the Dask scheduler at {scheduler} has no workers; start some with: dask worker {scheduler}"
                )
            time.sleep(0.2)
        at_once = sum(client.nthreads().values())
        # A worker that dies is no reason to give up: the scheduler hands its task to another.
        yield lambda: client.get_executor(retries=MOST_TRIES, pure=False), at_once
    finally:
        client.close()


def _order(wanted: Wanted, name: str, threads: int) -> TaskOrder:
    return TaskOrder(request=wanted.request, name=name, key=wanted.tasks[name].key, threads=threads)


def _sort(wanted: Wanted) -> "graphlib.TopologicalSorter[str]":
    sorter: graphlib.TopologicalSorter[str] = graphlib.TopologicalSorter()
    for name, task in wanted.tasks.items():
        sorter.add(name, *(need for need in task.needs if need in wanted.tasks))
    sorter.prepare()
    return sorter


def _is_lost_worker(error: BaseException) -> bool:
    return isinstance(error, BrokenProcessPool) or type(error).__name__ in ("KilledWorker", "CancelledError")
