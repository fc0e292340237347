"""How long the leaves in a photograph are, by the scale of its texture. Our own.

Leaves lie over each other in any direction, each of about one colour. Two places of the picture are similar as far as
they are on one leaf, so that the correlation of brightness falls with distance as leaves are large. Light and shade of
whole limbs are taken off before.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_LEVEL = 0.4  # correlation, at whose distance leaves are measured
_BLUR_PX = 1.6  # of that distance, which a camera's pixels make,
_LENGTHS = 6.2  # and lengths of the rest, that a leaf half as wide as long has: measured on drawn leaves
_SHADE = 0.1  # of the crown's size: light and shade that are no texture
_REACH = 0.12  # of the crown's size, as far as correlation is looked for
_FEW = 400  # pixels, too few to know


@dataclass(frozen=True, kw_only=True)
class LeafScaleSettings:
    """Which lengths can be."""

    shortest_px: float = 6.0  # shorter leaves are not resolved, and are as this
    longest: float = 0.08  # of the crown's size


def measure_leaf_length(
    srgb: NDArray[np.uint8],
    mask: NDArray[np.bool_],
    size_px: float,
    settings: LeafScaleSettings = LeafScaleSettings(),
) -> float | None:
    """The length of the leaves in pixels; None where the picture shows too few.

    Args:
        srgb: (H, W, 3), the photograph.
        mask: (H, W), where leaves are.
        size_px: Of the crown: the square root of its area.
        settings: Which lengths can be.
    """
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if mask.sum() < _FEW:
        return None
    part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    inside = mask[part].astype(np.float32)
    light = cv2.cvtColor(np.ascontiguousarray(srgb[part]), cv2.COLOR_RGB2GRAY).astype(np.float32)
    sigma = max(2.0, _SHADE * size_px)
    weight = np.maximum(cv2.GaussianBlur(inside, (0, 0), sigma), 1e-6)
    texture = (light - cv2.GaussianBlur(light * inside, (0, 0), sigma) / weight) * inside
    reach = max(4, round(_REACH * size_px))
    correlation = _correlate(texture.astype(np.float64), inside.astype(np.float64), reach)
    if correlation is None:
        return None
    below = np.flatnonzero(correlation < _LEVEL)
    if not len(below):
        distance = float(reach)
    else:
        at = int(below[0])
        before, after = correlation[at - 1], correlation[at]
        distance = at - 1 + float((before - _LEVEL) / max(before - after, 1e-9))
    longest_px = max(settings.longest * size_px, settings.shortest_px)
    return float(np.clip(_LENGTHS * (distance - _BLUR_PX), settings.shortest_px, longest_px))


def _correlate(texture: Floats, inside: Floats, reach: int) -> Floats | None:
    """(reach + 1,) mean correlation of places by their distance in whole pixels; None where nothing differs."""
    shape = [cv2.getOptimalDFTSize(side + reach) for side in texture.shape]
    spectra = [np.fft.rfft2(each, shape) for each in (texture, inside)]
    product, pairs = (np.fft.irfft2(np.abs(each) ** 2, shape) for each in spectra)
    down, right = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    distance = np.rint(np.hypot(down, right)).astype(int)
    near = distance <= reach
    sums, counts = (np.bincount(distance[near], each[down[near], right[near]]) for each in (product, pairs))
    mean = sums / np.maximum(counts, 1.0)
    return np.asarray(mean / mean[0]) if mean[0] > 1e-3 else None
