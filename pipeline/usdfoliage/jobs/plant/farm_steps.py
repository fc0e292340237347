"""A build cut into steps for a farm: each runs by itself, chunk by chunk, on any machine that sees the work folder.

The first step, plan, reads the input and remembers its digests; the last one, publish, puts the asset in its place.
Those between are the tasks of the build, grouped: a step may run when all chunks of the steps that it needs are done.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.executors import Done, TaskOrder
from usdfoliage.jobs.plant.finish import BuiltPlant, finish_plant
from usdfoliage.jobs.plant.record import note_build, note_task
from usdfoliage.jobs.plant.run import plan_plant
from usdfoliage.jobs.plant.store import find_finished, lock_task, read_stamp, remove_leftovers, stamp_mark
from usdfoliage.jobs.plant.tasks import REPORT, BuildPlan
from usdfoliage.jobs.plant.worker import run_named_task
from usdfoliage.progress import StepProgress

logger = logging.getLogger(__name__)

PLAN, PUBLISH = "plan", "publish"


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step of a build."""

    name: str
    stage: str = ""  # of its tasks
    tasks: tuple[str, ...] = ()  # of the plan, one a chunk
    needs: tuple[str, ...] = ()  # names of steps
    estimate_s: float = 0.0  # of a chunk, the longest

    @property
    def chunks(self) -> int:
        return max(len(self.tasks), 1)


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """A chunk of a step that is to be run."""

    plan: BuildPlan
    order: TaskOrder


def list_steps(plan: BuildPlan) -> tuple[Step, ...]:
    """The steps of a plant, each after those that it needs."""
    groups: dict[str, list[str]] = {}
    for name, task in plan.tasks.items():
        groups.setdefault(task.step, []).append(name)
    steps = [Step(name=PLAN, estimate_s=1.0)]
    for name, tasks in groups.items():
        needs = dict.fromkeys(plan.tasks[need].step for task in tasks for need in plan.tasks[task].needs)
        estimate_s = max(plan.tasks[task].estimate_s for task in tasks)
        steps.append(
            Step(
                name=name,
                stage=plan.tasks[tasks[0]].stage,
                tasks=tuple(tasks),
                needs=tuple(needs) or (PLAN,),
                estimate_s=estimate_s,
            )
        )
    return (*steps, Step(name=PUBLISH, needs=(REPORT,), estimate_s=1.0))


def find_step(steps: Sequence[Step], name: str) -> Step:
    """The step of that name; FoliageError where the plant has none."""
    for step in steps:
        if step.name == name:
            return step
    raise FoliageError(f"this plant has no step {name}; it has {', '.join(step.name for step in steps)}")


def plan_step(request: BuildRequest) -> tuple[Step, ...]:
    """The step plan: read every input file, and remember its digest.

    Raises:
        FoliageError: The input is unusable, or the work folder cannot be written.
    """
    remove_leftovers(request.store)
    _, plan = plan_plant(request, "bytes")
    note_build(request, plan)
    return list_steps(plan)


def find_chunks(
    request: BuildRequest, name: str, chunks: range | None = None, of: int | None = None, threads: int = 0
) -> tuple[Chunk, ...]:
    """Chunks of a step.

    Args:
        request: The plant.
        name: Of the step.
        chunks: From 1; None: all.
        of: How many there are as far as the caller knows.
        threads: Of each.

    Raises:
        FoliageError: There is no such step or chunk, or the input is unusable.
    """
    _, plan = plan_plant(request, "memory")
    step = find_step(list_steps(plan), name)
    if of is not None and of != step.chunks:
        raise FoliageError(
            f"{name} has {step.chunks} chunks, not {of}: the photographs or the plan have changed since the job was "
            "made",
            "make it again",
        )
    chosen = chunks or range(1, step.chunks + 1)
    if chosen[0] < 1 or chosen[-1] > step.chunks:
        raise FoliageError(f"{name} has chunks 1 to {step.chunks}, not {chosen[0]} to {chosen[-1]}")
    tasks = [plan.tasks[step.tasks[number - 1]] for number in chosen]
    return tuple(
        Chunk(
            plan=plan,
            order=TaskOrder(
                request=request,
                name=task.name,
                key=task.key,
                threads=threads,
                poor_mark=stamp_mark(request.store, task.key),
            ),
        )
        for task in tasks
    )


def run_chunk(chunk: Chunk, progress: StepProgress | None = None) -> Done:
    """Do one chunk, unless it is done, or was pruned and all that is made of it is there: farms run chunks again.

    Raises:
        FoliageError: What it needs is not done.
    """
    order, plan = chunk.order, chunk.plan
    request, task = order.request, plan.tasks[order.name]
    missing = [need for need in task.needs if not _is_there(request, plan, need)]
    if find_finished(request.store, order.key, thorough=True) is None:
        if not _is_wanted(request, plan, order.name, {}):
            note_task(request, plan, task)
            return Done(name=order.name, seconds=0.0, was_run=False, spare=True)
        if missing:
            _forget_damaged(request, order.key)
            raise FoliageError(_explain_missing(plan, order.name, missing))
    done = run_named_task(order, progress)
    if done.lost:
        raise FoliageError(_explain_missing(plan, order.name, task.needs, "something that it needs is damaged"))
    return done


def publish_step(request: BuildRequest) -> BuiltPlant:
    """The step publish: the finished asset, if validation lets it, in its place.

    Raises:
        FoliageError: It is not finished, or cannot be written.
    """
    _, plan = plan_plant(request, "memory")
    if find_finished(request.store, plan.tasks[REPORT].key, thorough=True) is None:
        raise FoliageError(_explain_missing(plan, PUBLISH, [REPORT]))
    stamps = {name: read_stamp(request.store, task.key) for name, task in plan.tasks.items()}
    seconds = {name: stamp.seconds for name, stamp in stamps.items() if stamp is not None}
    made = BuiltPlant(
        request=request,
        tasks=len(plan.tasks),
        seconds=seconds,
        stages={name: task.stage for name, task in plan.tasks.items()},
        wall_s=sum(seconds.values()),
    )
    return finish_plant(made, plan, "on a farm, step by step")


def _is_there(request: BuildRequest, plan: BuildPlan, task: str) -> bool:
    return find_finished(request.store, plan.tasks[task].key, thorough=False) is not None


def _is_wanted(request: BuildRequest, plan: BuildPlan, name: str, wanted: dict[str, bool]) -> bool:
    """Whether a task is wanted for itself, or something that is wanted and not done reads it."""
    if name not in wanted:
        wanted[name] = name in plan.last or any(
            not _is_good(request, reader.key) and _is_wanted(request, plan, reader.name, wanted)
            for reader in plan.needed_by(name)
        )
    return wanted[name]


def _is_good(request: BuildRequest, key: str) -> bool:
    stamp = find_finished(request.store, key, thorough=False)
    return stamp is not None and not stamp.poor


def _forget_damaged(request: BuildRequest, key: str) -> None:
    """Remove the stamp of a result whose bytes were altered, else what it is made of counts as spare."""
    store = request.store
    with lock_task(store, key):
        if find_finished(store, key, thorough=True) is None:
            store.stamp(key).unlink(missing_ok=True)


def _explain_missing(
    plan: BuildPlan, name: str, missing: Sequence[str], what: str = "what it needs is not done"
) -> str:
    steps = dict.fromkeys(plan.tasks[each].step for each in missing)
    return (
        f"{name} cannot run: {what}; run {' and '.join(steps)} first ({', '.join(missing[:4])}); if it was done and "
        "then pruned, submit the job again, or run usdfoliage build with the same options: each makes what is missing"
    )
