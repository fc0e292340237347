"""The flat leaf in space: functions turn, bend and twist of each branch rotate the turtle as it walks.

Source:
    L. Mündermann et al., Modeling lobed leaves, section 4.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.leaf.lobed.branches import LobedShape

Floats = NDArray[np.float64]

FUNCTIONS = ("turn", "bend", "twist")  # about the up direction, the left direction, the heading


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchFunctions:
    """Rotations of the turtle along the branches of a leaf, on top of those that its shape has.

    A function is a list of keys (K, 2): a position on the branch, from 0 to 1 and rising, and a rotation in radians a
    length of the branch; it is linear in between and constant beyond. Each sequence has one list a branch, which may
    be empty, or no list at all.
    """

    turn: Sequence[Floats] = field(default_factory=tuple)
    bend: Sequence[Floats] = field(default_factory=tuple)
    twist: Sequence[Floats] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        for name in FUNCTIONS:
            for keys in getattr(self, name):
                if np.ndim(keys) != 2 or np.shape(keys)[1] != 2 or not np.isfinite(keys).all():
                    raise ValueError(f"{name} must have lists of finite keys (position, rotation)")
                position = np.asarray(keys)[:, 0]
                if len(position) and not (position[0] >= 0 and position[-1] <= 1 and (np.diff(position) > 0).all()):
                    raise ValueError(f"positions of {name} must rise from 0 to 1 at most")


FLAT = BranchFunctions()


def bend_evenly(
    branches: int, *, turn_rad: float = 0.0, bend_rad: float = 0.0, twist_rad: float = 0.0, only: int | None = None
) -> BranchFunctions:
    """Functions that rotate each of so many branches by the same angle from its begin to its end, or one of them.

    Raises:
        ValueError: As add_evenly.
    """
    return add_evenly(FLAT, branches, turn_rad=turn_rad, bend_rad=bend_rad, twist_rad=twist_rad, only=only)


def add_evenly(
    functions: BranchFunctions,
    branches: int,
    *,
    turn_rad: float = 0.0,
    bend_rad: float = 0.0,
    twist_rad: float = 0.0,
    only: int | None = None,
) -> BranchFunctions:
    """Functions that rotate by so much more from the begin to the end of each of so many branches, or of one of them.

    Raises:
        ValueError: There is no such branch, or an angle is not finite.
    """
    if only is not None and not 0 <= only < branches:
        raise ValueError(f"branch must be 0 to {branches - 1}, not {only}")

    def more(lists: Sequence[Floats], angle: float) -> Sequence[Floats]:
        if not angle:
            return lists
        before = lists if len(lists) else (np.zeros((0, 2)),) * branches
        raised = [keys + np.array([0.0, angle]) if len(keys) else np.array([[0.0, angle]]) for keys in before]
        return tuple(raised[branch] if only in (None, branch) else keys for branch, keys in enumerate(before))

    return BranchFunctions(
        turn=more(functions.turn, turn_rad), bend=more(functions.bend, bend_rad), twist=more(functions.twist, twist_rad)
    )


def rotations_of(functions: BranchFunctions, branches: int) -> Floats:
    """(3, B) by how much turn, bend and twist rotate each of so many branches from its begin to its end, radians."""
    whole = np.zeros((len(FUNCTIONS), branches))
    for number, name in enumerate(FUNCTIONS):
        for branch, keys in enumerate(getattr(functions, name)):
            if len(keys):
                at = np.unique(np.concatenate([[0.0, 1.0], keys[:, 0]]))
                whole[number, branch] = np.trapezoid(np.interp(at, keys[:, 0], keys[:, 1]), at)
    return whole


def deform_leaves(shape: LobedShape, functions: Sequence[BranchFunctions], *, threads: int = 0) -> Floats:
    """Leaves of one shape, each deformed by its own functions.

    A branch begins in the frame that the branch which it leaves has there. Without functions a leaf is flat: exactly
    the places of its shape, with z = 0.

    Args:
        shape: N nodes and T ties.
        functions: Of M leaves.
        threads: At most so many; 0 for one per core. The result is the same for any number.

    Returns:
        (M, N + T, 3), the nodes and then the ends of the ties; x, y as the shape's, z above the leaf.

    Raises:
        ValueError: A function has lists of more or fewer branches than there are.
    """
    counts = np.zeros((len(functions), len(FUNCTIONS), shape.branch_count), np.int32)
    keys = [np.zeros((0, 2))]
    for leaf, own in enumerate(functions):
        for number, name in enumerate(FUNCTIONS):
            lists = getattr(own, name)
            if len(lists) not in (0, shape.branch_count):
                raise ValueError(f"{name} has lists of {len(lists)} branches, and there are {shape.branch_count}")
            for branch, each in enumerate(lists):
                counts[leaf, number, branch] = len(each)
                keys.append(np.asarray(each, np.float64))
    first = np.concatenate([[0], np.cumsum(counts.ravel(), dtype=np.int64)[:-1]]) if counts.size else counts.ravel()
    out = np.empty((len(functions), len(shape.nodes) + len(shape.feet), 3))
    _native.deform_lobed_leaves(
        np.ascontiguousarray(shape.nodes, np.float64),
        parents=shape.parents.astype(np.int32),
        branches=shape.branches.astype(np.int32),
        spans=np.ascontiguousarray(shape.spans()),
        tie_nodes=shape.tie_nodes.astype(np.int32),
        feet=np.ascontiguousarray(shape.feet, np.float64),
        key_first=first.astype(np.int64).reshape(counts.shape),
        key_counts=counts,
        keys=np.concatenate(keys),
        points=out,
        threads=threads,
    )
    return out
