"""Leaves with their edits in them, moved, or put together."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits, apply_edits

RIGID = 1e-4  # how far a matrix may be from a rotation and a uniform scale, as a share of its scale


def bake_leaves(leaves: Leaves, edits: LeafEdits) -> Leaves:
    """Leaves whose parameters have the edits in them, rounded as they are stored; the jitter is no parameter.

    Args:
        leaves: In any frame.
        edits: Collective edits, in leaf lengths.
    """
    return replace(leaves, parameters=apply_edits(leaves.parameters, edits).astype(np.float32).astype(np.float64))


def remaining_edits(edits: LeafEdits) -> LeafEdits:
    """What no parameter can carry."""
    return replace(NEUTRAL, jitter_amplitude=edits.jitter_amplitude, jitter_frequency=edits.jitter_frequency)


def join_leaves(parts: Sequence[Leaves]) -> Leaves:
    """All leaves one after another; a fact that some lack is unknown of all.

    Args:
        parts: One or more sets of leaves in one frame.

    Raises:
        ValueError: There is no part.
    """
    fields: dict[str, Any] = {}
    for name in Leaves.__dataclass_fields__:
        arrays = [getattr(part, name) for part in parts]
        fields[name] = np.concatenate(arrays) if all(array is not None for array in arrays) else None
    return Leaves(**fields)


def move_leaves(leaves: Leaves, matrix: NDArray[np.float64]) -> Leaves:
    """Leaves moved, turned and scaled.

    Args:
        leaves: In the frame that the matrix leads from.
        matrix: (4, 4) for column vectors, metres: a turn, one scale for all axes, and a move.

    Raises:
        AssetError: The matrix shears, mirrors, or scales the axes differently.
    """
    if np.array_equal(matrix, np.eye(4)):
        return leaves
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    turn = matrix[:3, :3] / scale if scale > 0 else np.zeros((3, 3))
    if scale <= 0 or np.abs(turn @ turn.T - np.eye(3)).max() > RIGID:
        raise AssetError(
            "the leaves stand under a matrix that shears, mirrors or stretches them", "undo it and bake again"
        )
    if not len(leaves):
        return leaves
    orientation = (Rotation.from_matrix(turn) * Rotation.from_quat(leaves.orientation)).as_quat()
    return replace(
        leaves,
        base_m=leaves.base_m @ matrix[:3, :3].T + matrix[:3, 3],
        orientation=orientation,
        length_m=leaves.length_m * scale,
    )
