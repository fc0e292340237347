"""What a cloud is of, before branches are traced through it: a plant, or surely something else.

Branches can be traced through any points, so that a house becomes a tree of nonsense. Each measure is one that a person
would point at, and far from its limit for every plant: to refuse a tree is worse than to trace a hedge.
"""

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.tracing.higher_feet import stands_on_stem
from usdfoliage.geometry.large_planes import LargePlanes, LargePlaneSettings, find_large_planes

_TAILS = 0.01  # share of the points on each side that do not count for length, width and height
_LAYERS = 5  # of a hedge, from its foot to its top
_PIECE = 0.25  # of its height, length of a piece of each
_MAX_PIECES = 80  # along it
_MIN_POINTS = 200  # that show whether something is a hedge
_LOW = 0.1  # share of the heights, in which a level plane is what a plant stands on


class CloudKind(Enum):
    """What a cloud is of."""

    PLANT = "plant"  # as far as anything is known
    BUILDING = "building"  # walls that face more than one direction
    WALL = "wall"  # one, and nothing else
    GROUND = "ground"  # a level plane, and nothing else
    HEDGE = "hedge"  # a long, low block that is dense all through, without a trunk


@dataclass(frozen=True, kw_only=True)
class CloudShapeSettings:
    """What is surely no tree."""

    stems: float = 0.25  # share of the roots, from which on their stems are believed: it is a plant whatever it has
    building: float = 0.75  # share of the points on large planes; a tree before a corner of walls has fewer
    other_walls: float = 0.1  # share on walls that face otherwise than the largest: an espalier has none
    wall_m: float = 3.0  # length of a building or a wall, at least
    walls: float = 0.3  # share on walls of any direction
    wall: float = 0.9  # share on planes of one that is alone; before it a plant has the rest
    wall_clutter: float = 0.2  # up to which it is flat: an espalier is not
    ground: float = 0.9  # share on level planes,
    thin: float = 0.03  # of its length, thickness of bare ground: a park seen from the air is thicker
    long: float = 3.0  # of its height and of its width each, length of a hedge
    wide: float = 0.25  # of its height, width of one: an espalier is thinner
    filled: float = 0.78  # share of the pieces of its barest layer that are filled; a crown that lies tapers
    fills: float = 0.4  # of the points of an average piece, that fill one
    hedge_clutter: float = 0.26  # from which on it is foliage: a log that lies is smooth
    level: float = 0.25  # upward part of the normal of a wall, up to which it is upright
    planes: LargePlaneSettings = field(default_factory=LargePlaneSettings)

    def __post_init__(self) -> None:
        shares = (self.stems, self.building, self.other_walls, self.walls, self.wall, self.ground, self.filled)
        if not all(0 < share <= 1 for share in shares):
            raise ValueError(f"shares must be above 0 and at most 1, not {self}")
        if not (self.long > 1 and self.wide > 0 and self.thin > 0 and self.fills > 0 and 0 < self.level < 1):
            raise ValueError(f"long must be above 1, wide, thin and fills above 0, level in (0, 1), not {self}")


@dataclass(frozen=True, kw_only=True)
class CloudShape:
    """What a cloud is of, and by which figures; lengths without what the plant stands on."""

    kind: CloudKind
    planes: int  # that are large
    on_planes: float  # share of the points
    on_walls: float
    on_other_walls: float  # that face otherwise than the largest of them
    on_level: float
    thickness: float  # of the whole cloud where it is flattest, of its length
    clutter: float  # thickness of a point's surroundings of their length, usually
    length_m: float  # the larger horizontal one
    width_m: float
    height_m: float
    filled: float  # share of the pieces of the barest layer along its length that have points
    stems: float  # share of the roots on which one stands


def judge_cloud_shape(
    points_m: NDArray[np.float64], roots_m: NDArray[np.float64], settings: CloudShapeSettings = CloudShapeSettings()
) -> CloudShape:
    """Judge what a cloud is of.

    Args:
        points_m: (N, 3), Y up, without the ground where it was found; N at least 3.
        roots_m: (R, 3), R at least 1.
        settings: What is no tree.
    """
    planes = find_large_planes(points_m, settings.planes)
    is_wall = np.abs(planes.normals[:, 1]) < settings.level
    is_level = np.abs(planes.normals[:, 1]) > np.sqrt(1 - settings.level**2)
    share = np.array([np.mean(planes.of_point == number) for number in range(len(planes.normals))])
    other = np.zeros(len(share), bool)
    if is_wall.any():
        first = planes.normals[np.flatnonzero(is_wall)[share[is_wall].argmax()]]
        other = is_wall & (np.abs(planes.normals @ first) < np.cos(np.radians(30)))
    standing = _without_floor(points_m, planes, is_level)
    length_m, width_m, height_m, filled = _measure_block(points_m[standing], settings)
    shape = CloudShape(
        kind=CloudKind.PLANT,
        planes=len(share),
        on_planes=float(share.sum()),
        on_walls=float(share[is_wall].sum()),
        on_other_walls=float(share[other].sum()),
        on_level=float(share[is_level].sum()),
        thickness=_measure_thickness(points_m),
        clutter=float(np.median(planes.clutter[standing])) if standing.any() else 0.0,
        length_m=length_m,
        width_m=width_m,
        height_m=height_m,
        filled=filled,
        stems=float(np.mean([stands_on_stem(points_m, root_m) for root_m in roots_m])),
    )
    return replace(shape, kind=_choose_kind(shape, settings))


def _choose_kind(shape: CloudShape, settings: CloudShapeSettings) -> CloudKind:
    if shape.stems >= settings.stems:
        return CloudKind.PLANT
    # Large leaves and pads are flat, too.
    large = shape.length_m >= settings.wall_m
    if large and shape.on_planes >= settings.building and shape.on_walls >= settings.walls:
        if shape.on_other_walls >= settings.other_walls:
            return CloudKind.BUILDING
        if shape.on_planes >= settings.wall and shape.clutter < settings.wall_clutter:
            return CloudKind.WALL
    if shape.on_level >= settings.ground and shape.thickness <= settings.thin:
        return CloudKind.GROUND
    is_long = shape.length_m >= settings.long * max(shape.height_m, shape.width_m)
    is_block = shape.filled >= settings.filled and shape.width_m >= settings.wide * shape.height_m
    if is_long and is_block and shape.clutter >= settings.hedge_clutter:
        return CloudKind.HEDGE
    return CloudKind.PLANT


def _measure_thickness(points_m: NDArray[np.float64]) -> float:
    """Thickness of points (N, 3) of their length, both without outliers."""
    along = np.linalg.eigh(np.cov(points_m.T))[1]
    low_m, high_m = np.quantile(points_m @ along, [_TAILS, 1 - _TAILS], axis=0)
    thick_m, _, length_m = (high_m - low_m).tolist()
    return float(thick_m / length_m) if length_m > 0 else 0.0


def _without_floor(
    points_m: NDArray[np.float64], planes: LargePlanes, is_level: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(N,) points above level planes that lie low: ground that is too rough to be found as such."""
    low_m, high_m = np.quantile(points_m[:, 1], [_TAILS, 1 - _TAILS])
    kept = np.ones(len(points_m), bool)
    for number in np.flatnonzero(is_level).tolist():
        own = planes.of_point == number
        if np.median(points_m[own, 1]) <= low_m + _LOW * (high_m - low_m):
            kept &= ~own
    return kept


def _measure_block(points_m: NDArray[np.float64], settings: CloudShapeSettings) -> tuple[float, float, float, float]:
    """Length, width and height of points (N, 3) in metres, and how much of their barest layer has points."""
    if len(points_m) < _MIN_POINTS:
        return 0.0, 0.0, 0.0, 0.0
    flat_m = points_m[:, [0, 2]] - points_m[:, [0, 2]].mean(axis=0)
    along = np.linalg.eigh(np.cov(flat_m.T))[1]
    place_m = np.column_stack([flat_m @ along, points_m[:, 1]])  # across, along, up
    low_m, high_m = np.quantile(place_m, [_TAILS, 1 - _TAILS], axis=0)
    width_m, length_m, height_m = (high_m - low_m).tolist()
    if not (height_m > 0 and length_m > 0):
        return length_m, width_m, height_m, 0.0
    pieces = int(np.clip(round(length_m / (_PIECE * height_m)), 4, _MAX_PIECES))
    piece = np.clip((place_m[:, 1] - low_m[1]) / length_m * pieces, 0, pieces - 1).astype(np.int64)
    layer = np.clip((place_m[:, 2] - low_m[2]) / height_m * _LAYERS, 0, _LAYERS - 1).astype(np.int64)
    count = np.bincount(piece * _LAYERS + layer, minlength=pieces * _LAYERS).reshape(pieces, _LAYERS)
    return length_m, width_m, height_m, float((count > settings.fills * count.mean()).mean(axis=0).min())
