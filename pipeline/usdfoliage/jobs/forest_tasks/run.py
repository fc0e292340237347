"""A forest in tasks from its beginning to its end, at once or step by step."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from usdfoliage.asset.packages.forest_package import WrittenTile
from usdfoliage.asset.packages.interface import TILES
from usdfoliage.asset.publish import publish_folder
from usdfoliage.errors import FoliageError
from usdfoliage.files.json import read_json
from usdfoliage.files.npz import reading_model
from usdfoliage.jobs.forest.planted_file import read_outline
from usdfoliage.jobs.forest.run import finish_forest
from usdfoliage.jobs.forest_tasks.build import ForestBuild
from usdfoliage.jobs.forest_tasks.tasks import ASSET, PLANTED, PLANTING, ForestPlan, plan_forest
from usdfoliage.jobs.forest_tasks.worker import TILE, run_forest_task
from usdfoliage.jobs.plant.executor_choice import ExecutorChoice
from usdfoliage.jobs.plant.executors import Done, Wanted, Workers, run_here, run_on
from usdfoliage.jobs.plant.record import note_build, use_plant
from usdfoliage.jobs.plant.steps import PUBLISH, Chunk, Step, choose_chunks, do_chunk, explain_missing, find_step
from usdfoliage.jobs.plant.steps import list_steps as steps_of
from usdfoliage.jobs.plant.store import copy_tree, find_finished, read_stamp, remove_leftovers
from usdfoliage.jobs.plant.tasks import find_wanted
from usdfoliage.jobs.plant.workers import open_workers
from usdfoliage.jobs.report.published import PublishedAsset
from usdfoliage.progress import StepProgress
from usdfoliage.remarks import RenderSetting

MAX_PLANS = 4  # a result that is lost while others are made is made again, but not for ever
FOREST = "forest"  # the command


class InternalFault(Exception):
    """A task failed by a fault of ours; the text is its traceback."""


def build_forest(
    build: ForestBuild, where: ExecutorChoice, render: RenderSetting, progress: StepProgress | None = None
) -> PublishedAsset:
    """Plant a forest and write its tiles where the user chooses, and publish it; what is done is not done again.

    Args:
        build: The forest.
        where: Where tasks run.
        render: How the report writes a setting.
        progress: Called with the steps.

    Raises:
        FoliageError: A file cannot be used, the output cannot be written, or there are no workers.
        InternalFault: A task broke.
    """
    remove_leftovers(build.store)
    with open_workers(where) as (workers, threads):
        for _ in range(MAX_PLANS):
            plan = plan_forest(build)
            note_build(build, plan.tasks)
            tasks, _ = find_wanted(plan.tasks, build.store, thorough=True)
            wanted = Wanted(request=build, plan=plan.tasks, tasks=tasks)
            if not any(done.lost for done in _run(wanted, workers, threads, progress)):
                break
        else:
            raise FoliageError(f"results in {build.work} vanish as soon as they are made", "is somebody removing them?")
    return publish_forest(build, render, progress)


def find_steps(build: ForestBuild) -> tuple[Step, ...]:
    """The steps of a forest; its terrain is read where it was not planted yet.

    Raises:
        FoliageError: The input is unusable.
    """
    return _list_steps(plan_forest(build, "names"))


def plan_step(build: ForestBuild) -> tuple[Step, ...]:
    """The step plan: read every input file, and remember its digest.

    Raises:
        FoliageError: The input is unusable, or the work folder cannot be written.
    """
    remove_leftovers(build.store)
    plan = plan_forest(build)
    note_build(build, plan.tasks)
    return _list_steps(plan)


def find_chunks(
    build: ForestBuild, name: str, chunks: range | None = None, of: int | None = None, threads: int = 0
) -> tuple[Chunk[ForestBuild], ...]:
    """Chunks of a step, as choose_chunks.

    Raises:
        FoliageError: There is no such step or chunk, or the input is unusable.
    """
    plan = plan_forest(build, "memory")
    step = find_step(_list_steps(plan), name, FOREST)
    return choose_chunks(build, plan.tasks, step, chunks, of, threads, FOREST)


def run_chunk(chunk: Chunk[ForestBuild], progress: StepProgress | None = None) -> Done:
    """Do one chunk, as do_chunk."""
    return do_chunk(chunk, run_forest_task, progress)


def publish_forest(build: ForestBuild, render: RenderSetting, progress: StepProgress | None = None) -> PublishedAsset:
    """The step publish: the finished forest in its place, whole or not at all.

    Raises:
        FoliageError: It is not finished, or cannot be written.
    """
    store = build.store
    with use_plant(build):
        plan = plan_forest(build, "memory")
        tasks = plan.tasks.tasks
        missing = [name for name, task in tasks.items() if find_finished(store, task.key, thorough=True) is None]
        if missing:
            raise FoliageError(explain_missing(plan.tasks, PUBLISH, missing, command=FOREST))
        seconds = _seconds_of(build, plan)
        request = replace(build.request, render_setting=render)
        with publish_folder(
            request.output, force=request.force, origin=request.origin, keep_old=request.keep_old
        ) as folder:
            for task in tasks.values():
                copy_tree(store.result(task.key) / ASSET, folder)
            outline = read_outline(store.result(plan.planting.key) / PLANTED)
            return finish_forest(request, folder, outline, list(_read_tiles(build, plan)), seconds, progress)


def _list_steps(plan: ForestPlan) -> tuple[Step, ...]:
    return steps_of(plan.tasks, plan.tasks.last)


def _run(
    wanted: Wanted[ForestBuild], workers: Workers | None, threads: int, progress: StepProgress | None
) -> Iterator[Done]:
    """Do the tasks; ends after one that failed, and raises what it failed by."""
    count = sum(task.stage == TILES for task in wanted.tasks.values())
    tiles = 0
    if not wanted.tasks:
        return
    if progress is not None:
        progress(PLANTING if PLANTING in wanted.tasks else TILES, 0.0)
    for done in _done_by(wanted, workers, threads, progress):
        if done.fault:
            raise InternalFault(done.fault)
        if done.error:
            raise FoliageError(done.error, done.remedy)
        tiles += done.name != PLANTING
        if progress is not None:
            progress(TILES, tiles / max(count, 1))
        yield done


def _done_by(
    wanted: Wanted[ForestBuild], workers: Workers | None, threads: int, progress: StepProgress | None
) -> Iterator[Done]:
    if workers is None:
        yield from run_here(wanted, partial(run_forest_task, progress=progress), threads)
        return
    left = [wanted]
    for _, done in run_on(lambda: left.pop() if left else None, run_forest_task, workers, threads):
        yield done


def _seconds_of(build: ForestBuild, plan: ForestPlan) -> dict[str, float]:
    """How long the tasks of each stage took, by their stamps."""
    seconds: dict[str, float] = {}
    for task in plan.tasks.tasks.values():
        stamp = read_stamp(build.store, task.key)
        seconds[task.stage] = seconds.get(task.stage, 0.0) + (stamp.seconds if stamp is not None else 0.0)
    return seconds


def _read_tiles(build: ForestBuild, plan: ForestPlan) -> Iterator[WrittenTile]:
    for task in plan.tasks.tasks.values():
        if task.stage == TILES:
            path = build.store.result(task.key) / TILE
            with reading_model(path, "tile of a forest"):
                stored = read_json(path)
                extent_m = np.array(stored["extent_m"], np.float64).reshape(2, 3)
                written = WrittenTile(name=str(stored["name"]), extent_m=extent_m)
            yield written
