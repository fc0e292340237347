"""Which end of a fitted leaf is its base.

What stands near either end, how bases and apices lie among other leaves, and how leaves taper and bend: each is a
number that changes its sign when the leaf is turned end for end. Stalks give the sign that the first ones have; the
others are learnt from the leaves at hand, by expectation maximisation. Nothing is known of species. Our own.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.capture.view import View
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.stalks import BOTH_ENDS, StalkPoints, StalkSettings, find_stalk_points
from usdfoliage.leaf.photographs.visibility import VisibilitySettings, estimate_spread
from usdfoliage.leaf.shape.surface import evaluate_grid, evaluate_points, grid_places

logger = logging.getLogger(__name__)

NEIGHBORS = 20  # leaves among which one leaf points inwards or outwards
NEAREST_ENDS = 4  # other bases and apices to which the distance is taken
FINEST = 0.03  # leaf lengths; nearer, distances count as equal
THINNEST = 0.02  # leaf lengths; narrower, widths count as equal
LIMIT = 2.5  # beyond so many root mean squares, a number counts no more than at that
CLEAREST = 0.95  # of the variance: that much at most may direction explain


@dataclass(frozen=True, kw_only=True)
class DirectionSettings:
    """How evidence is weighed."""

    # Before leaves are examined, stalks are expected at bases by this much. Unit: root mean squares. Range: 0 or
    # more.
    stalk: float = 0.6
    # Before leaves are examined, bases are expected to lie further inside the plant, and nearer to each other than
    # apices, by this much. Unit: root mean squares. Range: 0 or more.
    inwards: float = 0.2
    prior_leaves: float = 10.0  # That expectation weighs as much as this many leaves. Unit: leaves. Range: above 0.
    turns: int = 20  # Expectation maximisation runs this many turns. Range: 0 or more.
    stalks: StalkSettings = field(default_factory=StalkSettings)
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)

    def __post_init__(self) -> None:
        for name in ("stalk", "inwards"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ValueError(f"{name} must be 0 or more, not {getattr(self, name)}")
        if not (np.isfinite(self.prior_leaves) and self.prior_leaves > 0):
            raise ValueError(f"prior_leaves must be above 0, not {self.prior_leaves}")
        if self.turns < 0:
            raise ValueError(f"turns must be 0 or more, not {self.turns}")


@dataclass(frozen=True, kw_only=True, eq=False)
class DirectionResult:
    """Which of N leaves stand the wrong way round."""

    flip: NDArray[np.bool_]  # (N,), True where what was taken for the apex is the base
    certainty: NDArray[np.float64]  # (N,), 0.5 nothing is known to 1


def distinguish_base_from_apex(
    leaves: Leaves, views: Sequence[View], settings: DirectionSettings = DirectionSettings(), *, threads: int = 0
) -> DirectionResult:
    """Find which end of each leaf is the one at its stalk.

    Args:
        leaves: In the world of the views, base and apex as they came.
        views: Those without depth show no stalks.
        threads: That look for stalks; 0: one per core. The result is the same.
    """
    if not len(leaves):
        return DirectionResult(flip=np.zeros(0, bool), certainty=np.zeros(0))
    spread = estimate_spread(leaves, views, settings.visibility)
    stalks = find_stalk_points(leaves, views, spread, settings.stalks, threads=threads)
    of_stalks = _measure_stalks(leaves, stalks, settings.stalks.reach)
    of_place = _measure_place(leaves)
    of_shape = _measure_shape(leaves, views)
    evidence = np.column_stack([of_stalks, of_place, of_shape])
    expected = np.repeat(
        [settings.stalk, settings.inwards, 0.0], [of_stalks.shape[1], of_place.shape[1], of_shape.shape[1]]
    )
    octaves = learn_direction(evidence, expected, settings.prior_leaves, settings.turns)
    certainty = 1 / (1 + np.exp(-np.abs(octaves)))
    logger.info(
        "%d of %d leaves turned end for end; median certainty %.2f, from %d points of stalks",
        int(np.sum(octaves < 0)),
        len(leaves),
        float(np.median(certainty)),
        len(stalks.points_m),
    )
    return DirectionResult(flip=octaves < 0, certainty=certainty)


def learn_direction(
    evidence: NDArray[np.float64], expected: NDArray[np.float64], prior_leaves: float, turns: int
) -> NDArray[np.float64]:
    """Logarithm of the odds (N,) that leaves stand as they are rather than the other way round.

    Two normal distributions, the one the mirror image of the other, are fitted to the evidence. Their second moments
    about zero do not depend on which leaf belongs to which; their mean does, and is learnt by turns with the odds,
    which start from the evidence whose sign is expected alone.

    Args:
        evidence: (N, K) numbers that change their sign with the leaf's direction.
        expected: (K,), how strongly each is expected above 0 for leaves that stand rightly; 0 where nothing is known.
        prior_leaves: How many leaves without correlations are added to the moments: more make it more careful.
        turns: Of expectation maximisation; 0 uses what is expected alone.
    """
    scale = np.sqrt(np.mean(evidence**2, axis=0))
    scaled = np.divide(evidence, scale, out=np.zeros_like(evidence), where=scale > 0)
    scaled = np.clip(scaled, -LIMIT, LIMIT)
    count, kinds = scaled.shape
    moment = (scaled.T @ scaled + prior_leaves * np.eye(kinds)) / (count + prior_leaves)
    odds = 2 * scaled @ expected / max(float(expected.sum()), 1e-300)
    for _ in range(turns):
        mean = np.tanh(odds / 2) @ scaled / (count + prior_leaves)
        weights = np.linalg.solve(moment, mean)
        explained = min(float(mean @ weights), CLEAREST)
        odds = 2 * scaled @ weights / (1 - explained)  # by Sherman and Morrison, of the covariance about the mean
    return np.asarray(odds)


def _measure_stalks(leaves: Leaves, stalks: StalkPoints, reach: float) -> NDArray[np.float64]:
    """Above 0 where stalks are at the base: how many points, and how near, of all and of those not coloured as leaves.

    (N, 8).
    """
    count = len(leaves)
    ends = evaluate_points(leaves.parameters, BOTH_ENDS, placements=leaves.asset_from_leaf()).reshape(-1, 3)
    length_m = np.repeat(leaves.length_m, 2)
    if not len(stalks.points_m):
        return np.zeros((count, 8))
    pairs = cKDTree(ends).sparse_distance_matrix(
        cKDTree(stalks.points_m), float(reach * leaves.length_m.max()), output_type="ndarray"
    )
    away = pairs["v"] / length_m[pairs["i"]]
    numbers = []
    for share in (np.ones(len(stalks.points_m)), stalks.foreign):
        weight = share[pairs["j"]]
        for within in (0.4 * reach, 0.7 * reach, reach):
            points = np.bincount(pairs["i"], weight * (away <= within), 2 * count).reshape(count, 2)
            numbers.append(np.log((points[:, 0] + 1) / (points[:, 1] + 1)))
        nearest = np.full(2 * count, reach)
        chosen = weight > 0.5
        np.minimum.at(nearest, pairs["i"][chosen], away[chosen])
        near = nearest.reshape(count, 2) + FINEST
        numbers.append(np.log(near[:, 1] / near[:, 0]))
    return np.column_stack(numbers)


def _measure_place(leaves: Leaves) -> NDArray[np.float64]:
    """Above 0 where the base lies nearer to other leaves' ends than the apex, and further inside: (N, 3)."""
    count = len(leaves)
    if count < 3:
        return np.zeros((count, 3))
    placements = leaves.asset_from_leaf()
    ends = evaluate_points(leaves.parameters, BOTH_ENDS, placements=placements)
    middles = evaluate_points(leaves.parameters, np.array([[0.0, 0.5]]), placements=placements)[:, 0]
    axes = (ends[:, 1] - ends[:, 0]) / leaves.length_m[:, None]
    length_m = np.median(leaves.length_m)

    # The first two found are the end itself and, or not, the leaf's other one.
    others = min(NEAREST_ENDS + 2, 2 * count)
    distances = np.asarray(cKDTree(ends.reshape(-1, 3)).query(ends.reshape(-1, 3), k=others)[0])[:, 2:]
    away = distances.mean(axis=1).reshape(count, 2) / length_m + FINEST
    neighbors = np.asarray(cKDTree(middles).query(middles, k=min(NEIGHBORS + 1, count))[1])[:, 1:]
    outwards = np.einsum("nc,nc->n", axes, middles - middles[neighbors].mean(axis=1)) / length_m
    from_center = np.einsum("nc,nc->n", axes, middles - middles.mean(axis=0)) / length_m
    return np.column_stack([np.log(away[:, 1] / away[:, 0]), outwards, from_center])


def _measure_shape(leaves: Leaves, views: Sequence[View]) -> NDArray[np.float64]:
    """How leaves differ from base to apex, with a sign that nobody knows beforehand: (N, 9)."""
    v = np.array([0.1, 0.25, 0.4, 0.6, 0.75, 0.9])
    sides = evaluate_points(leaves.parameters, grid_places((-1.0, 1.0), v)).reshape(len(leaves), len(v), 2, 3)
    width = np.linalg.norm(sides[:, :, 1] - sides[:, :, 0], axis=-1) + THINNEST
    taper = np.log(width[:, :3] / width[:, :2:-1])
    axis = evaluate_points(leaves.parameters, grid_places(0.0, np.array([0.25, 0.75])))
    lifted = axis[:, 1, 2] - axis[:, 0, 2]
    arched = np.abs(axis[:, 1, 2]) - np.abs(axis[:, 0, 2])
    aside = np.abs(axis[:, 1, 0]) - np.abs(axis[:, 0, 0])
    # Photographs are taken upright, or most of them.
    up = -np.mean([view.camera.cam_from_world[1, :3] for view in views], axis=0) if views else np.zeros(3)
    placed = evaluate_grid(leaves.parameters, [0.0], [0.02, 0.98], placements=leaves.asset_from_leaf())
    slopes = (
        placed.tangents_v[:, :, 0] / np.maximum(np.linalg.norm(placed.tangents_v[:, :, 0], axis=-1), 1e-300)[..., None]
    )
    rises = slopes @ up
    return np.column_stack([taper, lifted, arched, aside, rises.sum(axis=1), np.abs(rises[:, 1]) - np.abs(rises[:, 0])])
