"""Depth of the views of a capture that has none: every photograph matched with others, everything in memory."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.clear_sky import ClearSkySettings, elevations_deg, find_clear_sky
from usdfoliage.capture.folder.listing import named
from usdfoliage.capture.folder.photo_set import find_blurred, measure_sharpness, remark_blurred
from usdfoliage.capture.mvs.packed_planes import reader_of_planes
from usdfoliage.capture.mvs.patch_match import Picture
from usdfoliage.capture.mvs.rounds import MvsSettings, finish_depth, match_views, plan_depths
from usdfoliage.capture.mvs.upsampling import enlarge_depth
from usdfoliage.capture.view import View
from usdfoliage.files.threads import map_threaded, share_cores
from usdfoliage.progress import PartCounter, Progress
from usdfoliage.remarks import Remark, remark

logger = logging.getLogger(__name__)

MaskChoice = Literal["auto", "given", "none"]

MASK_MARGIN_PX = 16  # around a mask, of the photograph as it is matched: about the window of the coarsest round


@dataclass(frozen=True, kw_only=True)
class PhotographDepthSettings:
    """How depth is computed from photographs."""

    # given uses the masks of the folder masks/ and a margin around them; auto also leaves out the sky where a
    # photograph has no mask; none uses no mask.
    mask: MaskChoice = "auto"
    sky: ClearSkySettings = field(default_factory=ClearSkySettings)
    depth: MvsSettings = field(default_factory=MvsSettings)

    @property
    def sky_left_out(self) -> ClearSkySettings | None:
        """What is left out of photographs without a mask; None for nothing."""
        return self.sky if self.mask == "auto" else None


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewDepths:
    """The same views with depth."""

    views: tuple[View, ...]
    remarks: tuple[Remark, ...]  # on blurred photographs, and on those that no other can be matched with


def view_to_match(view: View, max_side_px: int, sky: ClearSkySettings | None, up: NDArray[np.floating]) -> View:
    """A view as it is matched: no larger than that, without depth, and without the sky where it has no mask.

    Args:
        view: Its depth is not looked at.
        max_side_px: Of the photograph that is matched.
        sky: What sky is; None: it is not left out.
        up: (3,), of the world, of length 1.
    """
    small = Picture.of(view, max_side_px, 0)
    mask = None if small.mask is None else small.mask > 0
    if mask is None and sky is not None:
        seen = find_clear_sky(small.srgb, sky, elevation_deg=elevations_deg(small.camera, up))
        mask = None if seen is None else ~seen
    no_depth = np.broadcast_to(np.float32(0), small.gray.shape)
    return View(name=view.name, camera=small.camera, srgb=small.srgb, depth_m=no_depth, mask=mask)


def widen_mask(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where depth is looked for of a plant's mask (H, W): on the plant and MASK_MARGIN_PX around it.

    What is behind an edge shows where the edge is. Where depth ended with the mask, 8 of 100 leaves fewer were found,
    and 6 of 100 more of those that were found were wrong (tools/bench/bad_captures.py --kinds good "good masks").
    """
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * MASK_MARGIN_PX + 1,) * 2)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), around) > 0)


def estimate_view_depths(
    views: Sequence[View],
    up: NDArray[np.floating],
    points_m: NDArray[np.floating] | None = None,
    settings: PhotographDepthSettings = PhotographDepthSettings(),
    progress: Progress | None = None,
    *,
    threads: int = 0,
) -> ViewDepths:
    """Depth of every view, as a build of these photographs finds it.

    A build keeps what lies between the rounds in its work folder. Here it is in memory: 20 bytes for each pixel that is
    matched (capture.depth.max_side_px), which is less than the views themselves where photographs are larger.

    Args:
        views: At least two; their depth is not looked at. Pixels outside a view's mask, widened, get no depth.
        up: (3,), of the world, of length 1.
        points_m: (N, 3), points of the scene, which give the range of depths; without them the cameras do.
        settings: Which pixels count, and how thoroughly they are matched.
        progress: Called with the work done and all of it: each view once in each round, and once at the end.
        threads: 0: one per core. The depth is the same.

    Returns:
        The views in their order; those that no other can be matched with have no depth.

    Raises:
        CaptureError: No two views look at the same place from a usable angle.
    """
    cameras = [view.camera for view in views]
    plan = plan_depths(cameras, None if points_m is None or not len(points_m) else points_m, settings.depth)
    at_once, threads_each = share_cores(threads)

    def prepare(view: View) -> View:
        given = view if settings.mask != "none" else replace(view, mask=None)
        small = view_to_match(given, settings.depth.max_side_px, settings.sky_left_out, up)
        return small if given.mask is None or small.mask is None else replace(small, mask=widen_mask(small.mask))

    matched = list(map_threaded(prepare, views, threads=at_once))
    parts = PartCounter(progress, (len(settings.depth.rounds) + 1) * len(views))
    of_rounds = parts.next_piece(len(settings.depth.rounds) * len(views))
    read_planes = reader_of_planes(match_views(matched, plan, settings.depth, of_rounds, threads=threads), cameras)

    def finish(index: int) -> View:
        size = cameras[index].height_px, cameras[index].width_px
        if not plan.sources[index]:
            return replace(views[index], depth_m=np.zeros(size, np.float32))
        found = finish_depth(index, plan, matched.__getitem__, read_planes, settings.depth, threads=threads_each)
        return replace(views[index], depth_m=enlarge_depth(found, cameras[index]).depth_m)

    finished = []
    for view in map_threaded(finish, range(len(views)), threads=at_once):
        finished.append(view)
        parts.add()
    alone = [view.name for view, sources in zip(views, plan.sources, strict=True) if not sources]
    blurred = find_blurred([(view.name, measure_sharpness(_gray(view))) for view in matched])
    remarks = [*([remark_blurred(blurred)] if blurred else []), *([remark_alone(alone)] if alone else [])]
    logger.info(
        "%d views matched, depth at %.0f %% of the pixels",
        len(views) - len(alone),
        100 * np.mean([(view.depth_m > 0).mean() for view in finished]),
    )
    return ViewDepths(views=tuple(finished), remarks=tuple(remarks))


def remark_alone(names: Sequence[str]) -> Remark:
    """On photographs that no other can be matched with."""
    text = f"{named(names)}: no other photograph shows the same from a usable angle, no depth"
    return remark("photographs-without-companion", text, subject=named(names))


def _gray(view: View) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(view.srgb, cv2.COLOR_RGB2GRAY))
