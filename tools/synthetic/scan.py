"""What a laser scanner would make of a scene: points of what each station sees, with the leaf that each is of."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from usdfoliage.geometry.pinhole import Pinhole, look_at

from tools.synthetic.raster import rasterise

Array = NDArray[np.float64]

WOOD, CLUTTER = -1, -2  # instead of the number of a leaf
AWAY = 3.0  # radii of what is scanned, from its middle to the stations
OVERSAMPLED = 1.6  # times as many rays as points are wanted, so that stations overlap
MIN_SIDE_PX, MAX_SIDE_PX = 200, 4000
ASIDE = 0.3  # of the noise along a ray, across it
ELEVATIONS_RAD = (0.1, 0.7, -0.25)  # of the stations, by turns
ONE_SIDED_RAD = 0.5  # arc of the stations to either side, where only one side is seen


@dataclass(frozen=True, kw_only=True)
class ScanSettings:
    """How a scene is scanned."""

    points: int = 100_000  # of the scene, without clutter
    stations: int = 6
    one_sided: bool = False  # all stations stand on one side
    noise_m: float = 0.001  # standard deviation along the ray
    clutter: float = 0.0  # share of all points that are anywhere
    seed: int = 0

    def __post_init__(self) -> None:
        if self.points < 1 or self.stations < 1:
            raise ValueError(f"points and stations must be 1 or more, not {self.points} and {self.stations}")
        if not (np.isfinite(self.noise_m) and self.noise_m >= 0):
            raise ValueError(f"noise_m must be 0 or more, not {self.noise_m}")
        if not 0 <= self.clutter < 1:
            raise ValueError(f"clutter must be from 0 to below 1, not {self.clutter}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """A cloud and what is true of it."""

    points_m: Array  # (N, 3), in no order
    leaf: NDArray[np.int32]  # (N,), number of the leaf, WOOD or CLUTTER


def scan_scene(
    vertices_m: Array,
    triangles: NDArray[np.integer],
    leaf: NDArray[np.integer],
    settings: ScanSettings = ScanSettings(),
) -> Scan:
    """Points of triangles as stations around them see them; fewer than wanted where hardly anything is seen.

    Args:
        vertices_m: (V, 3), Y up.
        triangles: (F, 3).
        leaf: (F,), number of the leaf, WOOD for none.
        settings: How.
    """
    rng = np.random.default_rng((settings.seed, 6))
    low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    side = MIN_SIDE_PX
    while True:
        seen = [_see(camera, vertices_m, triangles) for camera in _stand(middle, radius, side, settings)]
        count = sum(len(points) for _, points, _ in seen)
        if count >= OVERSAMPLED * settings.points or side >= MAX_SIDE_PX:
            break
        side = min(MAX_SIDE_PX, int(np.ceil(side * max(1.1, np.sqrt(OVERSAMPLED * settings.points / max(count, 1))))))
    origin = np.concatenate([np.tile(position, (len(points), 1)) for position, points, _ in seen])
    points = np.concatenate([points for _, points, _ in seen])
    triangle = np.concatenate([hit for _, _, hit in seen])
    chosen = rng.permutation(len(points))[: settings.points]
    points, origin, found = points[chosen], origin[chosen], np.asarray(leaf, np.int32)[triangle[chosen]]
    ray = points - origin
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    points = points + settings.noise_m * rng.normal(size=(len(points), 1)) * ray
    points += ASIDE * settings.noise_m * rng.normal(size=points.shape)
    extra = round(len(points) * settings.clutter / (1 - settings.clutter))
    points = np.concatenate([points, rng.uniform(low, high, (extra, 3))])
    found = np.concatenate([found, np.full(extra, CLUTTER, np.int32)])
    order = rng.permutation(len(points))
    return Scan(points_m=points[order], leaf=found[order])


def _stand(middle: Array, radius: float, side: int, settings: ScanSettings) -> Sequence[Pinhole]:
    """A picture of all that is scanned, from each station."""
    count = settings.stations
    azimuth = 2 * np.pi * np.arange(count) / count
    if settings.one_sided:
        azimuth = np.linspace(-ONE_SIDED_RAD, ONE_SIDED_RAD, count) if count > 1 else np.zeros(1)
    elevation = np.resize(ELEVATIONS_RAD, count)
    level = np.cos(elevation)
    away = np.column_stack([np.sin(azimuth) * level, np.sin(elevation), np.cos(azimuth) * level])
    focal_px = side / 2 * np.sqrt(AWAY**2 - 1)
    return [look_at(middle + AWAY * radius * direction, middle, focal_px, (side, side)) for direction in away]


def _see(camera: Pinhole, vertices_m: Array, triangles: NDArray[np.integer]) -> tuple[Array, Array, NDArray[np.int32]]:
    """Where the station stands (3,), the points (K, 3) that it sees and the triangle (K,) of each."""
    places, depth = camera.project(vertices_m)
    hits = rasterise(places, 1 / depth, np.asarray(triangles, np.int32), (camera.height_px, camera.width_px))
    rows, columns = np.nonzero(hits.triangle >= 0)
    depth_m = hits.depth[rows, columns]
    focal = np.array(camera.focal_px)
    inside = np.column_stack([(np.column_stack([columns, rows]) + 0.5 - camera.center_px) / focal, np.ones(len(rows))])
    rotation, translation = camera.cam_from_world[:, :3], camera.cam_from_world[:, 3]
    points = (inside * depth_m[:, None] - translation) @ rotation
    return -rotation.T @ translation, points, hits.triangle[rows, columns]
