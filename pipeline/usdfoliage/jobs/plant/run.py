"""A build from its beginning to its end: planned, run on an executor, checked, and put in its place."""

import logging
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

from usdfoliage.errors import FoliageError
from usdfoliage.files.reading import refusals_described
from usdfoliage.jobs.plant.call import BuildRequest, digest_profile, inputs_of
from usdfoliage.jobs.plant.executor_choice import ExecutorChoice
from usdfoliage.jobs.plant.executors import Done, NextPlant, TaskOrder, Wanted, Workers, run_here, run_on
from usdfoliage.jobs.plant.finish import BuiltPlant, finish_plant
from usdfoliage.jobs.plant.input_digests import DigestBy
from usdfoliage.jobs.plant.inputs import BuildInputs
from usdfoliage.jobs.plant.meter import Meter
from usdfoliage.jobs.plant.record import note_build
from usdfoliage.jobs.plant.store import remove_leftovers, stamp_mark
from usdfoliage.jobs.plant.tasks import REPORT, BuildPlan, find_wanted, plan_build
from usdfoliage.jobs.plant.times import expect_times
from usdfoliage.jobs.plant.worker import run_named_task
from usdfoliage.jobs.plant.workers import open_workers
from usdfoliage.progress import PlantProgress, Progress

logger = logging.getLogger(__name__)

MAX_PLANS = 4  # a result that is lost while others are made is made again, but not for ever


def plan_plant(
    request: BuildRequest, digest_by: DigestBy = "bytes", progress: Progress | None = None
) -> tuple[BuildInputs, BuildPlan]:
    """The inputs and tasks of a plant, with times as far as the work folder knows them.

    Progress is called while the frames of a video are taken.

    Raises:
        FoliageError: The inputs cannot be used.
    """
    with refusals_described():
        inputs = inputs_of(request, digest_by, progress)
    plan = plan_build(inputs, request.settings, request.name, request.only, digest_profile(request))
    return inputs, expect_times(plan, request.store)


def build_plants(
    requests: Sequence[BuildRequest], where: ExecutorChoice, progress: PlantProgress | None = None
) -> Iterator[tuple[int, BuiltPlant]]:
    """Build plants; one that fails does not stop the others.

    Yields:
        The number of a request, and what became of it, in the order in which they end.
    """
    for store in dict.fromkeys(request.store for request in requests):
        remove_leftovers(store)
    meter = Meter(len(requests), progress)
    states = [_State(request, where) for request in requests]
    waiting = deque(range(len(requests)))
    planned: list[int] = []  # the request of every plan that was made
    ended: dict[int, BuiltPlant] = {}
    reported: set[int] = set()

    def next_plant() -> Wanted[BuildRequest] | None:
        while waiting:
            number = waiting.popleft()
            state = states[number]
            made = state.plan(len(planned), meter.before(requests[number].name, "video"))
            if made is not None:
                ended[number] = made
                continue
            assert state.wanted is not None
            planned.append(number)
            meter.add(state.wanted)
            return state.wanted
        return None

    def report() -> Iterator[tuple[int, BuiltPlant]]:
        for number in sorted(ended.keys() - reported):
            reported.add(number)
            meter.end(states[number].place)
            yield number, ended[number]

    try:
        with open_workers(where) as (workers, threads):
            for place, done in _run(next_plant, workers, threads, meter):
                yield from report()
                number = planned[place]
                state = states[number]
                state.note(done)
                if number in reported or place != state.place:
                    continue  # it has failed, or is planned anew; this task ran meanwhile
                if done.lost and state.plans < MAX_PLANS:
                    meter.forget(state.place)
                    state.place = -1
                    waiting.append(number)
                elif not done.is_good or state.is_complete:
                    ended[number] = state.end()
                    yield from report()
    except FoliageError as error:  # there is nobody any more to do the work
        for number, state in enumerate(states):
            if number not in ended:
                ended[number] = replace(state.so_far(), error=error.text, remedy=error.remedy)
    yield from report()


class _State:
    """One plant while it is built."""

    def __init__(self, request: BuildRequest, where: ExecutorChoice) -> None:
        self.request = request
        self.wanted: Wanted[BuildRequest] | None = None
        self.place = -1  # of its last plan among all
        self.plans = 0
        self._where = where
        self._start = time.perf_counter()
        self._seconds: dict[str, float] = {}
        self._stages: dict[str, str] = {}  # of the tasks of all plans
        self._left: set[str] = set()
        self._all: set[str] = set()
        self._bad: Done | None = None
        self._plan: BuildPlan | None = None
        self._poor_marks: dict[str, int] = {}

    def plan(self, place: int, progress: Progress | None) -> BuiltPlant | None:
        """Find what is to be done; the plant, where nothing is, or it cannot be."""
        if not self.plans:
            self._start = time.perf_counter()
        self.place = place
        self.plans += 1
        try:
            _, self._plan = plan_plant(self.request, progress=progress)
            self._stages |= {name: task.stage for name, task in self._plan.tasks.items()}
            note_build(self.request, self._plan)
            if self.plans == 1:  # what turns poor later is good for this run: else two runs undo each other's for ever
                self._poor_marks = {
                    name: stamp_mark(self.request.store, task.key) for name, task in self._plan.tasks.items()
                }
            tasks, finished = find_wanted(self._plan, self.request.store, thorough=True)
        except FoliageError as error:
            return replace(self.so_far(), error=error.text, remedy=error.remedy)
        self.wanted = Wanted(request=self.request, plan=self._plan, tasks=tasks, poor_marks=self._poor_marks)
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
        elif self._bad is None:
            self._bad = None if done.lost and self.plans < MAX_PLANS else done

    def so_far(self) -> BuiltPlant:
        """What was done of it."""
        return BuiltPlant(
            request=self.request,
            tasks=len(self._all),
            cached=len(self._all - self._seconds.keys()) if not self._left else 0,
            seconds=dict(self._seconds),
            stages=dict(self._stages),
            wall_s=time.perf_counter() - self._start,
        )

    def end(self) -> BuiltPlant:
        """What became of it; the asset is put in its place."""
        made = self.so_far()
        if self._bad is not None:
            error, remedy = self._bad.error or self._bad.fault, self._bad.remedy
            if self._bad.lost:
                error = f"results in {self.request.work} vanish as soon as they are made"
                remedy = ("is somebody removing them?",)
            return replace(made, error=error, remedy=remedy, is_fault=bool(self._bad.fault), failed=self._bad.name)
        assert self._plan is not None
        if REPORT not in self._plan.last:
            return replace(made, result=self.request.store.result(self._plan.tasks[self._plan.last[-1]].key))
        try:
            return finish_plant(made, self._plan, self._where.describe())
        except FoliageError as error:
            return replace(made, error=error.text, remedy=error.remedy)


def _run(
    next_plant: NextPlant[BuildRequest], workers: Workers | None, threads: int, meter: Meter
) -> Iterator[tuple[int, Done]]:
    if workers is not None:
        for place, done in run_on(next_plant, run_named_task, workers, threads):
            meter.done(place, done)
            yield place, done
        return
    place = 0
    while (wanted := next_plant()) is not None:
        number = place

        def run(order: TaskOrder[BuildRequest], number: int = number) -> Done:
            return run_named_task(order, meter.step(number, order.name))

        for done in run_here(wanted, run, threads):
            meter.done(place, done)
            yield place, done
        place += 1
