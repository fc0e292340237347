"""Which pixels of a photograph are leaves of the tree whose crown somebody drew around.

P. Tan et al., Single image tree modeling, 2008, section 2: a mixture of ten normal distributions of the colours inside
of the stroke, of which some are leaves; a Gibbs energy that a minimum cut makes least. Which components are leaves is
decided otherwise: the paper takes the four greenest or reddest. Autumn, blossom and grey leaves are neither, so a
component counts by how much oftener it is inside of the stroke than around it, and by how green or red it is. A second
cut has mixtures of what the first one found.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.sky import segment_sky
from usdfoliage.sketch.drawing import SHIFT, dilate, draw_lines, even_out, fixed_points
from usdfoliage.sketch.minimum_cut import cut_pixels
from usdfoliage.sketch.mixtures import Mixture, fit_mixture, log_density, log_parts
from usdfoliage.sketch.sky_behind import share_of_tree
from usdfoliage.sketch.stroke_margin import StrokeMargin, measure_margin

Floats = NDArray[np.float64]

_SKY_PX = 400  # longer side of the picture in which the sky is looked for
_SOME_SKY, _NEARLY_SKY = 0.7, 0.95  # share of the colours of a component
_SURE = 12.0  # energy of a pixel by its colour, at most
_FEW = 60  # pixels, too few for a mixture
_THIN, _LEFT = 0.015, 0.65  # of the crown's width; and the share that is left of what is not thin
_COLORED = 0.02  # by which leaves are green or red; grey bark and sky are less
_SAME_HUE = 0.18  # between the hue of twigs and that of their stem, in _hue
_STEM_PIXELS = 20  # of a stem below the crown, of which its hue is known
_AROUND = 0.06  # of the size of leaves: what is close around them
_PAPER_PX = 1500.0  # longer side of the paper's pictures


@dataclass(frozen=True, kw_only=True)
class FoliageCutSettings:
    """How leaves are separated from what is behind them."""

    components: int = 10  # of the mixture, section 2
    leaf_components: int = 5  # of the mixture of the leaves that were found
    smoothness: float = 60.0  # lambda
    unsteady: float = 0.04  # of the crown's size, along the stroke, over which a hand that shakes is evened out
    dilation: float = 10.0  # pixels of a picture of 1500, by which the stroke may have been drawn too narrow
    around: float = 0.12  # of the crown's size, the width of the ring around it that is compared
    rounds: int = 3  # of the cut, with mixtures of what the one before found
    border: float = 2.0  # energy against leaves of a pixel at the stroke; it falls to 0 inside, and doubles outside
    loose: float = 0.04  # of the crown's size, how far from the leaves strokes are drawn, where that is not seen
    sure_border: float = 6.0  # energy against leaves at one spread outside of where the stroke's margin has them end
    steady: float = 0.01  # of the crown's size, the least spread of that margin
    min_share: float = 0.3  # of a pixel before the sky, which is leaves
    share_weight: float = 20.0  # energy of a whole pixel's share
    pure_share: float = 0.8  # of a pixel, from which on its colour is that of leaves alone
    beside_sky: float = 0.3  # of the energy by colour, that is left where the share is known
    dense: float = 0.03  # of the crown's size, around a pixel, where it is asked how much is leaves
    filled: float = 4.0  # energy for leaves of a pixel, where all around it is leaves
    max_pixels: int = 160_000  # of the crown's box, that labels are looked for in
    inside_weight: float = 1.0  # of the logarithm of how much oftener a component is inside
    color_weight: float = 0.5  # of how green or red it is
    certainty: float = 2.5  # of the score of a component, as logarithm of odds
    trust: float = 0.3  # in the stroke: what its colours leave open is leaves
    bark_weight: float = 1.5  # of the logarithm of how much oftener a component is under strokes of branches
    bark_width: float = 4.0  # pixels of a picture of 1500, of these strokes
    sky_weight: float = 4.0  # of the share of a component that is sky
    low: float = 0.3  # of the crown's height from below, beside which the ring shows plants and ground as green as it

    def __post_init__(self) -> None:
        if not (self.components >= 2 and 1 <= self.leaf_components < self.components):
            raise ValueError(f"leaf_components must be 1 or more and fewer than components, not {self}")
        if not (self.smoothness >= 0 and self.dilation >= 0 and self.around > 0 and self.max_pixels >= 1000):
            raise ValueError(f"smoothness, dilation, around and max_pixels must be positive, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Foliage:
    """The leaves of a tree in its photograph."""

    mask: NDArray[np.bool_]  # (H, W)
    pure: NDArray[np.bool_]  # (H, W), of these, whose colour is one of leaves and has no sky in it
    inside: NDArray[np.bool_]  # (H, W), the region of the stroke, dilated
    leaves: Mixture
    background: Mixture
    is_thin: bool  # what was found is nowhere wide: single leaves, or twigs
    is_bare: bool  # it is thin, and has no other colour than the stem: twigs alone
    before_sky: float  # share of what is around the leaves that is sky


def find_foliage(
    srgb: NDArray[np.uint8],
    crown_px: Floats,
    seed: int,
    settings: FoliageCutSettings = FoliageCutSettings(),
    branches_px: Sequence[Floats] = (),
) -> Foliage:
    """The leaves inside of a crown's stroke.

    Args:
        srgb: (H, W, 3), the photograph.
        crown_px: (N, 2), the stroke.
        seed: Of the mixture.
        settings: How.
        branches_px: (K, 2) each, strokes of branches, whose colours outside of the crown are those of twigs.

    Raises:
        ValueError: Nothing of the picture is inside.
    """
    height, width = srgb.shape[:2]
    low, high = crown_px.min(axis=0), crown_px.max(axis=0)
    size_px = float(np.clip(high, 0, [width, height]).max(initial=1) - max(low.min(), 0))
    grown_px = settings.dilation * max(width, height) / _PAPER_PX
    margin = int(np.ceil(grown_px + settings.around * max(high - low))) + 2
    x0, y0 = np.maximum(np.floor(low).astype(int) - margin, 0)
    x1, y1 = np.minimum(np.ceil(high).astype(int) + margin, [width, height])
    if x1 <= x0 or y1 <= y0 or size_px <= 0:
        raise ValueError("nothing of the picture is inside of the stroke")
    scale = min(1.0, float(np.sqrt(settings.max_pixels / ((x1 - x0) * (y1 - y0)))))
    small = (max(2, round((x1 - x0) * scale)), max(2, round((y1 - y0) * scale)))
    colors = cv2.resize(srgb[y0:y1, x0:x1], small, interpolation=cv2.INTER_AREA).astype(np.float64)
    steady = even_out(crown_px, settings.unsteady * float(max(high - low)))
    stroke = (steady - [x0, y0]) * [
        small[0] / (x1 - x0),
        small[1] / (y1 - y0),
    ]
    inner = fill_outline(stroke, small)
    inside = dilate(inner, grown_px * scale)
    if not inner.any():
        raise ValueError("nothing of the picture is inside of the stroke")
    ring = dilate(inside, settings.around * scale * max(high - low)) & ~inside
    row = np.arange(small[1])[:, None]
    above = ring & (row < stroke[:, 1].max() - settings.low * np.ptp(stroke[:, 1]))
    ring = above if above.sum() > 0.1 * ring.sum() else ring
    mixture = fit_mixture(colors[inside], settings.components, seed)
    sky = find_sky(srgb, seed)[np.ix_(*_nearest(srgb.shape[:2], (x0, y0, x1, y1), small))]
    placed = [(line - [x0, y0]) * scale for line in branches_px]
    under = draw_lines(placed, inner.shape, max(1, round(settings.bark_width * max(width, height) / _PAPER_PX * scale)))
    odds = rate_components(mixture, colors[inner], colors[ring], settings, sky[inner], colors[inner & under])
    leaves, background = mixture.weighted(odds), mixture.weighted(1 - odds)
    flat = colors.reshape(-1, 3)
    size = float(max(high - low)) * scale
    drawn = _near_stroke(inner, None, size, settings)
    right, down = (settings.smoothness / (1 + np.square(np.diff(colors, axis=axis)).sum(axis=2)) for axis in (1, 0))
    labels, colored, dense = inside, inside, np.zeros(inside.shape)
    for again in range(settings.rounds):
        if again:
            if labels.sum() < _FEW or (~labels & (inside | ring)).sum() < _FEW:
                break
            # What was found, and what surrounds it, are better samples than the components of both together.
            leaves = fit_mixture(colors[labels], settings.leaf_components, seed + again)
            background = fit_mixture(colors[~labels & (inside | ring)], settings.components, seed + again)
            density = cv2.GaussianBlur(labels.astype(np.float32), (0, 0), max(1.0, settings.dense * size))
            dense = settings.filled * np.clip(2 * density - 1, 0, 1)
        energy = (log_density(background, flat) - log_density(leaves, flat)).reshape(inside.shape)
        energy = np.clip(energy, -_SURE, _SURE)
        colored = energy < 0
        if again:
            behind = share_of_tree(colors, sky, labels, size)
            mixed = settings.share_weight * (settings.min_share - behind.share)
            energy = np.where(behind.known, settings.beside_sky * energy + np.clip(mixed, -_SURE, _SURE), energy)
            drawn = _near_stroke(inner, measure_margin(stroke, labels, behind.pure, size), size, settings)
        labels = cut_pixels(energy - drawn - dense, right, down, inside)
    behind = share_of_tree(colors, sky, labels, size)
    pure = labels & colored & ~(behind.before_sky & (behind.share < settings.pure_share))
    mask, pure, whole = (
        np.pad(_enlarge(part, (x1 - x0, y1 - y0)), ((y0, height - y1), (x0, width - x1)))
        for part in (labels, pure, inside)
    )
    mask &= whole
    is_thin = _is_thin(labels & inside)
    return Foliage(
        mask=mask,
        pure=pure & mask,
        inside=whole,
        leaves=leaves,
        background=background,
        is_thin=is_thin,
        before_sky=share_around(labels, sky),
        is_bare=is_thin and bool(mask.any()) and _are_twigs(srgb, mask, whole, branches_px),
    )


def share_around(mask: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """The share that another mask (H, W) has of what is close around a mask (H, W)."""
    around = dilate(mask, max(2.0, _AROUND * float(np.sqrt(mask.sum())))) & ~mask
    return float(other[around].mean()) if mask.any() and around.any() else 0.0


def _near_stroke(
    inner: NDArray[np.bool_], margin: StrokeMargin | None, size: float, settings: FoliageCutSettings
) -> Floats:
    """(H, W) energy for leaves by the distance from the stroke: below 0 near to it, and 0 well inside."""
    distance = _signed_distance(inner)
    if margin is None:
        return np.asarray(settings.border * np.clip(distance / (settings.loose * size) - 1, -2, 0), np.float64)
    spread = max(margin.spread_px, settings.steady * size)
    return np.asarray(settings.sure_border * np.clip((distance - margin.middle_px) / spread, -2, 0), np.float64)


def _signed_distance(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(H, W) pixels to the border of a mask, below 0 outside."""
    within, beyond = (
        cv2.distanceTransform(each.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for each in (mask, ~mask)
    )
    return np.asarray(within - beyond)


def _is_thin(mask: NDArray[np.bool_]) -> bool:
    """Whether little is left of what was found after an opening of the width of a small twig's foliage."""
    if not mask.any():
        return False
    reach = max(1, round(_THIN * float(np.ptp(np.flatnonzero(mask.any(axis=0))))))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    return float(opened.sum()) < _LEFT * float(mask.sum())


def _are_twigs(
    srgb: NDArray[np.uint8], mask: NDArray[np.bool_], inside: NDArray[np.bool_], branches_px: Sequence[Floats]
) -> bool:
    """Whether what was found has the hue of the stem below the crown; without one, whether it has none of leaves."""
    found = srgb[mask].astype(np.float64)
    # Sky shines through at the borders of twigs and leaves; the darker half is of themselves.
    light = found.sum(axis=1)
    own = found[light <= np.median(light)].mean(axis=0)
    below = draw_lines(branches_px, mask.shape, 3) & ~inside
    if below.sum() < _STEM_PIXELS:
        red, green, blue = own
        return bool((max(red, green) - blue) / (red + green + blue + 1) < _COLORED)
    return float(np.abs(_hue(own) - _hue(np.median(srgb[below], axis=0))).max()) < _SAME_HUE


def _hue(color: Floats) -> Floats:
    """(2,) logarithms of red over green and of blue over green."""
    return np.log((color[[0, 2]] + 5.0) / (color[1] + 5.0))


def rate_components(
    mixture: Mixture,
    inside: Floats,
    around: Floats,
    settings: FoliageCutSettings,
    is_sky: NDArray[np.bool_] | None = None,
    under_strokes: Floats | None = None,
) -> Floats:
    """(K,) how likely each component is one of leaves, above 0 and below 1.

    Args:
        mixture: Of the colours inside.
        inside: (N, 3) colours inside of the stroke.
        around: (M, 3) colours around it.
        settings: How.
        is_sky: (N,), which of those inside are sky, as far as that is known.
        under_strokes: (S, 3) colours inside that are under strokes of branches: bark, as far as leaves do not hide it.
    """
    share = [_shares(mixture, some) for some in (inside, around)]
    oftener = np.log((share[0] + 0.01) / (share[1] + 0.01)) if len(around) else np.zeros(len(mixture))
    score = settings.trust + settings.inside_weight * oftener + settings.color_weight * _green_or_red(mixture.mean)
    if is_sky is not None:
        score = score - settings.sky_weight * _sky_shares(mixture, inside, is_sky)
    if under_strokes is not None and len(under_strokes) >= _STEM_PIXELS:
        bark = np.log((_shares(mixture, under_strokes) + 0.02) / (share[0] + 0.02))
        score = score - settings.bark_weight * np.maximum(bark, 0)
    # The best is one of leaves, the worst is not.
    score = np.where(score == score.max(), np.maximum(score, 0.5), score)
    score = np.where((score == score.min()) & (len(score) > 1), np.minimum(score, -0.5), score)
    return np.asarray(1 / (1 + np.exp(-settings.certainty * np.clip(score, -3, 3))))


def _shares(mixture: Mixture, colors: Floats) -> Floats:
    """(K,) how often colours are of each component."""
    if not len(colors):
        return np.zeros(len(mixture))
    best = np.argmax(log_parts(mixture, colors[:: max(1, len(colors) // 20_000)]), axis=1)
    return np.asarray(np.bincount(best, minlength=len(mixture)) / len(best))


def _sky_shares(mixture: Mixture, colors: Floats, is_sky: NDArray[np.bool_]) -> Floats:
    """(K,) 0 for components of which few colours are sky, to 1 for those of which nearly all are."""
    best = np.argmax(log_parts(mixture, colors), axis=1)
    count = np.bincount(best, minlength=len(mixture))
    share = np.bincount(best, weights=is_sky, minlength=len(mixture)) / np.maximum(count, 1)
    return np.asarray(np.clip((share - _SOME_SKY) / (_NEARLY_SKY - _SOME_SKY), 0, 1))  # fine leaves let sky through


def find_sky(srgb: NDArray[np.uint8], seed: int) -> NDArray[np.bool_]:
    """(h, w) the sky of a picture (H, W, 3), which is made small before."""
    scale = min(1.0, _SKY_PX / max(srgb.shape[:2]))
    small = cv2.resize(srgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(small.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    mean, square = (cv2.GaussianBlur(each, (0, 0), 1.5) for each in (lab[..., 0], lab[..., 0] ** 2))
    return segment_sky(lab, np.sqrt(np.maximum(square - mean**2, 0)), seed)


def _nearest(
    shape: tuple[int, ...], box: tuple[int, int, int, int], size: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the small sky that lie at those of a box of the picture, drawn in another size."""
    scale = min(1.0, _SKY_PX / max(shape))
    x = box[0] + (np.arange(size[0]) + 0.5) * (box[2] - box[0]) / size[0]
    y = box[1] + (np.arange(size[1]) + 0.5) * (box[3] - box[1]) / size[1]
    width, height = (max(1, round(side * scale)) for side in (shape[1], shape[0]))
    return np.clip((y * scale).astype(np.int64), 0, height - 1), np.clip((x * scale).astype(np.int64), 0, width - 1)


def _green_or_red(mean: Floats) -> Floats:
    """(K,) above 0 for colours of leaves, below for those of sky: how far green, or red, exceeds blue."""
    red, green, blue = mean.T
    total = red + green + blue + 30.0
    return np.asarray(np.clip(6 * (np.maximum(green, red) - blue) / total, -2, 2))


def fill_outline(outline_px: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(H, W) the pixels inside of a closed outline (N, 2), where it crosses itself by the even-odd rule's union."""
    drawn = np.zeros(size[::-1], np.uint8)
    cv2.fillPoly(drawn, [fixed_points(outline_px)], 1, lineType=cv2.LINE_8, shift=SHIFT)
    # What a crossing stroke leaves out in the middle is inside as well.
    contours, _ = cv2.findContours(drawn, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(drawn, contours, -1, 1, cv2.FILLED)
    return drawn > 0


def _enlarge(mask: NDArray[np.bool_], size: tuple[int, int]) -> NDArray[np.bool_]:
    return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_LINEAR) > 0.5)
