"""The tasks of a forest, as every executor runs them."""

import json
from functools import partial
from pathlib import Path

from usdfoliage.asset.packages.forest_package import write_forest_tile
from usdfoliage.asset.packages.interface import TILES
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.forest.planted import PLANTING_STEPS, plant_tiles
from usdfoliage.jobs.forest.planted_file import read_tile, write_planted
from usdfoliage.jobs.forest_tasks.build import ForestBuild, digest_forest
from usdfoliage.jobs.forest_tasks.tasks import ASSET, PLANTED, PLANTING, ForestPlan, plan_forest
from usdfoliage.jobs.plant.executors import Done, TaskOrder
from usdfoliage.jobs.plant.one_task import PlannedWork, run_order
from usdfoliage.jobs.plant.store import ResultFile, drop_result, fill_result, list_files
from usdfoliage.jobs.plant.tasks import Task
from usdfoliage.jobs.work.results import write_whole
from usdfoliage.progress import StepProgress

TILE = "tile.json"  # of a result: what the interface holds of the tile


def run_forest_task(order: TaskOrder[ForestBuild], progress: StepProgress | None = None) -> Done:
    """Do one task of a forest, unless another run has done it meanwhile; what goes wrong is returned, not raised."""

    def prepare() -> PlannedWork:
        plan = plan_forest(order.request, "memory", with_tiles=order.name != PLANTING)
        return PlannedWork(
            plan=plan.tasks,
            fill=lambda task, scratch: (_fill(order.request, plan, task, progress), False),
            require_unchanged=partial(_require_unchanged, order.request, plan),
            reads_many=frozenset((TILES,)),  # of what was planted each reads one file, which has a seal
        )

    return run_order(order, prepare)


def _fill(build: ForestBuild, plan: ForestPlan, task: Task, progress: StepProgress | None) -> tuple[ResultFile, ...]:
    """Do what the task is for; returns the files of its result."""
    store = build.store
    with fill_result(store, task.key) as out:
        (out / ASSET).mkdir()
        if task.stage == PLANTING:
            planted = plant_tiles(build.request, out / ASSET, {}, _within(task, progress))
            write_planted(out / PLANTED, planted)
        else:
            _write_tile(build, plan, task, out)
        return list_files(store, out, store.result(task.key))


def _within(task: Task, progress: StepProgress | None) -> StepProgress | None:
    """What to call with the steps of planting, to report them as one task."""
    if progress is None:
        return None
    report = progress
    return lambda step, share: report(task.name, (PLANTING_STEPS.index(step) + share) / len(PLANTING_STEPS))


def _write_tile(build: ForestBuild, plan: ForestPlan, task: Task, out: Path) -> None:
    tile = read_tile(build.store.result(plan.planting.key) / PLANTED, plan.tiles[task.chunk])
    written = write_forest_tile(out / ASSET, build.request.name, tile)
    facts = {"name": written.name, "extent_m": written.extent_m.tolist()}
    write_whole(out / TILE, json.dumps(facts).encode())


def _require_unchanged(build: ForestBuild, plan: ForestPlan, task: Task) -> None:
    """Nothing may be kept of files that were written while they were read: it would be taken for a result of others.

    Raises:
        CaptureError: A file is not as it was when the task was planned; what was made of it is gone.
    """
    if task.stage != PLANTING:  # the others read what was planted, and nothing else
        return
    before, now = dict(plan.digests), dict(digest_forest(build, "files"))
    changed = [name for name in sorted(now.keys() | before.keys()) if now.get(name) != before.get(name)]
    if changed:
        drop_result(build.store, task.key)
        named = ", ".join(changed[:4])
        raise CaptureError(
            f"files of the forest changed while they were read: {named}",
            "run the same command again when nothing writes there",
        )
