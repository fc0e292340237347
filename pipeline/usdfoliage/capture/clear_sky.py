"""Sky that no photograph can be matched on: what stands before it keeps its outline, and nothing is found beside it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.sky import segment_sky
from usdfoliage.geometry.pinhole import Pinhole

_TEXTURE_PX = 1.5  # standard deviation of the window in which texture is measured


def elevations_deg(camera: Pinhole, up: NDArray[np.floating]) -> NDArray[np.float64]:
    """(H, W), how far over the horizon each pixel looks; up (3,) is of the world, of length 1."""
    rays = camera.rays()
    rising = rays @ (camera.cam_from_world[:, :3] @ up) / np.linalg.norm(rays, axis=-1)
    return np.degrees(np.arcsin(np.clip(rising, -1, 1)))


@dataclass(frozen=True, kw_only=True)
class ClearSkySettings:
    """When smooth regions that reach the top of a photograph are sky."""

    # A smooth region is sky up to this median standard deviation of lightness. Walls have more, and can be matched; 0
    # finds no sky. Unit: of 100. Range: 0 or more.
    max_texture: float = 1.5
    # Sky may be seen this far below the horizon, because the up direction is not known exactly. Unit: degrees. Range:
    # 0 to 90.
    below_horizon_deg: float = 10.0
    seed: int = 0  # Every random choice starts from this number. Range: 0 or more.

    def __post_init__(self) -> None:
        if not 0 <= self.below_horizon_deg <= 90:
            raise ValueError(f"below_horizon_deg must be in [0, 90], not {self.below_horizon_deg:g}")
        if not self.max_texture >= 0:
            raise ValueError(f"max_texture must be 0, for no sky, or more, not {self.max_texture}")


def find_clear_sky(
    srgb: NDArray[np.uint8],
    settings: ClearSkySettings = ClearSkySettings(),
    *,
    elevation_deg: NDArray[np.floating] | None = None,
) -> NDArray[np.bool_] | None:
    """Where a photograph (H, W, 3) shows the sky, gaps in the foliage included; None where it shows none.

    Args:
        srgb: Red, green, blue, encoded for display.
        settings: What sky is.
        elevation_deg: (H, W), of the lines of sight over the horizon: a road seen from above is as smooth as the sky.
    """
    may_be = None if elevation_deg is None else elevation_deg > -settings.below_horizon_deg
    if may_be is not None and not may_be.any():
        return None
    lab = cv2.cvtColor(srgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    lightness = np.ascontiguousarray(lab[..., 0])
    mean = cv2.GaussianBlur(lightness, (0, 0), _TEXTURE_PX)
    square = cv2.GaussianBlur(lightness**2, (0, 0), _TEXTURE_PX)
    texture = np.sqrt(np.maximum(square - mean**2, 0))
    sky = segment_sky(np.asarray(lab, np.float32), np.asarray(texture, np.float32), settings.seed % 2**31)
    if may_be is not None:
        sky &= may_be
    if not sky.any() or float(np.median(texture[sky])) > settings.max_texture:
        return None
    return sky
