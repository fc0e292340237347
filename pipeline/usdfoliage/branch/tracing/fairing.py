"""Fair axes: smooth curves near the nodes that were found, without the noise of these."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.axes import Axes

_FIXED = 1e9  # weight of what must stay where it is
_EVEN = 0.03  # of the mean of two steps, that one of them counts as at least: equations stay well conditioned
_FREE = 1e-6  # of what has none, for the equations to have one solution
_TURNS = 5  # of holding what moves too far
_HARDER = 1.5  # power of how much too far, by which it is pulled back more


def fair_axes(
    center_m: NDArray[np.float64],
    axes: Axes,
    weight: NDArray[np.floating] | NDArray[np.integer],
    stiffness: float,
    max_moved_m: NDArray[np.floating] | float = np.inf,
) -> NDArray[np.float64]:
    """Nodes (S, 3) moved so that their axes bend little: least squares of the distance moved and of second differences.

    Axes are made fair after their parents, whose node they keep to. Nodes that would move too far are pulled back the
    more, turn by turn: a few may still end a little farther than they should.

    Args:
        center_m: (S, 3).
        axes: Chains of nodes.
        weight: (S,), how much a node is worth where it is.
        stiffness: Weight of a second difference, 0 for none.
        max_moved_m: Of a node (S,) or all, how far it may be from where it was.
    """
    fair_m = center_m.copy()
    if stiffness == 0:
        return fair_m
    limit_m = np.broadcast_to(max_moved_m, len(fair_m))
    order_of = axes.order[axes.axis_of]
    for order in range(int(axes.order.max(initial=-1)) + 1):
        entries = np.flatnonzero(order_of == order)
        nodes, own = axes.nodes[entries], axes.own[entries]
        pull = np.where(own, weight[nodes], _FIXED).astype(np.float64)
        bends = second_differences(axes.axis_of[entries])
        moved_m = _settle(fair_m[nodes], pull, own, stiffness * (bends.T @ bends), limit_m[nodes])
        fair_m[nodes[own]] = moved_m[own]
    return fair_m


def fair_branches(
    skeleton: Skeleton,
    weight: NDArray[np.floating],
    stiffness: NDArray[np.floating],
    max_moved_m: NDArray[np.floating],
) -> Skeleton:
    """The same branches with their vertices moved so that they bend little, as fair_axes does, however long edges are.

    A vertex without weight goes where the others draw the curve: with such ones between those that were found, the
    result is a smoothing spline (C. Reinsch, 1967). One whose weight is infinite stays. Branches begin where the vertex
    that they leave from was moved to.

    Args:
        skeleton: (V vertices).
        weight: (V,), how much a vertex is worth where it is; the ends of each branch have some.
        stiffness: (V,), weight of the second difference at a vertex.
        max_moved_m: (V,), how far a vertex that has weight may be from where it was. As with fair_axes, it is pulled
            back the more the farther it would be, turn by turn: a few may end a little beyond it.
    """
    points_m = skeleton.points_m.copy()
    order_of = skeleton.order[skeleton.curve]
    step_m = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    for order in range(int(skeleton.order.max(initial=-1)) + 1):
        entries = np.flatnonzero(order_of == order)
        curve = skeleton.curve[entries]
        begins = entries == skeleton.first[curve]
        leaves = begins & (skeleton.parent_vertex[curve] >= 0)
        points_m[entries[leaves]] = points_m[skeleton.parent_vertex[curve[leaves]]]
        stays = np.isinf(weight[entries]) & ~leaves
        pull = np.where(leaves | stays, _FIXED, weight[entries] + _FREE)
        bends = second_differences(curve, step_m[entries[:-1]])
        own = (weight[entries] > 0) & ~leaves & ~stays
        stiff = (bends.T @ diags_array(stiffness[entries[_middles(curve)]]) @ bends).tocsc()
        moved_m = _settle(points_m[entries], pull, own, stiff, max_moved_m[entries])
        moves = ~leaves & ~stays
        points_m[entries[moves]] = moved_m[moves]
    return replace(skeleton, points_m=points_m)


def second_differences(curve_of: NDArray[np.integer], step_m: NDArray[np.floating] | None = None) -> csc_array:
    """(M, K) a row for each place that has one before and one after it on its curve, of K places.

    Args:
        curve_of: (K,) the curve of each place; those of a curve follow one another.
        step_m: (K - 1,) from each place to the next; without it they count as even. Differences are divided by it and
            multiplied by its mean, so that rows do not depend on the unit.
    """
    count, middle = len(curve_of), _middles(curve_of) - 1
    before = after = np.ones(len(middle))
    if step_m is not None:
        mean_m = np.maximum(0.5 * (step_m[middle] + step_m[middle + 1]), 1e-12)
        before, after = (np.maximum(step_m[at] / mean_m, _EVEN) for at in (middle, middle + 1))
    rows = np.stack([1 / before, -1 / before - 1 / after, 1 / after], axis=1)
    return coo_array(
        (rows.ravel(), (np.repeat(np.arange(len(middle)), 3), (middle[:, None] + np.arange(3)).ravel())),
        shape=(len(middle), count),
    ).tocsc()


def _middles(curve_of: NDArray[np.integer]) -> NDArray[np.int64]:
    """(M,) places that have one before and one after them on their curve."""
    return np.flatnonzero(curve_of[2:] == curve_of[:-2]) + 1


def _settle(
    points_m: NDArray[np.float64],
    pull: NDArray[np.float64],
    limited: NDArray[np.bool_],
    stiff: csc_array,
    max_moved_m: NDArray[np.floating],
) -> NDArray[np.float64]:
    """(K, 3) where places are in balance; those that are limited are pulled back where they would move too far."""
    pull = pull.copy()
    for _ in range(_TURNS):
        matrix = (diags_array(pull) + stiff).tocsc()
        solver = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0, options={"SymmetricMode": True})
        moved_m = np.asarray(solver.solve(pull[:, None] * points_m))
        away = np.linalg.norm(moved_m - points_m, axis=1) / max_moved_m
        too_far = limited & (away > 1)
        if not too_far.any():
            break
        pull[too_far] *= away[too_far] ** _HARDER
    return moved_m
