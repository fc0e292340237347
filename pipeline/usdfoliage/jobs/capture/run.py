"""From photographs to a capture: depth of every one of them, and one coloured cloud."""

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from usdfoliage import __version__
from usdfoliage.capture.cloud.cleaning import drop_floating, drop_outliers, thin_to_disks
from usdfoliage.capture.cloud.fusion import CloudSettings, merge_views
from usdfoliage.capture.cloud.visibility import drop_seen_through
from usdfoliage.capture.folder.listing import CAMERAS, counted, named
from usdfoliage.capture.folder.photo_set import read_photo_set
from usdfoliage.capture.folder.settings import read_capture_settings
from usdfoliage.capture.mvs.colmap_stereo import check_cuda
from usdfoliage.capture.mvs.view_depths import remark_alone
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.files.threads import share_cores
from usdfoliage.jobs.capture.depth_tasks import (
    DepthTasks,
    PreparedViews,
    find_missing,
    forget_others,
    plan_tasks,
    prepare_views,
    run_tasks,
    seen_depths,
    seen_surfaces,
)
from usdfoliage.jobs.capture.find_photographs import GivenPhotographs, check_video_output, find_photographs
from usdfoliage.jobs.capture.folder import Record, lay_out, publish, restore_replaced
from usdfoliage.jobs.capture.maps import KINDS, ViewMaps, forget_other_maps, write_maps
from usdfoliage.jobs.capture.poses import (
    REGISTERED,
    check_world,
    estimate_poses,
    observation_errors_px,
    poses_are_given,
    read_posed,
)
from usdfoliage.jobs.capture.report import CaptureReport, write_capture_report
from usdfoliage.jobs.capture.results import (
    CLOUD,
    LAYER,
    LAYER_CLOUD,
    REPORT,
    describe_photographs,
    lay_cameras,
    lay_maps,
    list_results,
    shared_matches,
    write_results,
)
from usdfoliage.jobs.capture.settings import CaptureRunSettings
from usdfoliage.jobs.capture.video_frames import find_video, lay_frames
from usdfoliage.jobs.report.table import ReportPicture, choose_evenly
from usdfoliage.jobs.work.results import WORK, forget, lock_work
from usdfoliage.jobs.work.settings_file import list_settings
from usdfoliage.progress import StepProgress, follow_step
from usdfoliage.remarks import Argument, Remark, RenderSetting, as_plan_setting, label_remarks, remark

logger = logging.getLogger(__name__)

BESIDE = "_estimated"  # ends the name of a folder of maps where the user has one of that name
# Of memory, measured with photographs of a megapixel at two qualities; the cloud is small beside it.
MIN_BYTES, BYTES_A_PHOTO_PIXEL, BYTES_A_MATCHED_PIXEL = 250_000_000, 150, 400
BYTES_A_CLOUD_PIXEL, MAX_VIEWS_OF_CLOUD = 70, 24  # of every view; the more there are, the more they see the same
FRAMES = "frames"  # in the work folder: of videos
_NEW = "new"  # in the work folder: results on their way to their places


@dataclass(frozen=True, kw_only=True)
class CaptureRequest:
    """What the user asked for, checked."""

    source: Path
    output: Path | None
    settings: CaptureRunSettings
    views: str | None = None  # None: all
    resume: bool = False  # only go on with an earlier run
    fresh: bool = False  # forget earlier runs
    threads: int = 0
    report: bool = True
    report_views: int = 12
    force: bool = False
    store: Path | None = None  # where results by hash are, if several runs share them: nothing there is removed
    times: bool = True  # whether the report has how long each step took
    render_setting: RenderSetting = as_plan_setting  # how remedies in the report write a setting

    def __post_init__(self) -> None:
        if self.resume and self.fresh:
            raise FoliageError("resume goes on with an earlier run and fresh forgets it", "use one of them")
        if self.threads < 0:
            raise FoliageError(f"threads must be 0, for all cores, or more, not {self.threads}")
        if self.report_views < 0:
            raise FoliageError(f"report_views must be 0 or more, not {self.report_views}")


@dataclass(frozen=True, kw_only=True)
class MadeCapture:
    """What was written, and what the user should know of it."""

    cloud: Path
    report: Path | None
    pictures: tuple[ReportPicture, ...]  # of the cloud, in the report's folder
    photographs: int
    registered: int  # of them, with a pose
    views: int  # of these, with depth
    points: int
    coverage: float  # median share of a photograph, what is masked left out, that has depth
    seconds: Mapping[str, float]  # by step
    remarks: tuple[Remark, ...]


def make_capture(request: CaptureRequest, progress: StepProgress | None = None) -> MadeCapture:
    """Find the depth of photographs and their cloud; what a killed run has done already is not done again.

    Raises:
        FoliageError: The input is unusable, or the output cannot be written; results appear whole or not at all.
    """
    seconds: dict[str, float] = {}
    restore_replaced(request.output or request.source)
    given = _find_given(request, None, seconds, progress)
    read_capture_settings(given.source)  # what is wrong with it is raised before anything is written
    if request.resume and not has_results(given.work):
        raise CaptureError(f"{given.folder} has no earlier run to go on with (resume)", "begin one")
    if request.settings.dense == "colmap":
        check_cuda()
    known = poses_are_given(given, Record(given.work), request.settings.poses)
    check_world(request.settings.world, given=known)
    if known and not given.in_place:  # likewise
        read_posed(given.source, request.views)
    store = request.store or given.work
    with lock_work(given.work):
        if request.fresh:
            forget_results(given.work)
        record = Record(given.work)
        places, remarks = choose_places(given.folder, record, cameras=not known, force=request.force)
        remarks += given.remarks
        lay_out(given, record, cameras=known, force=request.force)
        with follow_step("poses", seconds, None):
            posed = (
                read_posed(given.folder, request.views)
                if known
                else estimate_poses(
                    given.folder, request.views, request.settings, threads=request.threads, progress=progress
                )
            )
        capture = posed.capture
        with follow_step("photographs", seconds, progress) as advance:
            prepared = prepare_views(
                capture,
                store,
                request.settings.depth.max_side_px,
                masks=request.settings.mask != "none",
                sky=request.settings.sky if request.settings.mask == "auto" else None,
                named=given.source,
                threads=request.threads,
                progress=advance,
            )
        tasks = plan_tasks(
            prepared.views, capture.points_m, request.settings.depth, store, dense=request.settings.dense
        )
        missing = find_missing(tasks)
        resumed = remark_resumed(tasks, len(missing))
        remarks += [*posed.remarks, *prepared.remarks, *(prepared.checks if known else ()), *remark_tasks(tasks)]
        with follow_step("depth", seconds, progress) as advance:
            run_tasks(tasks, missing, threads=request.threads, progress=advance)
        with follow_step("maps", seconds, progress) as advance:
            maps = write_maps(tasks, threads=request.threads, progress=advance)
        with follow_step("cloud", seconds, progress) as advance:
            threads = request.threads
            surfaces = seen_surfaces(tasks, advance, threads=threads)
            cloud = merge_views(surfaces, size_cells(request.settings.cloud, maps), threads=threads)
            depths = seen_depths(tasks, threads=threads)
            cloud = drop_seen_through(cloud, depths, request.settings.visibility, threads=threads)
            cleaning = request.settings.cleaning
            cloud = thin_to_disks(drop_floating(drop_outliers(cloud, cleaning), cleaning), cleaning)
        if not len(cloud):
            raise CaptureError(
                f"no depth was found in {counted(len(prepared.views), 'photograph')} of {given.folder}: they agree "
                "about nothing",
                "check that the cameras belong to them, and that neighbours overlap by two thirds",
            )
        new = given.work / _NEW
        forget(new)
        with follow_step("output", seconds, progress):
            lay_maps(new, maps, places)
            write_results(new, capture, prepared, cloud)
            if not known:
                lay_cameras(new, given.work / REGISTERED)
        pictures: tuple[ReportPicture, ...] = ()
        if request.report:
            with follow_step("report", seconds, progress):
                photographs = describe_photographs(posed, prepared, tasks, maps)
                with_maps = [number for number, view_maps in enumerate(photographs) if view_maps.read_maps is not None]
                report = CaptureReport(
                    name=capture.name,
                    capture=request.source.resolve().name,
                    generator=f"usdfoliage {__version__}",
                    remarks=remarks,
                    render_setting=request.render_setting,
                    photographs=photographs,
                    cloud=cloud,
                    up=(float(capture.up[0]), float(capture.up[1]), float(capture.up[2])),
                    poses_given=known,
                    shared=shared_matches(posed, photographs),
                    errors_px=observation_errors_px(posed),
                    drawn=[with_maps[k] for k in choose_evenly(len(with_maps), request.report_views)],
                    seconds=seconds if request.times else {},
                    settings=list_settings(request.settings),
                )
                pictures = write_capture_report(new / REPORT, report).pictures
        with follow_step("publishing", seconds, progress):
            publish(new, given.folder, [*places, *list_results(new)], record)
        if request.views is None and request.store is None:  # else the others may be asked for next
            forget_others(tasks)
            forget_other_maps(tasks, maps)
    failures = () if posed.registered is None else posed.registered.failures
    return MadeCapture(
        cloud=given.folder / CLOUD,
        report=given.folder / REPORT / "index.html" if request.report else None,
        pictures=pictures,
        photographs=len(given.photos) if request.views is None else len(capture.views) + len(failures),
        registered=len(capture.views),
        views=len(maps),
        points=len(cloud),
        coverage=float(np.median([view_maps.coverage for view_maps in maps])),
        seconds=seconds,
        remarks=(*remarks, *resumed),  # not in the report, which equal runs have in common
    )


def plan_capture(request: CaptureRequest) -> str:
    """What make_capture would do, in lines, after looking at every photograph; writes nothing.

    Of a video the frames are taken, and dropped.
    """
    with temporary_folder("frames") as scratch:
        return _plan_given(request, _find_given(request, scratch, {}, None))


def _find_given(
    request: CaptureRequest, scratch: Path | None, seconds: dict[str, float], progress: StepProgress | None
) -> GivenPhotographs:
    """The photographs of a request; the frames of a video are taken for them, into the work folder or scratch."""
    video = find_video(request.source)
    if video is None:
        return find_photographs(request.source, request.output)
    output = check_video_output(request.source, request.output)
    with follow_step("video", seconds, progress) as advance:
        work = (scratch or request.store or output / WORK) / FRAMES
        if request.fresh:
            forget(work)
        frames = lay_frames(video, work, request.settings.video, progress=advance)
    return find_photographs(request.source, output, frames)


def _plan_given(request: CaptureRequest, given: GivenPhotographs) -> str:
    if request.settings.dense == "colmap":
        check_cuda()
    record = Record(given.work)
    known = poses_are_given(given, record, request.settings.poses)
    check_world(request.settings.world, given=known)
    places, remarks = choose_places(given.folder, record, cameras=not known, force=request.force)
    remarks += given.remarks
    if not known:
        return plan_estimate(request, given, [*places, CAMERAS], remarks)
    posed = read_posed(given.source, request.views)
    capture = posed.capture
    depth = request.settings.depth
    masks, sky = request.settings.mask != "none", request.settings.sky if request.settings.mask == "auto" else None
    prepared = prepare_views(
        capture,
        given.work,
        depth.max_side_px,
        masks=masks,
        sky=sky,
        keep=False,
        named=given.source,
        threads=request.threads,
    )
    tasks = plan_tasks(prepared.views, capture.points_m, depth, given.work, dense=request.settings.dense)
    missing = 0 if request.fresh else len(find_missing(tasks))
    every = _count_tasks(tasks)
    remarks += [*posed.remarks, *prepared.remarks, *prepared.checks, *remark_tasks(tasks)]
    sizes = Counter((view.width_px, view.height_px) for view in prepared.views)
    levels = ", ".join(f"1/{2**each.level}" for each in depth.rounds)
    lines = [
        f"photographs: {len(given.photos)} in {request.source}, {len(prepared.views)} to be used",
        f"sizes: {', '.join(f'{count} of {width} x {height} px' for (width, height), count in sorted(sizes.items()))}",
        f"poses: known, of {len(capture.views)} photographs",
        f"masks: of {sum(view.mask is not None for view in capture.views) if masks else 0}",
        *label_remarks(remarks, request.render_setting),
        f"depth: at {depth.max_side_px} px at most, in {len(depth.rounds)} rounds of {levels} of that, each photograph "
        f"with {depth.sources} others at most",
        f"tasks: {every}, {every - missing} of them done by an earlier run",
        f"memory: about {estimate_memory(prepared, request.settings, request.threads) / 2**30:.1f} GiB",
        f"would write into {given.folder}: {', '.join([*(f'{place}/' for place in places), LAYER, CLOUD])}",
    ]
    return "\n".join(lines)


def plan_estimate(
    request: CaptureRequest, given: GivenPhotographs, places: Sequence[str], remarks: Sequence[Remark]
) -> str:
    """What plan_capture returns where poses are to be estimated: what comes after them depends on them."""
    photo_set = read_photo_set(given.images, list(given.photos))
    sizes = Counter((photo.width_px, photo.height_px) for photo in photo_set.photos)
    depth = request.settings.depth
    lines = [
        f"photographs: {len(given.photos)} in {request.source}, {len(photo_set.photos)} to be used",
        f"sizes: {', '.join(f'{count} of {width} x {height} px' for (width, height), count in sorted(sizes.items()))}",
        "poses: to be estimated",
        *label_remarks((*remarks, *photo_set.remarks), request.render_setting),
        f"depth: at {depth.max_side_px} px at most, in {len(depth.rounds)} rounds",
        f"would write into {given.folder}: {', '.join([*(f'{place}/' for place in places), LAYER, CLOUD])}",
    ]
    return "\n".join(lines)


def choose_places(
    folder: Path, record: Record, *, cameras: bool = False, force: bool = False
) -> tuple[list[str], list[Remark]]:
    """The folders of depth, normals and confidence, and a remark on those that are not where they would be.

    Args:
        folder: The capture.
        record: Of it.
        cameras: Whether cameras/ are to be written too.
        force: Whether what is not ours may be lost.

    Raises:
        CaptureError: There are results in the way that usdfoliage did not make.
    """
    if cameras and not record.owns(folder, CAMERAS):
        raise CaptureError(
            f"{folder / CAMERAS} holds poses that usdfoliage did not estimate, or that were changed since, and they "
            "are never replaced",
            ("name another capture with ", Argument(name="output")),
        )
    single = [name for name in (CLOUD, LAYER, LAYER_CLOUD, REPORT) if not record.owns(folder, name)]
    if single and not force:
        raise CaptureError(
            f"{folder} has {named(single)}, not made by usdfoliage or changed since",
            ("move them elsewhere, or use ", Argument(name="force"), " to replace them"),
        )
    if force or all(record.owns(folder, kind) for kind in KINDS):
        return list(KINDS), []
    beside = [f"{kind}{BESIDE}" for kind in KINDS]
    blocked = [name for name in beside if not record.owns(folder, name)]
    if blocked:
        raise CaptureError(
            f"{folder} has {named(blocked)}, changed since usdfoliage made it",
            ("move it, or use ", Argument(name="force")),
        )
    kept = [kind for kind in KINDS if not record.owns(folder, kind)]
    text = f"{named(kept)} was there and is kept; what is found here is in {', '.join(beside)}"
    remedy = f"find leaves with the depth in {beside[0]}, or replace what was there with ", Argument(name="force")
    return beside, [remark("given-maps-kept", text, subject=named(kept), remedy=remedy)]


def size_cells(settings: CloudSettings, maps: Sequence[ViewMaps]) -> CloudSettings:
    """Cells as large as a pixel's footprint in the median view, unless their size is given."""
    footprints_m = [view_maps.footprint_m for view_maps in maps if np.isfinite(view_maps.footprint_m)]
    if settings.cell_m is not None or not footprints_m:
        return settings
    return replace(settings, cell_m=settings.cell_footprints * float(np.median(footprints_m)))


def has_results(work: Path) -> bool:
    """Whether an earlier run has left anything to go on with."""
    return work.is_dir() and any(below.is_dir() and any(below.iterdir()) for below in work.iterdir())


def forget_results(work: Path) -> None:
    """Remove all results of earlier runs; what is known of the capture's files stays, and the frames of its video."""
    for below in work.iterdir():
        if below.is_dir() and below.name != FRAMES:
            forget(below)


def remark_tasks(tasks: DepthTasks) -> list[Remark]:
    """On photographs without companions."""
    alone = [view.name for view, sources in zip(tasks.views, tasks.plan.sources, strict=True) if not sources]
    return [remark_alone(alone)] if alone else []


def remark_resumed(tasks: DepthTasks, missing: int) -> list[Remark]:
    """On what was found of an earlier run."""
    every = _count_tasks(tasks)
    if missing == every:
        return []
    text = f"{every - missing} of {every} tasks of depth were done by an earlier run"
    return [remark("tasks-done-before", text)]


def _count_tasks(tasks: DepthTasks) -> int:
    return sum(path is not None for paths in (*tasks.planes, tasks.depth) for path in paths)


def estimate_memory(prepared: PreparedViews, settings: CaptureRunSettings, threads: int = 0) -> float:
    """Bytes that a run takes at its peak, by what was measured."""
    photo_px = max(view.width_px * view.height_px for view in prepared.views)
    matched_px = max(_matched_px(view.width_px, view.height_px, settings.depth.max_side_px) for view in prepared.views)
    at_once, _ = share_cores(threads)
    views = min(len(prepared.views), MAX_VIEWS_OF_CLOUD)
    each = BYTES_A_PHOTO_PIXEL * photo_px + BYTES_A_MATCHED_PIXEL * matched_px
    return MIN_BYTES + at_once * each + views * BYTES_A_CLOUD_PIXEL * matched_px


def _matched_px(width_px: int, height_px: int, max_side_px: int) -> float:
    return width_px * height_px * min(1.0, max_side_px / max(width_px, height_px)) ** 2
