"""A leaf of the form of a picture of one: its silhouette goes around the picture's, and its texture cuts the leaf out.

A silhouette of three interior points is that of a plain leaf. Around lobes and teeth it goes as a hull does, and the
opacity of the texture leaves out what is between them. The method is our own.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.measures import leaf_area
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.leaf.shape.variation import default_leaf

Floats = NDArray[np.float64]

OPAQUE = 0.5  # from which on there is leaf
_END = 0.03  # of the leaf's length, whose middle is its base or its apex
_BINS = 48  # along the leaf, in which its half width is measured
_SAMPLES = 129  # along the silhouette
_CUT_OFF = 4.0  # how much more it counts where the silhouette would cut the leaf than where there is room beside it
_LOW, _HIGH = (0.02, 0.2, 0.6, 0.0, 0.0, 0.0), (0.4, 0.8, 0.98, 3.0, 3.0, 3.0)  # of v and x of the silhouette's points
_START_V = (0.15, 0.5, 0.85)
_BACK = 8  # halvings of the way from those places, on which a silhouette that folds is taken back
_TEXELS = 512  # along the leaf, at most
_FEWEST = 16
_SPARSEST = 0.05  # cover of a leaf


@dataclass(frozen=True, kw_only=True, eq=False)
class PicturedLeaf:
    """A leaf as its picture has it.

    Attributes:
        parameters: (7, 3), leaf lengths; arched and folded up as default_leaf.
        texture: (h, w, 4), the picture's colours and opacity over st = ((u + 1) / 2, v); the first row is at the apex.
        cover: Share of the leaf's area that is opaque; what is between lobes is not.
    """

    parameters: Floats
    texture: NDArray[np.float32]
    cover: float


def leaf_from_picture(rgba: NDArray[np.floating]) -> PicturedLeaf:
    """A leaf of the form and the colours of a picture.

    Args:
        rgba: (H, W, 4), base below and apex above; opacity in [0, 1], and colours that go on beside the leaf.

    Raises:
        ValueError: rgba is not (H, W, 4), or nothing in it is opaque.
    """
    if rgba.ndim != 3 or rgba.shape[2] != 4:
        raise ValueError(f"a picture must be (H, W, 4), not {rgba.shape}")
    row, column = np.nonzero(rgba[..., 3] >= OPAQUE)
    if not len(row):
        raise ValueError("nothing in the picture of a leaf is opaque")
    picture_from_leaf = _find_frame(row, column)
    places = np.column_stack([column, row]) + 0.5 - picture_from_leaf[:, 2]
    x, v = np.linalg.solve(picture_from_leaf[:, :2], places.T)
    silhouette = _fit_silhouette(x, v)
    parameters = _raise_from_plane(silhouette)
    length_px = float(np.linalg.norm(picture_from_leaf[:, 1]))
    cover = len(row) / (length_px**2 * float(leaf_area(parameters[None])[0]))
    return PicturedLeaf(
        parameters=parameters,
        texture=_unwrap(rgba, parameters, picture_from_leaf),
        cover=float(np.clip(cover, _SPARSEST, 1)),
    )


def _find_frame(row: NDArray[np.intp], column: NDArray[np.intp]) -> Floats:
    """(2, 3) pixels, x and y, of places of the leaf's plane: its base at the lowest pixels, its apex at the highest."""
    low, high = row.max() + 1.0, float(row.min())
    reach = max(1.0, _END * (low - high))
    base = np.array([column[row >= low - reach].mean() + 0.5, low])
    apex = np.array([column[row < high + reach].mean() + 0.5, high])
    along = apex - base
    return np.column_stack([[-along[1], along[0]], along, base])


def _fit_silhouette(x: Floats, v: Floats) -> Floats:
    """(3, 2) v and x of the interior points of a silhouette around places (N,) of a leaf, in leaf lengths."""
    of = np.clip((v * _BINS).astype(int), 0, _BINS - 1)
    half = np.zeros(_BINS)
    np.maximum.at(half, of, np.abs(x))
    at = (np.arange(_BINS) + 0.5) / _BINS
    t = np.linspace(0, 1, _SAMPLES)
    weights = np.column_stack([4 * t * (1 - t) ** 3, 6 * t**2 * (1 - t) ** 2, 4 * t**3 * (1 - t)])

    def room(points: Floats) -> Floats:
        width = np.interp(at, np.maximum.accumulate(weights @ points[:3] + t**4), weights @ points[3:])
        return np.asarray(width - half)

    def cost(points: Floats) -> Floats:
        beside = room(points)
        return np.asarray(np.where(beside < 0, _CUT_OFF, 1.0) * beside)

    start = np.array([*_START_V, *np.full(3, np.clip(1.1 * half.max(), 0.01, 2.9))])
    fitted = np.asarray(least_squares(cost, start, bounds=(_LOW, _HIGH)).x, np.float64)
    return np.column_stack([fitted[:3], np.maximum(fitted[3:], 1e-3)])


def _raise_from_plane(silhouette: Floats) -> Floats:
    """(7, 3) the leaf of a silhouette (3, 2), arched and folded up as default_leaf, and not over itself."""
    default = default_leaf()
    start = np.column_stack([_START_V, silhouette[:, 1]])
    for halvings in range(_BACK + 1):
        points = start + (silhouette - start) * 0.5**halvings
        leaf = default.copy()
        leaf[0, :2], leaf[1, :2] = (0, 1 / 3), (0, 2 / 3)  # along it places are even, as in the picture
        slope = points[:, 1] / default[2:5, 1]
        leaf[2:5] = np.column_stack([points, slope * default[2:5, 2]])
        leaf[5:] = default[5:] * slope
        if not find_folds(leaf[None])[0]:
            break
    return leaf


def _unwrap(rgba: NDArray[np.floating], parameters: Floats, picture_from_leaf: Floats) -> NDArray[np.float32]:
    """(h, w, 4) the picture over st of a leaf; opaque is only what is opaque in the picture."""
    length_px = float(np.linalg.norm(picture_from_leaf[:, 1]))
    rows = int(np.clip(round(length_px), _FEWEST, _TEXELS))
    columns = int(np.clip(round(2 * rows * parameters[2:5, 1].max()), _FEWEST, _TEXELS))
    u, v = 2 * (np.arange(columns) + 0.5) / columns - 1, 1 - (np.arange(rows) + 0.5) / rows
    at = evaluate_points(parameters[None], grid_places(u, v))[0, :, :2].reshape(rows, columns, 2)
    x, y = np.moveaxis(at @ picture_from_leaf[:, :2].T + picture_from_leaf[:, 2] - 0.5, -1, 0).astype(np.float32)
    given = np.ascontiguousarray(rgba, np.float32)
    texture = cv2.remap(given, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    beyond = (x < -0.5) | (y < -0.5) | (x > rgba.shape[1] - 0.5) | (y > rgba.shape[0] - 0.5)
    texture[..., 3][beyond] = 0
    return np.asarray(texture, np.float32)
