"""A build from its beginning to its end: planned, run on an executor, checked, and put in its place."""

import json
import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from usdfoliage.asset.publish import publish_folder
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.build.call import BuildRequest, digest_profile
from usdfoliage.jobs.build.executors import (
    Done,
    Wanted,
    connect_dask,
    open_processes,
    run_here,
    run_on,
    threads_each,
)
from usdfoliage.jobs.build.inputs import BuildInputs, find_inputs
from usdfoliage.jobs.build.report import TaskTiming, Timings
from usdfoliage.jobs.build.report_html import write_timings
from usdfoliage.jobs.build.report_stage import FINISHED, VERDICT
from usdfoliage.jobs.build.store import copy_tree, read_stamp, remove_leftovers
from usdfoliage.jobs.build.tasks import REPORT, BuildPlan, find_wanted, plan_build
from usdfoliage.jobs.build.worker import run_named_task
from usdfoliage.jobs.crown_report import Row
from usdfoliage.steps import StepProgress

logger = logging.getLogger(__name__)

MOST_PLANS = 4  # a result that is lost while others are made is made again, but not for ever

# Told of the plant, of what runs, and of the share of the whole work that is done.
BuildProgress = Callable[[str, str, float], None]


@dataclass(frozen=True, kw_only=True)
class ExecutorChoice:
    """Where tasks run."""

    jobs: int = 1  # processes of this machine; 1: this one
    scheduler: str = ""  # address of a Dask scheduler, instead
    threads: int = 0  # of a task; 0: one per core, shared among the processes

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise ValueError(f"jobs must be at least 1, not {self.jobs}")
        if self.threads < 0:
            raise ValueError(f"threads must be 0 or more, not {self.threads}")
        if self.scheduler and self.jobs > 1:
            raise ValueError("jobs are processes of this machine, and scheduler is Dask: name one of them")

    def describe(self) -> str:
        if self.scheduler:
            return f"by Dask at {self.scheduler}"
        return f"in {self.jobs} processes" if self.jobs > 1 else "in one process"


@dataclass(frozen=True, kw_only=True)
class BuiltPlant:
    """What became of a plant."""

    request: BuildRequest
    error: str = ""  # why there is no asset
    is_fault: bool = False  # whether that is a fault of ours; then error is its traceback
    failed: str = ""  # the task that failed
    result: Path | None = None  # folder with the finished asset in the work folder
    asset: Path | None = None  # where it was put
    errors: int = 0  # that validation found
    tasks: int = 0
    cached: int = 0  # of them, that had been done before
    seconds: Mapping[str, float] | None = None  # by task that was run
    wall_s: float = 0.0  # of the run
    warnings: tuple[str, ...] = ()
    facts: tuple[Row, ...] = ()

    @property
    def verdict(self) -> str:
        """fault, failed, invalid or built."""
        if self.error:
            return "fault" if self.is_fault else "failed"
        return "invalid" if self.errors else "built"

    def seconds_by_stage(self) -> dict[str, float]:
        """Of the tasks that were run."""
        summed: dict[str, float] = {}
        for name, seconds in (self.seconds or {}).items():
            stage = name.split("/")[0].split("-")[0]
            summed[stage] = summed.get(stage, 0.0) + seconds
        return summed


def plan_plant(request: BuildRequest, look: str = "bytes") -> tuple[BuildInputs, BuildPlan]:
    """The inputs and tasks of a plant; FoliageError for inputs that cannot be used."""
    inputs = find_inputs(request.capture, request.store, request.settings.leaves.depth, look)  # type: ignore[arg-type]
    return inputs, plan_build(inputs, request.settings, request.name, request.only, digest_profile(request))


def build_plants(
    requests: Sequence[BuildRequest], where: ExecutorChoice, progress: BuildProgress | None = None
) -> Iterator[tuple[int, BuiltPlant]]:
    """Build plants; one that fails does not stop the others.

    Yields:
        The number of a request, and what became of it, in the order in which they end.
    """
    with _open(where) as (open_executor, at_once, threads):
        states = [_State(request, where) for request in requests]
        waiting = list(range(len(requests)))
        for _ in range(MOST_PLANS):
            planned: list[int] = []
            wanted: list[Wanted] = []
            for number in waiting:
                state = states[number]
                ended = state.plan()
                if ended is not None:
                    yield number, ended
                elif state.wanted is not None:
                    planned.append(number)
                    wanted.append(state.wanted)
            again: list[int] = []
            open_plants = set(range(len(planned)))
            for place, done in _run(wanted, open_executor, at_once, threads, _Meter(wanted, progress)):
                state = states[planned[place]]
                state.note(done)
                if done.lost:
                    again.append(planned[place])
                    open_plants.discard(place)
                elif not done.is_good or state.is_complete:
                    open_plants.discard(place)
                    yield planned[place], state.end()
            waiting = again
            if not waiting:
                return
        for number in waiting:
            text = f"results in {requests[number].work} vanish as soon as they are made; is somebody removing them?"
            yield number, BuiltPlant(request=requests[number], error=text)


class _State:
    """One plant while it is built."""

    def __init__(self, request: BuildRequest, where: ExecutorChoice) -> None:
        self.request = request
        self._where = where
        self._start = time.perf_counter()
        self.wanted: Wanted | None = None
        self._seconds: dict[str, float] = {}
        self._left: set[str] = set()
        self._all: set[str] = set()
        self._bad: Done | None = None
        self._plan: BuildPlan | None = None

    def plan(self) -> BuiltPlant | None:
        """Find what is to be done; the plant, where nothing is, or it cannot be."""
        try:
            remove_leftovers(self.request.store)
            _, self._plan = plan_plant(self.request)
            tasks, finished = find_wanted(self._plan, self.request.store, thorough=True)
        except FoliageError as error:
            return BuiltPlant(request=self.request, error=str(error))
        self.wanted = Wanted(request=self.request, plan=self._plan, tasks=tasks)
        self._left = set(tasks)
        self._all |= {*tasks, *finished}
        return self.end() if not tasks else None

    @property
    def is_complete(self) -> bool:
        return not self._left

    def note(self, done: Done) -> None:
        if done.is_good:
            self._left.discard(done.name)
            if done.was_run:
                self._seconds[done.name] = done.seconds
        elif not done.lost:
            self._bad = done

    def end(self) -> BuiltPlant:
        """What became of it; the asset is put in its place."""
        made = BuiltPlant(
            request=self.request,
            tasks=len(self._all),
            cached=len(self._all) - len(self._seconds),
            seconds=dict(self._seconds),
            wall_s=time.perf_counter() - self._start,
        )
        if self._bad is not None:
            return replace(
                made, error=self._bad.error or self._bad.fault, is_fault=bool(self._bad.fault), failed=self._bad.name
            )
        assert self._plan is not None
        if REPORT not in self._plan.last:
            return replace(made, result=self.request.store.result(self._plan.tasks[self._plan.last[-1]].key))
        try:
            return finish_plant(made, self._plan, self._where)
        except FoliageError as error:
            return replace(made, error=str(error))


class _Meter:
    """How much of all the work is done, by what it was thought to take."""

    def __init__(self, wanted: Sequence[Wanted], progress: BuildProgress | None) -> None:
        self._progress = progress
        self._wanted = wanted
        self._all_s = sum(task.estimate_s for each in wanted for task in each.tasks.values()) or 1.0
        self._done_s = 0.0

    def step(self, number: int, name: str) -> StepProgress | None:
        """What is told of the steps within a task, where it runs in this process."""
        if self._progress is None:
            return None
        tell, plant = self._progress, self._wanted[number].request.name
        estimate_s = self._wanted[number].tasks[name].estimate_s

        def show(step: str, share: float) -> None:
            what = name if step == name else f"{name}: {step}"
            # Steps follow each other within a task, and each counts from 0: the task as a whole is half done.
            inner = share if step == name else 0.5
            tell(plant, what, (self._done_s + inner * estimate_s) / self._all_s)

        return show

    def done(self, number: int, done: Done) -> None:
        task = self._wanted[number].tasks[done.name]
        self._done_s += task.estimate_s
        if self._progress is not None:
            self._progress(self._wanted[number].request.name, done.name, self._done_s / self._all_s)


@contextmanager
def _open(where: ExecutorChoice) -> Iterator[tuple[Callable[[], Executor] | None, int, int]]:
    """What makes executors, None for this process; tasks at a time; threads of each."""
    with ExitStack() as stack:
        if where.scheduler:
            open_executor, at_once = stack.enter_context(connect_dask(where.scheduler))
            yield open_executor, at_once, where.threads or 1
        elif where.jobs > 1:
            yield lambda: open_processes(where.jobs), where.jobs, where.threads or threads_each(where.jobs)
        else:
            yield None, 1, where.threads


def _run(
    wanted: Sequence[Wanted],
    open_executor: Callable[[], Executor] | None,
    at_once: int,
    threads: int,
    meter: _Meter,
) -> Iterator[tuple[int, Done]]:
    if open_executor is not None:
        for number, done in run_on(wanted, run_named_task, open_executor, threads, at_once):
            meter.done(number, done)
            yield number, done
        return
    for number, each in enumerate(wanted):
        for done in run_here(each, lambda order: run_named_task(order, meter.step(number, order.name)), threads):  # noqa: B023
            meter.done(number, done)
            yield number, done


def finish_plant(made: BuiltPlant, plan: BuildPlan, where: ExecutorChoice) -> BuiltPlant:
    """Put the finished asset in its place, if validation lets it.

    Raises:
        FoliageError: It cannot be written; what was there stays.
    """
    request = made.request
    result = request.store.result(plan.tasks[REPORT].key)
    held = json.loads((result / VERDICT).read_text(encoding="utf-8"))
    made = replace(
        made,
        result=result / FINISHED,
        errors=int(held["errors"]),
        warnings=tuple(held["warnings"]),
        facts=tuple(Row(**row) for row in held["facts"]),
    )
    if made.errors and not request.keep_invalid:
        return made
    with publish_folder(request.output, force=request.force) as folder:
        copy_tree(result / FINISHED, folder)
        write_timings(folder / "report", collect_timings(made, plan, where))
    return replace(made, asset=request.output / f"{request.name}.usda")


def collect_timings(made: BuiltPlant, plan: BuildPlan, where: ExecutorChoice) -> Timings:
    """How long each task took; of those that an earlier run did, what it took then."""
    store, ran = made.request.store, made.seconds or {}
    tasks = []
    for name, task in plan.tasks.items():
        stamp = read_stamp(store, task.key)
        if stamp is not None:
            tasks.append(TaskTiming(stage=task.stage, name=name, seconds=stamp.seconds, cached=name not in ran))
    stages = []
    for stage in dict.fromkeys(timing.stage for timing in tasks):
        own = [timing for timing in tasks if timing.stage == stage]
        seconds = sum(timing.seconds for timing in own)
        stages.append(TaskTiming(stage=stage, seconds=seconds, cached=all(timing.cached for timing in own)))
    return Timings(executor=where.describe(), seconds=made.wall_s, stages=stages, tasks=tasks)
