"""Leaves at the points of a cloud that are of leaves, but in which no single leaf was recognised.

Every place gets one leaf: in the plane that the points around it lie in, pointing away from the branch that it grows
on, of the median length. Where the points end sooner on both sides they are the leaf: it begins and ends with them,
and a slim one points where they do. Our own idea: the leaves of a plant seen from afar are known by where they are.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, kw_only=True)
class FillSettings:
    """How closely leaves stand, and what decides how they lie. Lengths are in those of a leaf."""

    apart: float = 0.5  # middles of leaves at least: a leaf's own points are no place for another
    around: float = 0.35  # of a leaf's middle, points that its plane is fitted to
    min_points: int = 4  # around it: fewer are no leaf
    flat: float = 0.5  # spread across the plane over that along it, above which it is no plane
    slim: float = 0.35  # spread across the longest direction over that along it, below which it is the leaf's own
    tilt: float = 0.7  # of a leaf there, from level: standard deviation of its normal's parts, whose upward one is 1
    wide: float = 0.25  # from a leaf's axis, and half of that from its plane, points that its length is measured from
    gap: float = 0.1  # between points along the axis, where they end; points half as far apart as that mark no end
    unseen: float = 0.25  # between where they end and a twig there, at which the leaf begins then
    shortest: float = 0.3  # of leaves whose points end sooner; 1: all have the median length
    farthest: float = 3.5  # from what leaves grow from: beyond it are no leaves of the plant
    max_leaves: int = 200_000

    def __post_init__(self) -> None:
        above = (self.apart, self.around, self.flat, self.slim, self.wide, self.gap, self.farthest)
        if not (min(above) > 0 and min(self.tilt, self.unseen) >= 0):
            raise ValueError(
                "apart, around, flat, slim, wide, gap and farthest must be above 0, tilt and unseen not below it, "
                f"not {self}"
            )
        if not 0 < self.shortest <= 1:
            raise ValueError(f"shortest must be above 0 and at most 1, not {self.shortest}")
        if self.min_points < 3 or self.max_leaves < 1:
            raise ValueError(f"min_points must be at least 3, max_leaves at least 1, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class FilledPlaces:
    """Where leaves were put."""

    base_m: NDArray[np.float64]  # (N, 3)
    orientation: NDArray[np.float64]  # (N, 4), unit quaternions (x, y, z, w), from leaf space
    length_m: NDArray[np.float64]  # (N,), at most the median one
    width_m: NDArray[np.float64]  # (N,), of slim ones, measured from their points; not a number: the median one
    point: NDArray[np.int64]  # (N,), of the cloud, amid each leaf


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pieces:
    """The points around each place, as they lie."""

    point: NDArray[np.int64]  # (N,), the place, of the cloud
    middle_m: NDArray[np.float64]  # (N, 3)
    normal: NDArray[np.float64]  # (N, 3), unit, the upper side
    along: NDArray[np.float64]  # (N, 3), the longest direction, either way
    is_slim: NDArray[np.bool_]  # (N,)

    def take(self, kept: NDArray[np.generic]) -> "_Pieces":
        return replace(self, **{field.name: getattr(self, field.name)[kept] for field in fields(self)})


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
        length_m: Of a median leaf, which is the longest.
        rng: Of the order in which places are tried.
        settings: How closely.
        plant_m: (P, 3), all points of the plant, which show where a leaf ends better than those that are surely of
            leaves; None: points_m.

    Raises:
        ValueError: The length is not above 0, or there is nothing that leaves grow from.
    """
    if not (np.isfinite(length_m) and length_m > 0):
        raise ValueError(f"length_m must be above 0, not {length_m}")
    if not len(origins_m):
        raise ValueError("leaves grow from at least one place")
    plant_m = points_m if plant_m is None else plant_m
    chosen = _thin_out(points_m, settings.apart * length_m, rng)
    pieces = _fit_planes(points_m, chosen, settings.around * length_m, settings, rng)
    origins = cKDTree(origins_m)
    away_m = np.asarray(origins.query(pieces.middle_m)[0])
    # A slim piece around a twig is the twig itself.
    kept = (away_m <= settings.farthest * length_m) & ~(pieces.is_slim & (away_m <= 0.1 * length_m))
    pieces = pieces.take(kept)
    if len(pieces.point) > settings.max_leaves:
        pieces = pieces.take(np.sort(rng.choice(len(pieces.point), settings.max_leaves, replace=False)))
    if not len(pieces.point):
        none = np.zeros(0)
        return FilledPlaces(
            base_m=np.zeros((0, 3)), orientation=np.zeros((0, 4)), length_m=none, width_m=none, point=pieces.point
        )
    axis = _find_axes(pieces, origins, 0.1 * length_m)
    turn = np.stack([np.cross(axis, pieces.normal), axis, pieces.normal], axis=-1)
    foot_m = _find_feet(pieces.middle_m, axis, origins, length_m, settings)
    begin_m, own_m, width_m = _find_ends(plant_m, pieces.middle_m, turn, foot_m, length_m, settings)
    base_m = pieces.middle_m + begin_m[:, None] * axis
    is_measured = pieces.is_slim | (own_m < length_m)
    once = _drop_repeated(base_m + 0.5 * own_m[:, None] * axis, axis, is_measured, 0.25 * length_m)
    return FilledPlaces(
        base_m=base_m[once],
        orientation=Rotation.from_matrix(turn[once]).as_quat(canonical=True),
        length_m=own_m[once],
        width_m=np.where(pieces.is_slim, width_m, np.nan)[once],
        point=pieces.point[once],
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
) -> _Pieces:
    """The points around each of those chosen that has enough of them."""
    found = cKDTree(points_m).query_ball_point(points_m[chosen], around_m) if len(chosen) else []
    lists: list[list[int]] = list(found)  # type: ignore[arg-type]  # its stubs know of one place alone
    counts = np.array([len(each) for each in lists], np.int64)
    kept = counts >= settings.min_points
    chosen, counts = chosen[kept], counts[kept]
    if not len(chosen):
        none = np.zeros((0, 3))
        return _Pieces(point=chosen, middle_m=none, normal=none, along=none, is_slim=np.zeros(0, bool))
    owner = np.repeat(np.arange(len(chosen)), counts)
    inside_m = points_m[np.concatenate([each for each, good in zip(lists, kept, strict=True) if good])]
    middle_m = np.column_stack([np.bincount(owner, inside_m[:, axis]) for axis in range(3)]) / counts[:, None]
    beside = inside_m - middle_m[owner]
    moments = np.empty((len(chosen), 3, 3))
    for row in range(3):
        for column in range(3):
            moments[:, row, column] = np.bincount(owner, beside[:, row] * beside[:, column]) / counts
    squares, directions = np.linalg.eigh(moments)
    spread = np.sqrt(np.maximum(squares, 0))
    slim = spread[:, 1] < settings.slim * spread[:, 2]
    thick = spread[:, 0] > settings.flat * np.maximum(spread[:, 1], 1e-15)
    tilted = rng.normal(0, settings.tilt, (len(chosen), 3)) + np.array([0.0, 1.0, 0.0])
    sideways = rng.normal(size=(len(chosen), 3))  # points that are all in one place have no direction
    along = np.where((thick & ~slim)[:, None], sideways, directions[:, :, 2])
    tilted = np.where(slim[:, None], _in_plane(tilted, along), tilted)  # about its own direction
    normal = np.where(thick[:, None], tilted, directions[:, :, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(normal[:, 1:2] < 0, -normal, normal)  # the upper side is up
    return _Pieces(point=chosen, middle_m=middle_m, normal=normal, along=along, is_slim=slim)


def _find_axes(pieces: _Pieces, origins: cKDTree, short_m: float) -> NDArray[np.float64]:
    """(N, 3), unit: in the plane of each piece, away from what is nearest of origins, or as a slim piece goes."""
    away = pieces.middle_m - origins.data[origins.query(pieces.middle_m)[1]]
    axis = _in_plane(away, pieces.normal)
    # Where a leaf stands right over its twig its points show its direction.
    own = pieces.is_slim | (np.linalg.norm(axis, axis=1) < short_m)
    along = _in_plane(pieces.along, pieces.normal)
    along = np.where(((along * away).sum(axis=1) < 0)[:, None], -along, along)
    axis = np.where(own[:, None], along, axis)
    return np.asarray(axis / np.linalg.norm(axis, axis=1, keepdims=True))


def _find_feet(
    middle_m: NDArray[np.float64],
    axis: NDArray[np.float64],
    origins: cKDTree,
    length_m: float,
    settings: FillSettings,
) -> NDArray[np.float64]:
    """(N,), how far back from the middle the axis meets what leaves grow from; infinite where it meets none."""
    feet_m = np.full(len(middle_m), np.inf)
    for leaf, near in enumerate(origins.query_ball_point(middle_m, length_m)):
        back = middle_m[leaf] - origins.data[near]
        foot_m = back @ axis[leaf]
        aside_m = np.linalg.norm(back - foot_m[:, None] * axis[leaf], axis=1)
        met = (aside_m <= 0.5 * settings.wide * length_m) & (foot_m > 0.1 * length_m)
        if met.any():
            feet_m[leaf] = foot_m[met][np.argmin(aside_m[met])]
    return feet_m


def _find_ends(
    plant_m: NDArray[np.float64],
    middle_m: NDArray[np.float64],
    turn: NDArray[np.float64],
    foot_m: NDArray[np.float64],
    length_m: float,
    settings: FillSettings,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Where along its axis each leaf begins, from its middle, its length, and its width.

    Both ends are where the points beside the axis end, or the leaf begins at its foot. Where they go on for more than
    a median length they are of other leaves too, and do not count.
    """
    begin_m, own_m = np.full(len(middle_m), -0.5 * length_m), np.full(len(middle_m), length_m)
    width_m = np.full(len(middle_m), np.nan)
    tree = cKDTree(plant_m)
    away_m = np.asarray(tree.query(plant_m, [2])[0])  # infinite of a single point
    apart_m = float(np.median(away_m)) if len(away_m) else np.inf
    if settings.shortest == 1 or apart_m > 0.5 * settings.gap * length_m:
        return begin_m, own_m, width_m
    for leaf, inside in enumerate(tree.query_ball_point(middle_m, np.hypot(length_m, settings.wide * length_m))):
        across, along, above = (plant_m[inside] - middle_m[leaf]).dot(turn[leaf]).T
        beside = (abs(across) <= settings.wide * length_m) & (abs(above) <= 0.5 * settings.wide * length_m)
        across, along = across[beside], along[beside]
        back_m = min(_reach(-along[along <= 0], settings.gap * length_m), foot_m[leaf])
        ahead_m = _reach(along[along > 0], settings.gap * length_m)
        if foot_m[leaf] - back_m <= settings.unseen * length_m and foot_m[leaf] + ahead_m <= length_m:
            back_m = foot_m[leaf]
        if back_m + ahead_m < length_m:
            own_m[leaf] = max(back_m + ahead_m, settings.shortest * length_m)
            begin_m[leaf] = 0.5 * (ahead_m - back_m - own_m[leaf])
        else:  # it stays on its points
            begin_m[leaf] = np.clip(begin_m[leaf], -back_m, ahead_m - length_m)
        outer = (along - begin_m[leaf]) / own_m[leaf]
        beside = (outer > 0.5) & (outer < 1)  # beside its base are points of its twig
        if beside.any():
            aside_m = abs(across[beside])
            width_m[leaf] = 2 * np.quantile(aside_m[aside_m <= max(_reach(aside_m, 3 * apart_m), aside_m.min())], 0.9)
    return begin_m, own_m, width_m


def _reach(along_m: NDArray[np.float64], gap_m: float) -> float:
    """How far points go on without a gap, from 0 outwards."""
    along_m = np.sort(along_m)
    if not len(along_m):
        return 0.0
    steps = np.diff(along_m, prepend=0.0) > gap_m
    last = int(np.argmax(steps)) if steps.any() else len(along_m)
    return float(along_m[last - 1]) if last else 0.0


def _drop_repeated(
    center_m: NDArray[np.float64], axis: NDArray[np.float64], is_measured: NDArray[np.bool_], near_m: float
) -> NDArray[np.int64]:
    """The leaves without those that are one of the others again: their points have one centre, along one axis."""
    dropped = np.zeros(len(center_m), bool)
    for first, second in sorted(cKDTree(center_m).query_pairs(near_m)):
        if not dropped[first] and is_measured[first] and is_measured[second]:
            dropped[second] |= abs(axis[first] @ axis[second]) > np.sqrt(0.5)
    return np.flatnonzero(~dropped)


def _in_plane(vectors: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """What is left of vectors (N, 3) without their parts along normal (N, 3), which is a unit one."""
    return np.asarray(vectors - (vectors * normal).sum(axis=1, keepdims=True) * normal)
