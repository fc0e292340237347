"""Depth that was found in a reduced photograph, on the pixels of the photograph itself."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.mvs.agreement import DepthEstimate
from usdfoliage.geometry.pinhole import Pinhole

# of depth inside a pixel; beyond it a plane is seen so much from its side that its depth means nothing
_MAX_CHANGE = 1.25


def enlarge_depth(estimate: DepthEstimate, camera: Pinhole) -> DepthEstimate:
    """The same for a camera of the same picture at another size.

    Every pixel takes the plane of the nearest one, and the depth of that plane where it looks itself: nothing is mixed
    across edges, and slanted surfaces get no steps. Our own.

    Args:
        estimate: As it was found.
        camera: Of the picture that is wanted.
    """
    small = estimate.camera
    size = camera.height_px, camera.width_px
    if estimate.depth_m.shape == size:
        return estimate
    rows = _nearest(size[0], small.height_px)
    columns = _nearest(size[1], small.width_px)
    near = np.ix_(rows, columns)
    depth_m, normals = estimate.depth_m[near], estimate.normals[near]
    own_ray = _rays(camera, np.arange(size[0]), np.arange(size[1]))
    its_ray = _rays(small, rows, columns)
    along, towards = np.sum(normals * its_ray, axis=2), np.sum(normals * own_ray, axis=2)
    change = np.divide(along, towards, out=np.ones_like(along), where=(along < 0) & (towards < 0))
    change[(change > _MAX_CHANGE) | (change < 1 / _MAX_CHANGE)] = 1
    return DepthEstimate(
        camera=camera,
        depth_m=(depth_m * change).astype(np.float32),
        normals=normals,
        confidence=estimate.confidence[near],
        agreeing=estimate.agreeing[near],
    )


def _nearest(count: int, there: int) -> NDArray[np.int64]:
    """(count,), which of so many pixels in a line is nearest to each of another number of them."""
    places = (np.arange(count) + 0.5) * (there / count) - 0.5
    return np.clip(np.rint(places), 0, there - 1).astype(np.int64)


def _rays(camera: Pinhole, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float32]:
    """(rows, columns, 3), in camera axes, through pixels' centres to where z is 1."""
    rays = np.ones((len(rows), len(columns), 3), np.float32)
    rays[..., 0] = ((columns + 0.5 - camera.center_px[0]) / camera.focal_px[0])[None, :]
    rays[..., 1] = ((rows + 0.5 - camera.center_px[1]) / camera.focal_px[1])[:, None]
    return rays
