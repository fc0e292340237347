"""Where in a photograph the plant is, by depth and by what the cloud's points are of. Our own."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from usdfoliage.geometry.pinhole import Pinhole

_PAD = 3  # cells around the plant's points
_LEVELS = 16  # of each colour
_UNSEEN = 1e-4  # share of a kind's pixels that every colour has from the start


@dataclass(frozen=True, kw_only=True)
class PlantMaskSettings:
    """How masks are drawn."""

    max_cells: int = 6_000_000  # of the grid that holds the plant
    near_cells: float = 2.5  # up to which the nearest point decides what an empty cell is of
    reach: float = 0.02  # of the longer side: how far from known pixels others are drawn
    speck: float = 2e-5  # of the photograph's pixels: smaller pieces of either kind are none
    min_odds: float = 0.2  # of a colour among the plant's to the others', below which a pixel without depth is none
    sure_px: int = 1  # by which what depth shows of the plant is shrunk before its outline is drawn

    def __post_init__(self) -> None:
        if self.max_cells < 1000 or not (self.near_cells > 0 and 0 < self.reach < 1 and 0 <= self.speck < 1):
            raise ValueError(f"max_cells must be at least 1000, near_cells, reach and speck above 0, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantGrid:
    """What space around a plant is of, in cells."""

    of_plant: NDArray[np.bool_]  # (X, Y, Z)
    corner_m: NDArray[np.float64]  # (3,)
    cell_m: float

    def holds(self, points_m: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(N,) whether points (N, 3) are of the plant."""
        place = np.floor((points_m - self.corner_m) / self.cell_m)
        inside = np.all((place >= 0) & (place < np.array(self.of_plant.shape)), axis=1)
        x, y, z = np.where(inside[:, None], place, 0).astype(np.intp).T
        return np.asarray(inside & self.of_plant[x, y, z])


def make_plant_grid(
    points_m: NDArray[np.float64], plant: NDArray[np.bool_], settings: PlantMaskSettings = PlantMaskSettings()
) -> PlantGrid:
    """A grid that distinguishes the plant's space from that of other points.

    Args:
        points_m: (N, 3).
        plant: (N,), which are of the plant.
        settings: How fine the grid is.

    Raises:
        ValueError: No point is of the plant.
    """
    if not plant.any():
        raise ValueError("none of the points is of the plant")
    own_m = points_m[plant]
    low_m, high_m = own_m.min(axis=0), own_m.max(axis=0)
    span_m = np.maximum(high_m - low_m, 1e-3 * max(float((high_m - low_m).max()), 1e-9))
    cell_m = float(np.cbrt(np.prod(span_m) / settings.max_cells))
    while np.prod(np.ceil(span_m / cell_m) + 2 * _PAD) > settings.max_cells:
        cell_m *= 1.05
    corner_m = low_m - _PAD * cell_m
    shape = tuple((np.ceil(span_m / cell_m) + 2 * _PAD).astype(int))
    votes = np.zeros(shape, np.int32)  # for the plant, or against it
    for chosen, vote in ((plant, 1), (~plant, -1)):
        place = np.floor((points_m[chosen] - corner_m) / cell_m)
        inside = ((place >= 0) & (place < shape)).all(axis=1)
        key = np.ravel_multi_index(place[inside].astype(np.intp).T, shape)
        votes += vote * np.bincount(key, minlength=votes.size).reshape(shape).astype(np.int32)
    # Depth has noise, and thin parts were seen by few.
    away, nearest = distance_transform_edt(votes == 0, return_indices=True)
    return PlantGrid(
        of_plant=np.asarray((votes[tuple(nearest)] > 0) & (away <= settings.near_cells)),
        corner_m=corner_m,
        cell_m=cell_m,
    )


def draw_plant_mask(
    srgb: NDArray[np.uint8],
    points_m: NDArray[np.floating],
    grid: PlantGrid,
    expected: NDArray[np.bool_],
    settings: PlantMaskSettings = PlantMaskSettings(),
) -> NDArray[np.bool_]:
    """(H, W) where a photograph shows the plant.

    Pixels with depth are what the cloud is there. Others are of the plant if points of it are expected there and their
    colours are not rather those beside it. What is left takes part with what it looks like up to an edge, if depth is
    known near it, and is none of the plant if not.

    Args:
        srgb: (H, W, 3), encoded for display.
        points_m: (H, W, 3), where each pixel's surface is, in the grid's frame; NaN without depth.
        grid: What is of the plant.
        expected: (H, W), where points of the plant would be seen if nothing stood before them.
        settings: How outlines are drawn.

    Source:
        F. Meyer, Color image segmentation, 1992 (the watershed from markers, as in OpenCV).
    """
    height, width = srgb.shape[:2]
    known = np.isfinite(points_m[..., 0])
    plant = np.zeros((height, width), bool)
    plant[known] = grid.holds(points_m[known])
    min_px = max(int(settings.speck * height * width), 4)
    plant = _drop_specks(plant, min_px)
    other = _drop_specks(known & ~plant, min_px)
    if not (plant.any() or (expected & ~known).any()):
        return plant
    reach_px = settings.reach * max(height, width)
    beside = other | (cv2.distanceTransform((~(plant | other | expected)).astype(np.uint8), cv2.DIST_L2, 3) > reach_px)
    unlike = ~known & (
        _color_odds(srgb, plant if plant.any() else expected, beside) < settings.min_odds
    )  # sky has no depth, but a colour
    plant |= _drop_specks(expected & ~known & ~unlike, min_px)
    markers = np.zeros((height, width), np.int32)
    kernel = np.ones((2 * settings.sure_px + 1,) * 2, np.uint8)
    # Depth is coarse at outlines: what is uncertain there is left to the edges of the photograph.
    markers[~plant & (cv2.erode((beside | unlike).astype(np.uint8), kernel) > 0)] = 1
    inner = cv2.erode(plant.astype(np.uint8), kernel) > 0
    markers[inner | (plant & ~_grown(inner, settings.sure_px))] = 2  # thin parts stay
    cv2.watershed(np.ascontiguousarray(srgb), markers)
    drawn = markers == 2
    line = markers < 0  # between the two: of the plant where depth shows it
    drawn[line] = plant[line]
    return _drop_specks(drawn, min_px)


def _color_odds(srgb: NDArray[np.uint8], plant: NDArray[np.bool_], other: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(H, W) how much more often a pixel's colour is found in the plant than beside it; 1 where nothing is beside."""
    if not other.any():
        return np.ones(plant.shape)
    level = (srgb // (256 // _LEVELS)).astype(np.int64)
    key = (level[..., 0] * _LEVELS + level[..., 1]) * _LEVELS + level[..., 2]
    own, beside = (
        gaussian_filter(np.bincount(key[kind], minlength=_LEVELS**3).reshape((_LEVELS,) * 3) / kind.sum(), 0.7).ravel()
        + _UNSEEN
        for kind in (plant, other)
    )
    return np.asarray((own / beside)[key])


def _grown(mask: NDArray[np.bool_], px: int) -> NDArray[np.bool_]:
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((2 * px + 1,) * 2, np.uint8)) > 0)


def _drop_specks(mask: NDArray[np.bool_], min_px: int) -> NDArray[np.bool_]:
    """The mask without pieces of fewer pixels."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    kept = stats[:, cv2.CC_STAT_AREA] >= min_px
    kept[0] = False
    return np.asarray(kept[labels])


def expect_plant(camera: Pinhole, points_m: NDArray[np.float64], apart_m: float) -> NDArray[np.bool_]:
    """(H, W) where a camera would see points (N, 3) of the plant, each as wide as they are apart."""
    places, depth_m = camera.project(points_m)
    with np.errstate(invalid="ignore"):
        inside = ((places >= 0) & (places < (camera.width_px, camera.height_px))).all(axis=1) & (depth_m > 0)
    expected = np.zeros((camera.height_px, camera.width_px), np.uint8)
    if not inside.any():
        return expected > 0
    column, row = places[inside].astype(np.intp).T
    expected[row, column] = 1
    side = int(np.ceil(apart_m * camera.focal_px[0] / float(np.median(depth_m[inside])))) | 1
    return np.asarray(cv2.morphologyEx(expected, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8)) > 0)
