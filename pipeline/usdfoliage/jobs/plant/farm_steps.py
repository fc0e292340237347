"""A build step by step, as farms run it."""

from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.executors import Done
from usdfoliage.jobs.plant.finish import BuiltPlant, finish_plant
from usdfoliage.jobs.plant.record import note_build
from usdfoliage.jobs.plant.run import plan_plant
from usdfoliage.jobs.plant.steps import (
    PUBLISH,
    Chunk,
    Step,
    choose_chunks,
    do_chunk,
    explain_missing,
    find_step,
    list_steps,
)
from usdfoliage.jobs.plant.store import find_finished, read_stamp, remove_leftovers
from usdfoliage.jobs.plant.tasks import REPORT
from usdfoliage.jobs.plant.worker import run_named_task
from usdfoliage.progress import StepProgress


def find_steps(request: BuildRequest) -> tuple[Step, ...]:
    """The steps of a plant, by the names of its files; nothing is read of files that nobody remembers.

    Raises:
        FoliageError: The input is unusable.
    """
    return list_steps(plan_plant(request, "names")[1], (REPORT,))


def plan_step(request: BuildRequest) -> tuple[Step, ...]:
    """The step plan: read every input file, and remember its digest.

    Raises:
        FoliageError: The input is unusable, or the work folder cannot be written.
    """
    remove_leftovers(request.store)
    _, plan = plan_plant(request, "bytes")
    note_build(request, plan)
    return list_steps(plan, (REPORT,))


def find_chunks(
    request: BuildRequest, name: str, chunks: range | None = None, of: int | None = None, threads: int = 0
) -> tuple[Chunk[BuildRequest], ...]:
    """Chunks of a step, as choose_chunks.

    Raises:
        FoliageError: There is no such step or chunk, or the input is unusable.
    """
    _, plan = plan_plant(request, "memory")
    return choose_chunks(request, plan, find_step(list_steps(plan, (REPORT,)), name), chunks, of, threads)


def run_chunk(chunk: Chunk[BuildRequest], progress: StepProgress | None = None) -> Done:
    """Do one chunk, as do_chunk."""
    return do_chunk(chunk, run_named_task, progress)


def publish_step(request: BuildRequest) -> BuiltPlant:
    """The step publish: the finished asset, if validation lets it, in its place.

    Raises:
        FoliageError: It is not finished, or cannot be written.
    """
    _, plan = plan_plant(request, "memory")
    if find_finished(request.store, plan.tasks[REPORT].key, thorough=True) is None:
        raise FoliageError(explain_missing(plan, PUBLISH, [REPORT]))
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
