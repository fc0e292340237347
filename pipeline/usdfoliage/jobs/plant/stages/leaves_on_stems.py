"""Leaves that are none: thin long patches of a stem, be it traced or seen by its colour alone. Our own."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.distances import place_on_axes
from usdfoliage.branch.model import Skeleton
from usdfoliage.jobs.plant.stages.plant_hue import find_plant_hue
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points

_ALONG = 12  # places on a leaf's axis
_WIDER = 2.5  # stems, that a patch of a stem is wide at most: depth is coarse at its border
_SLENDER = 0.4  # widths of such a patch for its length, at most
_LIES = 0.8  # share of the axis that lies on the stem
_PARALLEL = 0.8  # cosine of the angle between the two
_NARROW = 0.8  # of the median leaf's width for its length, below which a leaf may be a piece of a stem
_DULLER = 2.7  # of what hues of leaves are off at most: a piece of a stem as wide as the median leaf is farther off


def lie_along_stems(leaves: Leaves, skeleton: Skeleton) -> NDArray[np.bool_]:
    """(N,) leaves that are hardly wider than a stem whose course they follow; both in one frame, in metres."""
    if not len(leaves) or not (np.diff(skeleton.curve) == 0).any():
        return np.zeros(len(leaves), bool)
    axes = place_on_axes(skeleton, float(np.median(leaves.length_m)) / (2 * _ALONG))
    places = np.column_stack([np.zeros(_ALONG), np.linspace(0.05, 0.95, _ALONG)])
    points_m = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf())
    away_m, nearest = (np.asarray(each) for each in cKDTree(axes.points_m).query(points_m.reshape(-1, 3)))
    radius_m = skeleton.radius_m[axes.vertex][nearest].reshape(len(leaves), _ALONG)
    away_m = away_m.reshape(len(leaves), _ALONG)
    course = np.gradient(points_m, axis=1)
    course /= np.maximum(np.linalg.norm(course, axis=2, keepdims=True), 1e-12)
    parallel = (
        np.abs(np.einsum("nki,nki->nk", course, axes.direction[nearest].reshape(len(leaves), _ALONG, 3))) > _PARALLEL
    )
    width = leaf_width(leaves.parameters)
    on_stem = parallel & (away_m < radius_m + 0.5 * (width * leaves.length_m)[:, None])
    thin = width * leaves.length_m < _WIDER * 2 * np.median(radius_m, axis=1)
    return np.asarray(thin & (width < _SLENDER) & (on_stem.mean(axis=1) >= _LIES))


def find_dull_slivers(leaves: Leaves) -> NDArray[np.bool_]:
    """(N,) narrow leaves that are duller than the plant's leaves, as pieces of stems are that nobody traced.

    The plant's hue is that of the leaves that are not narrow. A narrow leaf is a piece of a stem where its hue is
    farther from it than the hues of those leaves are, the farther the wider the leaf is, and nearer to grey. Form alone
    does not decide, so that grasses keep their leaves, and colour alone does not either, so that young leaves stay.
    Where leaves have no colours, none is left out.
    """
    if not len(leaves):
        return np.zeros(0, bool)
    width = leaf_width(leaves.parameters)
    share = width / max(float(np.median(width)), 1e-12)
    narrow = share < _NARROW
    hue = find_plant_hue(leaves, ~narrow)
    if hue is None:
        return np.zeros(len(leaves), bool)
    duller = np.linalg.norm(hue.hues - 1 / 3, axis=1) < np.linalg.norm(hue.of_plant - 1 / 3)
    return np.asarray(narrow & duller & (hue.off > hue.allowed * np.maximum(_DULLER * share, 1)))
