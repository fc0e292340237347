"""How near and how far a photograph's depth is searched for."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.geometry.pinhole import Pinhole


def depth_range_m(
    cameras: Sequence[Pinhole],
    index: int,
    points_m: NDArray[np.floating] | None = None,
    *,
    nearer: float = 0.02,
) -> tuple[float, float]:
    """Nearest and farthest depth worth searching in one view.

    From the points in the picture, the outermost hundredth left out, with a margin; with fewer than 20 of them, a half
    and double of the depth where the cameras' axes come closest to each other.

    Args:
        cameras: Of all views.
        index: Of the view.
        points_m: (N, 3), points of the scene.
        nearer: Share of the nearest point's inverse depth by which what the points do not show may be nearer.

    Raises:
        CaptureError: There are neither points nor a place that the cameras look at.
    """
    camera = cameras[index]
    if points_m is not None and len(points_m):
        places, depth_m = camera.project(np.asarray(points_m, np.float64))
        seen = (depth_m > 0) & np.all((places >= 0) & (places < (camera.width_px, camera.height_px)), axis=1)
        if np.count_nonzero(seen) >= 20:
            far, near = np.quantile(1 / depth_m[seen], [0.01, 0.99])
            margin = 0.1 * (near - far)
            return 1 / (near + margin + nearer * near), 1 / max(far - margin - 0.02 * near, 0.5 * far)
    depth = float(_looked_at_m(cameras) @ camera.cam_from_world[2, :3] + camera.cam_from_world[2, 3])
    if not depth > 0:
        raise CaptureError("the range of depths cannot be found: the cameras do not look at one place", "give points3D")
    return depth / 2, depth * 2


def _looked_at_m(cameras: Sequence[Pinhole]) -> NDArray[np.float64]:
    """(3,), the place closest to the optical axes of all cameras, by least squares."""
    system, right = np.zeros((3, 3)), np.zeros(3)
    for camera in cameras:
        axis = camera.cam_from_world[2, :3]
        across = np.eye(3) - np.outer(axis, axis)
        system += across
        right += across @ camera.position_m
    return np.asarray(np.linalg.lstsq(system, right, rcond=None)[0])
