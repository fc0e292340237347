"""The tasks that find poses, and the depth of some photographs at a time."""

import os
import shutil
from functools import lru_cache
from pathlib import Path

from usdfoliage.capture.folder.listing import CAMERAS, IMAGES, named
from usdfoliage.capture.folder.read import Capture
from usdfoliage.capture.folder.settings import FILE_NAME, complete_capture_settings
from usdfoliage.jobs.capture.depth_tasks import (
    DepthTasks,
    MissingTasks,
    PreparedViews,
    plan_tasks,
    prepare_views,
    run_tasks,
)
from usdfoliage.jobs.capture.find_photographs import find_photographs
from usdfoliage.jobs.capture.folder import Record, lay_out
from usdfoliage.jobs.capture.poses import (
    REGISTERED,
    PosedCapture,
    check_world,
    estimate_poses,
    failures_of,
    observation_errors_px,
    poses_are_given,
    read_posed,
)
from usdfoliage.jobs.capture.settings import CaptureRunSettings
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.store import ResultFile, describe_files
from usdfoliage.jobs.plant.summary import StageSummary, write_summary
from usdfoliage.jobs.plant.tasks import POSES
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.work.results import WORK, has_result, write_whole
from usdfoliage.remarks import merge_remarks, remark

_MAX_NAMED = 5  # photographs with the reason why they are left out


def capture_folder(call: StageCall, task: str) -> Path:
    """The capture that a task made, named as the user's."""
    return call.result_of(task) / "capture" / capture_name(call)


def capture_name(call: StageCall) -> str:
    return call.inputs.name or "capture"


def find_poses(call: StageCall) -> tuple[ResultFile, ...]:
    """Poses that are given, or estimated ones, in a capture of their own; and every photograph read once."""
    settings = call.settings.capture
    laid = call.scratch / capture_name(call)
    given = find_photographs(call.request.capture, laid, call.inputs.frames)
    known = poses_are_given(given, Record(given.work), settings.poses)
    check_world(settings.world, given=known)
    lay_out(given, Record(given.work), cameras=known)
    if known:
        posed = read_posed(laid, None)
    else:
        posed = estimate_poses(laid, None, settings, threads=call.threads, progress=call.progress)
    capture = call.out / "capture" / capture_name(call)
    for folder in (IMAGES, "masks"):
        _link_folder(laid / folder, capture / folder)
    shutil.copytree(laid / CAMERAS if known else laid / WORK / REGISTERED, capture / CAMERAS)
    stated = posed.capture.settings
    settings_file = laid / FILE_NAME
    text = settings_file.read_bytes().decode("utf-8") if settings_file.is_file() else ""
    completed = complete_capture_settings(text, {"up_axis": stated.up_axis, "metres_per_unit": stated.metres_per_unit})
    if completed:
        write_whole(capture / FILE_NAME, completed.encode("utf-8"))
    prepared = _prepare(read_posed(capture, None).capture, store_of_views(call), settings, call.threads)
    failures = failures_of(posed, prepared.dropped)
    remarks = [*call.inputs.remarks, *posed.remarks, *prepared.remarks, *(prepared.checks if known else ())]
    if failures:
        remarks = [each for each in remarks if each.code != "photographs-unusable"]  # the next remark names them all
        text = (
            f"{len(failures)} of {len(call.inputs.photographs)} photographs are left out: "
            + "; ".join(f"{name}: {reason}" for name, reason in sorted(failures.items())[:_MAX_NAMED])
            + (f"; and {len(failures) - _MAX_NAMED} more" if len(failures) > _MAX_NAMED else "")
        )
        remarks.append(remark("photographs-left-out", text, subject=named(sorted(failures))))
    rows = _pose_rows(call, posed, prepared, known=known)
    write_summary(call.out, StageSummary(rows=rows, remarks=merge_remarks(remarks)))
    return describe_files(call.store, [view.pixels for view in prepared.views])


def _pose_rows(call: StageCall, posed: PosedCapture, prepared: PreparedViews, *, known: bool) -> list[Row]:
    rows = [
        Row(name="photographs", value=f"{len(call.inputs.photographs):,}"),
        Row(name="with a pose", value=f"{len(prepared.views):,}", remark="given" if known else "estimated"),
    ]
    errors_px = observation_errors_px(posed)
    if errors_px is not None and len(errors_px):
        rows.append(Row(name="reprojection error", value=f"{float((errors_px**2).mean()) ** 0.5:.2f} px", remark="rms"))
    return rows


def match_photographs(call: StageCall) -> tuple[ResultFile, ...]:
    """One round of matching of some photographs."""
    tasks, views = _own_views(call)
    number = call.task.round
    paths = {k: path for k in views if (path := tasks.planes[number][k]) is not None}
    missing = tuple(k for k, path in paths.items() if not has_result(path))
    planes = tuple(missing if place == number else () for place in range(len(tasks.planes)))
    _run(call, tasks, MissingTasks(planes=planes, depth=()))
    return describe_files(call.store, paths.values())


def finish_photographs(call: StageCall) -> tuple[ResultFile, ...]:
    """Depth of some photographs, out of the last round of matching."""
    tasks, views = _own_views(call)
    paths = {k: path for k in views if (path := tasks.depth[k]) is not None}
    missing = tuple(k for k, path in paths.items() if not has_result(path))
    _run(call, tasks, MissingTasks(planes=tuple(() for _ in tasks.planes), depth=missing))
    return describe_files(call.store, paths.values())


def _run(call: StageCall, tasks: DepthTasks, missing: MissingTasks) -> None:
    run_tasks(tasks, missing, threads=call.threads, keep=True, progress=call.report_parts)
    write_summary(call.out, StageSummary())


def store_of_views(call: StageCall) -> Path:
    return call.store.views(call.plan.tasks[POSES].key)


def _prepare(capture: Capture, store: Path, settings: CaptureRunSettings, threads: int) -> PreparedViews:
    """Every task of one build must make the same request: the keys of matching are made of it."""
    return prepare_views(
        capture,
        store,
        settings.depth.max_side_px,
        masks=settings.mask != "none",
        sky=settings.sky if settings.mask == "auto" else None,
        threads=threads,
    )


def _own_views(call: StageCall) -> tuple[DepthTasks, range]:
    """All that is to be matched, and which views are of this task."""
    tasks = _open_tasks(capture_folder(call, POSES), store_of_views(call), call.settings.capture, call.threads)
    return tasks, range(call.task.chunk, len(tasks.views), call.task.chunks)


@lru_cache(maxsize=2)
def _open_tasks(capture: Path, store: Path, settings: CaptureRunSettings, threads: int) -> DepthTasks:
    """Remembered: a process does many tasks of one capture."""
    posed = read_posed(capture, None).capture
    prepared = _prepare(posed, store, settings, threads)
    return plan_tasks(prepared.views, posed.points_m, settings.depth, store, dense=settings.dense)


def _link_folder(source: Path, target: Path) -> None:
    """Links to the files of a folder, copies where the disk has no links; a folder that is absent is none."""
    for path in sorted(source.rglob("*")):
        there = target / path.relative_to(source)
        if path.is_dir():
            there.mkdir(parents=True, exist_ok=True)
            continue
        there.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(path, there)
        except OSError:
            shutil.copyfile(path, there)
