"""How similar two trees are, by shape, geometry and structure, wherever each of their branches is.

After S_T of J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 6.2, which has
it from Stava et al., Inverse procedural modelling of trees, 2014: 1 for trees that agree, 0 for no similarity.
Our terms are others: figures of those papers are on another scale. Branches shorter than 2 % of the height are left
out, since clouds show few of them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.axis_places import places_at
from usdfoliage.branch.distances import place_on_axes
from usdfoliage.branch.model import Skeleton

_LOW = 0.1  # of its largest extent, that a plant is high at least, for what is compared by its height
_SHORT = 0.02  # of the height, below which branches are left out; directions are taken over as much
_LAYERS = 10  # of the height, whose radii are compared
_ORDERS = 3  # beyond the trunk, that are compared
_LITTLE = 0.03  # share of the wood of both trees, below which an order is not compared
_WIDE = 0.95  # quantile of the distances of wood from its middle, that is the radius of a crown

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class TreeTraits:
    """What is compared of a tree. Each array of an order has that of the trunks first, and NaN where there is none."""

    height_m: float
    crown_m: float  # radius of the crown, seen from above
    fork_deg: float  # mean angle between a branch and the one that it leaves; NaN where there is none
    layers: Array  # (10,), radius of the wood in each tenth of the height, over the height
    numbers: Array  # (4,), of branches of each order
    lengths: Array  # (4,), their mean length over the height
    angles_deg: Array  # (4,), their mean angle with what they leave; NaN for trunks
    slopes_deg: Array  # (4,), their mean angle with the horizontal
    wood: Array  # (4,), their share of the length of all axes


@dataclass(frozen=True, kw_only=True)
class TreeSimilarity:
    """Of two trees, 0 to 1 each."""

    shape: float  # heights, crown radii, and radii at each height
    geometry: float  # lengths, angles and slopes of branches of the same order
    structure: float  # numbers of branches of each order, and their shares of the wood

    @property
    def total(self) -> float:
        """S_T."""
        return (self.shape + self.geometry + self.structure) / 3


def measure_traits(skeleton: Skeleton) -> TreeTraits:
    """What is compared of a tree, metres, Y up."""
    foot_m = float(skeleton.points_m[skeleton.first[skeleton.parent_curve < 0], 1].min())
    extent_m = np.ptp(skeleton.points_m, axis=0)
    # A plant may hang from its root, or lie.
    height_m = max(float(extent_m[1]), _LOW * float(extent_m.max()), 1e-6)
    counted = (skeleton.lengths_m >= _SHORT * height_m) | (skeleton.parent_curve < 0)
    places = place_on_axes(skeleton, _SHORT * height_m / 2)
    places_m = places.points_m[counted[skeleton.curve[places.vertex]]]
    from_middle_m = np.linalg.norm((places_m - places_m.mean(axis=0))[:, [0, 2]], axis=1)
    layer = np.clip(((places_m[:, 1] - foot_m) / height_m * _LAYERS).astype(np.int64), 0, _LAYERS - 1)
    wide = [np.quantile(from_middle_m[layer == each], _WIDE) if (layer == each).any() else 0 for each in range(_LAYERS)]
    along = _directions(skeleton, np.arange(len(skeleton)), np.zeros(len(skeleton)), _SHORT * height_m)
    angle_deg = np.full(len(skeleton), np.nan)
    child = np.flatnonzero(skeleton.parent_curve >= 0)
    springs_m = skeleton.arcs_m[skeleton.parent_vertex[child]]
    below = _directions(skeleton, skeleton.parent_curve[child], springs_m, _SHORT * height_m, around=True)
    angle_deg[child] = np.degrees(np.arccos(np.clip(np.einsum("bc,bc->b", along[child], below), -1, 1)))
    ends_m = skeleton.points_m[skeleton.first + skeleton.counts - 1] - skeleton.points_m[skeleton.first]
    slope_deg = np.degrees(np.arctan2(ends_m[:, 1], np.linalg.norm(ends_m[:, [0, 2]], axis=1)))
    of_order = [counted & (skeleton.order == order) for order in range(_ORDERS + 1)]
    length_m = skeleton.lengths_m
    wood = np.array([length_m[each].sum() for each in of_order])
    forks = counted & (skeleton.parent_curve >= 0)
    return TreeTraits(
        height_m=height_m,
        crown_m=float(np.quantile(from_middle_m, _WIDE)),
        fork_deg=_mean(angle_deg[forks]),
        layers=np.array(wide) / height_m,
        numbers=np.array([each.sum() for each in of_order], np.float64),
        lengths=np.array([_mean(length_m[each]) for each in of_order]) / height_m,
        angles_deg=np.array([_mean(angle_deg[each]) for each in of_order]),
        slopes_deg=np.array([_mean(slope_deg[each]) for each in of_order]),
        wood=wood / max(float(wood.sum()), 1e-300),
    )


def compare_trees(one: TreeTraits, other: TreeTraits) -> TreeSimilarity:
    """How similar two trees are."""
    # Below so much a crown is none, as of bare trunks.
    narrow_m = _SHORT * max(one.height_m, other.height_m)
    crowns = _ratio(max(one.crown_m, narrow_m), max(other.crown_m, narrow_m))
    layers = max(float((one.layers + other.layers).sum()), 2 * _LAYERS * _SHORT)
    spread = np.abs(one.layers - other.layers).sum() / layers
    shape = [_ratio(one.height_m, other.height_m), crowns, 1 - float(spread)]
    # Of an order that hardly any wood is of, a single twig decides.
    orders = np.flatnonzero(np.maximum(one.wood, other.wood) >= _LITTLE)
    geometry = [
        *_compare(one.lengths[orders], other.lengths[orders], _ratio),
        *_compare(one.angles_deg[orders], other.angles_deg[orders], _agree),
        *_compare(one.slopes_deg[orders], other.slopes_deg[orders], _agree),
    ]
    structure = [
        *_compare(one.numbers[orders], other.numbers[orders], _ratio),
        1 - float(np.abs(one.wood - other.wood).sum()) / 2,
    ]
    return TreeSimilarity(
        shape=float(np.mean(shape)), geometry=float(np.mean(geometry)), structure=float(np.mean(structure))
    )


def _directions(
    skeleton: Skeleton, curve: NDArray[np.integer], arc_m: Array, over_m: float, *, around: bool = False
) -> Array:
    """(B, 3) unit directions of branches from places along them, or around these."""
    start_m = places_at(skeleton, curve, arc_m - (over_m if around else 0.0)).between(skeleton.points_m)
    along_m = places_at(skeleton, curve, arc_m + over_m).between(skeleton.points_m) - start_m
    return np.asarray(along_m / np.maximum(np.linalg.norm(along_m, axis=1, keepdims=True), 1e-300))


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _compare(one: Array, other: Array, agree: Callable[[float, float], float]) -> list[float]:
    """How numbers of the same orders agree: 0 where one tree has no such branches, nothing where neither has."""
    return [
        agree(a, b) if np.isfinite([a, b]).all() else 0.0
        for a, b in zip(one.tolist(), other.tolist(), strict=True)
        if np.isfinite([a, b]).any()
    ]


def _agree(one_deg: float, other_deg: float) -> float:
    return max(0.0, 1 - abs(one_deg - other_deg) / 90)


def _ratio(one: float, other: float) -> float:
    return float(min(one, other) / max(one, other)) if max(one, other) > 0 else 1.0
