"""Catmull–Clark cages of leaves: few control points whose limit surface is the leaf, nearly.

All leaves share one topology, so the limit is one linear map of a cage's vertices, and the cage nearest to a leaf in
the mean square is one linear map of the leaf's control net: a small matrix, found once. The method is our own.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from usdfoliage._native import refine_catmull_clark
from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.nurbs import net_weights
from usdfoliage.leaf.shape.surface import LEFT_OF_AXIS, evaluate_normals, evaluate_points, grid_places, leaf_nets
from usdfoliage.leaf.shape.topology import LeafTopology, leaf_topology, towards_ends

SHARP = 10.0  # OpenSubdiv's infinite sharpness
# Shares of cosine spacing: in v silhouettes turn most at base and apex; in u either half ends without curvature, as
# subdivision does at borders and creases, and shorter faces there leave less of a leaf's curvature out.
V_TOWARDS_ENDS = 0.5
U_TOWARDS_ENDS = 0.2
REFINEMENT = 3  # levels, of the limit points at which cage and leaf are compared
BLOCK = 512  # leaves at once, so that temporaries stay small


@dataclass(frozen=True, kw_only=True)
class LeafCageSettings:
    """How many control points a leaf gets, and when its midrib is a crease."""

    across: int = 6  # faces from silhouette to silhouette, even
    along: int = 6  # rows of faces from base to apex
    smooth_below_deg: float = 5.0  # mean angle between the halves' normals, below which the midrib is no crease

    def __post_init__(self) -> None:
        leaf_topology(self.across, self.along, self.along)
        if not self.smooth_below_deg >= 0:
            raise ValueError(f"smooth_below_deg must be 0 or more, not {self.smooth_below_deg}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafCage:
    """Cages of leaves as one mesh for a subdivision surface, leaf after leaf; borders are "edgeAndCorner"."""

    points_m: NDArray[np.float32]  # (V, 3), in the asset's frame
    st: NDArray[np.float32]  # (V, 2), ((u + 1) / 2, v) nearly, when subdivided as the points are
    face_counts: NDArray[np.int32]  # (F,)
    face_vertices: NDArray[np.int32]  # (sum of face_counts,), indices of points_m
    crease_indices: NDArray[np.int32]  # (sum of crease_lengths,), the axis of each creased leaf
    crease_lengths: NDArray[np.int32]  # (C,), vertices of each crease
    crease_sharpnesses: NDArray[np.float32]  # (C,)
    corner_indices: NDArray[np.int32]  # (2 leaves,), base and apex
    corner_sharpnesses: NDArray[np.float32]  # (2 leaves,)


def build_leaf_cage(
    leaves: Leaves, settings: LeafCageSettings = LeafCageSettings(), jitter: Jitter = NO_JITTER
) -> LeafCage:
    """Cages of all leaves in one mesh; base and apex are met exactly, jitter as nearly as so few points can.

    Raises:
        AssetError: The vertices are more than a mesh can number.
    """
    topology = leaf_topology(settings.across, settings.along, settings.along)
    count, vertices = len(leaves), topology.vertex_count
    if count * len(topology.face_vertices) > np.iinfo(np.int32).max:
        raise AssetError(
            f"{count} leaves of {vertices} control points are too many for one mesh", "choose fewer across and along"
        )
    points_m = np.empty((count, vertices, 3), np.float32)
    st = np.empty((count, vertices, 2), np.float32)
    creased = midrib_angles(leaves.parameters) >= np.radians(settings.smooth_below_deg)
    for crease in (False, True):
        same_crease = np.flatnonzero(creased == crease)
        operator = _cage_operator(settings.across, settings.along, crease)
        st[same_crease] = operator.st
        for first in range(0, len(same_crease), BLOCK):
            chosen = same_crease[first : first + BLOCK]
            block = leaves.take(chosen)
            cages = _fit_cages(block, operator, jitter)
            matrix = block.asset_from_leaf()
            points_m[chosen] = cages @ matrix[:, :, :3].transpose(0, 2, 1) + matrix[:, None, :, 3]
    offsets = vertices * np.arange(count, dtype=np.int32)[:, None]
    axis = _axis_vertices(topology)
    creases = (axis + offsets[creased]).reshape(-1)
    corners = (np.arange(2, dtype=np.int32) + offsets).reshape(-1)
    return LeafCage(
        points_m=points_m.reshape(-1, 3),
        st=st.reshape(-1, 2),
        face_counts=np.tile(topology.face_counts, count),
        face_vertices=(topology.face_vertices + offsets).reshape(-1),
        crease_indices=creases,
        crease_lengths=np.full(int(creased.sum()), len(axis), np.int32),
        crease_sharpnesses=np.full(int(creased.sum()), SHARP, np.float32),
        corner_indices=corners,
        corner_sharpnesses=np.full(len(corners), SHARP, np.float32),
    )


def midrib_angles(parameters: NDArray[np.floating]) -> NDArray[np.float64]:
    """Mean angle between the normals of the two halves along the axis of each leaf: (N,), radians."""
    v = np.linspace(0.1, 0.9, 17)  # towards base and apex the halves narrow and the angle is no longer seen
    places = grid_places(np.array([0.0, LEFT_OF_AXIS]), v)
    angles = np.empty(len(parameters))
    for first in range(0, len(parameters), BLOCK):
        block = slice(first, first + BLOCK)
        normals = evaluate_normals(parameters[block], places)[1].reshape(-1, len(v), 2, 3)
        right, left = normals[:, :, 0], normals[:, :, 1]
        apart = np.arctan2(np.linalg.norm(np.cross(left, right), axis=-1), np.sum(left * right, axis=-1))
        angles[block] = apart.mean(axis=1)
    return angles


@dataclass(frozen=True, kw_only=True, eq=False)
class _CageOperator:
    """What makes cages from leaves, in leaf space."""

    from_net: NDArray[np.float64]  # (P, 35), of a leaf's control net
    from_jitter: NDArray[np.float64]  # (P, J), of how far jitter moves the right silhouette at the J places
    jitter_places: NDArray[np.float64]  # (J, 2), their (u, v)
    st: NDArray[np.float64]  # (P, 2)


def _fit_cages(leaves: Leaves, operator: _CageOperator, jitter: Jitter) -> NDArray[np.float64]:
    """Cages (N, P, 3) in leaf space."""
    cages = operator.from_net @ leaf_nets(leaves.parameters).reshape(len(leaves), -1, 3)
    if jitter.amplitude:
        places = operator.jitter_places
        moved = evaluate_points(leaves.parameters, places, jitter, leaves.phase)
        cages += operator.from_jitter @ (moved - evaluate_points(leaves.parameters, places))
    return cages


@cache
def _cage_operator(across: int, along: int, creased: bool) -> _CageOperator:
    """Least squares over the limit points of a leaf's cage; base and apex stay where they are."""
    topology = leaf_topology(across, along, along)
    creases = _edges_along(_axis_vertices(topology)) if creased else np.zeros((0, 2), np.int32)
    limit = _refine(topology, np.eye(topology.vertex_count), creases, np.arange(2, dtype=np.int32))
    places = _sample_places(topology)
    base, apex = (int(np.flatnonzero(places[:, 1] == v)[0]) for v in (0, 1))

    from_samples = np.zeros((topology.vertex_count, len(places)))
    from_samples[2:] = np.linalg.pinv(limit[:, 2:])
    from_ends = from_samples @ limit[:, :2]  # what base and apex already make of the surface
    from_samples[:, (base, apex)] -= from_ends
    from_samples[0, base] = from_samples[1, apex] = 1.0
    u, v = places.T
    rows, row = np.unique(v, return_inverse=True)
    # Of the cubic across, the silhouette has this share; the left one is moved the other way.
    by_row = np.zeros((len(places), len(rows)))
    by_row[np.arange(len(places)), row] = np.copysign(np.abs(u) ** 3, u)
    return _CageOperator(
        from_net=from_samples @ net_weights(places),
        from_jitter=from_samples @ by_row,
        jitter_places=grid_places(np.ones(1), rows),
        # s jumps at base and apex, which no smooth field can follow, so it stays what it is at the vertices.
        st=np.column_stack([(_spread_u(topology.uv[:, 0]) + 1) / 2, from_samples @ v]),
    )


def _sample_places(topology: LeafTopology) -> NDArray[np.float64]:
    """(u, v) of the limit points: within each face as far from its corners as subdivision divides it.

    Around base and apex all of u is one vertex; there u is the direction in which a point lies.
    """
    u, v = topology.uv.T
    rows, row = np.unique(v, return_inverse=True)
    weight = ((v > 0) & (v < 1)).astype(np.float64)  # base and apex lie in no direction
    # With all edges and corners sharp every face is divided evenly.
    ring = _face_edges(topology)
    refined = _refine(
        topology, np.column_stack([u * weight, weight, row]), ring, np.arange(topology.vertex_count, dtype=np.int32)
    )
    directions = refined[:, 0] / np.where(refined[:, 1] > 1e-12, refined[:, 1], 1.0)
    t = refined[:, 2] / (len(rows) - 1)
    return np.column_stack([_spread_u(directions), towards_ends(t, V_TOWARDS_ENDS)]).clip((-1, 0), 1)


def _spread_u(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """u of what lies evenly across, drawn towards axis and silhouettes."""
    return np.copysign(towards_ends(np.abs(u), U_TOWARDS_ENDS), u)


def _refine(
    topology: LeafTopology, values: NDArray[np.float64], creases: NDArray[np.int32], corners: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Limits (S, K) of values (P, K) of the vertices, after some levels of refinement."""
    limits = []
    for column in range(0, values.shape[1], 3):
        three = np.zeros((len(values), 3))
        three[:, : values.shape[1] - column] = values[:, column : column + 3]
        refined = refine_catmull_clark(
            three,
            topology.face_counts,
            topology.face_vertices,
            crease_edges=creases,
            crease_sharpness=np.full(len(creases), SHARP, np.float32),
            corner_vertices=corners,
            corner_sharpness=np.full(len(corners), SHARP, np.float32),
            levels=REFINEMENT,
            limit=True,
        )
        limits.append(refined.points)
    return np.concatenate(limits, axis=1)[:, : values.shape[1]]


def _axis_vertices(topology: LeafTopology) -> NDArray[np.int32]:
    """The vertices of the axis from base to apex."""
    on_axis = np.flatnonzero(topology.uv[:, 0] == 0)
    return on_axis[np.argsort(topology.uv[on_axis, 1])].astype(np.int32)


def _edges_along(vertices: NDArray[np.int32]) -> NDArray[np.int32]:
    return np.stack([vertices[:-1], vertices[1:]], axis=1)


def _face_edges(topology: LeafTopology) -> NDArray[np.int32]:
    """All edges (E, 2), each once."""
    starts = np.repeat(np.cumsum(topology.face_counts) - topology.face_counts, topology.face_counts)
    counts = np.repeat(topology.face_counts, topology.face_counts)
    following = starts + (np.arange(len(starts)) - starts + 1) % counts
    edges = np.stack([topology.face_vertices, topology.face_vertices[following]], axis=1)
    return np.unique(np.sort(edges, axis=1), axis=0)
