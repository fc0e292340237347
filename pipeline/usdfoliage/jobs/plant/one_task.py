"""One task, as every executor runs it: planned again from the files, done unless it is done, and stamped."""

import logging
import shutil
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.executors import Done, TaskOrder
from usdfoliage.jobs.plant.record import note_task, use_plant
from usdfoliage.jobs.plant.store import (
    ResultFile,
    Stamp,
    Store,
    drop_result,
    find_finished,
    lock_task,
    stamp_mark,
    write_stamp,
)
from usdfoliage.jobs.plant.task_request import R
from usdfoliage.jobs.plant.tasks import BuildPlan, Task

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class PlannedWork:
    """The plan of a worker, and what it does for a task of it."""

    plan: BuildPlan
    fill: Callable[[Task, Path], tuple[tuple[ResultFile, ...], bool]]  # with the scratch; files, and whether it is poor
    require_unchanged: Callable[[Task], None]  # FoliageError where the input has changed since it was planned
    reads_many: frozenset[str] = frozenset()  # stages that check for damage the files that they read, as they read them


def run_order(
    order: TaskOrder[R],
    prepare: Callable[[], PlannedWork],
    explain: Callable[[FoliageError], Done] | None = None,
) -> Done:
    """Do one task, unless another run has done it meanwhile.

    What goes wrong is returned, not raised: a farm's worker goes on with the next.

    Args:
        order: The task.
        prepare: Plans what it belongs to.
        explain: Words an error for the user; None for as it is.
    """
    try:
        work = prepare()
        task = work.plan.tasks.get(order.name)
        if task is None or task.key != order.key:
            raise FoliageError(
                f"{order.name} is planned otherwise here than where the build was started: {order.request.capture} "
                "has changed meanwhile, or this worker has another version of usdfoliage, its libraries, validators or "
                "preview interpreter"
            )
        note_task(order.request, work.plan, task)
        with use_plant(order.request):
            return _run(order, work, task)
    except FoliageError as error:
        if explain is not None:
            return explain(error)
        return Done(name=order.name, seconds=0.0, was_run=True, error=error.text, remedy=error.remedy)
    except Exception:  # noqa: BLE001 (a farm must hear of any)
        return Done(name=order.name, seconds=0.0, was_run=True, fault=traceback.format_exc())


def _run(order: TaskOrder[R], work: PlannedWork, task: Task) -> Done:
    store, plan = order.request.store, work.plan
    with lock_task(store, task.key) as scratch:
        finished = find_finished(store, task.key, thorough=True)
        if finished is not None and not (finished.poor and stamp_mark(store, task.key) == order.poor_mark):
            return Done(name=task.name, seconds=0.0, was_run=False)
        marks = {need: stamp_mark(store, plan.tasks[need].key) for need in task.needs}
        poor = False  # what is made of something poor is poor as well
        for need in task.needs:
            thorough = task.stage not in work.reads_many
            stamp = find_finished(store, plan.tasks[need].key, thorough=thorough)
            if stamp is None:
                return Done(name=task.name, seconds=0.0, was_run=False, lost=True)
            poor |= stamp.poor
        start = time.perf_counter()
        try:
            files, is_poor = work.fill(task, scratch)
            seconds = time.perf_counter() - start
        except Exception:
            work.require_unchanged(task)  # its message is more precise
            if _lost_needs(store, plan, marks, sizes=True):
                return Done(name=task.name, seconds=0.0, was_run=False, lost=True)
            raise
        work.require_unchanged(task)
        if _lost_needs(store, plan, marks):
            drop_result(store, task.key)
            return Done(name=task.name, seconds=0.0, was_run=False, lost=True)
        if stamp_mark(store, task.key):  # another run was faster, as without locks: its result stays
            return Done(name=task.name, seconds=seconds, was_run=True)
        write_stamp(
            store,
            Stamp(
                key=task.key,
                name=task.name,
                stage=task.stage,
                step=task.step,
                seconds=seconds,
                estimate_s=task.estimate_s,
                files=files,
                poor=poor or is_poor,
            ),
        )
        shutil.rmtree(scratch, ignore_errors=True)
    logger.info("%s: %.1f s", task.name, seconds)
    return Done(name=task.name, seconds=seconds, was_run=True)


def _lost_needs(store: Store, plan: BuildPlan, marks: Mapping[str, int], *, sizes: bool = False) -> bool:
    """Whether what a task read is gone, or was made anew by another run, while it was read."""
    keys = {need: plan.tasks[need].key for need in marks}
    return any(
        stamp_mark(store, keys[need]) != mark or (sizes and find_finished(store, keys[need], thorough=False) is None)
        for need, mark in marks.items()
    )
