"""Ground under a plant: a thin wide layer at the bottom of its cloud."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_TURNS = 20  # of reweighting
STEEPEST = 0.6  # rise of a ground that a plant is captured on


@dataclass(frozen=True, kw_only=True)
class GroundSettings:
    """What is taken for ground."""

    cell_of_extent: float = 0.02  # of the larger horizontal side, width of a cell whose lowest point counts
    layer_of_height: float = 0.012  # of the plant, thickness of the layer above and below the plane
    min_layer_m: float = 0.02
    min_cells: int = 16  # that lie on the plane, without which there is none
    max_below: float = 0.003  # share of all points that may be lower still
    dominance: float = 2.0  # points in the layer for one in an equal layer above it

    def __post_init__(self) -> None:
        if not (0 < self.cell_of_extent < 1 and self.layer_of_height > 0 and self.min_cells >= 3):
            raise ValueError(f"shares must be above 0 and min_cells at least 3, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Ground:
    """Which points are ground, and the plane that they lie on."""

    points: NDArray[np.bool_]  # (N,)
    plane: NDArray[np.float64] | None  # (3,), y = plane . (x, z, 1); None where there is no ground


def no_ground(points_m: NDArray[np.float64]) -> Ground:
    """The ground of a cloud (N, 3) that has none."""
    return Ground(points=np.zeros(len(points_m), bool), plane=None)


def find_ground(points_m: NDArray[np.float64], settings: GroundSettings = GroundSettings()) -> Ground:
    """Find the ground of a cloud, if it has any; a plant that was cut out has none.

    Args:
        points_m: (N, 3), Y up.
        settings: What is ground.
    """
    nothing = no_ground(points_m)
    low_m, extent_m = points_m.min(axis=0), np.ptp(points_m, axis=0)
    cell_m = settings.cell_of_extent * max(extent_m[0], extent_m[2])
    if not cell_m > 0:
        return nothing
    cell = np.floor((points_m[:, [0, 2]] - low_m[[0, 2]]) / cell_m).astype(np.int64)
    key = cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    order = np.lexsort((points_m[:, 1], key))
    lowest = order[np.concatenate([[True], key[order][1:] != key[order][:-1]])]
    layer_m = max(settings.layer_of_height * extent_m[1], settings.min_layer_m)
    plane = _fit_low_plane(points_m[lowest], layer_m)
    above_m = points_m[:, 1] - ground_height(plane, points_m)
    lying = np.abs(above_m[lowest]) < layer_m
    on_plane = lowest[lying]
    if len(on_plane) < settings.min_cells or np.hypot(plane[0], plane[1]) > STEEPEST:
        return nothing
    # Of a trunk that was cut out, cells side by side lie at one height as well, but so does what is above them.
    ground_cells = np.isin(key, key[on_plane])
    within = int((ground_cells & (np.abs(above_m) < layer_m)).sum())
    over = int((ground_cells & (above_m >= layer_m) & (above_m < 3 * layer_m)).sum())
    # The underside of a crown is flat as well, but its trunk stands below it.
    below = int((above_m < -layer_m).sum())
    if within < settings.dominance * max(over, 1) or below > settings.max_below * len(points_m):
        return nothing
    return Ground(points=above_m < layer_m, plane=plane)


def _fit_low_plane(points_m: NDArray[np.float64], layer_m: float) -> NDArray[np.float64]:
    """(3,) plane through the low ones of points (N, 3): what is above it counts less in turns, what is below counts."""
    middle_m = points_m[:, [0, 2]].mean(axis=0)  # far from the origin the normal equations lose digits
    design = np.column_stack([points_m[:, [0, 2]] - middle_m, np.ones(len(points_m))])
    plane = np.array([0.0, 0.0, np.quantile(points_m[:, 1], 0.05)])
    reach_m = max(0.25 * float(np.ptp(points_m[:, 1])), 2 * layer_m)
    for _ in range(_TURNS):
        above_m = points_m[:, 1] - design @ plane
        weight = 1 / (1 + np.square(np.where(above_m > 0, above_m, 0.3 * above_m) / reach_m)) ** 2
        weighted = design * weight[:, None]
        plane = np.linalg.lstsq(weighted.T @ design + 1e-9 * np.eye(3), weighted.T @ points_m[:, 1], rcond=None)[0]
        reach_m = max(0.6 * reach_m, layer_m)
    plane[2] -= plane[:2] @ middle_m
    return plane


def ground_height(plane: NDArray[np.float64], points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) height of the plane (3,) of a Ground under or above points (N, 3)."""
    return np.asarray(points_m[:, 0] * plane[0] + points_m[:, 2] * plane[1] + plane[2])
