"""Tasks grouped into steps for a farm: each runs by itself, chunk by chunk, where the work folder is seen.

The first step, plan, reads the input and remembers its digests; the last one, publish, puts the asset in its place.
Those between are the tasks, grouped: a step may run when all chunks of the steps that it needs are done.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic

from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.executors import Done, TaskOrder
from usdfoliage.jobs.plant.record import note_task
from usdfoliage.jobs.plant.store import find_finished, lock_task, stamp_mark
from usdfoliage.jobs.plant.task_request import R, TaskRequest
from usdfoliage.jobs.plant.tasks import BuildPlan
from usdfoliage.progress import StepProgress

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
class Chunk(Generic[R]):
    """A chunk of a step that is to be run."""

    plan: BuildPlan
    order: TaskOrder[R]
    command: str = "build"  # of usdfoliage, that does all steps


def list_steps(plan: BuildPlan, last: Sequence[str]) -> tuple[Step, ...]:
    """The steps of a plan, each after those that it needs; publish needs those of the last tasks."""
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
    of_last = dict.fromkeys(plan.tasks[task].step for task in last)
    return (*steps, Step(name=PUBLISH, needs=tuple(of_last), estimate_s=1.0))


def find_step(steps: Sequence[Step], name: str, what: str = "plant") -> Step:
    """The step of that name; FoliageError where what is made, a plant or a forest, has none."""
    for step in steps:
        if step.name == name:
            return step
    raise FoliageError(f"this {what} has no step {name}; it has {', '.join(step.name for step in steps)}")


def choose_chunks(
    request: R,
    plan: BuildPlan,
    step: Step,
    chunks: range | None = None,
    of: int | None = None,
    threads: int = 0,
    command: str = "build",
) -> tuple[Chunk[R], ...]:
    """Chunks of a step.

    Args:
        request: What is made.
        plan: Of it.
        step: Of the plan.
        chunks: From 1; None: all.
        of: How many there are as far as the caller knows.
        threads: Of each.
        command: Of usdfoliage, that does all steps.

    Raises:
        FoliageError: There is no such chunk.
    """
    if of is not None and of != step.chunks:
        raise FoliageError(
            f"{step.name} has {step.chunks} chunks, not {of}: the input or the settings have changed since the job was "
            "made",
            "make it again",
        )
    chosen = chunks or range(1, step.chunks + 1)
    if chosen[0] < 1 or chosen[-1] > step.chunks:
        raise FoliageError(f"{step.name} has chunks 1 to {step.chunks}, not {chosen[0]} to {chosen[-1]}")
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
            command=command,
        )
        for task in tasks
    )


def do_chunk(
    chunk: Chunk[R],
    run: Callable[[TaskOrder[R], StepProgress | None], Done],
    progress: StepProgress | None = None,
) -> Done:
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
            raise FoliageError(explain_missing(plan, order.name, missing, command=chunk.command))
    done = run(order, progress)
    if done.lost:
        what = "something that it needs is damaged"
        raise FoliageError(explain_missing(plan, order.name, task.needs, what, command=chunk.command))
    return done


def explain_missing(
    plan: BuildPlan,
    name: str,
    missing: Sequence[str],
    what: str = "what it needs is not done",
    *,
    command: str = "build",
) -> str:
    """Why a step cannot run, and what to run first."""
    steps = dict.fromkeys(plan.tasks[each].step for each in missing)
    return (
        f"{name} cannot run: {what}; run {' and '.join(steps)} first ({', '.join(missing[:4])}); if it was done and "
        f"then pruned, submit the job again, or run usdfoliage {command} with the same options: each makes what is "
        "missing"
    )


def _is_there(request: TaskRequest, plan: BuildPlan, task: str) -> bool:
    return find_finished(request.store, plan.tasks[task].key, thorough=False) is not None


def _is_wanted(request: TaskRequest, plan: BuildPlan, name: str, wanted: dict[str, bool]) -> bool:
    """Whether a task is wanted for itself, or something that is wanted and not done reads it."""
    if name not in wanted:
        wanted[name] = name in plan.last or any(
            not _is_good(request, reader.key) and _is_wanted(request, plan, reader.name, wanted)
            for reader in plan.needed_by(name)
        )
    return wanted[name]


def _is_good(request: TaskRequest, key: str) -> bool:
    stamp = find_finished(request.store, key, thorough=False)
    return stamp is not None and not stamp.poor


def _forget_damaged(request: TaskRequest, key: str) -> None:
    """Remove the stamp of a result whose bytes were altered, else what it is made of counts as spare."""
    store = request.store
    with lock_task(store, key):
        if find_finished(store, key, thorough=True) is None:
            store.stamp(key).unlink(missing_ok=True)
