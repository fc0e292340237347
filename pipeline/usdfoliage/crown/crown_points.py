"""Which points of a plant are its crown, and the centre that the crown is seen from. Our own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import grey_opening
from scipy.spatial import cKDTree

from usdfoliage.errors import FitError
from usdfoliage.geometry.cubemap import face_coordinates
from usdfoliage.geometry.point_cells import touching_parts

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CrownPointSettings:
    """What is crown and what is trunk, and what is neither."""

    min_points: int = 100
    slices: int = 64  # of the plant's height
    trunk_width: float = 0.3  # of the crown's width, below which a slice shows a trunk
    trunk_slices: int = 3  # that follow each other: a crown has narrow places between its branches
    min_trunk: float = 0.06  # of the plant's height, below which what is narrow is the crown's own lower end
    layer_slices: int = 5  # what is wide over fewer of them is a layer on the ground and no crown
    farthest: float = 1.3  # of the crown's reach from its axis, beyond which points are not of the plant
    gap: float = 0.05  # of the plant's height: parts that are farther from each other are apart
    min_part: float = 0.02  # of the points of the largest part, that others must have
    outlier_neighbors: int = 8
    outlier_distance: float = 5.0  # median distances to that neighbour, beyond which a point stands alone
    flat: float = 0.02  # third spread over the second, below which points are a plane and have no inside
    center_faces: int = 16  # texels a side of the cubemap on which centres are compared
    center_gain: float = 0.03  # of the volume, that a centre must save to be better than the middle

    def __post_init__(self) -> None:
        if min(self.trunk_slices, self.layer_slices, self.outlier_neighbors, self.center_faces) < 1:
            raise ValueError(f"counts must be 1 or more, not {self}")
        if self.min_points < 4 or self.slices < 4 * self.layer_slices:
            raise ValueError(f"min_points >= 4 and slices >= 4 layer_slices are needed, not {self}")
        if not (0 < self.trunk_width < 1 and self.gap > 0 and self.farthest >= 1 and 0 <= self.flat < 1):
            raise ValueError(f"trunk_width in (0, 1), gap > 0, farthest >= 1, flat in [0, 1) are needed, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownPoints:
    """The points of a crown."""

    chosen: NDArray[np.bool_]  # (N,), of the plant's points
    base_m: float  # height of the crown's lowest part
    outliers: int  # points that stand alone, or far from the crown, and were left out


def choose_crown_points(
    points_m: Array,
    settings: CrownPointSettings = CrownPointSettings(),
    foliage: NDArray[np.bool_] | None = None,
) -> CrownPoints:
    """The points of a plant (N, 3), Y up and without ground, that are above the base of its crown.

    From its widest part the crown goes down to where the plant is a trunk, or ends. With foliage (N,) the crown is
    made of leaves alone: they are its outside, and what is no leaf may be a wall or a pot.

    Raises:
        FitError: Too few points, or they lie in a plane.
    """
    if len(points_m) < settings.min_points:
        raise FitError(f"{len(points_m)} points of the plant, {settings.min_points} needed for a crown")
    plant = ~_stand_alone(points_m, settings)
    outliers = int((~plant).sum())
    if foliage is not None and (plant & foliage).sum() >= settings.min_points:
        plant &= foliage
    base_m, near = _find_base(points_m[plant], settings)
    chosen = np.zeros(len(points_m), bool)
    chosen[np.flatnonzero(plant)[near]] = True
    chosen &= points_m[:, 1] >= base_m
    if chosen.sum() >= settings.min_points:
        part = _main_parts(points_m[chosen], settings)
        outliers += int((~part).sum())
        chosen[np.flatnonzero(chosen)[~part]] = False
    if chosen.sum() < settings.min_points:
        raise FitError(f"{int(chosen.sum())} points above the crown's base, {settings.min_points} needed")
    _refuse_plane(points_m[chosen], settings.flat)
    return CrownPoints(chosen=chosen, base_m=max(base_m, float(points_m[chosen, 1].min())), outliers=outliers)


def _refuse_plane(points_m: Array, flat: float) -> None:
    """FitError for points (N, 3) without depth, as of a wall or of one leaf."""
    spread_m = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False) / np.sqrt(len(points_m))
    if spread_m[2] < flat * spread_m[1]:
        raise FitError(
            f"the {len(points_m):,} points of the crown lie in a plane: they spread {spread_m[2]:.3g} m across it, and "
            f"{flat * spread_m[1]:.3g} m are needed for {spread_m[1]:.3g} m along it",
            "give a cloud of the plant from all sides, without walls, and check its axes",
        )


def _stand_alone(points_m: Array, settings: CrownPointSettings) -> NDArray[np.bool_]:
    """(N,) points whose neighbours are much farther away than the median."""
    k = min(settings.outlier_neighbors + 1, len(points_m))
    away_m = np.asarray(cKDTree(points_m).query(points_m, k=[k], workers=-1)[0])[:, 0]
    return np.asarray(away_m > settings.outlier_distance * np.median(away_m))


def _main_parts(points_m: Array, settings: CrownPointSettings) -> NDArray[np.bool_]:
    """(N,) points of the largest part, and of others that are large enough to be boughs of their own."""
    piece = touching_parts(points_m, settings.gap * float(np.ptp(points_m[:, 1])))
    counts = np.bincount(piece)
    return np.asarray((counts >= settings.min_part * counts.max())[piece])


def _find_base(points_m: Array, settings: CrownPointSettings) -> tuple[float, NDArray[np.bool_]]:
    """Height of the lowest slice of the crown, and which points (N,) are near enough to its axis."""
    y_m = points_m[:, 1]
    low_m, high_m = np.quantile(y_m, [0.002, 0.998])
    step_m = (high_m - low_m) / settings.slices
    if not step_m > 0:
        return float(low_m), np.ones(len(points_m), bool)
    number = np.clip(np.floor((y_m - low_m) / step_m), 0, settings.slices - 1).astype(np.int64)
    width_m, reach_m = np.zeros((2, settings.slices))
    for one in range(settings.slices):
        inside = points_m[number == one][:, [0, 2]]
        if len(inside) >= 3:
            away_m = np.linalg.norm(inside - np.median(inside, axis=0), axis=1)
            # Of a slice with a trunk and a few twigs most is trunk.
            width_m[one], reach_m[one] = np.quantile(away_m, [0.8, 0.99])
    # A layer on the ground is wide and thin: opened, it is gone.
    thick_m, far_m = (np.asarray(grey_opening(each, size=(settings.layer_slices,))) for each in (width_m, reach_m))
    wide = thick_m >= settings.trunk_width * np.quantile(thick_m, 0.9)
    base = int(thick_m.argmax())
    narrow = 0
    for one in range(base, -1, -1):
        narrow = 0 if wide[one] else narrow + 1
        if narrow == settings.trunk_slices:
            break
        if wide[one]:
            base = one
    axis_m = np.median(points_m[number >= base][:, [0, 2]], axis=0)
    near = np.linalg.norm(points_m[:, [0, 2]] - axis_m, axis=1) <= settings.farthest * far_m.max()
    if base < settings.min_trunk * settings.slices:
        return float(y_m[near].min(initial=high_m)), near
    return float(low_m + base * step_m), near


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownCenter:
    """Where a crown is seen from."""

    center_m: Array  # (3,)
    filled: float  # volume of the least star-shaped body that holds the points, of that about the worst centre tried
    tried: int


def find_crown_center(points_m: Array, settings: CrownPointSettings = CrownPointSettings()) -> CrownCenter:
    """The centre about which the crown of points (N, 3) is nearest to star-shaped.

    What is star-shaped about a centre and holds all points is the larger the more of it is empty. Of the places between
    the middle of the crown's bounds and the median of its points, higher and lower, the one is taken whose body is
    smallest and deep enough all around, the one nearest to the middle where several are as good.
    """
    low_m, high_m = np.quantile(points_m, [0.01, 0.99], axis=0)
    middle_m, median_m = (low_m + high_m) / 2, np.median(points_m, axis=0)
    shell = points_m[:: max(1, len(points_m) // 40_000)]
    candidates = []
    for share in (0.0, 0.5, 1.0):
        for rise in (-0.16, -0.08, 0.0, 0.08, 0.16):
            place = middle_m + share * (median_m - middle_m)
            candidates.append(place + rise * np.array([0.0, high_m[1] - low_m[1], 0.0]))
    volumes, depths = np.array([_star_body(shell, place, settings.center_faces) for place in candidates]).T
    # A centre near the surface has few points on that side, and its body is small for want of them.
    deep = depths >= 0.8 * depths.max()
    good = deep & (volumes <= volumes[deep].min() / (1 - settings.center_gain))
    away_m = np.linalg.norm(np.array(candidates) - middle_m, axis=1)
    best = int(np.where(good, away_m, np.inf).argmin())
    return CrownCenter(
        center_m=np.asarray(candidates[best], np.float64),
        filled=float(volumes[best] / volumes.max()),
        tried=len(candidates),
    )


def _star_body(points_m: Array, center_m: Array, faces: int) -> tuple[float, float]:
    """Volume of the body about a centre that holds the points, in its own unit, and how deep the centre is in it."""
    offset_m = points_m - center_m
    radius_m = np.linalg.norm(offset_m, axis=1)
    offset_m[radius_m < 1e-9] = [1e-9, 0, 0]
    face, row, column = face_coordinates(offset_m, faces + 1)
    cell = (face * faces + np.minimum(row, faces - 1).astype(np.intp)) * faces
    cell += np.minimum(column, faces - 1).astype(np.intp)
    order = np.lexsort((radius_m, cell))
    ends = np.flatnonzero(np.append(np.diff(cell[order]) > 0, True))
    starts = np.append(0, ends[:-1] + 1)
    outermost = radius_m[order][starts + ((ends - starts) * 0.95).astype(np.intp)]
    place = (np.arange(faces) + 0.5) * 2 / faces - 1
    size = (1 + place[:, None] ** 2 + place**2) ** -1.5  # solid angle of a cell
    angle = size.ravel()[cell[order][starts] % (faces * faces)]
    return float((angle * outermost**3).sum() / angle.sum()), float(np.quantile(outermost, 0.05))
