"""Leaves for what the photograph shows as leaves and none of a tree covers. Our own.

Leaves stand on shoots by the species, and many of them are left out where the photograph shows none: on the narrow
limbs of a crown few are left. A gap gets a leaf from the twig beside it, which points over the gap.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.geometry.directions import unit_vectors
from usdfoliage.sketch.drawing import SHIFT, fixed_points, rows_and_columns

Floats = NDArray[np.float64]

_AT = 0.55  # of a leaf's length, where it covers the gap
_REACH = 0.9  # of its length, that a gap may be away from a twig
_TWIGS = 12  # that are compared
_APART = 0.4  # of a leaf's length, between the gaps that are filled at once
_AREA = 0.6  # of a leaf's length times its width, that it covers
_OWN = 0.5  # of that area, that no other leaf covers
_RIDGE = 0.85  # of the widest place beside it, from which on a place is in the middle of its gap
_TIP = 0.95  # of its length, that must be over leaves of the picture
_BEHIND = 0.2  # of a leaf's length: what a twig on the far side counts more
_TILT = 0.35  # standard deviation of a leaf's slope to the viewer
_WIDEST = (0.15, 0.45, 0.75)  # of a leaf's length, where its outline is drawn,
_WIDTHS = (0.3, 0.5, 0.3)  # in its width


@dataclass(frozen=True, kw_only=True)
class LeafFillSettings:
    """How gaps are filled."""

    rounds: int = 12
    narrowest: float = 0.06  # of a leaf's length, half of a gap that is filled
    enough: float = 0.004  # of the leaves in the picture; fewer open pixels need no leaf

    def __post_init__(self) -> None:
        if not (self.rounds >= 0 and self.narrowest > 0 and 0 <= self.enough < 1):
            raise ValueError(f"rounds must be 0 or more, narrowest above 0 and enough 0 to below 1, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class FilledLeaves:
    """Leaves over gaps, in the frame of a view."""

    base: Floats  # (N, 3), on a twig
    along: Floats  # (N, 3), unit, to the apex


def fill_gaps(
    covered: NDArray[np.bool_],
    mask: NDArray[np.bool_],
    allowed: NDArray[np.bool_],
    twigs: Floats,
    length_px: float,
    width: float,
    max_leaves: int,
    rng: np.random.Generator,
    settings: LeafFillSettings = LeafFillSettings(),
) -> FilledLeaves:
    """Leaves from twigs over what is not covered in a view of a tree: the photograph's own, or one from the side.

    Frame of the view: x to the right and y up, in pixels (y is minus the row), z towards the viewer, 0 in the middle.

    Args:
        covered: (H, W), by leaves and branches that there are.
        mask: (H, W), where leaves are to be seen.
        allowed: (H, W), where a leaf may end: that mask with its narrow gaps.
        twigs: (N, 3) places on thin twigs, in the frame of the view.
        length_px: Of a leaf.
        width: Of a leaf, in its lengths.
        max_leaves: No more than these.
        rng: For which gaps are first, and for the slopes of leaves.
        settings: How.
    """
    bases, alongs = [np.zeros((0, 3))], [np.zeros((0, 3))]
    if len(twigs) and length_px > 0:
        # At full width a cover of leaves would close gaps between them that it does not.
        drawn = covered.astype(np.uint8)
        tree = cKDTree(twigs[:, :2])
        left = max_leaves
        for _ in range(settings.rounds):
            open_px = mask & (drawn == 0)
            needed = float(open_px.sum() - settings.enough * mask.sum())
            if left <= 0 or needed <= 0:
                break
            gaps = _choose_gaps(open_px, length_px, settings, rng)
            base, along = _leaves_over(gaps, twigs, tree, allowed, length_px, rng)
            # Leaves lie over each other, about half of each over others; the next round covers what is left.
            count = min(left, int(np.ceil(needed / (_OWN * _AREA * width * length_px**2))))
            base, along = base[:count], along[:count]
            if not len(base):
                break
            bases.append(base)
            alongs.append(along)
            left -= len(base)
            _draw_leaves(drawn, base, along, length_px, width)
    return FilledLeaves(base=np.concatenate(bases), along=np.concatenate(alongs))


def _choose_gaps(
    open_px: NDArray[np.bool_], length_px: float, settings: LeafFillSettings, rng: np.random.Generator
) -> Floats:
    """(G, 2) middles of gaps, the widest first and none near another, in the frame of the picture."""
    away = cv2.distanceTransform(np.pad(open_px, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    middle = away >= _RIDGE * cv2.dilate(away, np.ones((3, 3), np.uint8))
    row, column = np.nonzero(middle & (away >= max(1.0, settings.narrowest * length_px)))
    if not len(row):
        return np.zeros((0, 2))
    wide = away[row, column] + rng.random(len(row))
    order = np.argsort(-wide, kind="stable")
    places = np.column_stack([column + 0.5, -(row + 0.5)])[order]
    near = cKDTree(places).query_ball_point(places, _APART * length_px, return_sorted=False)
    taken, chosen = np.zeros(len(places), bool), []
    for number in range(len(places)):
        if not taken[number]:
            chosen.append(number)
            taken[near[number]] = True
    return places[chosen]


def _leaves_over(
    gaps: Floats, twigs: Floats, tree: cKDTree, allowed: NDArray[np.bool_], length_px: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """(N, 3) bases and (N, 3) directions of a leaf over each gap that has a twig beside it."""
    if not len(gaps):
        return np.zeros((0, 3)), np.zeros((0, 3))
    count = min(_TWIGS, len(twigs))
    # Twigs about so far from the gap that a leaf's middle is over it: a ring, sampled by shifted places.
    turns = 2 * np.pi * np.arange(count) / count
    ring = gaps[:, None] + _AT * length_px * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    near = np.asarray(tree.query(ring.reshape(-1, 2))[1]).reshape(len(gaps), count)
    across = gaps[:, None] - twigs[near, :2]
    away = np.linalg.norm(across, axis=2)
    flat = across / np.maximum(away, 1e-9)[..., None]
    tips = twigs[near, :2] + _TIP * length_px * flat
    row, column, within = rows_and_columns(tips, allowed.shape)
    score = (
        np.abs(away - _AT * length_px)
        + length_px * ~(within & allowed[row, column])
        + _BEHIND * length_px * (twigs[near, 2] < 0)
        + 10 * length_px * ((away > _REACH * length_px) | (away < 1e-3))
    )
    best = score.argmin(axis=1)
    number = np.arange(len(gaps))
    good = score[number, best] < 0.9 * length_px
    number, best = number[good], best[good]
    slope = _TILT * rng.standard_normal(len(number))
    along = unit_vectors(np.column_stack([flat[number, best], slope]))
    return twigs[near[number, best]], along


def _draw_leaves(drawn: NDArray[np.uint8], base: Floats, along: Floats, length_px: float, width: float) -> None:
    """Draw leaves in the picture, as wide as they are seen from the front."""
    axis = along[:, :2] * [1, -1] * length_px
    start = base[:, :2] * [1, -1]
    side = np.column_stack([-axis[:, 1], axis[:, 0]]) * width
    right = [start + at * axis + wide * side for at, wide in zip(_WIDEST, _WIDTHS, strict=True)]
    left = [start + at * axis - wide * side for at, wide in zip(_WIDEST, _WIDTHS, strict=True)]
    for corners in fixed_points(np.stack([start, *right, start + axis, *left[::-1]], axis=1)):
        cv2.fillConvexPoly(drawn, corners, 1, shift=SHIFT)
