"""Meshes of leaves at a chosen resolution."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.surface import LEFT_OF_AXIS, evaluate_normals, grid_places
from usdfoliage.leaf.shape.topology import LeafTopology, VertexPlaces, leaf_topology

SEGMENTS_A_ROW = 2  # of the silhouette: with 16 rows it keeps 998 of 1000 pixels of the leaf, with one a row 994
SEGMENTS_A_CYCLE = 16  # of the silhouette, so that chords cut some 2 % of the jitter's amplitude at most
SEGMENTS_A_TEXEL = 2
MAX_SEGMENTS = 512  # beyond it, a jitter map is finer than a leaf is ever drawn
MIN_MEAN = np.float32(1e-4)  # below it, normals cancel: the leaf is folded flat
BLOCK = 512  # leaves evaluated at once, so that temporaries stay small


@dataclass(frozen=True, kw_only=True)
class LeafMeshSettings:
    """How finely each leaf is divided.

    Attributes:
        across: Cells from silhouette to silhouette, an even number, 4 or more.
        along: Rows of cells from base to apex, 2 or more.
        silhouette: Segments of either silhouette, `along` or more. None: two a row, and more where jitter needs them.

    Raises:
        ValueError: A number is out of its range.
    """

    across: int = 8
    along: int = 16
    silhouette: int | None = None

    def __post_init__(self) -> None:
        leaf_topology(self.across, self.along, self.along if self.silhouette is None else self.silhouette)


@dataclass(frozen=True, kw_only=True)
class PrototypeSettings:
    """How finely the leaf that an instancer repeats is divided: coarse within, fine along the silhouette."""

    across: int = 6
    along: int = 16
    silhouette: int = 128  # so that jitter of 8 cycles keeps 998 of 1000 pixels of the leaf
    even: bool = False  # whether rows and segments are evenly spaced, not drawn towards base and apex
    places: VertexPlaces | None = None  # in place of either

    def __post_init__(self) -> None:
        self.topology()

    def topology(self) -> LeafTopology:
        """The division."""
        return leaf_topology(self.across, self.along, self.silhouette, self.even, self.places)

    @property
    def triangles(self) -> int:
        """How many a leaf has."""
        return 2 * (self.across - 1) * (self.along - 1) + 2 * (self.silhouette - 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafMesh:
    """Leaves as one mesh, leaf after leaf; a flat leaf is counter-clockwise seen from its upper side.

    Attributes:
        points_m: (V, 3), metres in the asset's frame; in leaf space for a prototype.
        normals: (V, 3), unit vectors in the same frame.
        st: (V, 2), texture coordinates ((u + 1) / 2, v).
        face_counts: (F,), vertices of each face.
        face_vertices: (sum of face_counts,), indices into points_m.
    """

    points_m: NDArray[np.float32]
    normals: NDArray[np.float32]
    st: NDArray[np.float32]
    face_counts: NDArray[np.int32]
    face_vertices: NDArray[np.int32]


def silhouette_segments(min_segments: int, jitter: Jitter) -> int:
    """How many segments a silhouette needs to show its jitter: least, or more up to MAX_SEGMENTS."""
    if not jitter.amplitude:
        return min_segments
    a_cycle = SEGMENTS_A_CYCLE if jitter.map is None else SEGMENTS_A_TEXEL * len(jitter.map)
    return max(min_segments, math.ceil(min(jitter.frequency * a_cycle, MAX_SEGMENTS)))


def build_leaf_mesh(
    leaves: Leaves, settings: LeafMeshSettings = LeafMeshSettings(), jitter: Jitter = NO_JITTER
) -> LeafMesh:
    """All leaves in one mesh, every vertex on its leaf; jitter is part of the shape.

    Normals are those of the surface; on the axis the mean of both halves', at base and apex the mean over the leaf's
    width.

    Raises:
        AssetError: The vertices are more than a mesh can number.
    """
    segments = settings.silhouette
    if segments is None:
        segments = silhouette_segments(SEGMENTS_A_ROW * settings.along, jitter)
    topology = leaf_topology(settings.across, settings.along, segments)
    count, vertices = len(leaves), topology.vertex_count
    if count * len(topology.face_vertices) > np.iinfo(np.int32).max:
        raise AssetError(
            f"{count} leaves of {vertices} vertices are too many for one mesh", "choose fewer cells across and along"
        )
    points_m = np.empty((count, vertices, 3), np.float32)
    normals = np.empty((count, vertices, 3), np.float32)
    for first in range(0, count, BLOCK):
        chosen = np.arange(first, min(first + BLOCK, count))
        block = leaves.take(chosen)
        points_m[chosen], normals[chosen] = _evaluate(
            block.parameters, topology, jitter, block.phase, block.asset_from_leaf()
        )
    offsets = vertices * np.arange(count, dtype=np.int32)[:, None]
    return LeafMesh(
        points_m=points_m.reshape(-1, 3),
        normals=normals.reshape(-1, 3),
        st=np.tile(topology.st.astype(np.float32), (count, 1)),
        face_counts=np.tile(topology.face_counts, count),
        face_vertices=(topology.face_vertices + offsets).reshape(-1),
    )


def build_prototype(parameters: NDArray[np.floating], settings: PrototypeSettings = PrototypeSettings()) -> LeafMesh:
    """One leaf (7, 3), in leaf space, for an instancer; st is where each vertex lies on any leaf.

    Raises:
        ValueError: parameters are not (7, 3).
    """
    if np.shape(parameters) != (7, 3):
        raise ValueError(f"parameters must be (7, 3), not {np.shape(parameters)}")
    topology = settings.topology()
    points, normals = _evaluate(np.asarray(parameters)[None], topology)
    return LeafMesh(
        points_m=points[0],
        normals=normals[0],
        st=topology.st.astype(np.float32),
        face_counts=topology.face_counts,
        face_vertices=topology.face_vertices,
    )


def _evaluate(
    parameters: NDArray[np.floating],
    topology: LeafTopology,
    jitter: Jitter = NO_JITTER,
    phase: NDArray[np.float64] | None = None,
    placements: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points and unit normals (N, P, 3) of the topology's vertices."""
    uv = topology.uv
    count = len(uv)
    on_axis = np.flatnonzero((uv[:, 0] == 0) & (uv[:, 1] > 0) & (uv[:, 1] < 1))
    columns = np.unique(uv[:, 0])
    # Where normals are means: the left half at the axis, and every column's limit at base and apex.
    beside_axis = uv[on_axis] + (LEFT_OF_AXIS, 0)
    places = np.concatenate([uv, beside_axis, grid_places(columns, np.array([0.0, 1.0]))])
    points, facing = evaluate_normals(parameters, places, jitter, phase, placements=placements, dtype=np.float32)
    normals = facing[:, :count]
    halves = np.stack([normals[:, on_axis], facing[:, count : count + len(on_axis)]], axis=2)
    normals[:, on_axis] = _mean_direction(halves)
    normals[:, :2] = _mean_direction(facing[:, count + len(on_axis) :].reshape(-1, 2, len(columns), 3))
    return points[:, :count], normals


def _mean_direction(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit means (N, P, 3) of normals (N, P, K, 3); the first where they cancel each other."""
    mean = normals.mean(axis=2)
    length = np.linalg.norm(mean, axis=-1, keepdims=True)
    return np.where(length > MIN_MEAN, mean / np.maximum(length, MIN_MEAN), normals[:, :, 0])
