"""The division of a leaf into faces, the same for every leaf: coarse within, fine along the silhouette."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.shape.surface import grid_places

# Shares of cosine spacing: silhouettes turn most at base and apex, and there the cells beside them are narrow.
SILHOUETTE_TOWARDS_ENDS = 0.25
ROWS_TOWARDS_ENDS = 0.6


@dataclass(frozen=True, kw_only=True)
class VertexPlaces:
    """Where the vertices of a division are, each from small to large, between 0 and 1 without these."""

    columns: tuple[float, ...]  # |u| of the inner vertices beside the axis
    rows: tuple[float, ...]  # v of the inner vertices
    silhouette: tuple[float, ...]  # v of a silhouette's vertices

    def __post_init__(self) -> None:
        for numbers in (self.columns, self.rows, self.silhouette):
            if not (np.diff([0.0, *numbers, 1.0]) > 0).all():
                raise ValueError(f"places must go up between 0 and 1, not {numbers}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafTopology:
    """Vertices in (u, v) and faces of one leaf; counter-clockwise where u runs to the right and v up.

    The vertices are the base, the apex, the inner ones row by row from base to apex, and those of the silhouettes from
    base to apex, left and right by turns.
    """

    uv: NDArray[np.float64]  # (P, 2), u from -1 left to 1 right, v from 0 at the base to 1 at the apex
    face_counts: NDArray[np.int32]  # (F,)
    face_vertices: NDArray[np.int32]  # (sum of face_counts,)

    @property
    def vertex_count(self) -> int:
        """Vertices of one leaf."""
        return len(self.uv)

    @property
    def triangles(self) -> NDArray[np.intp]:
        """(T, 3), vertices of the triangles that faces are drawn as, from their first corner on."""
        ends = np.cumsum(self.face_counts).tolist()
        faces = [self.face_vertices[end - n : end].tolist() for end, n in zip(ends, self.face_counts, strict=True)]
        return np.array([(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)], np.intp)

    @property
    def st(self) -> NDArray[np.float64]:
        """Texture coordinates (P, 2) of the vertices: ((u + 1) / 2, v)."""
        return np.column_stack([(self.uv[:, 0] + 1) / 2, self.uv[:, 1]])


@cache
def leaf_topology(
    across: int, along: int, silhouette: int, even: bool = False, places: VertexPlaces | None = None
) -> LeafTopology:
    """Divide a leaf into cells.

    Base and apex are one vertex each, with triangles around them. Where the silhouette is finer than the rows, the
    cells beside it are triangles that meet it edge by edge, without T-junctions.

    Args:
        across: cells from silhouette to silhouette, even, 4 or more, so that the axis is an edge.
        along: rows of cells from base to apex, 2 or more.
        silhouette: segments of either silhouette, along or more.
        even: Rows and segments are evenly spaced, which comes nearest to the surface where they are few; else they are
            drawn towards both ends.
        places: Where the vertices are, in place of that.

    Raises:
        ValueError: A number is not of this kind.
    """
    if across < 4 or across % 2:
        raise ValueError(f"across must be even and 4 or more, not {across}")
    if along < 2:
        raise ValueError(f"along must be 2 or more, not {along}")
    if silhouette < along:
        raise ValueError(f"silhouette must be {along}, the number of rows, or more, not {silhouette}")
    columns, rows = across - 1, along - 1
    inner_u = np.arange(1 - across // 2, across // 2) / (across // 2)
    silhouette_share, row_share = (0.0, 0.0) if even else (SILHOUETTE_TOWARDS_ENDS, ROWS_TOWARDS_ENDS)
    silhouette_v = towards_ends(np.arange(silhouette + 1) / silhouette, silhouette_share)
    row_steps = _rows_among(along, silhouette, row_share)  # each row ends at vertices of the silhouettes
    inner_v, silhouette_v = silhouette_v[row_steps[1:-1]], silhouette_v[1:-1]
    if even:
        inner_v = np.arange(1, along) / along
    if places is not None:
        if tuple(map(len, (places.columns, places.rows, places.silhouette))) != (across // 2 - 1, rows, silhouette - 1):
            raise ValueError("places must be as many as the vertices that they are for")
        right_u = np.array(places.columns)
        inner_u = np.concatenate([-right_u[::-1], [0.0], right_u])
        inner_v, silhouette_v = np.array(places.rows), np.array(places.silhouette)

    inner = 2 + np.arange(rows * columns).reshape(rows, columns)
    base, apex = np.full((1, columns), 0), np.full((1, columns), 1)
    inner = np.concatenate([base, inner, apex])
    outside = 2 + rows * columns + 2 * np.arange(silhouette - 1)
    left, right = (np.concatenate([[0], outside + side, [1]]) for side in (0, 1))

    faces: list[tuple[int, ...]] = []
    for row in range(along):
        low, high = inner[row].tolist(), inner[row + 1].tolist()
        beside = slice(row_steps[row], row_steps[row + 1] + 1)
        # Mirrored, so that the left half is the right one's mirror image; its faces are then turned over.
        faces += [face[::-1] for face in _beside_silhouette(low[0], high[0], left[beside].tolist())]
        for column in range(columns - 1):
            faces.append((low[column], low[column + 1], high[column + 1], high[column]))
        faces += _beside_silhouette(low[-1], high[-1], right[beside].tolist())
    faces = [tuple(dict.fromkeys(face)) for face in faces]  # at base and apex quads are triangles

    return LeafTopology(
        uv=np.concatenate(
            [[(0, 0), (0, 1)], grid_places(inner_u, inner_v), grid_places(np.array([-1.0, 1.0]), silhouette_v)]
        ),
        face_counts=np.array([len(face) for face in faces], np.int32),
        face_vertices=np.array([vertex for face in faces for vertex in face], np.int32),
    )


def towards_ends(t: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Rows evenly spaced in t, 0 to 1, drawn towards both ends by this share of cosine spacing."""
    return (1 - share) * t + share * (1 - np.cos(np.pi * t)) / 2


def _rows_among(along: int, silhouette: int, share: float) -> NDArray[np.intp]:
    """Which of the silhouette's vertices the along + 1 ends of the rows are; no two of them are the same."""
    row = np.arange(along + 1)
    nearest = np.rint(towards_ends(row / along, share) * silhouette).astype(np.intp)
    return np.minimum(np.maximum.accumulate(nearest - row) + row, silhouette - along + row)


def _beside_silhouette(low: int, high: int, outside: list[int]) -> list[tuple[int, ...]]:
    """Faces of a cell at the right silhouette, whose vertices there are these from bottom to top."""
    steps = len(outside) - 1
    if steps == 1:
        return [(low, outside[0], outside[1], high)]
    # Triangles around the lower inner vertex, then around the upper one; at base and apex around the other alone.
    turn = 0 if low == outside[0] else steps if high == outside[-1] else (steps + 1) // 2
    around_low = [(low, outside[k], outside[k + 1]) for k in range(turn)]
    between = [] if turn in (0, steps) else [(low, outside[turn], high)]
    around_high = [(high, outside[k], outside[k + 1]) for k in range(turn, steps)]
    return [*around_low, *between, *around_high]
