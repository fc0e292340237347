"""Depth of every photograph of a capture: which photographs are matched with each, and the rounds of matching.

A round takes one view at a time and reads its photograph, those of its sources and what the round before left of
them; what it leaves is kept by the caller. So memory does not grow with the number of photographs, and a killed run
goes on at the view where it was.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.mvs.agreement import AgreementSettings, DepthEstimate, confirm_depth
from usdfoliage.capture.mvs.depth_range import depth_range_m
from usdfoliage.capture.mvs.packed_planes import PackedPlanes, pack_planes, reader_of_planes
from usdfoliage.capture.mvs.patch_match import (
    MAX_SOURCES,
    MatchedPlanes,
    PatchMatchSettings,
    Picture,
    match_view,
    open_maps,
)
from usdfoliage.capture.mvs.segment_planes import SegmentSettings, fit_segment_planes, segment_photo
from usdfoliage.capture.mvs.view_selection import ViewSelectionSettings, select_views
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.files.threads import map_threaded, share_cores
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.progress import Progress

logger = logging.getLogger(__name__)

MAX_LEVELS = 16  # no photograph has as many pixels a side as 2^16 times those that matching needs
MAX_ITERATIONS = 1000
_LIMIT = 0.01  # of the range of inverse depth, at its ends

Quality = Literal["draft", "normal", "high"]


@dataclass(frozen=True, kw_only=True)
class Round:
    """One round over all views."""

    level: int  # how often the pictures are halved
    iterations: int
    coherent: bool  # whether the views' depth counts as well, equation 3
    segments: bool = False  # whether the planes of segments count as well, equation 2

    def __post_init__(self) -> None:
        if not 0 <= self.level <= MAX_LEVELS:
            raise ValueError(f"level must be 0 to {MAX_LEVELS}, not {self.level}")
        if not 1 <= self.iterations <= MAX_ITERATIONS:
            raise ValueError(f"iterations must be 1 to {MAX_ITERATIONS}, not {self.iterations}")


ROUNDS = (
    Round(level=2, iterations=4, coherent=False),
    Round(level=1, iterations=3, coherent=False),
    Round(level=1, iterations=1, coherent=True),
    Round(level=0, iterations=2, coherent=True),
    Round(level=0, iterations=1, coherent=True, segments=True),
)


@dataclass(frozen=True, kw_only=True)
class MvsSettings:
    """How thoroughly photographs are matched, and which depth is believed."""

    max_side_px: int = 1200  # Photographs are matched at this longer side at most. Unit: pixels. Range: 32 or more.
    sources: int = 9  # Each photograph is matched with this many others. Range: matching.best_sources to 16.
    # These rounds of matching run one after the other over all photographs. level: how often photographs are halved.
    # iterations: how often planes spread. coherent: whether the depth of other photographs counts. segments: whether
    # planes of segments count where there is no texture. Range: at least one round.
    rounds: tuple[Round, ...] = ROUNDS
    # Depth is searched nearer than the nearest known point by this share of it, because features lie on the ground
    # rather than on the trees above it. Range: 0 or more.
    nearer: float = 0.3
    # Depth is searched up to this many times the farthest known point, so that the background is matched as such.
    # Range: 1 or more.
    farther: float = 25.0
    seed: int = 0  # Every random choice starts from this number. Range: 0 to 2^63 - 1.
    selection: ViewSelectionSettings = field(default_factory=ViewSelectionSettings)
    segments: SegmentSettings = field(default_factory=SegmentSettings)
    # Pixels of one plane of a segment differ by up to this share of the range of inverse depth. Range: above 0.
    segment_tolerance: float = 0.004
    matching: PatchMatchSettings = field(default_factory=PatchMatchSettings)
    agreement: AgreementSettings = field(default_factory=AgreementSettings)

    def __post_init__(self) -> None:
        if self.max_side_px < 32 or not self.rounds:
            raise ValueError("max_side_px must be at least 32, and there must be rounds")
        if not (np.isfinite(self.nearer) and self.nearer >= 0):
            raise ValueError(f"nearer must not be below 0, not {self.nearer:g}")
        if not (np.isfinite(self.farther) and self.farther >= 1):
            raise ValueError(f"farther must be at least 1, not {self.farther:g}")
        if not self.matching.best_sources <= self.sources <= MAX_SOURCES:
            raise ValueError(f"best_sources <= sources <= {MAX_SOURCES}, not {self.sources}")
        if not 0 <= self.seed < 2**63:
            raise ValueError(f"seed must be in [0, 2^63), not {self.seed}")


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthPlan:
    """What each view is matched with."""

    ranges_m: tuple[tuple[float, float], ...]  # nearest and farthest depth searched in each view, NaN without sources
    farthest_m: tuple[float, ...]  # depth believed in each view; what is found behind it is background
    sources: tuple[tuple[int, ...], ...]  # views that each is matched with, the most useful first


def plan_depths(
    cameras: Sequence[Pinhole],
    points_m: NDArray[np.floating] | None = None,
    settings: MvsSettings = MvsSettings(),
) -> DepthPlan:
    """Nearest and farthest depth of every view, and the views that each is matched with, none where there are none.

    Args:
        cameras: Of all views.
        points_m: (N, 3), points of the scene, which give the range of depths; without them the cameras do.
        settings: How many, and at which angles.

    Raises:
        CaptureError: No two views look at the same place from a usable angle.
    """
    ranges_m: list[tuple[float, float]] = []
    farthest_m: list[float] = []
    sources: list[tuple[int, ...]] = []
    for index in range(len(cameras)):
        try:
            range_m = depth_range_m(cameras, index, points_m, nearer=settings.nearer)
        except CaptureError as error:
            logger.info("view %d: %s", index, error)
            ranges_m.append((np.nan, np.nan))
            farthest_m.append(np.nan)
            sources.append(())
            continue
        ranges_m.append((range_m[0], range_m[1] * settings.farther))
        farthest_m.append(range_m[1])
        sources.append(tuple(select_views(cameras, index, range_m, settings.sources, settings.selection)))
    if not any(sources):
        raise CaptureError(
            f"no two of {len(cameras)} photographs look at the same place from {settings.selection.min_angle_deg:g} to "
            f"{settings.selection.max_angle_deg:g} degrees apart",
            f"{_hint(cameras, ranges_m, settings)}",
        )
    return DepthPlan(ranges_m=tuple(ranges_m), farthest_m=tuple(farthest_m), sources=tuple(sources))


def _hint(cameras: Sequence[Pinhole], ranges_m: Sequence[tuple[float, float]], settings: MvsSettings) -> str:
    """What to do where no two views can be matched."""
    positions_m = np.array([camera.position_m for camera in cameras])
    spread_m = float(np.linalg.norm(np.ptp(positions_m, axis=0)))
    nearest_m = np.array(ranges_m)[:, 0]
    near_m = float(np.median(nearest_m[np.isfinite(nearest_m)])) if np.isfinite(nearest_m).any() else 0.0
    rounding_m = 1e-6 * (1 + float(np.abs(positions_m).max()))
    if spread_m <= max(near_m * np.tan(np.radians(settings.selection.min_angle_deg)), rounding_m):
        return "the camera only turned between them and did not move, or hardly; walk around the plant"
    return "take more photographs from places nearer to each other, or check the poses"


def match_round(
    number: int,
    index: int,
    plan: DepthPlan,
    read_view: Callable[[int], View],
    read_planes: Callable[[int], MatchedPlanes | None],
    settings: MvsSettings = MvsSettings(),
    *,
    threads: int = 0,
) -> MatchedPlanes:
    """One view in one round; its sources must not be empty.

    Args:
        number: Of the round, from 0.
        index: Of the view.
        plan: Of all views.
        read_view: Gives a view, by its number.
        read_planes: Gives what the round before left of a view, by its number; None for a view without sources.
        settings: How thoroughly.
        threads: 0: one per core.
    """
    current = settings.rounds[number]
    chosen = plan.sources[index]
    view = read_view(index)
    start = read_planes(index) if number else None
    return match_view(
        view,
        [read_view(k) for k in chosen],
        plan.ranges_m[index],
        current.level,
        current.iterations,
        settings.matching,
        start=start,
        segment_planes=_segment_planes(view, start, current.level, plan.ranges_m[index], settings)
        if start is not None and current.segments
        else None,
        source_planes=[read_planes(k) for k in chosen] if number and current.coherent else None,
        max_side_px=settings.max_side_px,
        seed=settings.seed * 64 + number,
        threads=threads,
    )


def _segment_planes(
    view: View, start: MatchedPlanes, level: int, range_m: tuple[float, float], settings: MvsSettings
) -> NDArray[np.float32]:
    """(H, W, 3), the plane of each pixel's segment at the size of matching."""
    picture = Picture.of(view, settings.max_side_px, level)
    labels = segment_photo(picture.srgb, settings.segments)
    planes = start.at_size(labels.shape)
    tolerance = settings.segment_tolerance * (1 / range_m[0] - 1 / range_m[1])
    return fit_segment_planes(planes.planes, planes.cost, labels, tolerance, settings.segments)


def finish_depth(
    index: int,
    plan: DepthPlan,
    read_view: Callable[[int], View],
    read_planes: Callable[[int], MatchedPlanes | None],
    settings: MvsSettings = MvsSettings(),
    *,
    level: int | None = None,
    threads: int = 0,
) -> DepthEstimate:
    """The depth of one view after the last round, as far as it is believed.

    Args:
        index: Of the view, which must have sources.
        plan: Of all views.
        read_view: Gives a view, by its number.
        read_planes: Gives what the last round left of a view, by its number; None for a view without sources.
        settings: What is believed.
        level: How often the pictures that the planes are of were halved; None: as in the last round.
        threads: 0: one per core.
    """
    level = settings.rounds[-1].level if level is None else level
    planes = read_planes(index)
    if planes is None:
        raise ValueError(f"view {index} has not been matched")
    planes = drop_limits(planes, plan.ranges_m[index], plan.farthest_m[index])
    own = Picture.of(read_view(index), settings.max_side_px, level)
    sources, opens = [], []
    for k in plan.sources[index]:
        found = read_planes(k)
        if found is not None:
            # What is not believed of a source is no witness.
            sources.append(drop_limits(found, plan.ranges_m[k], plan.farthest_m[k]))
            opens.append(Picture.of(read_view(k), settings.max_side_px, level))
    maps = open_maps(opens, settings.matching.open_margin_px)
    return confirm_depth(planes, sources, maps, own.srgb, settings.agreement, threads=threads)


def drop_limits(planes: MatchedPlanes, range_m: tuple[float, float], farthest_m: float) -> MatchedPlanes:
    """The planes without those of the background and those nearest of all, which may well lie nearer still.

    Args:
        planes: Of a view.
        range_m: Nearest and farthest depth that it was searched for.
        farthest_m: Depth that is believed.
    """
    near, far = 1 / range_m[0], 1 / farthest_m
    limit = _LIMIT * (near - far)
    inverse = planes.planes[..., 0]
    kept = (inverse > far + limit) & (inverse < near - limit)
    return replace(planes, planes=np.where(kept[..., None], planes.planes, np.float32(0)))


def match_views(
    views: Sequence[View],
    plan: DepthPlan,
    settings: MvsSettings = MvsSettings(),
    progress: Progress | None = None,
    *,
    threads: int = 0,
) -> list[PackedPlanes | None]:
    """The planes of every view after all the rounds, everything in memory; None for views without sources.

    Args:
        views: Their depth is not looked at. Pixels outside a view's mask get no plane.
        plan: Of them.
        settings: How thoroughly.
        progress: Called with the number of views matched, each round counted, and of all.
        threads: 0: one per core.
    """
    at_once, threads_each = share_cores(threads)
    cameras = [view.camera for view in views]
    planes: list[PackedPlanes | None] = [None] * len(views)
    done = 0
    for number in range(len(settings.rounds)):
        read_before = reader_of_planes(tuple(planes), cameras)

        def match(
            index: int, number: int = number, read: Callable[[int], MatchedPlanes | None] = read_before
        ) -> PackedPlanes | None:
            if not plan.sources[index]:
                return None
            return pack_planes(
                match_round(number, index, plan, views.__getitem__, read, settings, threads=threads_each)
            )

        for index, matched in enumerate(map_threaded(match, range(len(views)), threads=at_once)):
            planes[index] = matched
            done += 1
            if progress is not None:
                progress(done, len(settings.rounds) * len(views))
    return planes


def estimate_depths(
    views: Sequence[View],
    points_m: NDArray[np.floating] | None = None,
    settings: MvsSettings = MvsSettings(),
    progress: Progress | None = None,
    *,
    threads: int = 0,
) -> list[DepthEstimate | None]:
    """Depth of every view by all the rounds, everything in memory; None for views that no other can be matched with.

    Args:
        views: At least two; their depth is not looked at. Pixels outside a view's mask get no depth.
        points_m: (N, 3), points of the scene, which give the range of depths; without them the cameras do.
        settings: How thoroughly.
        progress: Called with the number of views matched, each round counted, and of all.
        threads: 0: one per core.

    Raises:
        CaptureError: No two views look at the same place from a usable angle.
    """
    cameras = [view.camera for view in views]
    plan = plan_depths(cameras, points_m, settings)
    read_planes = reader_of_planes(match_views(views, plan, settings, progress, threads=threads), cameras)
    return [
        finish_depth(index, plan, views.__getitem__, read_planes, settings, threads=threads)
        if plan.sources[index]
        else None
        for index in range(len(views))
    ]
