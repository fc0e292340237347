"""Leaves cut out of one picture: a scan or a photograph of leaves on paper or on another even ground.

Colours that several sides of the picture show are those of the ground: paper, its ruling, its shadow. A pixel is of a
leaf where its colour is far from all of them; how far is decided by Otsu's method. Pieces of that are leaves, dust, or
what is no leaf: black dots for scale, the edge of a table.

Source:
    N. Otsu, A threshold selection method from gray-level histograms, 1979; L. Mündermann et al., Modeling lobed leaves,
    section 3.1. How the ground is found, and what is a leaf: our own.
"""

import enum
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import FitError

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SOFTEN_PX = 0.8  # of the picture, before colours are compared
_CLUSTERS = 12
_SAMPLES = 20_000
_RIM = 0.04  # of the shorter side, is the rim of the picture
_RIM_SHARE = 0.004  # of a side of the rim, that a colour of the ground has there
_SIDES = 3  # of the rim that show it
_LIGHT = 0.35  # what a difference of lightness counts beside one of colour, since shadows and lamps make it
_BRIGHT = 0.15  # the same where a pixel is brighter than white paper
_FARTHEST = 80.0  # Lab units: greater differences are no clearer
_CLEAR = 6.0  # Lab units, from the colours of the ground, that a threshold is at least
_TOO_FINE = 0.004  # of the longer side: notches and bridges of that width in a mask are noise
_PALE = 0.35  # of the difference in colour that the most colourful piece has: less is a dot, ink or a table
_LAMP = 2.0  # Lab units of lightness, by which what a lamp mirrors in is brighter than paper
_STRIP = 4.0  # times as long as wide, is a strip along the border that is no leaf
_BOX = 4  # pixels around a leaf in its own mask


class Finding(enum.Enum):
    """What was found about a leaf that may spoil it."""

    OVER_BORDER = "over the border"  # a part of it is outside of the picture
    TOUCHING = "touching"  # it seems to be several leaves that touch each other
    HOLES_FILLED = "holes filled"  # small ones were
    HOLES_KEPT = "holes kept"  # torn, or between lobes that overlap
    LOW_CONTRAST = "low contrast"  # to the ground: its silhouette is uncertain


@dataclass(frozen=True, kw_only=True)
class CutOutSettings:
    """What is a leaf in a picture."""

    longest_px: int = 2400  # A larger picture is reduced until its longer side has this length. Range: 64 or more.
    dust: float = 0.02  # A piece below this share of the largest one is dust. Range: above 0, below 1.
    small_hole: float = 0.002  # A hole below this share of its leaf is filled. Range: 0 to below 1.

    def __post_init__(self) -> None:
        if self.longest_px < 64 or not 0 < self.dust < 1 or not 0 <= self.small_hole < 1:
            raise ValueError(f"longest_px must be at least 64, dust in (0, 1), small_hole in [0, 1), not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafCutOut:
    """One leaf of a picture."""

    mask: Mask  # (h, w), its petiole included, in pixels of the reduced picture
    corner: tuple[int, int]  # row and column of the mask's first pixel in the reduced picture
    findings: frozenset[Finding]
    holes: int  # that stay


@dataclass(frozen=True, kw_only=True, eq=False)
class CutOut:
    """What was found in a picture."""

    leaves: tuple[LeafCutOut, ...]  # the largest first
    dust: int  # pieces that were left out because they are small
    others: int  # and because they have no colour of a leaf
    scale: tuple[float, float]  # pixels of the picture in one of the reduced picture: across and down
    reduced: NDArray[np.uint8]  # (h, w, 3) that picture, sRGB


def cut_out_leaves(srgb: NDArray[np.uint8], settings: CutOutSettings = CutOutSettings()) -> CutOut:
    """Find the leaves of a picture by their colours.

    Args:
        srgb: (H, W, 3), red, green, blue, encoded for display.
        settings: What is a leaf.

    Raises:
        ValueError: srgb is not (H, W, 3) of uint8.
        FitError: Nothing in the picture differs from its ground.
    """
    if srgb.ndim != 3 or srgb.shape[2] != 3 or srgb.dtype != np.uint8:
        raise ValueError(f"srgb must be (H, W, 3) of uint8, not {srgb.shape} of {srgb.dtype}")
    reduced, scale = _reduce(srgb, settings.longest_px)
    if min(reduced.shape[:2]) < 16:
        raise FitError(f"no leaf was found: the picture has {srgb.shape[1]} x {srgb.shape[0]} pixels, 16 x 16 needed")
    lab = cv2.cvtColor(cv2.GaussianBlur(reduced, (0, 0), _SOFTEN_PX), cv2.COLOR_RGB2LAB).astype(np.float32)
    lab = (lab - np.array([0, 128, 128], np.float32)) * np.array([100 / 255, 1, 1], np.float32)
    ground = _find_ground(lab)
    away, colored = _measure_distance(lab, ground)
    threshold, contrast = _otsu(away)
    if threshold < _CLEAR:
        raise FitError(
            f"no leaf was found: what differs most from the ground differs by {threshold:.1f} Lab units, "
            f"{_CLEAR:g} needed",
            "Give the mask of the leaf",
        )
    solid = _clean(away > threshold)
    doubtless = away < threshold / 2
    paper = ground[np.argmax(ground[:, 0]), 0]
    lamps = (lab[..., 0] > paper + _LAMP) if paper > 50 else np.zeros(solid.shape, bool)
    return _sort_pieces(solid, doubtless, colored, lamps, contrast, reduced, scale, settings)


def cut_out_mask(mask: Mask, settings: CutOutSettings = CutOutSettings()) -> CutOut:
    """The leaves of a mask (H, W) that was drawn, which is reduced as a picture is.

    Raises:
        FitError: The mask is empty.
    """
    if mask.ndim != 2 or mask.dtype != np.bool_:
        raise ValueError(f"mask must be (H, W) of bool, not {mask.shape} of {mask.dtype}")
    drawn, scale = _reduce(mask.view(np.uint8), settings.longest_px, mask=True)
    solid = drawn > 0
    if not solid.any():
        raise FitError("no leaf was found: the mask is empty", "Give a mask with a white leaf")
    picture = np.repeat(drawn[..., None] * np.uint8(255), 3, axis=2)
    everything = np.full(solid.shape, np.inf, np.float32)
    return _sort_pieces(solid, ~solid, everything, np.zeros_like(solid), np.inf, picture, scale, settings)


def _reduce(
    picture: NDArray[np.uint8], longest_px: int, *, mask: bool = False
) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """A picture no larger than allowed, and how many of its pixels make one then: across and down."""
    height, width = picture.shape[:2]
    share = min(1.0, longest_px / max(height, width))
    size = max(1, round(width * share)), max(1, round(height * share))
    if share < 1:
        # A mask of 0 and 1 would round to 0 in each pixel that is not full.
        source = picture * np.uint8(255) if mask else picture
        small = cv2.resize(source, size, interpolation=cv2.INTER_AREA)
        picture = (small > 127).astype(np.uint8) if mask else np.asarray(small, np.uint8)
    return picture, (width / size[0], height / size[1])


def _find_ground(lab: NDArray[np.float32]) -> Floats:
    """(G, 3) colours of the ground: those clusters of all colours that several sides of the picture show."""
    height, width = lab.shape[:2]
    step = max(1, int(np.sqrt(height * width / _SAMPLES)))
    few = np.ascontiguousarray(lab[step // 2 :: step, step // 2 :: step].reshape(-1, 3))
    weights = np.array([_LIGHT, 1, 1], np.float32)
    clusters = min(_CLUSTERS, len(few))
    cv2.setRNGSeed(0)  # the same picture gives the same colours
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.3)
    _, _, centers = cv2.kmeans(few * weights, clusters, None, stop, 2, cv2.KMEANS_PP_CENTERS)
    rim = max(2, round(_RIM * min(height, width)))
    sides = (lab[:rim], lab[-rim:], lab[:, :rim], lab[:, -rim:])
    seen = np.zeros(clusters, np.int64)
    largest = np.zeros(clusters)
    for side in sides:
        part = side.reshape(-1, 3)
        part = part[:: max(1, len(part) // 5000)] * weights
        nearest = ((part[:, None] - centers) ** 2).sum(axis=2).argmin(axis=1)
        share = np.bincount(nearest, minlength=clusters) / len(part)
        seen += share >= _RIM_SHARE
        largest += share
    paper = seen >= min(_SIDES, int(seen.max()))
    paper[np.argmax(largest)] = True
    return np.asarray(centers[paper] / weights, np.float64)


def _measure_distance(lab: NDArray[np.float32], ground: Floats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(H, W) how far colours are from the nearest one of the ground: with and without lightness, Lab units."""
    away = np.full(lab.shape[:2], np.inf, np.float32)
    colored = away.copy()
    for color in ground.astype(np.float32):
        # On dark cloth leaves are brighter than the ground; on paper only lamps are.
        lighter = _BRIGHT if color[0] > 50 else _LIGHT
        light = lab[..., 0] - color[0]
        light = light * np.where(light > 0, np.float32(lighter), np.float32(_LIGHT))
        chroma = (lab[..., 1] - color[1]) ** 2 + (lab[..., 2] - color[2]) ** 2
        np.minimum(away, np.sqrt(light**2 + chroma), out=away)
        np.minimum(colored, np.sqrt(chroma), out=colored)
    return away, colored


def _otsu(away: NDArray[np.float32]) -> tuple[float, float]:
    """The threshold between two kinds of distances, and by how much the means of the two differ, in deviations."""
    bins = np.linspace(0, _FARTHEST, 257)
    count = np.histogram(np.minimum(away, _FARTHEST), bins)[0].astype(np.float64)
    middle = (bins[1:] + bins[:-1]) / 2
    below, above = np.cumsum(count), np.cumsum(count[::-1])[::-1]
    low = np.cumsum(count * middle) / np.maximum(below, 1)
    high = (np.cumsum((count * middle)[::-1]) / np.maximum(above[::-1], 1))[::-1]
    between = below[:-1] * above[1:] * (low[:-1] - high[1:]) ** 2
    # A leaf that fills little of the picture has few pixels: a plateau of the criterion is taken in its middle.
    best = np.flatnonzero(between >= between.max() * (1 - 1e-9))
    cut = int(best[len(best) // 2])
    under, over = middle[: cut + 1], middle[cut + 1 :]
    spread = np.sqrt(
        ((count[: cut + 1] * (under - low[cut]) ** 2).sum() + (count[cut + 1 :] * (over - high[cut + 1]) ** 2).sum())
        / max(count.sum(), 1)
    )
    return float(bins[cut + 1]), float((high[cut + 1] - low[cut]) / max(spread, 1e-6))


def _clean(solid: Mask) -> Mask:
    """Without bridges of noise between a leaf and what lies beside it."""
    reach = max(1, round(_TOO_FINE * max(solid.shape) / 4))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    closed = cv2.morphologyEx(solid.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, disc)
    # Thin petioles and tips go with the opening: what hangs together with a piece of it comes back.
    near = cv2.dilate(opened, np.ones((3, 3), np.uint8)) & closed
    _, labels = cv2.connectedComponents(closed, connectivity=8)
    joined = np.unique(labels[near > 0])
    return np.asarray(np.isin(labels, joined[joined > 0]) & (closed > 0))


def _sort_pieces(
    solid: Mask,
    ground: Mask,
    colored: NDArray[np.float32],
    lamps: Mask,
    contrast: float,
    reduced: NDArray[np.uint8],
    scale: tuple[float, float],
    settings: CutOutSettings,
) -> CutOut:
    """The pieces of a mask that are leaves, the largest first."""
    pieces, labels, measures, _ = cv2.connectedComponentsWithStats(solid.astype(np.uint8), connectivity=8)
    if pieces < 2:
        raise FitError("no leaf was found: nothing in the picture differs from its ground", "Give the mask of the leaf")
    filled = measures[:, cv2.CC_STAT_AREA].astype(np.float64)
    chroma = np.bincount(labels.ravel(), np.minimum(colored, 1e3).ravel(), minlength=pieces) / filled
    chroma[0] = 0
    considered = np.arange(1, pieces)[filled[1:] >= settings.dust * filled[1:].max()]
    height, width = solid.shape
    vivid = float(chroma[considered].max())
    leafy = [
        int(each)
        for each in considered
        if chroma[each] >= _PALE * vivid and not _is_edge(labels == each) and not lamps[labels == each].mean() > 0.5
    ]
    if not leafy:
        raise FitError(
            "no leaf was found: what differs from the ground lies along the border", "Give the mask of the leaf"
        )
    largest = max(filled[leafy])
    kept = sorted((each for each in leafy if filled[each] >= settings.dust * largest), key=lambda each: -filled[each])
    leaves = []
    for each in kept:
        left, top, across, down = (int(value) for value in measures[each, :4])
        low = max(0, top - _BOX), max(0, left - _BOX)
        box = slice(low[0], min(height, top + down + _BOX)), slice(low[1], min(width, left + across + _BOX))
        mask, holes, findings = _fill_small(labels[box] == each, ground[box], settings.small_hole)
        if left == 0 or top == 0 or left + across == width or top + down == height:
            findings.add(Finding.OVER_BORDER)
        if _touch(mask | _inner(mask)):
            findings.add(Finding.TOUCHING)
        if contrast < 3:
            findings.add(Finding.LOW_CONTRAST)
        leaves.append(LeafCutOut(mask=mask, corner=low, findings=frozenset(findings), holes=holes))
    others = len([each for each in considered if each not in kept and filled[each] >= settings.dust * largest])
    return CutOut(
        leaves=tuple(leaves), dust=pieces - 1 - len(kept) - others, others=others, scale=scale, reduced=reduced
    )


def _is_edge(region: Mask) -> bool:
    """Whether a region is a strip along the border, as the edge of a table or of a second sheet is."""
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    for side, extent, across in (
        (region[0], region.shape[1], len(rows)),
        (region[-1], region.shape[1], len(rows)),
        (region[:, 0], region.shape[0], len(columns)),
        (region[:, -1], region.shape[0], len(columns)),
    ):
        along = int(side.sum())
        if along > 0.9 * extent or along > _STRIP * across:
            return True
    return False


def _fill_small(mask: Mask, ground: Mask, small: float) -> tuple[Mask, int, set[Finding]]:
    """A mask without its small holes and those that do not show the ground, and how many stay."""
    count, labels, measures, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    rim = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    visible = np.bincount(labels[ground], minlength=count)
    filled, kept = mask.copy(), 0
    findings: set[Finding] = set()
    for hole in range(1, count):
        if hole in rim or mask[labels == hole].any():
            continue
        pixels = int(measures[hole, cv2.CC_STAT_AREA])
        if pixels < small * mask.sum() or visible[hole] < pixels / 4:
            filled |= labels == hole
            findings.add(Finding.HOLES_FILLED)
        else:
            kept += 1
            findings.add(Finding.HOLES_KEPT)
    return filled, kept, findings


def _inner(mask: Mask) -> Mask:
    """The holes of a mask."""
    lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    drawn = np.zeros(mask.shape, np.uint8)
    cv2.drawContours(drawn, lines, -1, 1, cv2.FILLED)
    return (drawn > 0) & ~mask


def _touch(mask: Mask) -> bool:
    """Whether a mask has two bodies of like size that are joined by a neck that is narrow beside both.

    A lobe has a neck too, but not one so narrow: of leaves that lie beside each other only the rims touch.
    """
    scale = min(1.0, 300 / max(mask.shape))
    size = max(1, round(mask.shape[1] * scale)), max(1, round(mask.shape[0] * scale))
    small = cv2.copyMakeBorder(
        cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST), 1, 1, 1, 1, cv2.BORDER_CONSTANT
    )
    deep = cv2.distanceTransform(small, cv2.DIST_L2, 5)
    # A neck as wide as a petiole joins leaflets of one leaf as well: only necks far from all thin limbs count.
    for share in (0.15, 0.25, 0.35):
        bodies, labels, measures, _ = cv2.connectedComponentsWithStats((deep > share * deep.max()).astype(np.uint8))
        if bodies < 3:
            continue
        depth = np.array([deep[labels == body].max() for body in range(1, bodies)])
        pixels = measures[1:, cv2.CC_STAT_AREA]
        if ((depth > 0.6 * deep.max()) & (pixels > 0.3 * pixels.max())).sum() >= 2:
            return True
    return False
