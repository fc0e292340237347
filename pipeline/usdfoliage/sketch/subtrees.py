"""The library of elementary subtrees that a tree grows from: predefined ones, and those that were traced.

P. Tan et al., Single image tree modeling, 2008, section 3.1: in a subtree of type I branches grow at the end of the
supporting branch, in one of type II along it. Their angles are those of the species.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.foliage.species import Species
from usdfoliage.geometry.directions import unit_vectors
from usdfoliage.geometry.lines import arc_lengths, points_at
from usdfoliage.sketch.axes import Axis

Floats = NDArray[np.float64]

MAX_SUBTREES = 8  # subtrees in the library, as in the paper
POINTS = 4  # of a child's axis
_BENT = 0.35  # of a child's angle, that it loses to its end


@dataclass(frozen=True, kw_only=True, eq=False)
class Subtree:
    """Branches on a supporting branch from (0, 0, 0) to (0, 1, 0)."""

    at: Floats  # (C,) share of the supporting branch, where each child leaves it
    children: Floats  # (C, POINTS, 3), each from (0, at, 0) on


def build_library(axes: Sequence[Axis], species: Species) -> list[Subtree]:
    """At most MAX_SUBTREES subtrees: of the traced branches, and predefined ones of both types.

    Args:
        axes: Of the traced branches, in space.
        species: How they branch.
    """
    predefined = predefined_subtrees(species)
    return [*traced_subtrees(axes)[: MAX_SUBTREES - len(predefined)], *predefined]


def predefined_subtrees(species: Species) -> list[Subtree]:
    """Two of type I, and three of type II."""
    angle, roll = species.branching_rad, species.roll_rad
    pairs = species.leaves_per_node == 2
    return [
        _subtree([(1.0, 0.55 * angle, 0.0, 0.75), (1.0, 0.7 * angle, np.pi, 0.6)]),
        _subtree([(1.0, 0.12, 0.0, 0.7), (1.0, 0.9 * angle, roll, 0.55), (1.0, 0.9 * angle, 2 * roll, 0.55)]),
        _subtree([(at, angle, k * roll, 0.6 * (1.15 - at) + 0.15) for k, at in enumerate((0.45, 0.65, 0.85))]),
        _subtree([(at, angle, k * roll, 0.5 * (1.2 - at) + 0.12) for k, at in enumerate((0.3, 0.45, 0.6, 0.75, 0.9))]),
        _subtree(
            [
                (at, angle, k * np.pi / 2 + side, 0.5 * (1.2 - at) + 0.12)
                for k, at in enumerate((0.4, 0.6, 0.8))
                for side in (0.0, np.pi)
            ]
            if pairs
            else [(0.55, angle, 0.0, 0.55), (0.8, 0.9 * angle, roll, 0.4), (1.0, 0.1, 0.0, 0.45)]
        ),
    ]


def traced_subtrees(axes: Sequence[Axis]) -> list[Subtree]:
    """Of each axis that carries two branches or more, what it carries; those with the most first."""
    carried: dict[int, list[Axis]] = {}
    for axis in axes:
        if axis.parent >= 0:
            carried.setdefault(axis.parent, []).append(axis)
    found = []
    for number, children in sorted(carried.items(), key=lambda item: (-len(item[1]), item[0])):
        support = axes[number]
        along = support.points[-1] - support.points[0]
        size = float(np.linalg.norm(along))
        if len(children) < 2 or size <= 0 or support.order == 0:
            continue
        turn = _frame(along / size).T
        arc = arc_lengths(support.points)
        at, lines = [], []
        for child in children:
            share = float(arc[child.parent_point] / max(arc[-1], 1e-9))
            line = (
                (points_at(child.points, np.linspace(0, arc_lengths(child.points)[-1], POINTS)) - child.points[0])
                @ turn.T
                / size
            )
            at.append(share)
            lines.append(line + np.array([0, share, 0]))
        found.append(Subtree(at=np.array(at), children=np.array(lines)))
    return found


def place_subtree(subtree: Subtree, support: Floats, rotations: int) -> Floats:
    """(rotations, C, POINTS, 3) the children on a supporting branch (K, 3), turned about it by equal angles."""
    along = support[-1] - support[0]
    size = float(np.linalg.norm(along))
    frame = _frame(along / max(size, 1e-9))
    base = points_at(support, subtree.at * arc_lengths(support)[-1])
    turn = 2 * np.pi * np.arange(rotations) / rotations
    cosine, sine, zero, one = np.cos(turn), np.sin(turn), np.zeros(rotations), np.ones(rotations)
    about = np.stack([cosine, zero, sine, zero, one, zero, -sine, zero, cosine], axis=-1).reshape(-1, 3, 3)
    offsets = (
        subtree.children - np.stack([np.zeros_like(subtree.at), subtree.at, np.zeros_like(subtree.at)], -1)[:, None]
    )
    turned = np.einsum("rab,cpb->rcpa", about, offsets)
    return np.asarray(base[:, None] + size * turned @ frame.T)


def _subtree(children: Sequence[tuple[float, float, float, float]]) -> Subtree:
    """A subtree of children: where, angle to the supporting branch, angle about it, and length in its lengths."""
    lines = []
    for at, angle, about, length in children:
        # Shoots turn to the direction of what carries them, towards the light.
        angles = angle * (1 - _BENT * np.linspace(0, 1, POINTS - 1))
        steps = np.stack([np.sin(angles) * np.cos(about), np.cos(angles), np.sin(angles) * np.sin(about)], axis=-1) * (
            length / (POINTS - 1)
        )
        lines.append(np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]) + np.array([0, at, 0]))
    return Subtree(at=np.array([each[0] for each in children]), children=np.array(lines))


def _frame(along: Floats) -> Floats:
    """(3, 3) columns: a direction across, along, and the other across."""
    helper = np.array([1.0, 0, 0]) if abs(along[0]) < 0.9 else np.array([0, 0, 1.0])
    across = unit_vectors(np.cross(along, np.cross(helper, along))[None])[0]
    return np.stack([across, along, np.cross(across, along)], axis=-1)
