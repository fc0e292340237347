"""Railroad ties as steps of a turtle, and back.

A turtle walks along each branch in the leaf's plane: from tie to tie by a turn and a step, and from there along the tie
by another. Angles are counter-clockwise seen from above the leaf; those of the paper's equations are clockwise.

Source:
    L. Mündermann et al., Modeling lobed leaves, section 4, equations 2 and 3.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.lobed.branches import LobedShape

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_AXIS_HEADING = np.pi / 2  # of the turtle before the axis begins: +y


@dataclass(frozen=True, kw_only=True, eq=False)
class TurtleTies:
    """Ties in the order of their first appearance along the skeleton, branch after branch; lengths as the leaf's."""

    branches: Ints  # (T,)
    k_length: Floats  # (T,), step along the branch from the tie before, for its first tie from where it begins
    k_turn_rad: Floats  # (T,), before that step; for a first tie from the heading of the branch that this one leaves
    t_length: Floats  # (T,), of the tie
    t_turn_rad: Floats  # (T,), from the heading to the tie


def ties_to_turtle(shape: LobedShape) -> TurtleTies:
    """The ties of a leaf as steps of the turtle; every node of the skeleton must have a tie.

    Raises:
        ValueError: A node has no tie.
    """
    if len(np.unique(shape.tie_nodes)) != len(shape.nodes):
        raise ValueError("every node of the skeleton needs a tie")
    node, heading = shape.tie_nodes, shape.headings()
    again = np.concatenate([[False], node[1:] == node[:-1]])  # a tie where the one before begins
    begin = np.where(again, node, shape.parents[node])
    begin[0] = 0
    step = shape.nodes[node] - shape.nodes[begin]  # K, eq. 2
    before = np.where(begin > 0, heading[begin], np.where(node == 0, _AXIS_HEADING, heading[0]))
    before[again] = heading[node[again]]
    tie = shape.feet - shape.nodes[node]  # T, eq. 3
    t_length = np.linalg.norm(tie, axis=1)
    t_angle = np.where(t_length > 0, np.arctan2(tie[:, 1], tie[:, 0]), heading[node])
    return TurtleTies(
        branches=shape.branches[node],
        k_length=np.linalg.norm(step, axis=1),
        k_turn_rad=_wrap(heading[node] - before),
        t_length=t_length,
        t_turn_rad=_wrap(t_angle - heading[node]),
    )


def ties_from_turtle(nodes: Floats, parents: Ints, branches: Ints, turtle: TurtleTies) -> tuple[Floats, Floats]:
    """Where ties begin and end.

    Args:
        nodes: (N, 2), of the skeleton: where a branch begins, and in which direction it is left, is read of them.
        parents: (N,), -1 for the base.
        branches: (N,), that leads to each node.
        turtle: T ties.

    Returns:
        (T, 2) where they begin on the skeleton, and (T, 2) where they end.
    """
    first = np.searchsorted(branches, np.arange(int(branches.max()) + 1))
    begins, ends = np.empty((len(turtle.branches), 2)), np.empty((len(turtle.branches), 2))
    for branch, start in enumerate(first.tolist()):
        own = np.flatnonzero(turtle.branches == branch)
        fork = max(int(parents[start]), 0)
        heading = _AXIS_HEADING
        if branch:
            # A branch that leaves at the base has the heading in which the axis leaves it.
            came = nodes[fork] - nodes[parents[fork]] if fork else nodes[1] - nodes[0]
            heading = float(np.arctan2(came[1], came[0]))
        angle = heading + np.cumsum(turtle.k_turn_rad[own])
        step = turtle.k_length[own, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        begins[own] = nodes[fork] + np.cumsum(step, axis=0)
        angle = angle + turtle.t_turn_rad[own]
        ends[own] = begins[own] + turtle.t_length[own, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return begins, ends


def _wrap(angle: Floats) -> Floats:
    """Angles from -π to π."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
