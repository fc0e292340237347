"""What a plant stands on: a floor, a table, a lawn. Our own.

A photographed floor is not quite a plane, and below a glossy one its reflections are measured too: the lowest points of
a cloud, which show the ground of a scan, are none of it. So the plane is looked for as the fullest thin layer of all
nearly level ones, and the floor follows the plane with a gentle relief.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

_TURNS = 12  # of fitting
_SIGMA_OF_MAD = 1.4826
_RELIEF_CELLS = 256  # along a side, at most
_TALLEST = 10.0  # of the scale, over and under what is aimed at: farther points are errors of depth


@dataclass(frozen=True, kw_only=True)
class SupportSettings:
    """What is taken for a support."""

    steepest_rad: float = 0.30  # of its plane: up is known roughly, and lawns slope
    tilt_step_rad: float = 0.044  # between planes that are tried
    layer: float = 0.012  # of the scale, half the thickness of the layer that must stand out
    reach: float = 2.0  # of the scale, around the focus, within which the plane is looked for
    dominance: float = 2.0  # cells in the layer for one in the fuller of two layers as thick, above it and below
    min_cells: int = 400  # that lie in the layer
    min_width: float = 0.35  # of the scale: square root of the area that the layer covers
    max_below: float = 0.15  # of what is not in the layer but above or below it, the share below
    relief: float = 0.08  # of the scale, width over which the floor may rise and fall
    sigmas: float = 3.5  # of the layer's roughness, above which points are no floor

    def __post_init__(self) -> None:
        if not (0 < self.tilt_step_rad <= self.steepest_rad < np.pi / 4):
            raise ValueError(f"tilt_step_rad and steepest_rad must be above 0 and in order, not {self}")
        if not (self.layer > 0 and self.reach > 0 and self.relief > 0 and self.sigmas > 0 and self.min_cells >= 3):
            raise ValueError(f"layer, reach, relief and sigmas must be above 0, min_cells at least 3, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Support:
    """A floor: a plane with a gentle relief."""

    plane: NDArray[np.float64]  # (3,), y = plane . (x, z, 1)
    relief_m: NDArray[np.float64]  # (H, W), of the floor over its plane, on a grid of x and z
    corner_m: tuple[float, float]  # x and z of the grid's first place
    step_m: float  # between its places
    layer_m: float  # height over the floor up to which points are of it

    def heights(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) how high points (N, 3) are over the floor."""
        over_m = points_m[:, 1] - points_m[:, [0, 2]] @ self.plane[:2] - self.plane[2]
        places = (points_m[:, [0, 2]] - self.corner_m) / self.step_m
        return np.asarray(over_m - map_coordinates(self.relief_m, places.T, order=1, mode="nearest"))


def find_support(
    cells_m: NDArray[np.float64],
    middle_m: NDArray[np.float64],
    scale_m: float,
    settings: SupportSettings = SupportSettings(),
) -> Support | None:
    """The floor of a cloud; None where there is none that stands out.

    Args:
        cells_m: (N, 3), Y up, a point for each cell of a grid, so that what is seen closely does not count more.
        middle_m: (3,), what the photographs are aimed at.
        scale_m: How far from it the cameras are, or how large the cloud is.
        settings: What is a support.
    """
    layer_m = settings.layer * scale_m
    aside_m = np.hypot(cells_m[:, 0] - middle_m[0], cells_m[:, 2] - middle_m[2])
    # One point that is far off must not make layers without end.
    near = (aside_m < settings.reach * scale_m) & (np.abs(cells_m[:, 1] - middle_m[1]) < _TALLEST * scale_m)
    near_m = cells_m[near] - middle_m  # far from the origin sums lose digits
    if len(near_m) < settings.min_cells:
        return None
    plane = _fit_plane(near_m, _find_layer(near_m, layer_m, settings), layer_m)
    over_m = near_m[:, 1] - near_m[:, [0, 2]] @ plane[:2] - plane[2]
    within = np.abs(over_m) < layer_m
    if within.sum() < settings.min_cells or np.hypot(*plane[:2]) > np.tan(settings.steepest_rad):
        return None
    # What stands beside the floor, as walls do, decides nothing about it.
    width_m = 0.05 * scale_m
    place = np.floor(near_m[:, [0, 2]] / width_m).astype(np.int64)
    place -= place.min(axis=0)
    key = place[:, 0] * (int(place[:, 1].max()) + 1) + place[:, 1]
    covered, counts = np.unique(key[within], return_counts=True)
    covered = covered[counts >= max(3, 0.2 * np.median(counts))]
    if np.sqrt(len(covered)) * width_m < settings.min_width * scale_m:
        return None
    over_m = over_m[np.isin(key, covered)]
    inside = int((np.abs(over_m) < layer_m).sum())
    # The next layers hold what the floor is rough by: the rivals are those after them.
    rivals = [int(((side * over_m >= 3 * layer_m) & (side * over_m < 5 * layer_m)).sum()) for side in (1, -1)]
    above, below = int((over_m >= 3 * layer_m).sum()), int((over_m <= -3 * layer_m).sum())
    if inside < settings.dominance * max(rivals) or below > settings.max_below * (above + below):
        return None
    return _follow_relief(cells_m, middle_m, plane, scale_m, settings)


def _find_layer(points_m: NDArray[np.float64], layer_m: float, settings: SupportSettings) -> NDArray[np.float64]:
    """(3,) plane in the middle of the fullest layer among nearly level ones."""
    best = (-1, np.zeros(3))
    rings = np.arange(0, settings.steepest_rad + 1e-9, settings.tilt_step_rad)
    for ring, tilt in enumerate(rings):
        for turn in np.arange(0, 2 * np.pi - 1e-9, 2 * np.pi / max(6 * ring, 1)):
            slope = np.tan(tilt) * np.array([np.cos(turn), np.sin(turn)])
            height_m = points_m[:, 1] - points_m[:, [0, 2]] @ slope
            low_m = float(height_m.min())
            counts = np.bincount(((height_m - low_m) / layer_m).astype(np.int64))
            pair = counts[:-1] + counts[1:] if len(counts) > 1 else counts
            fullest = int(pair.argmax())
            if pair[fullest] > best[0]:
                best = int(pair[fullest]), np.array([*slope, low_m + (fullest + 1) * layer_m])
    return best[1]


def _fit_plane(points_m: NDArray[np.float64], plane: NDArray[np.float64], layer_m: float) -> NDArray[np.float64]:
    """(3,) the plane fitted to points (N, 3) near it, in turns."""
    design = np.column_stack([points_m[:, [0, 2]], np.ones(len(points_m))])
    for turn in range(_TURNS):
        reach_m = layer_m * (3 - 2 * min(turn / (_TURNS / 2), 1))
        over = (points_m[:, 1] - design @ plane) / reach_m
        weight = np.square(np.maximum(1 - np.square(over), 0))  # Tukey's
        weighted = design * weight[:, None]
        if (weight > 0).sum() < 3:
            break
        plane = np.linalg.lstsq(weighted.T @ design, weighted.T @ points_m[:, 1], rcond=None)[0]
    return plane


def _follow_relief(
    cells_m: NDArray[np.float64],
    middle_m: NDArray[np.float64],
    plane: NDArray[np.float64],
    scale_m: float,
    settings: SupportSettings,
) -> Support:
    """The floor along its plane, as far as it is seen: smoothed means of what lies near it."""
    layer_m = settings.layer * scale_m
    plane = np.array([*plane[:2], plane[2] + middle_m[1] - plane[:2] @ middle_m[[0, 2]]])
    over_m = cells_m[:, 1] - cells_m[:, [0, 2]] @ plane[:2] - plane[2]
    near = np.abs(over_m) < 3 * layer_m
    aside_m = np.hypot(cells_m[:, 0] - middle_m[0], cells_m[:, 2] - middle_m[2])
    near &= aside_m < 2 * settings.reach * scale_m
    floor_m, over_m = cells_m[near][:, [0, 2]], over_m[near]
    corner_m, span_m = floor_m.min(axis=0), float(np.ptp(floor_m, axis=0).max())
    step_m = max(settings.relief * scale_m / 4, span_m / _RELIEF_CELLS)
    place = np.rint((floor_m - corner_m) / step_m).astype(np.int64)
    shape = (int(place[:, 0].max()) + 1, int(place[:, 1].max()) + 1)
    key = place[:, 0] * shape[1] + place[:, 1]
    blur = settings.relief * scale_m / step_m
    relief_m = np.zeros(shape)
    for reach_m in (3 * layer_m, 2 * layer_m, 1.5 * layer_m):  # what stands on the floor counts less and less
        apart_m = over_m - relief_m.ravel()[key]
        weight = np.square(np.maximum(1 - np.square(apart_m / reach_m), 0))
        sums, counts = (
            gaussian_filter(
                np.bincount(key, values, minlength=shape[0] * shape[1]).reshape(shape), blur, mode="constant"
            )
            for values in (weight * over_m, weight)
        )
        # Where hardly any floor is seen, it is the plane.
        relief_m = sums / (counts + 0.02 * float(counts.max()))
    apart_m = over_m - relief_m.ravel()[key]
    spread_m = _SIGMA_OF_MAD * float(np.median(np.abs(apart_m[np.abs(apart_m) < 1.5 * layer_m])))
    return Support(
        plane=plane,
        relief_m=relief_m,
        corner_m=(float(corner_m[0]), float(corner_m[1])),
        step_m=step_m,
        layer_m=float(np.clip(settings.sigmas * spread_m, 0.3 * layer_m, 1.5 * layer_m)),
    )
