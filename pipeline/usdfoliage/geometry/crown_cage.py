"""The control mesh of a crown, whose Catmull-Clark limit passes through the crown's surface.

Source:
    Limit positions: M. Halstead et al., Efficient, fair interpolation using Catmull-Clark surfaces, 1993, section 4.
    The rounds: H. Lin et al., Survey on geometric iterative methods, 2018, section 3.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.geometry.crown_mesh import CrownMesh, build_crown_mesh
from usdfoliage.geometry.smooth_mesh import refine_smooth

MIN_SIZE = 3  # the limit of a bare cube's eight vertices cannot follow radii that rise and fall by turns
FARTHEST = 0.5  # radii: no vertex is moved by more, so that no coarse cage of a rough crown turns inside out
# A limit is a mean of the vertices around it, whose eigenvalues lie between 1/9 and 1 (from 0.078 for the least mesh):
# this gain lessens what is off fastest, to 0.8 of it in a round.
_GAIN = 1.8
_ROUNDS = 100


def build_crown_cage(radius_m: NDArray[np.floating], center_m: NDArray[np.floating], size: int) -> CrownMesh:
    """The mesh of build_crown_mesh, its points moved so that their limits are where they were.

    Args:
        radius_m: (6, N, N), metres, positive, borders shared.
        center_m: (3,), metres.
        size: vertices along a cube edge, MIN_SIZE or more.

    Raises:
        ValueError: As build_crown_mesh, or the size is below MIN_SIZE.
    """
    if size < MIN_SIZE:
        raise ValueError(f"size must be at least {MIN_SIZE}, not {size}")
    if np.shape(center_m) != (3,):
        raise ValueError(f"center_m must be (3,), not {np.shape(center_m)}")
    mesh = build_crown_mesh(radius_m, np.zeros(3), size)
    aims_m = mesh.points_m.astype(np.float64)
    nowhere = np.zeros_like(aims_m)
    control_m = _native.pull_limit(
        mesh.face_vertices.astype(np.int64),
        _native.LimitAims(
            aims_m=aims_m,
            tangents=nowhere,
            swell=np.zeros((len(aims_m), 2)),
            center_m=nowhere,
            gain=np.full(len(aims_m), _GAIN),
        ),
        rounds=_ROUNDS,
        farthest=FARTHEST,
        threads=0,
    )
    return replace(mesh, points_m=(control_m + np.asarray(center_m, np.float64)).astype(np.float32))


def crown_limit(cage: CrownMesh, levels: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Points (V, 3) on the limit surface of a cage, in metres, and the quads (F, 4) between them.

    Args:
        levels: How often each quad is divided into four; 0: the points are the limits of the cage's own.
    """
    return refine_smooth(cage.points_m.astype(np.float64), cage.face_vertices.reshape(-1, 4), levels)
