"""The envelope of a crown: an egg or a cone, placed where it parts the picture best.

It distinguishes the tree that was meant from its neighbours, the lawn and the hedge behind, which colour alone cannot.
Our own.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

_GRID_PX = 90  # longest side of the grid on which envelopes are compared
_RING = 1.2  # what an envelope is compared with: itself, grown by this
_WORTH_SPREAD = 0.1  # answers that differ less in worth are equally good
_BELOW_EXPONENT = 2.5  # of the part below the widest row

# What is worth how much, against the share of the parting (0 to 1) that the envelope explains.
_WORTH_AREA = 0.10  # a factor e of area
_WORTH_PLACE = 0.30  # colours of the middle instead of those of the lower border and the sides
_COST_SKY_INSIDE = 5.0
_COST_CROWN_ABOVE = 2.0  # what stands before the sky above the envelope, as a share of its area
_COST_ASYMMETRY = 0.10
_COST_OFF_CENTER = 0.06
_COST_ASPECT = 0.03


class Envelope(NamedTuple):
    """In pixels of the picture that it was fitted to."""

    axis_px: float  # column
    top_px: float
    bottom_px: float
    left_px: float  # half-width to the left of the axis
    right_px: float
    widest: float  # height of the widest row, 0 at the top and 1 at the bottom
    exponent: float  # of the part above it: 1 a cone, 2 an ellipse

    def fill(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """(H, W), true inside."""
        left, right = _row_spans(np.array([self]), *shape, 0.0)
        columns = np.arange(shape[1])
        return np.asarray((columns >= left[0][:, None]) & (columns < right[0][:, None]))


class Candidate(NamedTuple):
    """One of the envelopes that a picture may be read as having."""

    envelope: Envelope
    weight: float  # all candidates together 1
    contrast: float  # 0 to 1, how much inside and ring differ


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
    """Prefix sums along the rows of the reduced picture, (h, w + 1, classes): clusters, open sky, sky in gaps."""

    sums: NDArray[np.float64]
    solid: NDArray[np.float64]  # (h, w + 1), the same for all that is not sky
    solid_area: NDArray[np.float64]  # (h + 1, w + 1), summed along both
    worth: NDArray[np.float64]  # (classes,), how welcome each class is


def fit_crown_envelopes(
    clusters: NDArray[np.integer],
    sky: NDArray[np.bool_],
    liking: NDArray[np.float64],
    searches: int,
    rng: np.random.Generator,
) -> list[Candidate]:
    """Find the envelopes whose inside differs most from the ring around them.

    The difference is the Jensen-Shannon divergence of the two histograms of clusters, sky being one of them. Several
    searches, each from its own start, show whether there is one answer or several.

    Args:
        clusters: (H, W), what each pixel looks like, 0 to K - 1.
        sky: (H, W), pixels of the sky, whatever their cluster.
        liking: (K,), how welcome each cluster is inside, against a difference of 0 to 1.
        searches: How many.
        rng: For their starts and steps.

    Returns:
        What the searches found, the best first.
    """
    height, width = clusters.shape
    scale = min(1.0, _GRID_PX / max(height, width))
    rows, columns = max(8, round(height * scale)), max(8, round(width * scale))
    grid = _build_grid(clusters, sky, liking, rows, columns)
    found = sorted((_search(grid, rng) for _ in range(searches)), key=lambda result: -result[1])
    weights = np.exp([(worth - found[0][1]) / _WORTH_SPREAD for _, worth, _ in found])
    weights /= weights.sum()
    x, y = width / columns, height / rows
    pixels = np.array([x, y, y, x, x, 1, 1])
    return [
        Candidate(Envelope(*(float(value) for value in place * pixels)), float(weight), contrast)
        for (place, _, contrast), weight in zip(found, weights, strict=True)
    ]


def _search(grid: _Grid, rng: np.random.Generator) -> tuple[NDArray[np.float64], float, float]:
    """The best envelope found from one random start, its worth and its contrast."""
    rows, columns = grid.solid.shape[0], grid.solid.shape[1] - 1
    # axis, top, bottom, left, right, widest, exponent
    low = np.array([0.2 * columns, -0.05 * rows, 0.35 * rows, 0.05 * columns, 0.05 * columns, 0.25, 1.0])
    high = np.array([0.8 * columns, 0.6 * rows, 0.95 * rows, 0.6 * columns, 0.6 * columns, 0.92, 2.6])
    found = rng.uniform(low, high, (500, 7))
    worth, contrast = _judge(found, grid)
    for turn in range(12):  # the best survive, and others are tried near them
        best = np.argsort(-worth, kind="stable")[:20]
        parents = found[best][rng.integers(0, len(best), 80)]
        spread = (high - low) * 0.12 * 0.8**turn
        near = parents + rng.normal(size=parents.shape) * spread * (rng.random(parents.shape) < 0.5)
        near = np.clip(near, low, high)
        near_worth, near_contrast = _judge(near, grid)
        found = np.concatenate([found[best], near])
        worth = np.concatenate([worth[best], near_worth])
        contrast = np.concatenate([contrast[best], near_contrast])
    winner = int(np.argmax(worth))
    return found[winner], float(worth[winner]), float(contrast[winner])


def _build_grid(
    clusters: NDArray[np.integer], sky: NDArray[np.bool_], liking: NDArray[np.float64], rows: int, columns: int
) -> _Grid:
    count = len(liking)
    classes = np.where(sky, np.where(_open_sky(sky), count, count + 1), clusters)
    shares = np.dstack(
        [
            cv2.resize((classes == k).astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
            for k in range(count + 2)
        ]
    ).astype(np.float64)

    y, x = np.mgrid[0:rows, 0:columns]
    across, down = (x + 0.5) / columns, (y + 0.5) / rows
    middle = np.exp(-0.5 * (((across - 0.5) / 0.18) ** 2 + ((down - 0.45) / 0.2) ** 2))
    border = (down > 0.9) + 0.5 * (np.abs(across - 0.5) > 0.44)
    in_middle = np.einsum("yxk,yx->k", shares, middle / middle.sum())
    on_border = np.einsum("yxk,yx->k", shares, border / border.sum())
    place = (in_middle - on_border) / (in_middle + on_border + 1e-3)
    worth = np.zeros(count + 2)
    worth[:count] = _WORTH_PLACE * place[:count] + liking
    worth[count] = -_COST_SKY_INSIDE

    sums = np.zeros((rows, columns + 1, count + 2))
    np.cumsum(shares, axis=1, out=sums[:, 1:])
    solid = sums[..., :count].sum(axis=2)
    solid_area = np.zeros((rows + 1, columns + 1))
    np.cumsum(solid, axis=0, out=solid_area[1:])
    return _Grid(sums=sums, solid=solid, solid_area=solid_area, worth=worth)


def _open_sky(sky: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Sky around the trees; the rest of it shows through gaps, and may lie inside a crown."""
    height, width = sky.shape
    radius = max(1, int(0.006 * (height + width)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    solid = cv2.copyMakeBorder((~sky).astype(np.uint8), *4 * (2 * radius,), cv2.BORDER_REPLICATE)
    solid = cv2.morphologyEx(solid, cv2.MORPH_CLOSE, disc)[2 * radius : -2 * radius, 2 * radius : -2 * radius]
    _, labels, stats, _ = cv2.connectedComponentsWithStats(1 - solid, connectivity=4)
    is_open = (stats[:, cv2.CC_STAT_TOP] == 0) | (stats[:, cv2.CC_STAT_AREA] > 0.06 * sky.size)
    is_open[0] = False
    return np.asarray(is_open[labels])


def _row_spans(
    envelopes: NDArray[np.float64], rows: int, columns: int, grow: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First column inside and first one outside, each (N, rows), of envelopes (N, 7) grown by a share of their size."""
    axis, top, bottom, left, right, widest, exponent = (envelopes[:, [k]] for k in range(7))
    bottom = np.maximum(bottom, top + 1)
    margin = grow * np.sqrt((bottom - top) * (left + right)) / 2
    top, bottom, left, right = top - margin, bottom + margin, left + margin, right + margin
    t = (np.arange(rows) + 0.5 - top) / (bottom - top)
    above = t < widest
    away = np.clip(np.where(above, 1 - t / widest, (t - widest) / (1 - widest)), 0, 1)  # 0 in the widest row
    power = np.where(above, exponent, _BELOW_EXPONENT)
    reach = np.where((t < 0) | (t > 1), 0, (1 - away**power) ** (1 / power))
    first = np.clip(np.rint(axis - left * reach), 0, columns).astype(np.intp)
    end = np.clip(np.rint(axis + right * reach), 0, columns).astype(np.intp)
    return first, np.maximum(first, end)


def _judge(envelopes: NDArray[np.float64], grid: _Grid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Worth and contrast of envelopes (N, 7), each (N,)."""
    rows, columns = grid.solid.shape[0], grid.solid.shape[1] - 1
    axis, top, bottom, left, right, widest, _ = envelopes.T
    first, end = _row_spans(envelopes, rows, columns, 0.0)
    ring_first, ring_end = _row_spans(envelopes, rows, columns, _RING - 1)
    y = np.arange(rows)
    inside = _sum_spans(grid.sums, first, end)
    around = np.maximum(_sum_spans(grid.sums, ring_first, ring_end) - inside, 0)
    area = inside.sum(axis=1)
    share = (area / np.maximum(area + around.sum(axis=1), 1e-9))[:, None]
    p = inside / np.maximum(area, 1e-9)[:, None]
    q = around / np.maximum(around.sum(axis=1), 1e-9)[:, None]
    contrast = _entropy(share * p + (1 - share) * q) - share[:, 0] * _entropy(p) - (1 - share[:, 0]) * _entropy(q)
    contrast = contrast / np.log(2)

    # What is not sky in the columns of the envelope, above its widest row, and not inside.
    west = np.clip(axis - 0.85 * left, 0, columns).astype(np.intp)
    east = np.clip(axis + 0.85 * right, 0, columns).astype(np.intp)
    widest_row = np.clip(top + widest * (bottom - top), 0, rows).astype(np.intp)
    boxed = grid.solid_area[widest_row, east] - grid.solid_area[widest_row, west]
    core_first, core_end = (np.clip(edge, west[:, None], east[:, None]) for edge in (first, end))
    covered = np.sum((grid.solid[y, core_end] - grid.solid[y, core_first]) * (y < widest_row[:, None]), axis=1)
    above = np.maximum(boxed - covered, 0) / np.maximum(area, 1e-9)

    tall = np.maximum(bottom - top, 1)
    worth = contrast + _WORTH_AREA * np.log(np.maximum(area, 1e-9) / (rows * columns)) + p @ grid.worth
    worth -= _COST_CROWN_ABOVE * above
    worth -= _COST_ASYMMETRY * np.log(left / right) ** 2
    worth -= _COST_OFF_CENTER * ((axis / columns - 0.5) / 0.15) ** 2
    worth -= _COST_ASPECT * np.log(tall / (left + right) / 1.1) ** 2
    worth[(area < 0.02 * rows * columns) | (tall < 0.1 * rows)] -= 10
    return worth, contrast


def _sum_spans(sums: NDArray[np.float64], first: NDArray[np.intp], end: NDArray[np.intp]) -> NDArray[np.float64]:
    """Sum of each class between first and end of all rows, (N, classes)."""
    total = np.zeros((len(first), sums.shape[2]))
    for row in range(sums.shape[0]):
        total += sums[row, end[:, row]] - sums[row, first[:, row]]
    return total


def _entropy(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(-np.sum(shares * np.log(shares + 1e-9), axis=1))
