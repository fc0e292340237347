"""Coarse depth of posed photographs, by sweeping planes of equal depth through the scene.

R. T. Collins, A space-sweep approach to true multi-image matching, 1996, with the matching cost and the smoothness of
semiglobal matching; what the photographs of one another do not confirm is then dropped (depth_consistency).
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.capture.folder.listing import counted, named
from usdfoliage.capture.mvs.consistency import ConsistencySettings, keep_consistent
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.native_settings import native_settings
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, remark

logger = logging.getLogger(__name__)

_BRIGHTNESS_SCALE = 64  # of brightness as native code takes it: steps of a 64th of an 8-bit level
_ONE_SURFACE_STEPS = 8  # a pixel and those around it, whose depths differ by more, belong to several surfaces


@dataclass(frozen=True, kw_only=True)
class PlaneSweepSettings:
    """How finely to sweep, and against which photographs."""

    max_side_px: int = 1200  # Photographs are matched at this longer side at most. Unit: pixels. Range: 16 or more.
    neighbors: int = 4  # Each photograph is matched with this many others. Range: 1 or more.
    # Photographs that see a place under a smaller angle are not matched, because depth is hardly determined. Unit:
    # degrees. Range: 0 to below max_angle_deg.
    min_angle_deg: float = 2.0
    # Photographs that see a place under a larger angle are not matched, because leaves look too different. Unit:
    # degrees. Range: above min_angle_deg, below 90.
    max_angle_deg: float = 30.0
    # The cost of a place is that of this share of the neighbours, those that match best; the others may not see it.
    # Range: above 0, up to 1.
    best_share: float = 0.5
    # Neighbouring planes move a pixel by this much in the neighbour that moves most. Unit: pixels. Range: above 0.
    step_px: float = 1.5
    # A photograph is swept with this many planes at most; the steps become longer where step_px needs more. Range: 3
    # or more.
    max_planes: int = 400
    window_px: int = 2  # The matching window has this radius. Unit: pixels. Range: 1 or more.
    tolerance: float = 2.0  # Differences of brightness up to this count as noise. Unit: of 255. Range: 0 or more.
    # A step of one plane between neighbouring pixels costs this. Unit: of 127. Range: 0 to below large_step_cost.
    small_step_cost: int = 20
    # A larger step between neighbouring pixels costs this. Unit: of 127. Range: above small_step_cost, below 1000.
    large_step_cost: int = 200
    # A difference of brightness of this size halves the cost of a larger step. Unit: of 255. Range: above 0.
    edge: float = 16.0
    # A pixel of lower uniqueness has no depth, because another plane fits as well. Range: 0 to 1.
    min_uniqueness: float = 0.02
    consistency: ConsistencySettings = field(default_factory=ConsistencySettings)
    threads: int = 0  # At most this many threads work; 0 is one per core. Range: 0 or more.

    def __post_init__(self) -> None:
        if self.max_side_px < 16 or self.neighbors < 1 or self.max_planes < 3 or self.window_px < 1:
            raise ValueError("max_side_px must be at least 16, neighbors and window_px 1, max_planes 3")
        if not 0 <= self.min_angle_deg < self.max_angle_deg < 90:
            raise ValueError(f"0 <= min_angle_deg < max_angle_deg < 90, not {self.min_angle_deg}, {self.max_angle_deg}")
        if not 0 < self.best_share <= 1 or not self.step_px > 0 or not self.edge > 0 or not self.tolerance >= 0:
            raise ValueError("best_share must be in (0, 1], step_px and edge above 0, tolerance not below 0")
        if not 0 <= self.small_step_cost < self.large_step_cost < 1000:
            raise ValueError("small_step_cost must be below large_step_cost, and both in [0, 1000)")


@dataclass(frozen=True, kw_only=True, eq=False)
class SweptDepth:
    """Depth of one photograph from the sweep alone."""

    depth_m: NDArray[np.float32]  # (h, w), along the optical axis, 0 where there is none; size of camera
    confidence: NDArray[np.float32]  # (h, w) in [0, 1], how far the depth stands out from others
    camera: Pinhole  # at the size of matching
    step_m: NDArray[np.float32]  # (h, w), between planes there


@dataclass(frozen=True, kw_only=True, eq=False)
class SweptViews:
    """Depth of all views."""

    depths_m: tuple[NDArray[np.float32], ...]  # of each view, (H, W) at its photograph's size, 0 where it is not known
    remarks: tuple[Remark, ...]  # on views that were not swept


def sweep_depths(
    views: Sequence[View],
    points_m: NDArray[np.floating] | None = None,
    settings: PlaneSweepSettings = PlaneSweepSettings(),
    progress: Progress | None = None,
) -> SweptViews:
    """Depth of every view.

    Every view is swept, then every depth is compared with those of the other views. Views with too few neighbours, and
    pixels outside a view's mask, get no depth.

    Args:
        views: At least two; their depth is not looked at.
        points_m: (N, 3), points of the scene, which give the range of depths; without them the cameras do.
        settings: How finely, and against which photographs.
        progress: Called with the number of views done and of all.

    Raises:
        CaptureError: No view has a neighbour at a usable angle.
    """
    cameras = [view.camera for view in views]
    swept: list[SweptDepth | None] = []
    for index in range(len(views)):
        swept.append(_sweep_if_possible(views, cameras, index, points_m, settings))
        if progress is not None:
            progress(index + 1, len(views))
    lonely = [view.name for view, depth in zip(views, swept, strict=True) if depth is None]
    if len(lonely) == len(views):
        raise CaptureError(
            f"no two of {len(views)} photographs look at the same place from {settings.min_angle_deg:g} to "
            f"{settings.max_angle_deg:g} degrees apart"
        )
    remarks = []
    if lonely:
        text = f"{len(lonely)} of {counted(len(views), 'view')} have no neighbour to match with: {named(lonely)}"
        remarks.append(remark("photographs-without-companion", text, subject=named(lonely)))

    known = [depth for depth in swept if depth is not None]
    checked = iter(
        keep_consistent(
            [depth.camera for depth in known],
            [np.where(depth.confidence >= settings.min_uniqueness, depth.depth_m, 0) for depth in known],
            [depth.step_m for depth in known],
            settings.consistency,
        )
    )
    depths = []
    for view, depth in zip(views, swept, strict=True):
        size = view.camera.height_px, view.camera.width_px
        full = np.zeros(size, np.float32) if depth is None else _enlarge(next(checked), depth.step_m, size)
        depths.append(full if view.mask is None else np.where(view.mask, full, np.float32(0)))
    logger.info(
        "%d views swept, depth at %.0f %% of the pixels", len(known), 100 * np.mean([(d > 0).mean() for d in depths])
    )
    return SweptViews(depths_m=tuple(depths), remarks=tuple(remarks))


def _sweep_if_possible(
    views: Sequence[View],
    cameras: Sequence[Pinhole],
    index: int,
    points_m: NDArray[np.floating] | None,
    settings: PlaneSweepSettings,
) -> SweptDepth | None:
    """Depth of one view; None where it has no neighbours, or looks where nobody else does."""
    try:
        range_m = depth_range_m(cameras, index, points_m)
    except CaptureError as error:
        logger.info("%s: %s", views[index].name, error)
        return None
    chosen = choose_neighbors(cameras, index, range_m, settings)
    return sweep_depth(views, index, chosen, range_m, settings) if chosen else None


def sweep_depth(
    views: Sequence[View],
    index: int,
    neighbors: Sequence[int],
    range_m: tuple[float, float],
    settings: PlaneSweepSettings = PlaneSweepSettings(),
) -> SweptDepth:
    """Depth of one view, not yet confirmed by others.

    Planes are equally far apart in inverse depth, so that they are in the photographs too.

    Args:
        views: The photographs.
        index: Which of them.
        neighbors: With which it is matched, at least one.
        range_m: Nearest and farthest depth.
        settings: How finely.
    """
    near_m, far_m = range_m
    if not 0 < near_m < far_m:
        raise ValueError(f"the range must be 0 < near < far, not {near_m:g}, {far_m:g}")
    if not neighbors or index in neighbors:
        raise ValueError(f"view {index} needs neighbours other than itself, not {list(neighbors)}")
    camera, photo = _reduced(views[index], settings.max_side_px)
    others = [_reduced(views[k], settings.max_side_px) for k in neighbors]

    shift_px = max(_shift_px(camera, other, near_m, far_m) for other, _ in others)
    planes = int(np.clip(np.ceil(shift_px / settings.step_px) + 1, 3, settings.max_planes))
    inverse = np.linspace(1 / far_m, 1 / near_m, planes)
    homographies = np.stack([_homographies(camera, other, inverse) for other, _ in others])

    cost = _native.sweep_cost(
        photo,
        [brightness for _, brightness in others],
        homographies=homographies,
        settings=native_settings(
            _native.SweepCostSettings, settings, tolerance_64ths=round(settings.tolerance * _BRIGHTNESS_SCALE)
        ),
        threads=settings.threads,
    )
    picks = _native.pick_planes(
        cost,
        photo,
        settings=native_settings(_native.SemiglobalSettings, settings, edge_64ths=settings.edge * _BRIGHTNESS_SCALE),
        threads=settings.threads,
    )
    step = (inverse[-1] - inverse[0]) / (planes - 1)
    depth_m = 1 / (inverse[0] + picks.plane.astype(np.float64) * step)
    inner = (picks.plane > 0.5) & (picks.plane < planes - 1.5)  # on the ends the best plane may lie beyond
    return SweptDepth(
        depth_m=np.where(inner, depth_m, 0).astype(np.float32),
        confidence=picks.uniqueness,
        camera=camera,
        step_m=np.asarray(depth_m**2 * step, np.float32),
    )


def depth_range_m(
    cameras: Sequence[Pinhole],
    index: int,
    points_m: NDArray[np.floating] | None = None,
    *,
    nearer: float = 0.02,
) -> tuple[float, float]:
    """Nearest and farthest depth worth sweeping in one view.

    From the points in the picture, the outermost hundredth left out, with a margin; with fewer than 20 of them, a half
    and double of the depth where the cameras' axes come closest to each other.

    Args:
        cameras: Of all views.
        index: Of the view.
        points_m: (N, 3), points of the scene.
        nearer: Share of the nearest point's inverse depth by which what the points do not show may be nearer.

    Raises:
        CaptureError: There are neither points nor a place that the cameras look at.
    """
    camera = cameras[index]
    if points_m is not None and len(points_m):
        places, depth_m = camera.project(np.asarray(points_m, np.float64))
        seen = (depth_m > 0) & np.all((places >= 0) & (places < (camera.width_px, camera.height_px)), axis=1)
        if np.count_nonzero(seen) >= 20:
            far, near = np.quantile(1 / depth_m[seen], [0.01, 0.99])
            margin = 0.1 * (near - far)
            return 1 / (near + margin + nearer * near), 1 / max(far - margin - 0.02 * near, 0.5 * far)
    depth = float(_looked_at_m(cameras) @ camera.cam_from_world[2, :3] + camera.cam_from_world[2, 3])
    if not depth > 0:
        raise CaptureError("the range of depths cannot be found: the cameras do not look at one place", "give points3D")
    return depth / 2, depth * 2


def choose_neighbors(
    cameras: Sequence[Pinhole],
    index: int,
    range_m: tuple[float, float],
    settings: PlaneSweepSettings = PlaneSweepSettings(),
) -> list[int]:
    """The views that see the middle of one view's range from a usable angle, the smallest angle first."""
    camera = cameras[index]
    middle_m = 2 / (1 / range_m[0] + 1 / range_m[1])
    grid = np.stack(np.meshgrid([0.25, 0.5, 0.75], [0.25, 0.5, 0.75]), -1).reshape(-1, 2)
    places = grid * (camera.width_px, camera.height_px)
    targets_m = camera.unproject(places, np.full(len(grid), middle_m))
    angles: list[tuple[float, int]] = []
    for k, other in enumerate(cameras):
        if k == index:
            continue
        seen_at, _ = other.project(targets_m)
        seen = np.all((seen_at >= 0) & (seen_at < (other.width_px, other.height_px)), axis=1)  # NaN is not
        to_own, to_other = camera.position_m - targets_m[4], other.position_m - targets_m[4]
        cosine = to_own @ to_other / (np.linalg.norm(to_own) * np.linalg.norm(to_other))
        angle_deg = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
        if 2 * np.count_nonzero(seen) >= len(grid) and settings.min_angle_deg <= angle_deg <= settings.max_angle_deg:
            angles.append((angle_deg, k))
    return [k for _, k in sorted(angles)[: settings.neighbors]]


def _looked_at_m(cameras: Sequence[Pinhole]) -> NDArray[np.float64]:
    """(3,), the place closest to the optical axes of all cameras, by least squares."""
    system, right = np.zeros((3, 3)), np.zeros(3)
    for camera in cameras:
        axis = camera.cam_from_world[2, :3]
        across = np.eye(3) - np.outer(axis, axis)
        system += across
        right += across @ camera.position_m
    return np.asarray(np.linalg.lstsq(system, right, rcond=None)[0])


def _reduced(view: View, max_side_px: int) -> tuple[Pinhole, NDArray[np.int16]]:
    """Camera and brightness (h, w) at the size of matching."""
    camera = view.camera
    brightness = cv2.cvtColor(view.srgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    scale = max_side_px / max(camera.width_px, camera.height_px)
    if scale < 1:
        width, height = round(camera.width_px * scale), round(camera.height_px * scale)
        brightness = cv2.resize(brightness, (width, height), interpolation=cv2.INTER_AREA)
        camera = camera.resized(width, height)
    return camera, np.ascontiguousarray(np.rint(brightness * _BRIGHTNESS_SCALE).astype(np.int16))


def _homographies(camera: Pinhole, other: Pinhole, inverse_depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """(planes, 3, 3): pixel indices of the other photograph from those of the camera's, for planes of equal depth."""
    rotation = other.cam_from_world[:, :3] @ camera.cam_from_world[:, :3].T
    translation = other.cam_from_world[:, 3] - rotation @ camera.cam_from_world[:, 3]
    through_plane = np.broadcast_to(rotation, (len(inverse_depth), 3, 3)).copy()
    through_plane[:, :, 2] += translation * inverse_depth[:, None]
    return np.asarray(other.pixel_from_ray() @ through_plane @ np.linalg.inv(camera.pixel_from_ray()))


def _shift_px(camera: Pinhole, other: Pinhole, near_m: float, far_m: float) -> float:
    """How far the picture's middle moves in the other photograph between nearest and farthest depth."""
    middle = np.array([[camera.width_px / 2, camera.height_px / 2]] * 2)
    places, _ = other.project(camera.unproject(middle, np.array([near_m, far_m])))
    shift = float(np.linalg.norm(places[0] - places[1]))
    return shift if np.isfinite(shift) else 0.0


def _enlarge(depth_m: NDArray[np.float32], step_m: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Depth at the photograph's size; between pixels on one surface it is interpolated, never across an edge."""
    if depth_m.shape == size:
        return depth_m
    to = size[1], size[0]
    nearest = cv2.resize(depth_m, to, interpolation=cv2.INTER_NEAREST_EXACT)
    smooth = cv2.resize(depth_m, to, interpolation=cv2.INTER_LINEAR)
    around = np.ones((3, 3), np.uint8)
    even = cv2.dilate(depth_m, around) - cv2.erode(depth_m, around) < _ONE_SURFACE_STEPS * step_m
    even = cv2.resize(even.astype(np.uint8), to, interpolation=cv2.INTER_NEAREST_EXACT) > 0
    return np.where(even & (nearest > 0), smooth, nearest).astype(np.float32)
