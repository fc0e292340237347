"""How far the triangles that a leaf is drawn with are from its surface."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.shape.surface import evaluate_normals, evaluate_points
from usdfoliage.leaf.shape.topology import LeafTopology

_STEPS = 4  # of a triangle's edges: distances are measured at their ends
_SHARES = np.array([(i, j, _STEPS - i - j) for i in range(_STEPS + 1) for j in range(_STEPS + 1 - i)]) / _STEPS
_OF_CHORDS = np.array([0.25, 0.5, 0.75])


def measure_deviation(parameters: NDArray[np.floating], topology: LeafTopology) -> NDArray[np.float64]:
    """The largest distance between each leaf's surface and its triangles, (N,), in leaf lengths.

    Across the surface it is measured along the normal, at fifteen places of a triangle; of the silhouettes it is the
    distance from the chords. It is a little larger than that to the nearest triangle. Faces of four corners are divided
    from their first corner on.

    Args:
        parameters: (N, 7, 3).
        topology: What all leaves are divided into; every vertex is on its leaf.
    """
    corners = topology.triangles
    points = evaluate_points(parameters, topology.uv)
    drawn = np.einsum("sc,ntcx->ntsx", _SHARES, points[:, corners]).reshape(len(points), -1, 3)
    surface, normals = evaluate_normals(parameters, _places_in(topology.uv[corners]))
    largest = np.abs(np.einsum("npx,npx->np", drawn - surface, normals)).max(axis=1)
    for side in (-1.0, 1.0):
        chain = _silhouette(topology, side)
        v = topology.uv[chain, 1]
        middle = v[:-1, None] + _OF_CHORDS * np.diff(v)[:, None]
        curve = evaluate_points(parameters, np.column_stack([np.full(middle.size, side), middle.ravel()]))
        start, chord = points[:, chain[:-1]], np.diff(points[:, chain], axis=1)
        chord /= np.maximum(np.linalg.norm(chord, axis=-1, keepdims=True), 1e-12)
        off = curve.reshape(len(points), -1, len(_OF_CHORDS), 3) - start[:, :, None]
        off -= np.einsum("nkmx,nkx->nkm", off, chord)[..., None] * chord[:, :, None]
        largest = np.maximum(largest, np.linalg.norm(off, axis=-1).reshape(len(points), -1).max(axis=1))
    return np.asarray(largest)


def _places_in(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(u, v) of the places of triangles (T, 3, 2) where distances are measured: (T * S, 2)."""
    # At base and apex all u are one place: there u is the other corners'.
    has_u = ((corners[..., 1] > 0) & (corners[..., 1] < 1)).astype(np.float64)
    weight = _SHARES @ has_u.T  # (S, T)
    u = _SHARES @ (has_u * corners[..., 0]).T / np.where(weight > 0, weight, 1.0)
    v = _SHARES @ corners[..., 1].T
    return np.stack([u, v], axis=-1).transpose(1, 0, 2).reshape(-1, 2)


def _silhouette(topology: LeafTopology, side: float) -> NDArray[np.intp]:
    """The vertices of a silhouette from base to apex, both with them."""
    u, v = topology.uv.T
    chain = np.flatnonzero((u == side) | (v == 0) | (v == 1))
    return chain[np.argsort(v[chain])]
