"""Moving a cage so that its Catmull–Clark limit passes where the branches are.

Each vertex is moved by what its limit is off, again and again: after few rounds the limit is there wherever it is
smooth, and short waves, which a solution in one step would overshoot with, are left out. Along the tubes vertices are
not moved, so that uneven rows stay in order; what is asked there is only that the surface be at the right distance.

Source:
    Limit positions: M. Halstead et al., Efficient, fair interpolation using Catmull-Clark surfaces, 1993, section 4.
    The rounds: H. Lin et al., Survey on geometric iterative methods, 2018, section 3.
"""

import numpy as np
from scipy.sparse import csr_array

from usdfoliage.branch.cage_tubes import Floats, Ints

FARTHEST = 0.5  # radii: no vertex is moved by more


def limit_stencils(faces: Ints, count: int) -> csr_array:
    """(count, count) matrix from the vertices of a closed mesh of quads (F, 4) to their limits."""
    valence = np.bincount(faces.reshape(-1), minlength=count).astype(float)
    corners = [np.roll(faces, -k, axis=1).reshape(-1) for k in range(4)]
    rows = np.concatenate([corners[0]] * 3 + [np.arange(count)]).astype(np.int32)
    columns = np.concatenate([corners[1], corners[3], corners[2], np.arange(count)]).astype(np.int32)
    size = faces.size
    # An edge is seen from both its faces, so each gives half of its weight.
    weights = np.concatenate([np.full(2 * size, 2.0), np.ones(size), valence**2])
    matrix = csr_array((weights, (rows, columns)), shape=(count, count))
    matrix.data /= np.repeat(np.maximum(valence * (valence + 5), 1), np.diff(matrix.indptr))
    return matrix


def pull_limit(
    faces: Ints, aims: Floats, tangents: Floats, swell: Floats, center: Floats, rounds: int, gain: Floats
) -> Floats:
    """Vertices whose limits are at their aims, nearly.

    Args:
        faces: (F, 4) a closed mesh.
        aims: (V, 3) where the limits are to be.
        tangents: (V, 3) unit vector along which a vertex is not moved; 0 for none.
        swell: (V, 2) by how much a tube's radius grows per length along the tangent, ahead and behind.
        center: (V, 3) the place of the axis that an aim belongs to.
        rounds: How often.
        gain: (V,) share of what is missing that a vertex is moved by.
    """
    stencils = limit_stencils(faces, len(aims))
    radial = aims - center
    farthest = FARTHEST * np.linalg.norm(radial, axis=1)
    points = aims.copy()
    for _ in range(rounds):
        off = stencils @ points - center
        along = np.einsum("vc,vc->v", off, tangents)[:, None]
        grown = 1 + np.where(along > 0, swell[:, :1], swell[:, 1:]) * along
        missing = radial * np.clip(grown, 0.5, 2.0) - (off - along * tangents)
        moved = points + gain[:, None] * missing - aims
        # Where rows are very uneven in a bend, what is off is not what to move by: then rather round the bend off.
        size = np.linalg.norm(moved, axis=1)
        points = aims + moved * np.minimum(1, farthest / np.maximum(size, 1e-300))[:, None]
    return points
