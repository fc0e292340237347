"""Pictures of a cloud from its sides, without perspective, the nearer points before the farther."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.geometry.pinhole import Pinhole

PAPER = (250, 250, 248)  # behind a cloud, as the report's page
BOUNDS = (0.002, 0.998)  # quantiles of a cloud's places that are shown: without single points far off
MARGIN = 0.05  # around them, of the largest side
DRAWN_POINTS = 1_500_000  # at most, evenly chosen
SPLATS_PX = (1, 2, 3, 4, 5, 7, 9, 13)  # sides of the squares that points are drawn as
SHADE = 6.0  # how dark steps of depth become
STEP, LARGEST_STEP = 0.004, 0.02  # of depth, in picture sides, that begins to darken, and beyond it the most that does
SHADE_PX = (1, 3)  # how far beside a pixel they are looked for
MIN_SIDE = 0.2  # of a picture of a cloud, in its longer one
QUANTILE = 0.999  # quantile of how many cameras see points that is taken for the most
COMMON = 0.5  # of the cameras that see the best point, must see one that is shown
CIRCLING = 0.25  # cameras whose middle is nearer to the cloud than this share of their distance stand all around
BAR_SHARE = 0.22  # of a picture's width
BAR_INK = (60, 60, 60)


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

    def places(self, points_m: NDArray[np.float64], direction: Direction) -> NDArray[np.float64]:
        """Where points (N, 3) are in the picture, (N, 2), x and y from the left upper corner."""
        x = (points_m @ direction.right - self.left_m) * self.px_per_m
        y = self.size_px[1] - (points_m @ direction.up - self.bottom_m) * self.px_per_m
        return np.column_stack([x, y])


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenPoints:
    """Which point of a cloud every pixel shows."""

    point: NDArray[np.int64]  # (H, W), -1 for none
    light: NDArray[np.float32]  # (H, W), 0 to 1: darker where something stands before


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


def thin_cloud(cloud: Cloud, max_points: int = DRAWN_POINTS) -> Cloud:
    """At most so many of its points, evenly chosen."""
    if len(cloud) <= max_points:
        return cloud
    return cloud.take(np.linspace(0, len(cloud) - 1, max_points).astype(np.int64))


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
    return np.asarray(count >= COMMON * np.quantile(count, QUANTILE))


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
        side = np.maximum(high - low, MIN_SIDE * longest_m) + 2 * MARGIN * longest_m
        start = (low + high - side) / 2
        windows.append(
            Window(left_m=float(start[0]), bottom_m=float(start[1]), width_m=float(side[0]), height_m=float(side[1]),
                   px_per_m=px_per_m)
        )  # fmt: skip
    return windows


def find_inside(
    points_m: NDArray[np.float64], drawn_m: NDArray[np.float64], directions: Sequence[Direction]
) -> NDArray[np.bool_]:
    """(N,), points in the box, along three directions, of those (M, 3) that are to be shown: others would hide them."""
    if not len(drawn_m):
        return np.ones(len(points_m), np.bool_)
    axes = np.column_stack([direction.towards for direction in directions])
    low, high = np.quantile(drawn_m @ axes, BOUNDS, axis=0)
    margin_m = MARGIN * float((high - low).max())
    places = points_m @ axes
    return np.asarray(((places >= low - margin_m) & (places <= high + margin_m)).all(axis=1))


def splat_points(
    points_m: NDArray[np.float64], direction: Direction, window: Window, widths_m: NDArray[np.floating]
) -> SeenPoints:
    """See points (N, 3) as squares as wide (N,) as they are apart, the nearer before the farther."""
    width_px, height_px = window.size_px
    x, y = window.places(points_m, direction).T
    inside = np.flatnonzero((x >= 0) & (x < width_px) & (y >= 0) & (y < height_px))
    near = points_m[inside] @ direction.towards
    order = np.argsort(near, kind="stable")
    inside, near = inside[order], near[order]
    column, row = x[inside].astype(np.intp), y[inside].astype(np.intp)
    sizes = np.searchsorted(SPLATS_PX[:-1], widths_m[inside] * window.px_per_m)
    rank = np.full((height_px, width_px), -1.0)  # which of the points, in the order of nearness: the last is seen
    for size, side in enumerate(SPLATS_PX):
        chosen = np.flatnonzero(sizes == size)
        if not len(chosen):
            continue
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
    visible = seen.point >= 0
    picture[visible] = np.rint(colors[seen.point[visible]] * seen.light[visible, None]).astype(np.uint8)
    return picture


def draw_scale_bar(picture: NDArray[np.uint8], length_m: float, px_per_m: float) -> None:
    """Put a bar of this length into the lower left corner."""
    length_px = max(1, round(length_m * px_per_m))
    top = picture.shape[0] - 12
    for color, grown in ((PAPER, 2), (BAR_INK, 0)):
        picture[top - grown : top + 4 + grown, 10 - grown : 10 + length_px + grown] = color


def bar_length(windows: Sequence[Window]) -> float:
    """A round length in metres that is about a fifth of the narrowest of pictures."""
    return round_length(BAR_SHARE * min(window.width_m for window in windows))


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
            steps += np.clip(beside - near - STEP, 0, LARGEST_STEP)
    return np.exp(-SHADE * steps).astype(np.float32)


def round_length(length_m: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten that is not longer."""
    power = 10.0 ** np.floor(np.log10(length_m))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length_m * (1 + 1e-9)))
