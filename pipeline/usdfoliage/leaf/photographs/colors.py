"""Colours of leaves, from all photographs that show them. Our own."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.geometry.color import decode_srgb, luminance
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.reprojection import draw_leaf_ids
from usdfoliage.leaf.photographs.visibility import (
    PRESUMED,
    SEEN,
    VisibilitySettings,
    estimate_spread,
    find_open,
    find_sights,
)
from usdfoliage.leaf.shape.surface import grid_places

logger = logging.getLogger(__name__)

DECODED = decode_srgb(np.arange(256) / 255.0)  # (256,), linear
DARKEST = 1 / 255  # linear; darker, noise decides what the ratio of two colours is
CLIPPED = 254  # encoded; from here on a channel may have been anything
GAIN_TURNS = 8
_MAX_PLACES = 1000  # no photograph shows more of a leaf
BLOCK = 1 << 17  # places of leaves, or colours of them, that are handled at once: some 50 MB


@dataclass(frozen=True, kw_only=True)
class PhotoColorSettings:
    """Where colours are read."""

    across: int = 7  # Colours are read at this many places from silhouette to silhouette. Range: 1 to 1000.
    along: int = 13  # Colours are read at this many places from base to apex. Range: 1 to 1000.
    # This share of the half width, and of the length at base and apex, is left out. Range: 0 to below 0.5.
    border: float = 0.15
    equalize_exposure: bool = True  # true matches the brightness of photographs where they show the same leaves.
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)

    def __post_init__(self) -> None:
        if max(self.across, self.along) > _MAX_PLACES:
            raise ValueError(f"across and along must be at most {_MAX_PLACES}, not {self.across} and {self.along}")
        if self.across < 1 or self.along < 1:
            raise ValueError(f"across and along must be 1 or more, not {self.across} and {self.along}")
        if not 0 <= self.border < 0.5:
            raise ValueError(f"border must be from 0 to below 0.5, not {self.border}")

    @property
    def uv(self) -> NDArray[np.float64]:
        """(P, 2)."""
        u = np.linspace(self.border - 1, 1 - self.border, self.across)
        return grid_places(u, np.linspace(self.border, 1 - self.border, self.along))


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafColors:
    """Colours of N leaves, and how bright V photographs are."""

    color: NDArray[np.float64]  # (N, 3), linear Rec.709
    seen: NDArray[np.bool_]  # (N,), False where the colour is the median of the others'
    gain: NDArray[np.float64]  # (V,), by which a photograph is brighter than the median one


def sample_leaf_colors(
    leaves: Leaves, views: Sequence[View], settings: PhotoColorSettings = PhotoColorSettings()
) -> LeafColors:
    """Read the colour of every leaf: the median of what all photographs show of it, frontal places counting more.

    Photographs differ in exposure; what several of them show gives the factor. Leaves that none shows get the median
    colour of the others, all of them mid grey where none is seen at all.

    Args:
        leaves: In the world of the views.
    """
    uv = settings.uv
    spread = estimate_spread(leaves, views, settings.visibility)
    seen_by = [_find_seen(leaves, view, uv, spread, settings) for view in views]
    gain = _find_gains(seen_by, len(leaves) * len(uv)) if settings.equalize_exposure else np.ones(len(views))
    color, seen = _find_medians(seen_by, gain, len(leaves), len(uv))
    if seen.any():
        color[~seen] = np.median(color[seen], axis=0)
    logger.info(
        "colours of %d leaves, %d of them seen in no photograph; exposures differ by %.3f to %.3f",
        len(leaves),
        int(np.sum(~seen)),
        gain.min(initial=1.0),
        gain.max(initial=1.0),
    )
    return LeafColors(color=color, seen=seen, gain=gain)


def weighted_median(values: NDArray[np.floating], weights: NDArray[np.floating]) -> NDArray[np.float64]:
    """Lower weighted median of each column: (C,) from values (K, C) and weights (K,), which sum to more than 0."""
    order = np.argsort(values, axis=0, kind="stable")
    reached = np.cumsum(weights[order], axis=0)
    place = np.argmax(reached >= reached[-1] / 2, axis=0)
    return np.asarray(np.take_along_axis(values, np.take_along_axis(order, place[None], axis=0), axis=0)[0], np.float64)


class _SeenPlaces(NamedTuple):
    """What one photograph shows of K places of leaves; the others need no memory."""

    number: NDArray[np.int32]  # (K,), of the leaf, times the places of a leaf, plus that of the place; ascending
    srgb: NDArray[np.uint8]  # (K, 3), encoded
    weight: NDArray[np.float64]  # (K,), above 0


def _find_seen(
    leaves: Leaves, view: View, uv: NDArray[np.float64], spread: float, settings: PhotoColorSettings
) -> _SeenPlaces:
    """The places whose colours a photograph shows, found for some leaves after others."""
    drawn = holes = None
    if (view.depth_m <= 0).any():
        drawn = draw_leaf_ids(leaves, view.camera, settings.visibility.draw)
        holes = find_open(leaves, view)
    numbers, colors, weights = [np.zeros(0, np.int32)], [np.zeros((0, 3), np.uint8)], [np.zeros(0)]
    step = max(1, BLOCK // len(uv))
    for first in range(0, len(leaves), step):
        block = leaves.take(np.arange(first, min(first + step, len(leaves))))
        sights = find_sights(block, view, uv, spread, settings.visibility, drawn, holes)
        is_seen = ((sights.state == SEEN) | (sights.state == PRESUMED)) & sights.inner
        columns, rows = sights.places_px[is_seen].astype(np.intp).T
        encoded = view.srgb[rows, columns]
        weight = np.abs(sights.facing[is_seen]) * (encoded.max(axis=1) < CLIPPED)
        used = weight > 0
        numbers.append((first * len(uv) + np.flatnonzero(is_seen)[used]).astype(np.int32))
        colors.append(encoded[used])
        weights.append(weight[used])
    return _SeenPlaces(np.concatenate(numbers), np.concatenate(colors), np.concatenate(weights))


def _find_medians(
    seen_by: Sequence[_SeenPlaces], gain: NDArray[np.float64], leaves: int, places: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Colours of leaves (N, 3) at the median exposure, mid grey for those that no photograph shows; who is seen (N,).

    Args:
        seen_by: Of each photograph.
        gain: (V,), how bright each is.
        leaves: N.
        places: Of a leaf.
    """
    color, seen = np.full((leaves, 3), 0.18), np.zeros(leaves, np.bool_)
    step = max(1, BLOCK // max(1, places * len(seen_by)))
    for first in range(0, leaves, step):
        parts = [_between(each, first * places, (first + step) * places) for each in seen_by]
        owner = np.concatenate([np.zeros(0, np.int32), *(part.number // places for part in parts)])
        order = np.argsort(owner, kind="stable")  # of a leaf the first photograph comes first
        linear = [np.zeros((0, 3)), *(DECODED[part.srgb] / bright for part, bright in zip(parts, gain, strict=True))]
        values = np.concatenate(linear)[order]
        weights = np.concatenate([np.zeros(0), *(part.weight for part in parts)])[order]
        numbers, starts = np.unique(owner[order], return_index=True)
        ends = np.append(starts, len(order))[1:]
        for leaf, start, end in zip(numbers, starts, ends, strict=True):
            color[leaf] = weighted_median(values[start:end], weights[start:end])
        seen[numbers] = True
    return color, seen


def _between(seen: _SeenPlaces, first: int, end: int) -> _SeenPlaces:
    """Places from one number to before another."""
    own = slice(*np.searchsorted(seen.number, (first, end)))
    return _SeenPlaces(seen.number[own], seen.srgb[own], seen.weight[own])


def _find_gains(seen_by: Sequence[_SeenPlaces], places: int) -> NDArray[np.float64]:
    """How bright photographs (V,) are, from what several of them show of so many places; the median one is 1."""
    lights = [luminance(DECODED[seen.srgb]) for seen in seen_by]
    counts = np.zeros(places, np.int32)
    for seen, light in zip(seen_by, lights, strict=True):
        counts[seen.number[light > DARKEST]] += 1
    common = counts > 1
    renumbered = np.cumsum(common, dtype=np.int32) - 1  # among those that several show
    numbers, octaves = [], []
    for seen, light in zip(seen_by, lights, strict=True):
        used = (light > DARKEST) & common[seen.number]
        numbers.append(renumbered[seen.number[used]])
        octaves.append(np.log2(light[used]))
    linked = np.array([len(own) > 0 for own in numbers], np.bool_)
    shift = np.zeros(len(seen_by))  # a photograph that shares nothing with others keeps its exposure
    for _ in range(GAIN_TURNS if linked.any() else 0):
        of_place = _median_of_places(numbers, octaves, shift, int(np.count_nonzero(common)))
        for view in np.flatnonzero(linked):
            shift[view] = np.median(octaves[view] - of_place[numbers[view]])
        shift[linked] -= np.median(shift[linked])
    return np.asarray(2**shift)


def _median_of_places(
    numbers: Sequence[NDArray[np.int32]], octaves: Sequence[NDArray[np.float64]], shift: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Median over the photographs of the light of each of so many places, in octaves, less the photographs' shift."""
    of_place = np.zeros(count)
    step = max(1, BLOCK // len(numbers))
    for first in range(0, count, step):
        some = np.full((len(numbers), min(step, count - first)), np.nan)
        for row, own, light, bright in zip(some, numbers, octaves, shift, strict=True):
            start, end = np.searchsorted(own, (first, first + step))
            row[own[start:end] - first] = light[start:end] - bright
        of_place[first : first + step] = np.nanmedian(some, axis=0)
    return of_place
