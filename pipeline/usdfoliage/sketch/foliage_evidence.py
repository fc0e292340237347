"""Whether pixels that were taken for leaves look like foliage by any measure. Our own.

Among the colours inside of a stroke the best ones count as leaves, so that a stroke over a road has leaves too. Foliage
differs from roads and water by its contrast from leaf to leaf, or by its colour; from walls, fences and bark by edges
of all directions. Of autumn, blossom, grey pictures and bare trees each has one of these, or stands before the sky.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.sketch.drawing import dilate

Floats = NDArray[np.float64]

_SIZE_PX = 220.0  # square root of the area of the box around what is measured, in the picture that it is measured in
_NEAR_PX = 4.0  # of that picture: a few leaves, whose contrast is one
_EDGE_PX = 3.0  # of it, around twigs: their contrast is that to what is behind them
_INNER_PX = 2.0  # of it, to the border of leaves, beside which edges are not those of leaves
_FEWEST = 100  # pixels, of which a measure is one
_DARK = 8.0  # of 255, that is added: in shade noise has contrast
_PLAIN, _COLORED = 0.10, 0.03  # contrast and colour of leaves; of 34 trees none without colour is below .15
_SMOOTH = 0.05  # contrast, below which a colour makes no leaves; the least of those trees is .12
_RULED = 0.16  # edges along two directions; of those trees none is above .11
_WALL = 0.3
_BEFORE_SKY = 0.08  # of what is around leaves, from which on the sky's border has their form; at least .18 of 34 trees


@dataclass(frozen=True, kw_only=True)
class FoliageEvidence:
    """What pixels have of foliage.

    Attributes:
        color: By how much green, or red, exceeds blue, as a share of all; the median.
        contrast: Standard deviation of the logarithm of brightness among a few leaves; the median.
        ruled: 0 where edges have all directions, to 1 where all are along two that are square to each other.
        before_sky: Share of what is around that is sky.
        is_thin: What was measured are twigs or single leaves, whose edges have their directions.
    """

    color: float
    contrast: float
    ruled: float
    before_sky: float
    is_thin: bool = False

    @property
    def is_ruled(self) -> bool:
        """Whether edges are along two directions, as those of walls, fences and bark."""
        return self.ruled > _RULED and not self.is_thin

    @property
    def has_sky(self) -> bool:
        """Whether sky is beside it, as beside a tree that stands before it."""
        return self.before_sky >= _BEFORE_SKY

    @property
    def is_none(self) -> bool:
        """Whether it is foliage by no measure."""
        plain = self.contrast < _PLAIN and self.color < _COLORED
        return not self.has_sky and (plain or (self.ruled > _WALL and not self.is_thin))

    @property
    def is_little(self) -> bool:
        """Whether a measure speaks against foliage."""
        sure = self.color >= _COLORED or self.has_sky
        return self.is_none or self.is_ruled or self.contrast < (_SMOOTH if sure else _PLAIN)

    def __str__(self) -> str:
        """The measures, for a message."""
        return f"contrast {self.contrast:.2f}, colour {self.color:.2f}, ruled {self.ruled:.2f}"


def measure_evidence(
    srgb: NDArray[np.uint8], mask: NDArray[np.bool_], before_sky: float, *, is_thin: bool = False
) -> FoliageEvidence:
    """What pixels of a photograph have of foliage.

    Args:
        srgb: (H, W, 3), the photograph.
        mask: (H, W), what was taken for leaves; not empty.
        before_sky: As FoliageEvidence has it.
        is_thin: Likewise.
    """
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    factor = _SIZE_PX / np.sqrt(float((np.ptp(rows) + 1) * (np.ptp(columns) + 1)))
    edge = int(np.ceil(4 * _NEAR_PX / factor))
    part = np.s_[max(0, rows[0] - edge) : rows[-1] + 1 + edge, max(0, columns[0] - edge) : columns[-1] + 1 + edge]
    height, width = mask[part].shape
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    shrink = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    colors = cv2.resize(np.ascontiguousarray(srgb[part]), size, interpolation=shrink).astype(np.float64)
    leaves = cv2.resize(mask[part].astype(np.float32), size, interpolation=shrink) > 0.5
    leaves = leaves if leaves.any() else np.ones_like(leaves)
    wide = dilate(leaves, _EDGE_PX) if is_thin else leaves
    light = np.log(colors.mean(axis=2) + _DARK)
    weight = wide.astype(np.float64)
    near = np.maximum(_blur(weight, _NEAR_PX), 1e-3)
    apart = (light - _blur(light * weight, _NEAR_PX) / near) * weight
    contrast = np.sqrt(np.maximum(_blur(apart**2, _NEAR_PX) / near, 0))
    inner = ~dilate(~leaves, _INNER_PX)
    inner = inner if inner.sum() >= _FEWEST else leaves
    red, green, blue = colors[inner].T
    color = (np.maximum(red, green) - blue) / (red + green + blue + 30)
    return FoliageEvidence(
        color=float(np.median(color)),
        contrast=float(np.median(contrast[inner])),
        ruled=_find_ruled(light, inner),
        before_sky=before_sky,
        is_thin=is_thin,
    )


def _find_ruled(light: Floats, inner: NDArray[np.bool_]) -> float:
    """How far the edges of a picture (H, W) are along two directions that are square to each other, by their weight."""
    smooth = _blur(light, 1.0)
    slope = (cv2.Sobel(smooth, cv2.CV_64F, 1, 0) + 1j * cv2.Sobel(smooth, cv2.CV_64F, 0, 1))[inner]
    steep = np.abs(slope)
    if not steep.sum() > 0:
        return 0.0
    direction = slope / np.maximum(steep, 1e-12)
    return float(np.abs((steep * direction**4).sum()) / steep.sum())


def _blur(picture: Floats, sigma_px: float) -> Floats:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px))
