"""What a capture found, as pictures: maps beside their photographs, the cloud from its sides, who shares what."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud import Cloud
from usdfoliage.geometry.pinhole import Pinhole

NOTHING = (46, 48, 52)  # where a map has no value
PAPER = (250, 250, 248)  # behind a cloud, as the report's page
TURBO, VIRIDIS = cv2.COLORMAP_TURBO, cv2.COLORMAP_VIRIDIS
RANGE = (0.01, 0.99)  # quantiles of what a map shows that take the ends of the colours
BOUNDS = (0.002, 0.998)  # quantiles of a cloud's places that are shown: single points stray far
MARGIN = 0.05  # around them, of the largest side
DRAWN_POINTS = 2_000_000  # at most, evenly chosen
SPLATS_PX = (1, 2, 3, 4, 5, 7, 9, 13)  # sides of the squares that points are drawn as
SHADE = 6.0  # how dark steps of depth become
SHADE_PX = (1, 3)  # how far beside a pixel they are looked for
LEAST_SIDE = 0.2  # of a picture of a cloud, in its longer one
COMMON = 0.5  # of the cameras that see the best point, must see one that is shown
CIRCLING = 0.25  # cameras whose middle is nearer to the cloud than this share of their distance stand all around


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction:
    """How a cloud is looked at, without perspective: axes of the picture in the world, unit (3,) each."""

    name: str
    right: NDArray[np.float64]
    up: NDArray[np.float64]
    towards: NDArray[np.float64]  # from what is seen to who sees it


@dataclass(frozen=True, kw_only=True)
class Window:
    """What a picture without perspective shows, in metres along its axes."""

    left_m: float
    bottom_m: float
    width_m: float
    height_m: float
    px_per_m: float

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return max(1, round(self.width_m * self.px_per_m)), max(1, round(self.height_m * self.px_per_m))


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenPoints:
    """Which point of a cloud every pixel shows."""

    point: NDArray[np.int64]  # (H, W), -1 for none
    light: NDArray[np.float32]  # (H, W), 0 to 1: darker where something stands before


def color_values(values: NDArray[np.floating], low: float, high: float, colors: int) -> NDArray[np.uint8]:
    """(..., 3), values from low to high in the colours of one of cv2's maps."""
    scaled = np.clip((np.asarray(values, np.float64) - low) / max(high - low, 1e-300), 0, 1)
    return color_table(colors)[np.rint(255 * scaled).astype(np.uint8)]


def color_table(colors: int) -> NDArray[np.uint8]:
    """(256, 3), red, green and blue of one of cv2's maps."""
    return np.ascontiguousarray(cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], colors)[:, 0, ::-1])


def depth_limits(depth_m: NDArray[np.floating], mask: NDArray[np.bool_] | None = None) -> tuple[float, float] | None:
    """Nearest and farthest depth (H, W) that is told apart by colour, of the plant where a mask tells; None without."""
    known = depth_m > 0
    if mask is not None and (known & mask).any():
        known = known & mask
    if not known.any():
        return None
    near, far = np.quantile(depth_m[known], RANGE)
    return float(near), float(far)


def draw_depth(depth_m: NDArray[np.floating], limits: tuple[float, float] | None) -> NDArray[np.uint8]:
    """(H, W, 3), near is red, far is blue, in even steps of the inverse: what a pixel tells of depth."""
    picture = np.full((*depth_m.shape, 3), NOTHING, np.uint8)
    known = depth_m > 0
    if limits is not None:
        picture[known] = color_values(1 / depth_m[known].astype(np.float64), 1 / limits[1], 1 / limits[0], TURBO)
    return picture


def draw_normals(
    normals: NDArray[np.floating], camera: Pinhole, known: NDArray[np.bool_] | None = None
) -> NDArray[np.uint8]:
    """(H, W, 3), normals of the world as the camera sees them: red to the right, green up, blue towards it."""
    in_camera = normals @ camera.cam_from_world[:, :3].T * (1, -1, -1)
    picture = np.rint(np.clip(127.5 + 127.5 * in_camera, 0, 255)).astype(np.uint8)
    shown = np.any(normals != 0, axis=2)
    picture[~(shown if known is None else shown & known)] = NOTHING
    return picture


def draw_confidence(confidence: NDArray[np.floating], known: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(H, W, 3), from 0, dark blue, to 1, yellow, where anything is known."""
    picture = color_values(confidence, 0, 1, VIRIDIS)
    picture[~known] = NOTHING
    return picture


def draw_shared(shared: NDArray[np.floating], longest_px: int = 640) -> NDArray[np.uint8]:
    """A square for each pair (N, N), brighter where they share more, by the root; white where nothing is shared."""
    count = max(len(shared), 1)
    values = np.zeros((count, count)) if not len(shared) else np.sqrt(np.maximum(shared, 0))
    picture = color_values(values, 0, float(values.max(initial=0)) or 1.0, VIRIDIS)
    picture[values == 0] = (255, 255, 255)
    np.einsum("iic->ic", picture)[:] = (215, 215, 212)
    side = max(1, longest_px // count)
    large = np.repeat(np.repeat(picture, side, axis=0), side, axis=1)
    if side >= 8:  # else lines would be all there is
        large[::side] = large[:, ::side] = (235, 235, 232)
    return large


# The cloud


def find_sides(cameras: Sequence[Pinhole], cloud: Cloud, up: NDArray[np.float64]) -> tuple[Direction, ...]:
    """Front, right and top; the front is where the cameras stand, or the first of them where they stand all around."""
    up = up / np.linalg.norm(up)
    middle_m = np.median(cloud.points_m, axis=0) if len(cloud) else np.zeros(3)
    places_m = np.array([camera.position_m for camera in cameras]).reshape(-1, 3) - middle_m
    places_m -= (places_m @ up)[:, None] * up
    front = places_m.mean(axis=0) if len(places_m) else np.zeros(3)
    if len(places_m) and np.linalg.norm(front) < CIRCLING * np.linalg.norm(places_m, axis=1).mean():
        front = places_m[0]
    if np.linalg.norm(front) < 1e-9 * max(float(np.abs(middle_m).max()), 1e-9):  # above it, or there are none
        front = np.eye(3)[np.argmin(np.abs(up))]
        front = front - (front @ up) * up
    front = front / np.linalg.norm(front)
    right = np.cross(up, front)
    return (
        Direction(name="front", right=right, up=up, towards=front),
        Direction(name="right", right=-front, up=up, towards=right),
        Direction(name="top", right=right, up=-front, towards=up),
    )


def thin_cloud(cloud: Cloud, most: int = DRAWN_POINTS) -> Cloud:
    """At most so many of its points, evenly chosen."""
    if len(cloud) <= most:
        return cloud
    return cloud.take(np.linspace(0, len(cloud) - 1, most).astype(np.int64))


def frame_points(
    points_m: NDArray[np.float64], directions: Sequence[Direction], longest_px: int, all_of: NDArray[np.float64]
) -> list[Window]:
    """Windows of one scale that show nearly all points (N, 3), and all of some others (M, 3), from some directions."""
    bounds = []
    for direction in directions:
        axes = np.column_stack([direction.right, direction.up])
        places = np.concatenate([np.quantile(points_m @ axes, BOUNDS, axis=0), all_of @ axes]) if len(points_m) else (
            all_of @ axes
        )  # fmt: skip
        places = places if len(places) else np.zeros((1, 2))
        bounds.append((places.min(axis=0), places.max(axis=0)))
    longest_m = max(float((high - low).max()) for low, high in bounds) or 1.0
    px_per_m = longest_px / (longest_m * (1 + 2 * MARGIN))
    windows = []
    for low, high in bounds:
        side = np.maximum(high - low, LEAST_SIDE * longest_m) + 2 * MARGIN * longest_m
        start = (low + high - side) / 2
        windows.append(
            Window(left_m=float(start[0]), bottom_m=float(start[1]), width_m=float(side[0]), height_m=float(side[1]),
                   px_per_m=px_per_m)
        )  # fmt: skip
    return windows


def splat_points(
    points_m: NDArray[np.float64], direction: Direction, window: Window, widths_m: NDArray[np.floating]
) -> SeenPoints:
    """See points (N, 3) as squares as wide (N,) as they are apart, the nearer before the farther."""
    width_px, height_px = window.size_px
    x = (points_m @ direction.right - window.left_m) * window.px_per_m
    y = height_px - (points_m @ direction.up - window.bottom_m) * window.px_per_m
    inside = np.flatnonzero((x >= 0) & (x < width_px) & (y >= 0) & (y < height_px))
    near = points_m[inside] @ direction.towards
    order = np.argsort(near, kind="stable")
    inside, near = inside[order], near[order]
    column, row = x[inside].astype(np.intp), y[inside].astype(np.intp)
    sizes = np.searchsorted(SPLATS_PX[:-1], widths_m[inside] * window.px_per_m)
    rank = np.full((height_px, width_px), -1.0)  # which of the points, in the order of nearness: the last is seen
    for size, side in enumerate(SPLATS_PX):
        chosen = np.flatnonzero(sizes == size)
        of_size = np.full((height_px, width_px), -1.0)
        of_size[row[chosen], column[chosen]] = chosen
        np.maximum(rank, cv2.dilate(of_size, np.ones((side, side), np.uint8)), out=rank)
    number = rank.astype(np.int64)
    empty = number < 0
    if not len(inside):
        return SeenPoints(point=number, light=np.ones(number.shape, np.float32))
    height_m = np.where(empty, near[0], near[number]) * (window.px_per_m / max(width_px, height_px))
    return SeenPoints(point=np.where(empty, -1, inside[number]), light=_light(height_m.astype(np.float32), empty))


def draw_seen(seen: SeenPoints, colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3), every pixel in the colour (N, 3) of its point."""
    picture = np.full((*seen.point.shape, 3), PAPER, np.uint8)
    shown = seen.point >= 0
    picture[shown] = np.rint(colors[seen.point[shown]] * seen.light[shown, None]).astype(np.uint8)
    return picture


def draw_scale_bar(picture: NDArray[np.uint8], px_per_m: float) -> str:
    """Put a bar of a round length into the lower left corner; returns the length in words."""
    length_m = round_length(0.22 * picture.shape[1] / px_per_m)
    length_px = max(1, round(length_m * px_per_m))
    top = picture.shape[0] - 12
    for color, grown in ((PAPER, 2), ((60, 60, 60), 0)):
        picture[top - grown : top + 4 + grown, 10 - grown : 10 + length_px + grown] = color
    return in_words(length_m)


def round_length(length_m: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten that is not longer."""
    power = 10.0 ** np.floor(np.log10(length_m))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length_m * (1 + 1e-9)))


def in_words(length_m: float) -> str:
    """A length in the unit in which it reads well."""
    for unit, metres in (("km", 1000.0), ("m", 1.0), ("cm", 0.01), ("mm", 0.001)):
        if length_m >= metres * (1 - 1e-9):
            return f"{length_m / metres:.3g} {unit}"
    return f"{length_m * 1e6:.3g} µm"


def _light(near: NDArray[np.float32], empty: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(H, W), 1 where nothing beside stands nearer, in parts of the picture's longer side.

    Source: C. Boucheny, Interactive scientific visualization of large datasets, 2009, section 6 (eye-dome lighting).
    """
    nearest = np.where(empty, -np.inf, near).astype(np.float32)
    steps = np.zeros(near.shape, np.float32)
    for reach in SHADE_PX:
        padded = cv2.copyMakeBorder(nearest, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
        height, width = near.shape
        for down, across in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)):
            beside = padded[reach + down * reach :, reach + across * reach :][:height, :width]
            steps += np.clip(beside - near, 0, 0.02)
    return np.exp(-SHADE * steps).astype(np.float32)


def find_common(points_m: NDArray[np.float64], cameras: Sequence[Pinhole]) -> NDArray[np.bool_]:
    """(N,), points where many cameras look: in the pictures of half as many as the best of them; all without.

    What lies far behind a plant that was photographed from all around is in few pictures.
    """
    count = np.zeros(len(points_m), np.int64)
    for camera in cameras:
        places, _ = camera.project(points_m)
        with np.errstate(invalid="ignore"):
            count += np.all((places >= 0) & (places < (camera.width_px, camera.height_px)), axis=1)
    if not count.any():
        return np.ones(len(points_m), np.bool_)
    return np.asarray(count >= COMMON * np.quantile(count, 0.95))
