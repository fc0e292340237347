"""How similar two trees are: S_T, after O. Stava et al., Inverse procedural modelling of trees, 2014.

S_T = 1 - (d_shape + d_geometry + d_structure) / 3: 1 for the same tree, 0 where nothing is similar. Each distance lies
in [0, 1]. Two positive numbers a and b are |a - b| / (a + b) apart, two profiles sum |a - b| / sum (a + b). The source
names the three distances and what goes into them; weights and profiles are our own choice, so that figures compare with
each other and not with those of other papers.

shape      Mean of three: of the heights; of the crown's radius in 10 slabs of the taller one's height and 8 directions
           about the root, the farthest wood in each; of the length of wood in the 10 slabs.
geometry   For each order up to 3, means and standard deviations over its branches, weighed by their length, of five
           figures: length, mean radius, angle with the parent where it leaves it, slope (angle with the vertical of its
           chord), deviation (1 - chord / length). What an order is apart is the mean over the ten; orders are weighed
           by their share of both trees' length.
structure  Edit distance of the hierarchies, after P. Ferraro and C. Godin, A distance measure between plant
           architectures, 2000: branches are matched to branches so that ancestors stay ancestors, by best assignment of
           what leaves them; to match two costs the difference of their lengths, to leave one out its length. It is
           divided by all length. Of each tree the 150 branches that carry most are compared; one that is left out may
           have one of its own in its place.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from usdfoliage.branch.distances import sample_axes
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree

SLABS = 10
DIRECTIONS = 8
HIGHEST_ORDER = 3
COMPARED = 150  # branches, in the distance of structure


@dataclass(frozen=True, kw_only=True)
class Similarity:
    """Three distances, 0 for the same."""

    shape: float
    geometry: float
    structure: float

    @property
    def total(self) -> float:
        """S_T, 1 for the same."""
        return 1 - (self.shape + self.geometry + self.structure) / 3


def compare_trees(one: Skeleton, two: Skeleton) -> Similarity:
    """Compare two skeletons, Y up, in metres; where they stand does not matter."""
    return Similarity(
        shape=_shape_distance(one, two), geometry=_geometry_distance(one, two), structure=_structure_distance(one, two)
    )


def _apart(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    both = float(np.sum(np.abs(a) + np.abs(b)))
    return float(np.sum(np.abs(a - b))) / both if both > 0 else 0.0


def _shape_distance(one: Skeleton, two: Skeleton) -> float:
    heights = np.array([float(np.ptp(tree.points_m[:, 1])) for tree in (one, two)])
    tallest = float(heights.max())
    profiles = [_profiles(tree, tallest) for tree in (one, two)]
    widths, lengths = zip(*profiles, strict=True)
    return (_apart(heights[:1], heights[1:]) + _apart(*widths) + _apart(*lengths)) / 3


def _profiles(tree: Skeleton, height_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Farthest wood (slabs * directions,) and length of wood (slabs,), by height over the lowest point."""
    step_m = height_m / 500
    places_m, _, _ = sample_axes(tree, step_m)
    above_m = places_m[:, 1] - tree.points_m[:, 1].min()
    slab = np.clip((above_m / height_m * SLABS).astype(int), 0, SLABS - 1)
    sideways = places_m[:, [0, 2]] - tree.points_m[0, [0, 2]]
    turn = np.arctan2(sideways[:, 1], sideways[:, 0]) / (2 * np.pi) % 1.0
    cell = slab * DIRECTIONS + np.minimum((turn * DIRECTIONS).astype(int), DIRECTIONS - 1)
    widest = np.zeros(SLABS * DIRECTIONS)
    np.maximum.at(widest, cell, np.linalg.norm(sideways, axis=1))
    return widest, np.bincount(slab, minlength=SLABS) * step_m


def _geometry_distance(one: Skeleton, two: Skeleton) -> float:
    figures = [_branch_figures(tree) for tree in (one, two)]
    total = weight = 0.0
    for order in range(HIGHEST_ORDER + 1):
        rows = [each[tree.order == order] for each, tree in zip(figures, (one, two), strict=True)]
        length = float(sum(each[:, 0].sum() for each in rows))
        if length == 0:
            continue
        if all(len(each) for each in rows):
            means, spreads = zip(*(_weighed(each) for each in rows), strict=True)
            terms = [_apart(pair[0][k : k + 1], pair[1][k : k + 1]) for pair in (means, spreads) for k in range(5)]
            distance = float(np.mean(terms))
        else:
            distance = 1.0
        total, weight = total + length * distance, weight + length
    return total / weight


def _weighed(rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    share = rows[:, 0] / rows[:, 0].sum()
    mean = share @ rows
    return mean, np.sqrt(share @ (rows - mean) ** 2)


def _branch_figures(tree: Skeleton) -> NDArray[np.float64]:
    """(B, 5) length, mean radius, angle with the parent, slope, deviation."""
    first, last = tree.first, tree.first + tree.counts - 1
    chord = tree.points_m[last] - tree.points_m[first]
    size = np.linalg.norm(chord, axis=1)
    length = np.maximum(tree.lengths_m, 1e-9)
    radius = np.add.reduceat(tree.radius_m, first) / tree.counts
    start = _unit(tree.points_m[first + 1] - tree.points_m[first])
    vertex = np.maximum(tree.parent_vertex, 0)
    above = np.maximum(tree.parent_curve, 0)
    low = np.maximum(vertex - 1, first[above])
    along = _unit(tree.points_m[np.minimum(low + 1, last[above])] - tree.points_m[low])
    angle = np.where(tree.parent_curve >= 0, np.arccos(np.clip(np.sum(start * along, axis=1), -1, 1)), 0)
    slope = np.arccos(np.clip(chord[:, 1] / np.maximum(size, 1e-12), -1, 1))
    return np.stack([length, radius, angle, slope, 1 - np.minimum(size / length, 1)], axis=1)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Hierarchy:
    children: list[list[int]]
    length: NDArray[np.float64]
    carried: NDArray[np.float64]  # length of a branch and all that it carries
    parent: NDArray[np.int64]


def _largest(tree: Skeleton) -> _Hierarchy:
    """The branches that carry most; what carries one of them carries more, and so is among them."""
    carried = RootedTree(tree.parent_curve).sum_above(tree.lengths_m)
    kept = np.sort(np.lexsort([np.arange(len(tree)), -carried])[:COMPARED])
    number = np.full(len(tree), -1)
    number[kept] = np.arange(len(kept))
    parent = np.where(tree.parent_curve[kept] >= 0, number[tree.parent_curve[kept]], -1)
    length = tree.lengths_m[kept]
    children: list[list[int]] = [[] for _ in kept]
    for child, above in enumerate(parent.tolist()):
        if above >= 0:
            children[above].append(child)
    carried = RootedTree(parent.astype(np.int32)).sum_above(length)
    return _Hierarchy(children=children, length=length, carried=carried, parent=parent)


def _structure_distance(one: Skeleton, two: Skeleton) -> float:
    a, b = _largest(one), _largest(two)
    apart = np.zeros((len(a.length), len(b.length)))
    for i in reversed(range(len(a.length))):  # parents come first, so from the last one all children are known
        for j in reversed(range(len(b.length))):
            apart[i, j] = _tree_distance(i, j, a, b, apart)
    roots = (np.flatnonzero(each.parent < 0).tolist() for each in (a, b))
    whole = _forest_distance(*roots, a, b, apart)
    return whole / float(a.length.sum() + b.length.sum())


def _tree_distance(i: int, j: int, a: _Hierarchy, b: _Hierarchy, apart: NDArray[np.float64]) -> float:
    best = abs(float(a.length[i] - b.length[j])) + _forest_distance(a.children[i], b.children[j], a, b, apart)
    # Either may be left out, with one of its own in its place.
    if a.children[i]:
        kept = np.min(apart[a.children[i], j] - a.carried[a.children[i]])
        best = min(best, float(a.carried[i] + kept))
    if b.children[j]:
        kept = np.min(apart[i, b.children[j]] - b.carried[b.children[j]])
        best = min(best, float(b.carried[j] + kept))
    return best


def _forest_distance(
    some: list[int], others: list[int], a: _Hierarchy, b: _Hierarchy, apart: NDArray[np.float64]
) -> float:
    """Least cost of matching trees to trees, those left over being removed or inserted."""
    if not some or not others:
        return float(a.carried[some].sum() + b.carried[others].sum())
    rows, columns = len(some), len(others)
    cost = np.zeros((rows + columns, rows + columns))
    cost[:rows, :columns] = apart[np.ix_(some, others)]
    cost[:rows, columns:] = a.carried[some][:, None]
    cost[rows:, :columns] = b.carried[others]
    chosen = linear_sum_assignment(cost)
    return float(cost[chosen].sum())
