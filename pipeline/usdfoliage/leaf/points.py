"""The points of leaves, as a segmentation gives them to the fit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

INTERIOR, FREE_EDGE, HIDDEN_EDGE = 0, 1, 2  # kinds of points


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafPoints:
    """The points of M leaves, leaf after leaf; those of leaf i are offsets[i] to offsets[i + 1]."""

    points_m: NDArray[np.float64]  # (P, 3), in the world
    normals: NDArray[np.float64]  # (P, 3), unit, in the world, towards the camera that saw the point
    kind: NDArray[np.uint8]  # (P,), INTERIOR, FREE_EDGE or HIDDEN_EDGE
    point_view: NDArray[np.int32]  # (P,), number of the view that saw the point
    offsets: NDArray[np.int64]  # (M + 1,)
    confidence: NDArray[np.float64]  # (M,), 0 guessed to 1 surely one leaf
    view: NDArray[np.int32]  # (M,), number of the view that shows most of the leaf

    def __post_init__(self) -> None:
        points, leaves = len(self.points_m), len(self.offsets) - 1
        shapes: tuple[tuple[str, NDArray[np.generic], tuple[int, ...]], ...] = (
            ("points_m", self.points_m, (points, 3)),
            ("normals", self.normals, (points, 3)),
            ("kind", self.kind, (points,)),
            ("point_view", self.point_view, (points,)),
            ("confidence", self.confidence, (leaves,)),
            ("view", self.view, (leaves,)),
        )
        for name, array, shape in shapes:
            if array.shape != shape:
                raise ValueError(f"{name} must be {shape}, not {array.shape}")
        if leaves < 0 or self.offsets[0] != 0 or self.offsets[-1] != points or (np.diff(self.offsets) < 0).any():
            raise ValueError("offsets must rise from 0 to the number of points")

    def __len__(self) -> int:
        return len(self.offsets) - 1


def no_points() -> LeafPoints:
    """The points of no leaf."""
    return LeafPoints(
        points_m=np.zeros((0, 3)),
        normals=np.zeros((0, 3)),
        kind=np.zeros(0, np.uint8),
        point_view=np.zeros(0, np.int32),
        offsets=np.zeros(1, np.int64),
        confidence=np.zeros(0),
        view=np.zeros(0, np.int32),
    )
