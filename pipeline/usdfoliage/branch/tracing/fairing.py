"""Fair axes: smooth curves near the nodes that were found, without the noise of these."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu

from usdfoliage.branch.tracing.axes import Axes

_FIXED = 1e9  # weight of what must stay where it is
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
    order_of = axes.order[axes.axis_of]
    for order in range(int(axes.order.max(initial=-1)) + 1):
        entries = np.flatnonzero(order_of == order)
        nodes, axis_of = axes.nodes[entries], axes.axis_of[entries]
        count = len(entries)
        middle = np.flatnonzero(axis_of[2:] == axis_of[:-2]) if count > 2 else np.zeros(0, np.int64)
        rows = np.repeat(np.arange(len(middle)), 3)
        bend = coo_array(
            (np.tile([1.0, -2.0, 1.0], len(middle)), (rows, (middle[:, None] + np.arange(3)).ravel())),
            shape=(len(middle), count),
        ).tocsc()
        pull = weight[nodes].astype(np.float64)
        pull[~axes.own[entries]] = _FIXED
        stiff = stiffness * (bend.T @ bend)
        own = axes.own[entries]
        for _ in range(_TURNS):
            matrix = (diags_array(pull) + stiff).tocsc()
            solver = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0, options={"SymmetricMode": True})
            moved_m = solver.solve(pull[:, None] * fair_m[nodes])
            away = np.linalg.norm(moved_m - fair_m[nodes], axis=1) / np.broadcast_to(max_moved_m, len(fair_m))[nodes]
            too_far = own & (away > 1)
            if not too_far.any():
                break
            pull[too_far] *= away[too_far] ** _HARDER
        fair_m[nodes[own]] = moved_m[own]
    return fair_m
