"""Depth of every photograph of a capture, task by task through the work folder.

Every task's result is a file named by the hash of what went into it. What is there is not made again, and no more than
a few photographs are in memory at a time.
"""

import json
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TypeVar, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.clear_sky import ClearSkySettings
from usdfoliage.capture.cloud.fusion import SeenSurface
from usdfoliage.capture.folder.listing import counted, named
from usdfoliage.capture.folder.photo_set import find_blurred, measure_sharpness, remark_blurred, remark_unusable
from usdfoliage.capture.folder.read import Capture, CaptureView, merge_view_remarks, read_view_remarked
from usdfoliage.capture.lens import Lens, scale_lens
from usdfoliage.capture.mvs.agreement import AgreementSettings, DepthEstimate
from usdfoliage.capture.mvs.colmap_stereo import read_stereo_planes, run_stereo, write_stereo_workspace
from usdfoliage.capture.mvs.packed_planes import PackedPlanes, pack_planes, unpack_planes
from usdfoliage.capture.mvs.patch_match import MatchedPlanes, Picture
from usdfoliage.capture.mvs.rounds import DepthPlan, MvsSettings, finish_depth, match_round, plan_depths
from usdfoliage.capture.mvs.view_depths import MASK_MARGIN_PX, view_to_match, widen_mask
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.files.hashing import digest_file
from usdfoliage.files.threads import MAX_AT_ONCE, map_ahead, map_threaded, share_cores
from usdfoliage.files.unwritten import describe_unwritten
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.capture.settings import DenseChoice
from usdfoliage.jobs.work.keys import task_key
from usdfoliage.jobs.work.results import forget, has_result, read_result, write_result
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, remark, remark_from_json

logger = logging.getLogger(__name__)

PHOTOS, PLANES, DEPTH, COLMAP = "photos", "planes", "depth", "colmap"  # folders in the work folder
_ABOUT = ("size", "remarks", "sharpness")  # what is kept of a photograph beside its pixels
_MAX_IN_MEMORY = 12 + 2 * MAX_AT_ONCE  # photographs, and planes of as many

Arrays = dict[str, NDArray[np.generic]]
Stored = TypeVar("Stored")


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedView:
    """A photograph that can be read; its pixels, undistorted and no more than are matched, are in the work folder."""

    chosen: CaptureView
    pixels: Path
    width_px: int  # of the photograph
    height_px: int
    key: str  # of pixels and camera

    @property
    def name(self) -> str:
        return self.chosen.name

    @property
    def lens(self) -> Lens:
        """Of the photograph, at its size."""
        return scale_lens(self.chosen.lens, self.width_px, self.height_px)

    @property
    def camera(self) -> Pinhole:
        """Of the photograph without distortion, at its size."""
        return self.lens.pinhole(self.chosen.cam_from_world)


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedViews:
    """The photographs of a capture that can be read."""

    views: tuple[PreparedView, ...]
    dropped: tuple[tuple[str, str], ...]  # names of those that cannot be used, and why
    remarks: tuple[Remark, ...]
    checks: tuple[Remark, ...]  # on blurred photographs and copies, which are reported before poses are estimated


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthTasks:
    """What is to be matched with what, and where each result is."""

    work: Path
    views: tuple[PreparedView, ...]
    settings: MvsSettings
    plan: DepthPlan
    planes: tuple[tuple[Path | None, ...], ...]  # by round and view; None for views without sources
    depth: tuple[Path | None, ...]  # by view
    dense: DenseChoice = "own"

    @property
    def level(self) -> int:
        """How often the pictures are halved at last."""
        return self.settings.rounds[-1].level if self.dense == "own" else 0


@dataclass(frozen=True, kw_only=True)
class MissingTasks:
    """What is not in the work folder."""

    planes: tuple[tuple[int, ...], ...]  # views to be matched, by round
    depth: tuple[int, ...]  # views to be finished

    def __len__(self) -> int:
        return sum(map(len, self.planes)) + len(self.depth)


def prepare_views(
    capture: Capture,
    work: Path,
    max_side_px: int,
    *,
    masks: bool = True,
    sky: ClearSkySettings | None = None,
    keep: bool = True,
    named: Path | None = None,
    threads: int = 0,
    progress: Progress | None = None,
) -> PreparedViews:
    """Read every photograph of a capture once; those that cannot be used are named, their companions kept.

    Args:
        capture: Whose depth maps are not looked at.
        work: The work folder.
        max_side_px: Of what is kept.
        masks: Whether masks are looked at.
        sky: What is left out of photographs without a mask; None for nothing.
        keep: Whether the work folder gets what is read; without it there are no pixels to go on with.
        named: The folder that the user knows the photographs by, where it is not the capture's.
        threads: 0: one per core.
        progress: Called with photographs done, and their number.

    Raises:
        CaptureError: Fewer than two can be read, or the work folder cannot be written.
    """
    bare = replace(
        capture,
        views=tuple(replace(view, depth=None, mask=view.mask if masks else None) for view in capture.views),
    )
    views: list[PreparedView] = []
    dropped: list[tuple[str, CaptureError]] = []
    about: list[Remark] = []
    sharpness: list[tuple[str, float]] = []
    same: dict[str, list[str]] = {}

    def read(index: int) -> tuple[Path, str, Arrays] | CaptureError:
        """Its file, and what is to be known of it without its pixels; or why it cannot be used."""
        made = None
        try:
            photo = digest_file(bare.views[index].photo)
            path = work / PHOTOS / f"{_picture_key(bare, bare.views[index], photo, max_side_px, sky)}.npz"
            stored = read_result(path, _ABOUT)
            if stored is None:
                made = stored = _read_picture(bare, index, max_side_px, sky)
        except CaptureError as error:
            return error
        if made is not None and keep:
            write_result(path, made)
        return path, photo, {name: stored[name] for name in _ABOUT}

    results = map_threaded(read, range(len(bare.views)), threads=share_cores(threads)[0])
    for index, (chosen, result) in enumerate(zip(bare.views, results, strict=True)):
        if isinstance(result, CaptureError):
            dropped.append((chosen.name, result))
        else:
            path, photo, stored = result
            width_px, height_px = (int(side) for side in stored["size"])
            key = task_key(path.stem, chosen.cam_from_world)
            views.append(PreparedView(chosen=chosen, pixels=path, width_px=width_px, height_px=height_px, key=key))
            about += [
                replace(remark_from_json(each), subject=chosen.name) for each in json.loads(str(stored["remarks"]))
            ]
            sharpness.append((chosen.name, float(stored["sharpness"])))
            same.setdefault(photo, []).append(chosen.name)
        if progress is not None:
            progress(index + 1, len(bare.views))
    remarks = [remark_unusable([name], error.text, error.remedy) for name, error in dropped]
    remarks += merge_view_remarks(about)
    if len(views) < 2:
        reason = f"; the first that cannot: {dropped[0][1].text}" if dropped else ""
        raise CaptureError(
            f"{counted(len(views), 'photograph')} of {len(bare.views)} with a camera in {named or capture.folder} can "
            f"be used, and depth takes two at least{reason}",
            dropped[0][1].remedy if dropped else "give cameras of two photographs at least, or none",
        )
    blurred = find_blurred(sharpness)
    checks = [remark_blurred(blurred)] if blurred else []
    checks += [_remark_copies(names) for names in same.values() if len(names) > 1]
    left_out = tuple((name, error.text) for name, error in dropped)
    return PreparedViews(views=tuple(views), dropped=left_out, remarks=tuple(remarks), checks=tuple(checks))


def _remark_copies(names: Sequence[str]) -> Remark:
    text = f"{named(names)} are one photograph, and what has only a copy for company is seen once"
    return remark("photograph-copies-used", text, subject=named(names), remedy="remove the copies")


def _picture_key(
    capture: Capture, chosen: CaptureView, photo: str, max_side_px: int, sky: ClearSkySettings | None
) -> str:
    seen_up = None if sky is None else chosen.cam_from_world[:, :3] @ capture.up
    mask = (sky, seen_up) if chosen.mask is None else (digest_file(chosen.mask), MASK_MARGIN_PX)
    return task_key("photo", photo, mask, chosen.lens, capture.settings.color_space, max_side_px)


def _read_picture(capture: Capture, index: int, max_side_px: int, sky: ClearSkySettings | None) -> Arrays:
    """What is kept of a photograph."""
    view, remarks = read_view_remarked(capture, index)
    # A photograph whose mask cannot be read is taken whole: its sky may be what the mask would have shown.
    small = view_to_match(view, max_side_px, sky if capture.views[index].mask is None else None, capture.up)
    stored: Arrays = {
        "srgb": small.srgb,
        "size": np.array([view.camera.width_px, view.camera.height_px]),
        "sharpness": np.array(measure_sharpness(cv2.cvtColor(small.srgb, cv2.COLOR_RGB2GRAY))),
        "remarks": np.array(json.dumps([replace(each, subject="").as_json() for each in remarks])),
    }
    if small.mask is not None:
        stored["mask"] = small.mask
        stored["given"] = np.array(view.mask is not None)
    return stored


def plan_tasks(
    views: Sequence[PreparedView],
    points_m: NDArray[np.floating],
    settings: MvsSettings,
    work: Path,
    *,
    dense: DenseChoice = "own",
) -> DepthTasks:
    """Which results there will be; of COLMAP's PatchMatch one round.

    Raises:
        CaptureError: No two views look at the same place from a usable angle.
    """
    plan = plan_depths([view.camera for view in views], points_m if len(points_m) else None, settings)
    matching = replace(settings, agreement=AgreementSettings())  # what is believed comes after matching
    keys = [view.key for view in views]  # of what the round before left of each view
    planes: list[tuple[Path | None, ...]] = []
    if dense == "colmap":
        every = task_key("colmap", keys, list(plan.ranges_m), list(plan.farthest_m), list(plan.sources))
        keys = [task_key(every, index) for index in range(len(views))]
        planes.append(
            tuple(work / PLANES / "0" / f"{key}.npz" if plan.sources[k] else None for k, key in enumerate(keys))
        )
    for number, current in enumerate(settings.rounds if dense == "own" else ()):
        before, keys = keys, list(keys)
        for index, sources in enumerate(plan.sources):
            if sources:
                others = [before[k] for k in sources] if current.coherent else []
                pictures = [views[k].key for k in sources]
                start = before[index]
                keys[index] = task_key(
                    "planes", number, views[index].key, pictures, list(plan.ranges_m[index]), start, others, matching
                )
        folder = work / PLANES / str(number)
        planes.append(tuple(folder / f"{key}.npz" if plan.sources[k] else None for k, key in enumerate(keys)))
    depth: list[Path | None] = []
    for index, sources in enumerate(plan.sources):
        of_sources = [keys[k] for k in sources]
        key = task_key("depth", keys[index], of_sources, plan.farthest_m[index], settings.agreement)
        depth.append(work / DEPTH / f"{key}.npz" if sources else None)
    return DepthTasks(
        work=work,
        views=tuple(views),
        settings=settings,
        plan=plan,
        planes=tuple(planes),
        depth=tuple(depth),
        dense=dense,
    )


def find_missing(tasks: DepthTasks) -> MissingTasks:
    """What must be made: going back from the last results, what those that are missing ask for."""
    depth = tuple(k for k, path in enumerate(tasks.depth) if path is not None and not has_result(path))
    wanted = {k for index in depth for k in (index, *tasks.plan.sources[index])}
    planes: list[tuple[int, ...]] = []
    for number in reversed(range(len(tasks.planes))):
        paths = tasks.planes[number]
        missing = tuple(k for k in sorted(wanted) if (path := paths[k]) is not None and not has_result(path))
        planes.append(missing)
        wanted = set(missing) if number else set()
        if number and tasks.settings.rounds[number].coherent:
            wanted |= {k for index in missing for k in tasks.plan.sources[index]}
    return MissingTasks(planes=tuple(reversed(planes)), depth=depth)


def run_tasks(
    tasks: DepthTasks,
    missing: MissingTasks,
    *,
    threads: int = 0,
    keep: bool = False,
    progress: Progress | None = None,
) -> None:
    """Match and finish what is missing; the planes of a round are removed when nothing asks for them any more.

    Those of the last round stay: another setting of what is believed then costs no matching. With keep all stay, for
    other processes that work on the same photographs.

    Raises:
        WriteError: The work folder cannot be written.
    """
    done = 0

    def report() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, len(missing))

    at_once, threads_each = share_cores(threads)
    read_view = _remembering(lambda index: read_pixels(tasks.views[index]))
    if tasks.dense == "colmap" and any(missing.planes):
        _match_by_colmap(tasks, missing.planes[0], report)
    for number, views in enumerate(missing.planes if tasks.dense == "own" else ()):
        read_before = _remembering(lambda index, number=number: _read_planes(tasks, number - 1, index))  # type: ignore[misc]

        def match(index: int, number: int = number, read: Callable[[int], MatchedPlanes | None] = read_before) -> None:
            matched = match_round(number, index, tasks.plan, read_view, read, tasks.settings, threads=threads_each)
            _write_planes(_there(tasks.planes[number][index]), matched)

        for _ in map_threaded(match, views, threads=at_once):
            report()
        if views and number and not keep:
            forget(tasks.work / PLANES / str(number - 1))
    read_last = _remembering(lambda index: _read_planes(tasks, len(tasks.planes) - 1, index))

    def finish(index: int) -> None:
        estimate = finish_depth(
            index, tasks.plan, read_view, read_last, tasks.settings, level=tasks.level, threads=threads_each
        )
        _write_estimate(_there(tasks.depth[index]), estimate)

    for _ in map_threaded(finish, missing.depth, threads=at_once):
        report()


def _match_by_colmap(tasks: DepthTasks, views: Sequence[int], report: Callable[[], None]) -> None:
    folder = tasks.work / COLMAP

    def read_view(index: int) -> View:
        return read_pixels(tasks.views[index])

    try:
        write_stereo_workspace(folder, tasks.plan, read_view)
    except OSError as error:
        raise describe_unwritten(folder, error, goes_on=True) from error
    run_stereo(folder, tasks.plan)
    for index in views:
        view = read_view(index)
        matched = read_stereo_planes(folder, index, view.camera)
        if view.mask is not None:
            matched = replace(matched, planes=matched.planes * view.mask[..., None])
        _write_planes(_there(tasks.planes[0][index]), matched)
        report()
    forget(folder)


def forget_others(tasks: DepthTasks) -> None:
    """Remove results in the work folder that are not of these tasks."""
    forget(tasks.work / PHOTOS, [view.pixels for view in tasks.views])
    forget(tasks.work / DEPTH, [path for path in tasks.depth if path is not None])
    forget(tasks.work / PLANES, [path for path in tasks.planes[-1] if path is not None])


def read_pixels(prepared: PreparedView, *, widened: bool = True) -> View:
    """A photograph as it is matched, its given mask widened or not.

    Raises:
        CaptureError: What was kept of it has been damaged since.
    """
    stored = _need(prepared.pixels)
    srgb = cast(NDArray[np.uint8], stored["srgb"])
    size = srgb.shape[:2]
    mask = cast("NDArray[np.bool_] | None", stored.get("mask"))
    return View(
        name=prepared.name,
        camera=prepared.camera.resized(size[1], size[0]),
        srgb=srgb,
        depth_m=np.broadcast_to(np.float32(0), size),
        mask=mask if mask is None or not widened or not stored["given"] else widen_mask(mask),
    )


def read_estimate(tasks: DepthTasks, index: int) -> DepthEstimate | None:
    """The depth of one view; None for one without sources.

    Raises:
        CaptureError: It is not there.
    """
    path = tasks.depth[index]
    if path is None:
        return None
    stored = _need(path)
    depth_m = cast(NDArray[np.float32], stored["depth_m"])
    return DepthEstimate(
        camera=tasks.views[index].camera.resized(depth_m.shape[1], depth_m.shape[0]),
        depth_m=depth_m,
        normals=stored["normals"].astype(np.float32),
        confidence=stored["confidence"].astype(np.float32),
        agreeing=cast(NDArray[np.uint8], stored["agreeing"]),
    )


def picture_of(tasks: DepthTasks, index: int) -> Picture:
    """The photograph at the size of its depth, and its mask."""
    return Picture.of(read_pixels(tasks.views[index], widened=False), tasks.settings.max_side_px, tasks.level)


def seen_surfaces(tasks: DepthTasks, progress: Progress | None = None, *, threads: int = 0) -> Iterator[SeenSurface]:
    """What each view adds to the cloud, one after the other: what its mask shows."""

    def read(index: int) -> SeenSurface | None:
        estimate = read_estimate(tasks, index)
        if estimate is None:
            return None
        picture = picture_of(tasks, index)
        return SeenSurface(
            camera=estimate.camera,
            depth_m=estimate.depth_m if picture.mask is None else estimate.depth_m * (picture.mask > 0),
            normals=in_world(estimate.normals, estimate.camera),
            srgb=picture.srgb,
            confidence=estimate.confidence,
            agreeing=estimate.agreeing,
        )

    for done, surface in enumerate(map_ahead(read, range(len(tasks.views)), share_cores(threads)[0]), 1):
        if surface is not None:
            yield surface
        if progress is not None:
            progress(done, len(tasks.views))


def seen_depths(tasks: DepthTasks, *, threads: int = 0) -> Iterator[tuple[Pinhole, NDArray[np.float32]]]:
    """Camera and depth of each view that has depth, one after the other."""

    def read(index: int) -> tuple[Pinhole, NDArray[np.float32]] | None:
        estimate = read_estimate(tasks, index)
        return None if estimate is None else (estimate.camera, estimate.depth_m)

    for seen in map_ahead(read, range(len(tasks.views)), share_cores(threads)[0]):
        if seen is not None:
            yield seen


def in_world(normals: NDArray[np.float32], camera: Pinhole) -> NDArray[np.float32]:
    """Normals (H, W, 3) in camera axes in those of the world."""
    return np.asarray(normals @ camera.cam_from_world[:, :3].astype(np.float32))


def _remembering(read: Callable[[int], Stored]) -> Callable[[int], Stored]:
    """The same for numbers asked for again and again; what was not asked for lately is forgotten."""
    return lru_cache(maxsize=_MAX_IN_MEMORY)(read)


def _write_planes(path: Path, matched: MatchedPlanes) -> None:
    packed = pack_planes(matched)
    write_result(path, {"inverse": packed.inverse, "slopes": packed.slopes, "cost": packed.cost})


def _read_planes(tasks: DepthTasks, number: int, index: int) -> MatchedPlanes | None:
    path = tasks.planes[number][index]
    if path is None:
        return None
    stored = _need(path)
    packed = PackedPlanes(
        inverse=cast(NDArray[np.float32], stored["inverse"]),
        slopes=cast(NDArray[np.float16], stored["slopes"]),
        cost=cast(NDArray[np.float16], stored["cost"]),
    )
    return unpack_planes(packed, tasks.views[index].camera)


def _write_estimate(path: Path, estimate: DepthEstimate) -> None:
    write_result(
        path,
        {
            "depth_m": estimate.depth_m,
            "normals": estimate.normals.astype(np.float16),
            "confidence": estimate.confidence.astype(np.float16),
            "agreeing": estimate.agreeing,
        },
        compressed=True,
    )


def _need(path: Path) -> Arrays:
    stored = read_result(path)
    if stored is None:
        raise CaptureError(f"{path} was removed or damaged while it was in use", "run the same command again")
    return stored


def _there(path: Path | None) -> Path:
    if path is None:
        raise ValueError("a view without sources has no results")
    return path
