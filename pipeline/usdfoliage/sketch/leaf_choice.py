"""Which leaves of a tree fit its photograph, and the colours that they have there."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from usdfoliage.sketch.bounds import CrownBounds

Floats = NDArray[np.float64]

_ALONG = (0.4, 0.95)  # of a leaf, places that must be over leaves of the picture
_NEIGHBOURS = 8
_PURE = 0.15  # of the pixels of leaves, that are enough for their colours


@dataclass(frozen=True, kw_only=True, eq=False)
class FittingLeaves:
    """Leaves that are over leaves of the picture."""

    kept: NDArray[np.bool_]  # (N,)
    seen: NDArray[np.bool_]  # (N,) on the side of the viewer
    color: Floats  # (N, 3) linear Rec.709


def fit_leaves(
    base: Floats,
    along: Floats,
    length: Floats,
    bounds: CrownBounds,
    linear: NDArray[np.float32],
    mask: NDArray[np.bool_],
    pure: NDArray[np.bool_],
    rng: np.random.Generator,
) -> FittingLeaves:
    """Choose leaves by the picture (section 4), and give each its colour there; behind, that of its neighbours.

    Args:
        base: (N, 3), where leaves begin, in the frame of the picture.
        along: (N, 3), unit, where they point to.
        length: (N,), in pixels.
        bounds: Of the crown.
        linear: (H, W, 3), the photograph.
        mask: (H, W), its pixels that are leaves; colours are those of the nearest one, never of sky in a gap.
        pure: (H, W), those of them in whose colour there is no sky.
        rng: For the hidden side.
    """
    places = [base + share * length[:, None] * along for share in _ALONG]
    kept = np.logical_and.reduce([bounds.shows_leaves(each) for each in places])
    middle = places[0]
    row, column, _ = bounds.rows_and_columns(middle)
    nearest = _nearest_leaf(mask, pure, linear)
    color = linear[nearest[0][row, column], nearest[1][row, column]].astype(np.float64)
    seen = kept & (middle[:, 2] > -0.15 * bounds.half_depth[row, column])
    if seen.any():
        hidden = np.flatnonzero(~seen)
        count = min(_NEIGHBOURS, int(seen.sum()))
        found = np.asarray(cKDTree(middle[seen, :2]).query(middle[hidden, :2], k=count)[1])
        near = found.reshape(len(hidden), count)
        drawn = near[np.arange(len(hidden)), rng.integers(near.shape[1], size=len(hidden))]
        color[hidden] = color[np.flatnonzero(seen)[drawn]]
    return FittingLeaves(kept=kept, seen=seen, color=color)


def _nearest_leaf(mask: NDArray[np.bool_], pure: NDArray[np.bool_], linear: NDArray[np.float32]) -> NDArray[np.int32]:
    """(2, H, W) row and column of the nearest pixel of a leaf that sky neither borders on nor shines through."""
    chosen = mask
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    for purer in (pure, inner, mask & (linear[..., 2] <= linear[..., :2].max(axis=2))):
        chosen = chosen & purer if (chosen & purer).sum() > _PURE * mask.sum() else chosen
    if not chosen.any():
        return np.indices(mask.shape, dtype=np.int32)
    return np.asarray(ndimage.distance_transform_edt(~chosen, return_distances=False, return_indices=True), np.int32)
