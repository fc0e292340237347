"""Photographs of a crown with their cameras, read one at a time and kept as small as the crown's texels can show."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.color import decode_srgb, encode_srgb, luminance
from usdfoliage.geometry.pinhole import Pinhole

_MARGIN = 1.15  # of the crown's radius, that is cut out of a photograph
_MIN_PX = 16  # of the crown in a photograph, below which it shows nothing
_NEAR_SKY_PX, _SKY_LIGHT = 12, 0.1  # from the sky, how near pixels hold its light, and how much of it is too much
_DECODED = np.asarray(decode_srgb(np.arange(256, dtype=np.float32) / 255), np.float32)


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownPicture:
    """One photograph without lens distortion, and what is known of it."""

    srgb: NDArray[np.uint8]  # (H, W, 3), encoded for display
    mask: NDArray[np.bool_] | None = None  # (H, W), True on the plant, its trunk included
    sky: NDArray[np.bool_] | None = (
        None  # (H, W), True where nothing stands; beside a mask it matters for colours alone
    )
    depth_m: NDArray[np.float32] | None = None  # (H, W), along the optical axis, 0 where there is none


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownView:
    """A camera in the asset's frame, and what reads its photograph."""

    name: str
    camera: Pinhole
    read: Callable[[], CrownPicture]


@dataclass(frozen=True, kw_only=True, eq=False)
class ReducedView:
    """The part of a photograph that shows the crown, shrunk."""

    name: str
    camera: Pinhole  # of the part
    srgb: NDArray[np.uint8]  # (h, w, 3)
    mask: NDArray[np.bool_] | None  # (h, w), True on the plant
    sky: NDArray[np.bool_] | None  # (h, w)
    depth_m: NDArray[np.float32] | None  # (h, w), 0 where there is none
    covered: NDArray[np.bool_] | None = None  # (h, w), where points of the crown are seen or would be

    @property
    def plant(self) -> NDArray[np.bool_]:
        """(h, w), False where the photograph surely shows something else than the plant."""
        if self.mask is not None:
            return self.mask
        return np.ones(self.srgb.shape[:2], bool) if self.sky is None else ~self.sky

    @property
    def leaves(self) -> NDArray[np.bool_]:
        """(h, w), True where colours are surely the plant's: through gaps between leaves one sees what is behind."""
        leaves = self.plant
        if self.mask is None and self.covered is not None:
            leaves = leaves & self.covered
        if self.sky is None or not self.sky.any():
            return leaves
        sky = self.sky.astype(np.uint8)
        leaves = leaves & (cv2.dilate(sky, np.ones((5, 5), np.uint8)) == 0)  # pixels beside it hold some of its light
        if not leaves.any():
            return leaves
        # Among leaves and gaps finer than a pixel more of them do: all that are much brighter than leaves are.
        light = luminance(self.linear())
        median, behind = np.median(light[leaves]), np.median(light[self.sky])
        if behind <= median:  # a dark wall, whose light in them does no harm
            return leaves
        near = cv2.dilate(sky, np.ones((2 * _NEAR_SKY_PX + 1, 2 * _NEAR_SKY_PX + 1), np.uint8)) > 0
        return leaves & ~(near & (light > median + _SKY_LIGHT * (behind - median)))

    def linear(self) -> NDArray[np.float32]:
        """(h, w, 3), linear Rec.709."""
        return np.asarray(_DECODED[self.srgb])


def reduce_view(
    view: CrownView, center_m: NDArray[np.floating], radius_m: float, longest_px: int
) -> ReducedView | None:
    """Read a photograph and cut out a ball, no side longer than longest_px; None where it does not show the ball.

    Raises:
        ValueError: The picture is not of the camera's size.
    """
    camera = view.camera
    place, depth_m = camera.project(np.asarray(center_m, np.float64)[None])
    if not depth_m[0] > 0.2 * radius_m:  # from within the crown nothing of its outside is seen
        return None
    reach_px = np.array(camera.focal_px) * _MARGIN * radius_m / max(float(depth_m[0]) - 0.5 * radius_m, 0.2 * radius_m)
    low = np.maximum(np.floor(place[0] - reach_px), 0).astype(int)
    high = np.minimum(np.ceil(place[0] + reach_px), (camera.width_px, camera.height_px)).astype(int)
    if (high - low).min() < _MIN_PX:
        return None
    picture = view.read()
    size = camera.height_px, camera.width_px
    if picture.srgb.shape != (*size, 3):
        raise ValueError(f"the picture of {view.name} is {picture.srgb.shape[:2]}, its camera {size}")
    part = np.s_[low[1] : high[1], low[0] : high[0]]
    scale = min(1.0, longest_px / int((high - low).max()))
    width, height = (max(1, round(float(side) * scale)) for side in high - low)
    cut = replace(
        camera,
        width_px=int(high[0] - low[0]),
        height_px=int(high[1] - low[1]),
        center_px=(camera.center_px[0] - int(low[0]), camera.center_px[1] - int(low[1])),
    )
    return ReducedView(
        name=view.name,
        camera=cut.resized(width, height),
        srgb=_shrink_colors(picture.srgb[part], (width, height)),
        mask=_shrink_mask(picture.mask, part, (width, height)),
        sky=_shrink_mask(picture.sky, part, (width, height)),
        depth_m=_shrink_depth(picture.depth_m, part, (width, height)),
    )


def _shrink_colors(srgb: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Means of light, not of what encodes it."""
    if (srgb.shape[1], srgb.shape[0]) == size:
        return srgb.copy()
    small = cv2.resize(np.asarray(_DECODED[srgb]), size, interpolation=cv2.INTER_AREA)
    return np.rint(np.clip(encode_srgb(small), 0, 1) * 255).astype(np.uint8)


def _shrink_mask(
    mask: NDArray[np.bool_] | None, part: tuple[slice, slice], size: tuple[int, int]
) -> NDArray[np.bool_] | None:
    if mask is None:
        return None
    share = cv2.resize(mask[part].astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(share >= 0.5)


def _shrink_depth(
    depth_m: NDArray[np.float32] | None, part: tuple[slice, slice], size: tuple[int, int]
) -> NDArray[np.float32] | None:
    """One of the depths of each pixel: means of near and far are of neither."""
    if depth_m is None or not depth_m[part].any():
        return None
    return np.asarray(cv2.resize(depth_m[part], size, interpolation=cv2.INTER_NEAREST), np.float32)
