"""The tasks of a build, as every executor runs them: which stage does which, on what."""

import re
from collections.abc import Mapping
from pathlib import Path

from usdfoliage.capture.folder.listing import IMAGES, is_video, named
from usdfoliage.errors import CaptureError, FoliageError, WriteError
from usdfoliage.jobs.plant.call import BuildRequest, Stage, StageCall, digest_profile, inputs_of
from usdfoliage.jobs.plant.executors import Done, TaskOrder
from usdfoliage.jobs.plant.inputs import BuildInputs
from usdfoliage.jobs.plant.one_task import PlannedWork, run_order
from usdfoliage.jobs.plant.stages.assemble import assemble_asset
from usdfoliage.jobs.plant.stages.capture import find_poses, finish_photographs, match_photographs
from usdfoliage.jobs.plant.stages.cloud import make_cloud
from usdfoliage.jobs.plant.stages.isolate import isolate_capture
from usdfoliage.jobs.plant.stages.part_asset import write_part_asset
from usdfoliage.jobs.plant.stages.parts import find_leaves, make_crown, trace_branches
from usdfoliage.jobs.plant.stages.report import compare_plant, report_plant, show_variants, turn_plant
from usdfoliage.jobs.plant.stages.sketch import sketch_plant
from usdfoliage.jobs.plant.stages.withheld import measure_plant
from usdfoliage.jobs.plant.store import ResultFile, drop_result, fill_result, list_files
from usdfoliage.jobs.plant.summary import SUMMARY, read_summary, rename_paths
from usdfoliage.jobs.plant.tasks import (
    ASSET,
    BRANCHES,
    CLOUD,
    COMPARISONS,
    CROWN,
    DEPTH,
    ISOLATION,
    LEAVES,
    MATCHING,
    PART_ASSET,
    POSES,
    REPORT,
    SKETCH,
    TURNTABLE,
    VARIANTS,
    WITHHELD,
    BuildPlan,
    Task,
    plan_build,
)
from usdfoliage.progress import StepProgress
from usdfoliage.remarks import rename_in_remedy

STAGES: Mapping[str, Stage] = {
    POSES: find_poses,
    MATCHING: match_photographs,
    DEPTH: finish_photographs,
    CLOUD: make_cloud,
    ISOLATION: isolate_capture,
    BRANCHES: trace_branches,
    LEAVES: find_leaves,
    CROWN: make_crown,
    PART_ASSET: write_part_asset,
    ASSET: assemble_asset,
    SKETCH: sketch_plant,
    WITHHELD: measure_plant,
    TURNTABLE: turn_plant,
    COMPARISONS: compare_plant,
    VARIANTS: show_variants,
    REPORT: report_plant,
}
# These read many files of others, each of which is checked for damage as it is read.
_READ_MANY = frozenset((MATCHING, DEPTH))


def run_named_task(order: TaskOrder[BuildRequest], progress: StepProgress | None = None) -> Done:
    """Do one task, unless another run has done it meanwhile.

    What goes wrong is returned, not raised: a farm's worker goes on with the next.
    """

    def prepare() -> PlannedWork:
        inputs, plan = _plan(order.request)
        return PlannedWork(
            plan=plan,
            fill=lambda task, scratch: _fill(order, inputs, plan, task, scratch, progress),
            require_unchanged=lambda task: _require_unchanged(order.request, inputs, task),
            reads_many=_READ_MANY,
        )

    return run_order(order, prepare, lambda error: _explain(order, error))


def _explain(order: TaskOrder[BuildRequest], error: FoliageError) -> Done:
    """The error with the files of the capture as the user has them.

    What could not be written is a file of the task itself, and the disk of the work folder the one to look at.
    """
    text, remedy = error.text, error.remedy
    if not isinstance(error, WriteError):
        source = str(order.request.capture)
        text = _as_given(text, order.request, source)
        remedy = rename_in_remedy(remedy, lambda part: _as_given(part, order.request, source))
    return Done(name=order.name, seconds=0.0, was_run=True, error=text, remedy=remedy)


def _fill(
    order: TaskOrder[BuildRequest],
    inputs: BuildInputs,
    plan: BuildPlan,
    task: Task,
    scratch: Path,
    progress: StepProgress | None,
) -> tuple[tuple[ResultFile, ...], bool]:
    """Run the stage; returns the files of its result, and whether that is poor."""
    store = order.request.store
    with fill_result(store, task.key) as out:
        others = STAGES[task.stage](
            StageCall(
                request=order.request,
                inputs=inputs,
                plan=plan,
                task=task,
                out=out,
                scratch=scratch,
                threads=order.threads,
                progress=progress,
            )
        )
        if (out / SUMMARY).is_file():  # which is part of the report: the same on every machine
            rename_paths(out, lambda text: _as_reported(text, order.request))
        return (*list_files(store, out, store.result(task.key)), *others), read_summary(out).poor


def _plan(request: BuildRequest) -> tuple[BuildInputs, BuildPlan]:
    inputs = inputs_of(request, "memory")
    return inputs, plan_build(inputs, request.settings, request.name, request.only, digest_profile(request))


def _require_unchanged(request: BuildRequest, inputs: BuildInputs, task: Task) -> None:
    """Nothing may be kept of files that were written while they were read: it would be taken for a result of others.

    Every stage reads files of the capture, if only as links to them in results.

    Raises:
        CaptureError: The capture is not as it was when the task was planned; what was made of it is gone.
    """
    before = dict(inputs.digests)
    try:
        now = dict(inputs_of(request, "files").digests)
        changed = [name for name in sorted(now.keys() | before.keys()) if now.get(name) != before.get(name)]
        if not changed:
            return
        text = named(changed)
    except CaptureError as error:
        text = error.text
    drop_result(request.store, task.key)
    raise CaptureError(
        f"{request.capture} changed while it was read: {text}", "run the same command again when nothing writes there"
    )


def _as_reported(text: str, request: BuildRequest) -> str:
    """A message with files of the capture below its name, and … for the work folder, wherever the two are."""
    given = _as_given(text, request, request.capture.resolve().name)
    return given.replace(str(request.store.folder), "…")


def _as_given(text: str, request: BuildRequest, source: str) -> str:
    """A message with files of the capture as source has them: tasks work on links and copies in the work folder."""
    place = request.capture.resolve()
    name = re.escape(place.stem if is_video(place.name) else place.name)
    laid = rf"{re.escape(str(request.store.folder))}/(?:scratch/[^/\s]+|results/[^/\s]+/capture)/{name}"
    if not (request.capture / IMAGES).is_dir():  # a plain folder of photographs
        laid += f"(?:/{IMAGES})?"
    return re.sub(f"{laid}|{re.escape(str(request.capture))}(?=/|\\s|$)", lambda _: source, text)
