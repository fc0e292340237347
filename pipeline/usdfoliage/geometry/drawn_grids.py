"""Surfaces as a camera sees them: grids of points drawn with a z-buffer."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.geometry.pinhole import Pinhole

NO_GRID = -1


class DrawnGrids(NamedTuple):
    """What a camera would see of grids if nothing else stood there."""

    ids: NDArray[np.int32]  # (H, W), number of the grid nearest to the camera, NO_GRID for none
    depth_m: NDArray[np.float32]  # (H, W), its planar depth, 0 for none


def draw_grids(points_m: NDArray[np.floating], camera: Pinhole, *, threads: int = 0) -> DrawnGrids:
    """Draw grids of points; a pixel shows what its centre shows.

    Cells that reach behind the camera are left out. Of grids equally near, the first is seen.

    Args:
        points_m: (N, V, U, 3), in the world of the camera. A quadrilateral is a grid of V = U = 2.
        camera: Whose picture is drawn, in its size.
        threads: 0: one per core; the picture is the same.

    Raises:
        ValueError: points_m has another shape.
    """
    if points_m.ndim != 4 or points_m.shape[3] != 3 or min(points_m.shape[1:3]) < 2:
        raise ValueError(f"points_m must be (N, V, U, 3) with V and U at least 2, not {points_m.shape}")
    places, depth_m = camera.project(points_m.reshape(-1, 3))
    grids = np.concatenate([places, depth_m[:, None]], axis=1).reshape(points_m.shape)
    drawn = _native.draw_leaf_grids(grids, height=camera.height_px, width=camera.width_px, threads=threads)
    return DrawnGrids(drawn.ids, drawn.depth)
