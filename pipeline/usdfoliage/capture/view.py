"""One posed photograph as the reconstructions take it: without lens distortion, with what depth is known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.pinhole import Pinhole


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A posed photograph without lens distortion, with its depth map."""

    name: str  # of the photograph's file
    camera: Pinhole
    srgb: NDArray[np.uint8]  # (H, W, 3), red, green, blue, encoded for display
    depth_m: NDArray[np.float32]  # (H, W), along the optical axis, 0 where there is none; finite
    mask: NDArray[np.bool_] | None = None  # (H, W), True on the plant

    def __post_init__(self) -> None:
        size = self.camera.height_px, self.camera.width_px
        if self.srgb.shape != (*size, 3) or self.depth_m.shape != size:
            raise ValueError(f"photograph {self.srgb.shape} and depth {self.depth_m.shape} must be {size} large")
        if self.mask is not None and self.mask.shape != size:
            raise ValueError(f"the mask must be {size}, not {self.mask.shape}")

    @property
    def has_depth(self) -> bool:
        return bool((self.depth_m > 0).any())

    def points(self) -> NDArray[np.float64]:
        """(H, W, 3), in the world, in metres; NaN where no depth is known."""
        depth_m = np.where(self.depth_m > 0, self.depth_m, np.nan).astype(np.float64)
        in_cam = self.camera.rays() * depth_m[..., None]
        rotation, translation = self.camera.cam_from_world[:, :3], self.camera.cam_from_world[:, 3]
        return np.asarray((in_cam - translation) @ rotation)
