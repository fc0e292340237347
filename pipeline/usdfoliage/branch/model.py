"""Branches: what all the rest of the system knows of them."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

_NONE_INFERRED = np.zeros(0, bool)  # stands for as many as there are branches


@dataclass(frozen=True, kw_only=True, eq=False)
class Skeleton:
    """The axes of a plant's branches, one polyline a branch, from where it leaves its parent to its tip.

    A branch comes after its parent. The first point of one that has a parent repeats the parent's vertex that it leaves
    from, with a radius of its own. Metres, Y up.

    Attributes:
        points_m: (V, 3), metres, branch after branch, from where a branch leaves its parent to its tip.
        radius_m: (V,), metres, above 0.
        counts: (B,), vertices of each branch, at least 2.
        parent_curve: (B,), number of the parent, -1 for a root.
        parent_vertex: (B,), index into points_m, -1 for a root.
        order: (B,), 0 for a trunk, else the parent's order + 1.
        inferred: (B,), whether the larger part of a branch was grown where nothing was traced; without it none was.

    Raises:
        ValueError: The arrays are not of these shapes, a number is not finite, a radius is not above 0, or branches are
            linked otherwise.
    """

    points_m: NDArray[np.float64]
    radius_m: NDArray[np.float64]
    counts: NDArray[np.int32]
    parent_curve: NDArray[np.int32]
    parent_vertex: NDArray[np.int32]
    order: NDArray[np.int32]
    inferred: NDArray[np.bool_] = field(default_factory=lambda: _NONE_INFERRED)

    def __post_init__(self) -> None:
        branches, vertices = len(self.counts), len(self.points_m)
        if self.inferred is _NONE_INFERRED:
            object.__setattr__(self, "inferred", np.zeros(branches, bool))
        shapes: tuple[tuple[str, NDArray[np.generic], tuple[int, ...]], ...] = (
            ("points_m", self.points_m, (vertices, 3)),
            ("radius_m", self.radius_m, (vertices,)),
            ("counts", self.counts, (branches,)),
            ("parent_curve", self.parent_curve, (branches,)),
            ("parent_vertex", self.parent_vertex, (branches,)),
            ("order", self.order, (branches,)),
            ("inferred", self.inferred, (branches,)),
        )
        for name, array, shape in shapes:
            if array.shape != shape:
                raise ValueError(f"{name} must be {shape}, not {array.shape}")
        if self.counts.sum() != vertices or (self.counts < 2).any():
            raise ValueError("counts must be 2 or more each, and together as many as there are points")
        if not np.isfinite(self.points_m).all() or not (np.isfinite(self.radius_m) & (self.radius_m > 0)).all():
            raise ValueError("points must be finite, radii finite and above 0")
        if (self.parent_curve >= np.arange(branches)).any() or (self.parent_curve < -1).any():
            raise ValueError("a branch must come after its parent")
        child = np.flatnonzero(self.parent_curve >= 0)
        from_first = self.parent_vertex[child] - self.first[self.parent_curve[child]]
        if (from_first < 0).any() or (from_first >= self.counts[self.parent_curve[child]]).any():
            raise ValueError("a branch must leave from a vertex of its parent")
        if not np.array_equal(self.points_m[self.first[child]], self.points_m[self.parent_vertex[child]]):
            raise ValueError("the first point of a branch must repeat the vertex of its parent")

    def __len__(self) -> int:
        return len(self.counts)

    @cached_property
    def first(self) -> NDArray[np.int32]:
        """(B,) index of each branch's first point."""
        return np.asarray(np.cumsum(self.counts) - self.counts, np.int32)

    @cached_property
    def curve(self) -> NDArray[np.int32]:
        """(V,) branch of each point."""
        return np.repeat(np.arange(len(self), dtype=np.int32), self.counts)

    @cached_property
    def edges_m(self) -> NDArray[np.float64]:
        """(V, 3) from the point before on its branch to each one; 0 for the first."""
        edges = np.diff(self.points_m, axis=0, prepend=self.points_m[:1])
        edges[self.first] = 0  # from one branch to the next
        return edges

    @cached_property
    def arcs_m(self) -> NDArray[np.float64]:
        """(V,) way to each point along its branch's axis."""
        walked = np.cumsum(np.linalg.norm(self.edges_m, axis=1))
        return np.asarray(walked - walked[self.first][self.curve])

    @cached_property
    def lengths_m(self) -> NDArray[np.float64]:
        """(B,) length of each branch along its axis."""
        return self.arcs_m[self.first + self.counts - 1]

    def branch(self, number: int) -> slice:
        """The points of a branch."""
        start = int(self.first[number])
        return slice(start, start + int(self.counts[number]))

    def up_to_order(self, order: int) -> "Skeleton":
        """The branches of this order and below it, which keep their parents."""
        return self.only(self.order <= order)

    def only(self, kept: NDArray[np.bool_]) -> "Skeleton":
        """The branches that are kept (B,); a parent of one must be as well."""
        number = np.cumsum(kept) - 1
        vertex = np.cumsum(kept[self.curve]) - 1
        parent, leaves_from = self.parent_curve[kept], self.parent_vertex[kept]
        return replace(
            self,
            points_m=self.points_m[kept[self.curve]],
            radius_m=self.radius_m[kept[self.curve]],
            counts=self.counts[kept],
            parent_curve=np.where(parent < 0, -1, number[parent]).astype(np.int32),
            parent_vertex=np.where(leaves_from < 0, -1, vertex[leaves_from]).astype(np.int32),
            order=self.order[kept],
            inferred=self.inferred[kept],
        )

    def only_vertices(self, kept: NDArray[np.bool_]) -> "Skeleton":
        """The same branches with the vertices that are kept (V,), at least two each, and all that others leave from."""
        number = np.cumsum(kept) - 1
        leaves_from = self.parent_vertex
        return replace(
            self,
            points_m=self.points_m[kept],
            radius_m=self.radius_m[kept],
            counts=np.add.reduceat(kept.astype(np.int32), self.first),
            parent_vertex=np.where(leaves_from < 0, -1, number[leaves_from]).astype(np.int32),
        )
