"""Colours of leaves, from all photographs that show them. Our own."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.geometry.color import decode_srgb, luminance
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.reprojection import draw_leaf_ids
from usdfoliage.leaf.photographs.visibility import PRESUMED, SEEN, VisibilitySettings, estimate_spread, find_sights
from usdfoliage.leaf.shape.surface import grid_places

logger = logging.getLogger(__name__)

DECODED = decode_srgb(np.arange(256) / 255.0)  # (256,), linear
DARKEST = 1 / 255  # linear; darker, noise decides what the ratio of two colours is
CLIPPED = 254  # encoded; from here on a channel may have been anything
GAIN_TURNS = 8


@dataclass(frozen=True, kw_only=True)
class PhotoColorSettings:
    """Where colours are read."""

    across: int = 7  # Colours are read at this many places from silhouette to silhouette. Range: 1 or more.
    along: int = 13  # Colours are read at this many places from base to apex. Range: 1 or more.
    # This share of the half width, and of the length at base and apex, is left out. Range: 0 to below 0.5.
    border: float = 0.15
    equalize_exposure: bool = True  # true matches the brightness of photographs where they show the same leaves.
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)

    def __post_init__(self) -> None:
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
    colors = np.zeros((len(views), len(leaves), len(uv), 3))
    weights = np.zeros((len(views), len(leaves), len(uv)))
    for number, view in enumerate(views):
        drawn = None
        if (view.depth_m <= 0).any():
            drawn = draw_leaf_ids(leaves, view.camera, settings.visibility.draw)
        sights = find_sights(leaves, view, uv, spread, settings.visibility, drawn)
        is_seen = ((sights.state == SEEN) | (sights.state == PRESUMED)) & sights.inner
        columns, rows = sights.places_px[is_seen].astype(np.intp).T
        encoded = view.srgb[rows, columns]
        colors[number][is_seen] = DECODED[encoded]
        weights[number][is_seen] = np.abs(sights.facing[is_seen]) * (encoded.max(axis=1) < CLIPPED)

    gain = _find_gains(colors, weights) if settings.equalize_exposure else np.ones(len(views))
    colors /= gain[:, None, None, None]
    seen = weights.sum(axis=(0, 2)) > 0
    color = np.full((len(leaves), 3), 0.18)
    for leaf in np.flatnonzero(seen):
        used = weights[:, leaf] > 0
        color[leaf] = weighted_median(colors[:, leaf][used], weights[:, leaf][used])
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


def _find_gains(colors: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """How bright photographs (V,) are, from the same places (V, N, P, 3) in several of them; the median one is 1."""
    places = weights.shape[1] * weights.shape[2]
    light = luminance(colors.reshape(len(colors), places, 3))
    used = (weights.reshape(len(colors), places) > 0) & (light > DARKEST)
    common = used.sum(axis=0) > 1
    shift = np.zeros(len(colors))
    octaves = np.where(used, np.log2(np.maximum(light, DARKEST)), np.nan)[:, common]
    linked = used[:, common].any(axis=1)  # a photograph that shares nothing with others keeps its exposure
    for _ in range(GAIN_TURNS if linked.any() else 0):
        of_place = np.nanmedian(octaves - shift[:, None], axis=0)
        shift[linked] = np.nanmedian(octaves[linked] - of_place, axis=1)
        shift[linked] -= np.median(shift[linked])
    return np.asarray(2**shift)
