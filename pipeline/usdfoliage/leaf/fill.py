"""Leaves at the points of a cloud that are of leaves, but of which no single leaf could be told.

Every place gets one leaf: in the plane that the points around it lie in, pointing away from the branch that it grows
on, of a usual length, or shorter where its points end sooner. Our own idea: the leaves of a plant seen from afar are
known by where they are, not one by one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, kw_only=True)
class FillSettings:
    """How closely leaves stand, and what decides how they lie. Lengths are in those of a leaf."""

    apart: float = 0.5  # middles of leaves at least: a leaf's own points are no place for another
    around: float = 0.35  # of a leaf's middle, points that tell its plane
    least_points: int = 4  # around it: fewer are no leaf
    flat: float = 0.5  # spread across the plane over that along it, above which it is no plane and tells nothing
    tilt: float = 0.7  # of a leaf there, from level: standard deviation of its normal's parts, whose upward one is 1
    shortest: float = 0.3  # a leaf whose points end sooner on both sides; 1: all have the usual length
    wide: float = 0.25  # from its axis, and half of that from its plane, points that tell how long it is
    gap: float = 0.1  # between points along the axis, where they end; points half as far apart as that tell no end
    farthest: float = 3.5  # from what leaves grow from: beyond it are no leaves of the plant
    most_leaves: int = 200_000

    def __post_init__(self) -> None:
        if not (min(self.apart, self.around, self.flat, self.wide, self.gap, self.farthest) > 0 and self.tilt >= 0):
            raise ValueError(
                f"apart, around, flat, wide, gap and farthest must be above 0, tilt not below it, not {self}"
            )
        if not 0 < self.shortest <= 1:
            raise ValueError(f"shortest must be above 0 and at most 1, not {self.shortest}")
        if self.least_points < 3 or self.most_leaves < 1:
            raise ValueError(f"least_points must be at least 3, most_leaves at least 1, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class FilledPlaces:
    """Where leaves were put."""

    base_m: NDArray[np.float64]  # (N, 3)
    orientation: NDArray[np.float64]  # (N, 4), unit quaternions (x, y, z, w), from leaf space
    length_m: NDArray[np.float64]  # (N,), at most the usual one
    point: NDArray[np.int64]  # (N,), of the cloud, amid each leaf


def fill_places(
    points_m: NDArray[np.float64],
    origins_m: NDArray[np.float64],
    length_m: float,
    rng: np.random.Generator,
    settings: FillSettings = FillSettings(),
    *,
    plant_m: NDArray[np.float64] | None = None,
) -> FilledPlaces:
    """Put leaves on points.

    Args:
        points_m: (N, 3), of leaves, Y up.
        origins_m: (M, 3), places that leaves grow from: points of twigs and branches; at least one.
        length_m: Of a usual leaf, which is the longest.
        rng: Of the order in which places are tried.
        settings: How closely.
        plant_m: (P, 3), all points of the plant, which tell where a leaf ends better than those that are surely of
            leaves; None: points_m.

    Raises:
        ValueError: The length is not above 0, or there is nothing that leaves grow from.
    """
    if not (np.isfinite(length_m) and length_m > 0):
        raise ValueError(f"length_m must be above 0, not {length_m}")
    if not len(origins_m):
        raise ValueError("leaves grow from at least one place")
    chosen = _thin_out(points_m, settings.apart * length_m, rng)
    middle_m, normal, along, chosen = _fit_planes(points_m, chosen, settings.around * length_m, settings, rng)
    if len(chosen):
        away_m, _ = cKDTree(origins_m).query(middle_m)
        near = away_m <= settings.farthest * length_m
        middle_m, normal, along, chosen = middle_m[near], normal[near], along[near], chosen[near]
    if len(chosen) > settings.most_leaves:
        kept = np.sort(rng.choice(len(chosen), settings.most_leaves, replace=False))
        middle_m, normal, along, chosen = middle_m[kept], normal[kept], along[kept], chosen[kept]
    if not len(chosen):
        return FilledPlaces(base_m=np.zeros((0, 3)), orientation=np.zeros((0, 4)), length_m=np.zeros(0), point=chosen)
    _, nearest = cKDTree(origins_m).query(middle_m)
    away = middle_m - origins_m[nearest]
    axis = _in_plane(away, normal)
    # Where a leaf stands right over its twig its points tell which way it goes.
    short = np.linalg.norm(axis, axis=1) < 0.1 * length_m
    axis[short] = _in_plane(along, normal)[short]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    turn = np.stack([np.cross(axis, normal), axis, normal], axis=-1)
    plant_m = points_m if plant_m is None else plant_m
    foot_m = (away * axis).sum(axis=1)
    beside = np.linalg.norm(away - foot_m[:, None] * axis, axis=1) <= settings.wide * length_m
    begin_m, own_m = _find_ends(plant_m, middle_m, turn, np.where(beside & ~short, foot_m, 0), length_m, settings)
    return FilledPlaces(
        base_m=middle_m + begin_m[:, None] * axis,
        orientation=Rotation.from_matrix(turn).as_quat(canonical=True),
        length_m=own_m,
        point=chosen,
    )


def _thin_out(points_m: NDArray[np.float64], apart_m: float, rng: np.random.Generator) -> NDArray[np.int64]:
    """Points no two of which are nearer than apart_m, as many as fit in the order in which they come up, sorted."""
    if not len(points_m):
        return np.zeros(0, np.int64)
    tree = cKDTree(points_m)
    free = np.ones(len(points_m), bool)
    chosen = []
    for point in rng.permutation(len(points_m)):
        if free[point]:
            chosen.append(point)
            free[tree.query_ball_point(points_m[point], apart_m)] = False
    return np.sort(np.array(chosen, np.int64))


def _fit_planes(
    points_m: NDArray[np.float64],
    chosen: NDArray[np.int64],
    around_m: float,
    settings: FillSettings,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Middle, normal and longest direction of the points around each of those chosen that has enough of them."""
    found = cKDTree(points_m).query_ball_point(points_m[chosen], around_m) if len(chosen) else []
    lists: list[list[int]] = list(found)  # type: ignore[arg-type]  # its stubs know of one place alone
    counts = np.array([len(each) for each in lists], np.int64)
    kept = counts >= settings.least_points
    chosen, counts = chosen[kept], counts[kept]
    if not len(chosen):
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), chosen
    owner = np.repeat(np.arange(len(chosen)), counts)
    inside_m = points_m[np.concatenate([each for each, good in zip(lists, kept, strict=True) if good])]
    middle_m = np.column_stack([np.bincount(owner, inside_m[:, axis]) for axis in range(3)]) / counts[:, None]
    beside = inside_m - middle_m[owner]
    moments = np.empty((len(chosen), 3, 3))
    for row in range(3):
        for column in range(3):
            moments[:, row, column] = np.bincount(owner, beside[:, row] * beside[:, column]) / counts
    spread, directions = np.linalg.eigh(moments)
    normal = directions[:, :, 0]
    thick = np.sqrt(np.maximum(spread[:, 0], 0)) > settings.flat * np.sqrt(np.maximum(spread[:, 1], 1e-30))
    tilted = rng.normal(0, settings.tilt, (len(chosen), 3)) + np.array([0.0, 1.0, 0.0])
    normal = np.where(thick[:, None], tilted / np.linalg.norm(tilted, axis=1, keepdims=True), normal)
    normal = np.where(normal[:, 1:2] < 0, -normal, normal)  # the upper side is up
    sideways = rng.normal(size=(len(chosen), 3))  # points that are all in one place have no direction
    along = np.where(thick[:, None], sideways, directions[:, :, 2])
    return middle_m, normal, along, chosen


def _find_ends(
    points_m: NDArray[np.float64],
    middle_m: NDArray[np.float64],
    turn: NDArray[np.float64],
    foot_m: NDArray[np.float64],
    length_m: float,
    settings: FillSettings,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where along its axis each leaf begins, from its middle, and its length.

    Both ends are where the points beside the axis end; where they go on beyond half the usual length on either side,
    they are of other leaves too, and tell nothing. A twig that the axis points at, foot_m (N,) back from the middle, is
    where a shorter leaf begins, as nothing between them was seen; 0 for none.
    """
    half_m = 0.5 * length_m
    begin_m, end_m = np.full(len(middle_m), -half_m), np.full(len(middle_m), half_m)
    tree = cKDTree(points_m)
    away_m = np.asarray(tree.query(points_m, [2])[0])  # infinite of a single point
    apart_m = float(np.median(away_m)) if len(away_m) else np.inf
    if settings.shortest < 1 and apart_m <= 0.5 * settings.gap * length_m:
        lists = tree.query_ball_point(middle_m, np.hypot(half_m, settings.wide * length_m))
        for leaf, inside in enumerate(lists):
            across, along, above = (points_m[inside] - middle_m[leaf]).dot(turn[leaf]).T
            beside = (abs(across) <= settings.wide * length_m) & (abs(above) <= 0.5 * settings.wide * length_m)
            along = np.sort(along[beside & (abs(along) <= half_m)])
            begin_m[leaf] = -_reach(-along[along <= 0][::-1], settings.gap * length_m)
            end_m[leaf] = _reach(along[along > 0], settings.gap * length_m)
        grown = (foot_m > 0) & (foot_m <= half_m)
        begin_m[grown] = -foot_m[grown]
    own_m = np.clip(end_m - begin_m, settings.shortest * length_m, length_m)
    return 0.5 * (begin_m + end_m - own_m), own_m


def _reach(along_m: NDArray[np.float64], gap_m: float) -> float:
    """How far points that are sorted from 0 outwards go on without a gap."""
    if not len(along_m):
        return 0.0
    steps = np.diff(along_m, prepend=0.0) > gap_m
    last = int(np.argmax(steps)) if steps.any() else len(along_m)
    return float(along_m[last - 1]) if last else 0.0


def _in_plane(vectors: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors - (vectors * normal).sum(axis=1, keepdims=True) * normal)
