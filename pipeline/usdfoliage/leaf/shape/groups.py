"""A few shapes that stand for many leaves: for renderers that repeat shapes, and cannot bend each leaf by itself.

Every leaf gets the shape of one leaf of the set. The first shape is that of the leaf nearest to the mean, each further
one that of the leaf farthest from all before it (a greedy k-centre); then each group takes the leaf in its middle, as
long as the leaves come nearer to their shapes. Our own arrangement.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.surface import evaluate_grid

_ACROSS, _ALONG = np.linspace(-1, 1, 5), np.linspace(0, 1, 5)  # places at which leaves are compared
_ROUNDS = 8  # of groups and their middles


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafGroups:
    """K shapes for N leaves."""

    chosen: NDArray[np.int64]  # (K,), the leaf whose shape each group has
    group: NDArray[np.int32]  # (N,)
    away: NDArray[np.float64]  # (N,), root mean square distance of a leaf from its shape, in leaf lengths

    def __len__(self) -> int:
        return len(self.chosen)


def group_leaves(leaves: Leaves, count: int) -> LeafGroups:
    """Choose at most count of the leaves, whose shapes stand for all.

    Args:
        leaves: In any frame: shapes are compared in leaf space, without the jitter.
        count: 1 or more; with as many as there are leaves, each leaf keeps its own shape.

    Raises:
        ValueError: count is below 1.
    """
    if count < 1:
        raise ValueError(f"count must be 1 or more, not {count}")
    total = len(leaves)
    if total <= count:
        return LeafGroups(
            chosen=np.arange(total), group=np.arange(total, dtype=np.int32), away=np.zeros(total, np.float64)
        )
    points = evaluate_grid(leaves.parameters, _ACROSS, _ALONG).points.reshape(total, -1)
    points = points / np.sqrt(points.shape[1] / 3)  # so that a distance is a root mean square over the places
    chosen = [int(np.argmin(_distances(points, points.mean(axis=0))))]
    nearest = _distances(points, points[chosen[0]])
    while len(chosen) < count and nearest.max() > 0:
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, _distances(points, points[chosen[-1]]))
    centers = np.array(chosen)
    group, away = _nearest(points, centers)
    for _ in range(_ROUNDS):
        moved = _middles(points, group, len(centers))
        next_group, next_away = _nearest(points, moved)
        if np.square(next_away).sum() >= np.square(away).sum():
            break
        centers, group, away = moved, next_group, next_away
    return LeafGroups(chosen=centers, group=group, away=away)


def _distances(points: NDArray[np.float64], center: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(points - center, axis=1))


def _nearest(points: NDArray[np.float64], centers: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """The nearest of the centres to each leaf (N,), and how far it is."""
    group, away = np.zeros(len(points), np.int32), np.full(len(points), np.inf)
    for number, center in enumerate(centers):
        distance = _distances(points, points[center])
        nearer = distance < away
        group[nearer], away[nearer] = number, distance[nearer]
    return group, away


def _middles(points: NDArray[np.float64], group: NDArray[np.int32], count: int) -> NDArray[np.int64]:
    """The leaf of each group that is nearest to the group's mean; every group has its centre."""
    middles = np.empty(count, np.int64)
    for number in range(count):
        members = np.flatnonzero(group == number)
        middles[number] = members[np.argmin(_distances(points[members], points[members].mean(axis=0)))]
    return middles
