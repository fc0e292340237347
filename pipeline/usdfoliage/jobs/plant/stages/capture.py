"""The tasks that find poses, and the depth of some photographs at a time."""

import os
import shutil
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from usdfoliage.capture.folder.hold_back import choose_withheld
from usdfoliage.capture.folder.listing import CAMERAS, IMAGES, MASKS, counted, file_of, files_below, named
from usdfoliage.capture.folder.read import Capture
from usdfoliage.capture.folder.settings import FILE_NAME, state_frame
from usdfoliage.capture.mask_place import describe_moves, measure_move
from usdfoliage.capture.poses.model_without import write_model_without
from usdfoliage.capture.view_check import refuse_inverted_masks
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.capture.depth_tasks import (
    DepthTasks,
    MissingTasks,
    PreparedViews,
    plan_tasks,
    prepare_views,
    read_pixels,
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
from usdfoliage.remarks import Remark, Setting, merge_remarks, remark

WITHHELD = "withheld"  # beside the capture that the plant is made of
_MIN_LEFT = 2  # photographs that depth takes
_MAX_NAMED = 5  # photographs with the reason why they are left out
_CHECKED_MASKS = 16  # evenly chosen: masks are inverted or displaced by the program that made them all


def capture_folder(call: StageCall, task: str) -> Path:
    """The capture that a task made, named as the user's."""
    return call.result_of(task) / "capture" / capture_name(call)


def withheld_folder(call: StageCall) -> Path:
    """The capture of the photographs that were withheld; there is none where none were."""
    return call.result_of(POSES) / WITHHELD / capture_name(call)


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
        # Depth in metres shows how long a unit of the poses is; it is not laid out.
        posed = read_posed(call.request.capture if call.inputs.has_depth else laid, None)
    else:
        posed = estimate_poses(laid, None, settings, threads=call.threads, progress=call.progress)
    capture = call.out / "capture" / capture_name(call)
    cameras = laid / CAMERAS if known else laid / WORK / REGISTERED
    every = tuple(call.inputs.photographs)
    withheld = choose_withheld(every, call.settings.plant.hold_back)
    if withheld:
        _check_left(posed, withheld)
        kept = tuple(name for name in every if name not in withheld)
        _lay_out_some(laid, cameras, capture, left_out=withheld)
        _lay_out_some(laid, cameras, call.out / WITHHELD / capture_name(call), left_out=kept)
    else:
        for folder in (IMAGES, MASKS):
            _link_folder(laid / folder, capture / folder)
        shutil.copytree(cameras, capture / CAMERAS)
    settings_file = laid / FILE_NAME
    text = settings_file.read_bytes().decode("utf-8") if settings_file.is_file() else ""
    stated = state_frame(text, posed.capture.settings).encode("utf-8")
    write_whole(capture / FILE_NAME, stated)
    if withheld:
        write_whole(call.out / WITHHELD / capture_name(call) / FILE_NAME, stated)
    prepared = _prepare(read_posed(capture, None).capture, store_of_views(call), settings, call.threads)
    of_masks = _check_masks(prepared)
    failures = failures_of(posed, prepared.dropped)
    failures = {name: reason for name, reason in failures.items() if name not in withheld}
    remarks = [*call.inputs.remarks, *posed.remarks, *prepared.remarks, *of_masks, *(prepared.checks if known else ())]
    if failures:
        remarks = [each for each in remarks if each.code != "photographs-unusable"]  # the next remark names them all
        text = (
            f"{len(failures)} of {len(call.inputs.photographs)} photographs are left out: "
            + "; ".join(f"{name}: {reason}" for name, reason in sorted(failures.items())[:_MAX_NAMED])
            + (f"; and {len(failures) - _MAX_NAMED} more" if len(failures) > _MAX_NAMED else "")
        )
        remarks.append(remark("photographs-left-out", text, subject=named(sorted(failures))))
    rows = _pose_rows(call, posed, prepared, known=known, withheld=len(withheld))
    write_summary(call.out, StageSummary(rows=rows, remarks=merge_remarks(remarks)))
    return describe_files(call.store, [view.pixels for view in prepared.views])


def _check_masks(prepared: PreparedViews) -> tuple[Remark, ...]:
    """What photographs show of faults of the masks that they came with, before anything is matched within these.

    Raises:
        CaptureError: The masks show all but the plant.
    """
    masked = [view for view in prepared.views if view.chosen.mask is not None]
    some = np.unique(np.linspace(0, len(masked) - 1, min(len(masked), _CHECKED_MASKS)).round().astype(int))
    views = [read_pixels(masked[number], widened=False) for number in some]
    refuse_inverted_masks(views)
    return describe_moves([measure_move(view.srgb, view.mask) for view in views if view.mask is not None])


def _pose_rows(
    call: StageCall, posed: PosedCapture, prepared: PreparedViews, *, known: bool, withheld: int
) -> list[Row]:
    rows = [
        Row(name="photographs", value=f"{len(call.inputs.photographs):,}"),
        *([Row(name="withheld", value=f"{withheld:,}", remark="nothing is made of them")] if withheld else []),
        Row(name="with a pose", value=f"{len(prepared.views):,}", remark="given" if known else "estimated"),
    ]
    rows += posed.frame_rows()
    errors_px = observation_errors_px(posed)
    if errors_px is not None and len(errors_px):
        rows.append(Row(name="reprojection error", value=f"{float((errors_px**2).mean()) ** 0.5:.2f} px", remark="rms"))
    return rows


def _check_left(posed: PosedCapture, withheld: Sequence[str]) -> None:
    """CaptureError where too few photographs have a pose: of those that make the plant, or of those that measure it."""
    names = [view.name for view in posed.capture.views]
    left = [name for name in names if name not in withheld]
    if len(left) < _MIN_LEFT:
        raise CaptureError(
            f"{counted(len(left), 'photograph')} with a pose would be left without the {len(withheld)} that are "
            f"withheld; depth takes {_MIN_LEFT} at least",
            ("withhold fewer with ", Setting(name="plant.hold_back")),
        )
    if len(left) == len(names):
        raise CaptureError(
            f"none of the photographs that are withheld ({named(withheld)}) has a pose",
            ("withhold others with ", Setting(name="plant.hold_back")),
        )


def _lay_out_some(source: Path, cameras: Path, target: Path, left_out: Sequence[str]) -> None:
    """A capture without some photographs: their files, their masks and their cameras."""
    photographs = [name for name in files_below(source / IMAGES) if name not in left_out]
    masks = files_below(source / MASKS)
    _link_files({name: source / IMAGES / name for name in photographs}, target / IMAGES)
    of_some = [file_of(name, masks, (".png",)) for name in photographs]
    _link_files({path.relative_to(source / MASKS).as_posix(): path for path in of_some if path}, target / MASKS)
    write_model_without(cameras, target / CAMERAS, frozenset(left_out))


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
    files = {}
    for path in sorted(source.rglob("*")):
        name = path.relative_to(source).as_posix()
        if path.is_dir():
            (target / name).mkdir(parents=True, exist_ok=True)
            continue
        files[name] = path
    _link_files(files, target)


def _link_files(files: Mapping[str, Path], target: Path) -> None:
    for name, path in files.items():
        there = target / name
        there.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(path, there)
        except OSError:
            shutil.copyfile(path, there)
