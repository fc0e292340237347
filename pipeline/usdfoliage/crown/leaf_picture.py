"""The picture of one leaf that the leaves of a crown are cut out by, cleaned, and without the colour of the crown.

A cluster has its colour from the crown's map. The picture multiplies it: its mean is 1 in each channel, so that a crown
keeps its colours, and what differs on a leaf, such as its veins, differs in brightness and hue as it does there. Ours.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from usdfoliage.errors import FitError

LONGEST_PX = 256  # a leaf of a cluster is some ten pixels long in a picture, and seldom a hundred
SHORTEST_PX = 8  # of leaf; fewer show no form
OPAQUE = 0.5  # alpha from which on there is leaf, as the materials have it
ISLAND = 0.05  # of the area of the largest piece; what is smaller is dirt
HOLE = 0.02  # of the leaf's area; smaller gaps within it are gaps of a mask
MARGIN_PX = 2  # around the leaf, so that its edge is not that of the picture
BRIGHTEST = 3.0  # times the mean: beyond are highlights
EDGE_PX = 2  # within a silhouette, where pixels show what was behind the leaf too
DARKEST = 1e-4  # linear mean of a channel, below which its hue is unknown

WIDEST = 4.0  # times as wide as long; beyond, a leaf lies on its side
SLIMMEST = 0.01

PLAIN_PX = 128
PLAIN_WIDTH = 0.62
PLAIN_COVER = 2733 / 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafPicture:
    """One leaf, its base below and its apex above.

    Attributes:
        rgba: (H, W, 4), linear factors on a leaf's colour, and opacity in [0, 1]. The mean of each colour is 1 where
            the opacity is above .5; beside the leaf, colours go on as those of its edge.
        width: Of the picture, over its height, as a leaf is drawn: its texels need not be square.
    """

    rgba: NDArray[np.float32]
    width: float

    @property
    def cover(self) -> float:
        """Share of the picture's area that shows leaf."""
        return float(np.mean(self.rgba[..., 3] >= OPAQUE))


def clean_leaf_picture(rgba: NDArray[np.floating], longest_px: int = LONGEST_PX) -> LeafPicture:
    """Make the picture of a leaf from a picture of one: cut to the leaf, of bounded size, with a mean of 1.

    Pieces below a twentieth of the largest are left out, such as dust on a scan; small gaps are closed.

    Args:
        rgba: (H, W, 4), linear Rec.709, not multiplied by opacity; base below. Opacity in [0, 1].
        longest_px: The longer side of the result at most.

    Raises:
        ValueError: rgba is not (H, W, 4).
        FitError: Nothing is opaque, nothing is transparent, the leaf is too small, too wide or too slim, or black.
    """
    if rgba.ndim != 3 or rgba.shape[2] != 4:
        raise ValueError(f"a picture must be (H, W, 4), not {rgba.shape}")
    alpha = np.nan_to_num(np.asarray(rgba[..., 3], np.float32), nan=0.0)
    opaque = alpha >= OPAQUE
    if not opaque.any():
        raise FitError("the picture of the leaf is transparent everywhere", "give a picture whose leaf is opaque")
    if opaque.all():
        raise FitError(
            "the picture of the leaf is opaque everywhere", "cut the leaf out: beside it the picture is transparent"
        )
    leaf = _without_dirt(opaque)
    rows, columns = np.flatnonzero(leaf.any(axis=1)), np.flatnonzero(leaf.any(axis=0))
    height, width = int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1
    if max(height, width) < SHORTEST_PX:
        raise FitError(
            f"the leaf is {width} x {height} pixels in its picture, {SHORTEST_PX} needed", "give a larger picture"
        )
    if not SLIMMEST <= width / height <= WIDEST:
        raise FitError(
            f"the leaf is {width} x {height} pixels in its picture, which is the form of no leaf",
            "turn the picture, so that the base is below and the apex above",
        )
    cut = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    # Soft edges stay soft; gaps that were closed are opaque, and what is no leaf is not.
    alpha = np.where(leaf & opaque, alpha, leaf.astype(np.float32))[cut]
    color = np.nan_to_num(np.asarray(rgba[..., :3][cut], np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    known = (opaque & leaf)[cut]
    scale = min(1.0, (longest_px - 2 * MARGIN_PX) / max(height, width))
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    weight = cv2.resize((known * alpha).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    color = cv2.resize(color * (known * alpha)[..., None], size, interpolation=cv2.INTER_AREA)
    alpha = cv2.resize(alpha, size, interpolation=cv2.INTER_AREA)
    color = color.reshape(*alpha.shape, 3) / np.maximum(weight, 1e-6)[..., None]
    margin = ((MARGIN_PX, MARGIN_PX), (MARGIN_PX, MARGIN_PX))
    alpha, weight, color = np.pad(alpha, margin), np.pad(weight, margin), np.pad(color, (*margin, (0, 0)))
    seen = weight > 0.25
    inner = cv2.erode(seen.astype(np.uint8), np.ones((2 * EDGE_PX + 1, 2 * EDGE_PX + 1), np.uint8)) > 0
    thin = seen & (cv2.dilate(inner.astype(np.uint8), np.ones((4 * EDGE_PX + 1, 4 * EDGE_PX + 1), np.uint8)) == 0)
    factors = _without_mean(_spread(color, inner | thin), alpha >= OPAQUE)
    return LeafPicture(rgba=np.dstack([factors, alpha]).astype(np.float32), width=alpha.shape[1] / alpha.shape[0])


def plain_leaf(size: int = PLAIN_PX) -> LeafPicture:
    """A grey leaf with a midrib and veins, where a plant has no picture of its own."""
    across, down = np.meshgrid(np.linspace(-1, 1, size), np.linspace(1, 0, size))
    half = 0.98 * np.sin(np.pi * np.clip(down, 0, 1)) ** 0.75 * (1.15 - 0.3 * down)
    inside = np.abs(across) < np.minimum(half, 1.0)
    veins = np.cos(2 * np.pi * 7 * (down - 0.35 * np.abs(across)))
    shade = 0.8 + 0.05 * veins + 0.12 * np.exp(-((across / 0.05) ** 2)) - 0.08 * np.abs(across)
    factors = _without_mean(np.repeat(shade[..., None], 3, axis=2).astype(np.float32), inside)
    return LeafPicture(rgba=np.dstack([factors, inside]).astype(np.float32), width=PLAIN_WIDTH)


def _without_dirt(opaque: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where a leaf is: the pieces of opaque pixels that are large, with small gaps closed."""
    _, label, stats, _ = cv2.connectedComponentsWithStats(opaque.astype(np.uint8), connectivity=8)
    area = stats[:, cv2.CC_STAT_AREA].astype(np.int64)
    area[0] = 0
    leaf = (area >= ISLAND * area.max())[label] & opaque
    beside = np.pad(~leaf, 1, constant_values=True).astype(np.uint8)
    _, label, stats, _ = cv2.connectedComponentsWithStats(beside, connectivity=4)
    gap = stats[:, cv2.CC_STAT_AREA] < HOLE * leaf.sum()
    gap[label[0, 0]] = False  # what is around the leaf
    gap[0] = False
    return leaf | gap[label][1:-1, 1:-1]


def _spread(color: NDArray[np.floating], known: NDArray[np.bool_]) -> NDArray[np.floating]:
    """Colours (H, W, 3), those of the nearest known texel where they are unknown: coarse levels mix what is beside."""
    if not known.any():
        return color
    nearest = scipy.ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return color[tuple(nearest)]


def _without_mean(color: NDArray[np.floating], inside: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Colours (H, W, 3) over their mean inside, none above BRIGHTEST, so that the mean of the result is 1.

    Raises:
        FitError: The leaf is black.
    """
    inside = inside if inside.any() else np.ones_like(inside)
    factors = np.maximum(color.astype(np.float64), 0)
    mean = factors[inside].mean(axis=0)
    if not float(mean.max()) > DARKEST:
        raise FitError("the picture of the leaf is black", "give a picture in the leaf's colours")
    # A channel of which the leaf has nothing has no pattern of its own either.
    factors = np.where(mean > DARKEST, factors / np.maximum(mean, DARKEST), 1.0)
    for _ in range(4):  # what is cut off is missing from the mean, less each time
        factors = np.minimum(factors, BRIGHTEST)
        factors /= factors[inside].mean(axis=0)
    return factors.astype(np.float32)
