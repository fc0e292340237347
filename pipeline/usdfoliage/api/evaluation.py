"""Points, normals and meshes of leaves, as a renderer shows them."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usdfoliage.asset.parts.leaf_part import LeafAppearance, leaf_jitter
from usdfoliage.asset.parts.leaves import edited_leaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits
from usdfoliage.leaf.shape.mesh import LeafMesh, LeafMeshSettings, build_leaf_mesh
from usdfoliage.leaf.shape.surface import evaluate_normals, evaluate_points


def leaf_points(
    leaves: Leaves, uv: ArrayLike, edits: LeafEdits = NEUTRAL, *, jitter_map: str | Path | None = None, threads: int = 0
) -> NDArray[np.float64]:
    """Evaluate the surfaces of leaves.

    Parameters are rounded to float32 first, as an asset stores them, so that the points are those of the asset.

    Args:
        leaves: N leaves, before the edits.
        uv: (P, 2) for all leaves, or (N, P, 2). u goes from -1 on the left silhouette over 0 on the axis to 1 on the
            right one, v from 0 at the base to 1 at the apex.
        edits: Collective edits, the jitter of the silhouettes among them.
        jitter_map: An image whose first row is one cycle of the jitter; the built-in wave without.
        threads: At most so many threads, 0 for one per core. The result does not depend on it.

    Returns:
        (N, P, 3) float64, metres, in the frame of the leaves.

    Raises:
        ValueError: uv has another shape.
        CaptureError: The jitter map cannot be used.
    """
    drawn = edited_leaves(leaves, edits)
    jitter = leaf_jitter(edits, _with_map(jitter_map))
    return evaluate_points(
        drawn.parameters, uv, jitter, drawn.phase, placements=drawn.asset_from_leaf(), threads=threads
    )


def leaf_normals(
    leaves: Leaves, uv: ArrayLike, edits: LeafEdits = NEUTRAL, *, jitter_map: str | Path | None = None, threads: int = 0
) -> NDArray[np.float64]:
    """Evaluate the unit normals of leaves, which look towards +z of a flat leaf; at base and apex they are the limit.

    Arguments, frame and errors are those of leaf_points.

    Returns:
        (N, P, 3) float64, of length 1.

    Raises:
        ValueError: uv has another shape.
        CaptureError: The jitter map cannot be used.
    """
    drawn = edited_leaves(leaves, edits)
    jitter = leaf_jitter(edits, _with_map(jitter_map))
    _, normals = evaluate_normals(
        drawn.parameters, uv, jitter, drawn.phase, placements=drawn.asset_from_leaf(), threads=threads
    )
    return normals


def leaf_mesh(
    leaves: Leaves,
    edits: LeafEdits = NEUTRAL,
    settings: LeafMeshSettings = LeafMeshSettings(),
    *,
    jitter_map: str | Path | None = None,
) -> LeafMesh:
    """Build one mesh of all leaves, as the representation `mesh` of an asset has it.

    Args:
        leaves: The leaves, before the edits.
        edits: Collective edits; their jitter is part of the shape.
        settings: How many cells across and along a leaf.
        jitter_map: An image whose first row is one cycle of the jitter; the built-in wave without.

    Returns:
        Points in metres in the frame of the leaves, unit normals, texture coordinates and faces.

    Raises:
        CaptureError: The jitter map cannot be used.
        AssetError: The vertices are more than a mesh can number.
    """
    return build_leaf_mesh(edited_leaves(leaves, edits), settings, leaf_jitter(edits, _with_map(jitter_map)))


def _with_map(jitter_map: str | Path | None) -> LeafAppearance:
    return LeafAppearance(jitter_map=None if jitter_map is None else Path(jitter_map))
