"""Views as the native functions over depth take them."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.geometry.pinhole import Pinhole


def depth_view(camera: Pinhole, depth_m: NDArray[np.floating]) -> _native.DepthView:
    """A view's camera with this depth (H, W), 0 where there is none.

    Raises:
        ValueError: The depth is not as large as the camera's pictures.
    """
    if depth_m.shape != (camera.height_px, camera.width_px):
        raise ValueError(f"the depth must be {(camera.height_px, camera.width_px)}, not {depth_m.shape}")
    intrinsics = np.array([*camera.focal_px, *camera.center_px], np.float64)
    return _native.DepthView(
        depth_m=np.ascontiguousarray(depth_m, np.float32),
        intrinsics=intrinsics,
        cam_from_world=np.ascontiguousarray(camera.cam_from_world, np.float64),
    )


def mean_focal_px(camera: Pinhole) -> float:
    """The focal length by which a pixel's footprint, depth / focal length, is measured."""
    return float(np.sqrt(camera.focal_px[0] * camera.focal_px[1]))
