"""Cameras without lens distortion, and where they stand."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native

UP = np.array([0.0, 1.0, 0.0])  # in the frame of assets


@dataclass(frozen=True, kw_only=True, eq=False)
class Pinhole:
    """A pinhole camera in the world.

    Camera axes are OpenCV's: x right, y down, z forward. The pixel in row i, column j has its centre at x = j + 0.5,
    y = i + 0.5.
    """

    width_px: int
    height_px: int
    focal_px: tuple[float, float]  # x, y
    center_px: tuple[float, float]  # x, y of the principal point
    cam_from_world: NDArray[np.float64]  # (3, 4): rotation and translation, for column vectors, in metres

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(f"the picture must have a size, not {self.width_px} by {self.height_px}")
        if not all(np.isfinite(number) and number > 0 for number in self.focal_px):
            raise ValueError(f"the focal lengths must be above 0, not {self.focal_px}")
        if self.cam_from_world.shape != (3, 4) or not np.isfinite(self.cam_from_world).all():
            raise ValueError(f"cam_from_world must be (3, 4) finite numbers, not {self.cam_from_world.shape}")

    @property
    def position_m(self) -> NDArray[np.float64]:
        """(3,), the centre of projection in the world."""
        return np.asarray(-self.cam_from_world[:, :3].T @ self.cam_from_world[:, 3])

    def resized(self, width_px: int, height_px: int) -> "Pinhole":
        """The camera of the same picture at another size."""
        across, down = width_px / self.width_px, height_px / self.height_px
        return replace(
            self,
            width_px=width_px,
            height_px=height_px,
            focal_px=(self.focal_px[0] * across, self.focal_px[1] * down),
            center_px=(self.center_px[0] * across, self.center_px[1] * down),
        )

    def rays(self) -> NDArray[np.float64]:
        """(H, W, 3), in camera axes, through every pixel's centre to where z is 1."""
        rays = np.ones((self.height_px, self.width_px, 3))
        rays[..., 0] = ((np.arange(self.width_px) + 0.5 - self.center_px[0]) / self.focal_px[0])[None, :]
        rays[..., 1] = ((np.arange(self.height_px) + 0.5 - self.center_px[1]) / self.focal_px[1])[:, None]
        return rays

    def pixel_from_ray(self) -> NDArray[np.float64]:
        """(3, 3), pixel indices (column, row, 1) of what lies on a ray (x, y, 1) in camera axes."""
        (focal_x, focal_y), (center_x, center_y) = self.focal_px, self.center_px
        return np.array([[focal_x, 0, center_x - 0.5], [0, focal_y, center_y - 0.5], [0, 0, 1]])

    def unproject(self, places_px: NDArray[np.floating], depth_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Points in the world: (N, 3) from places (N, 2), x and y, and their planar depth (N,)."""
        return np.asarray(
            _native.unproject_places(
                np.ascontiguousarray(places_px, np.float64), np.ascontiguousarray(depth_m, np.float64), *self._numbers()
            )
        )

    def project(self, points_m: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where points (N, 3) of the world are seen: places (N, 2), x and y, NaN behind the camera; depth (N,)."""
        places, depth_m = _native.project_points(np.ascontiguousarray(points_m, np.float64), *self._numbers())
        return places, depth_m

    def _numbers(self) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
        """Focal lengths and centre (4,), cam_from_world (3, 4), and threads, one per core, as native functions ask."""
        intrinsics = np.array([*self.focal_px, *self.center_px], np.float64)
        return intrinsics, np.ascontiguousarray(self.cam_from_world, np.float64), 0


def look_at(
    position: NDArray[np.float64], target: NDArray[np.float64], focal_px: float, size: tuple[int, int]
) -> Pinhole:
    """A camera at a position (3,) that has a target (3,) in the middle of its picture, of this width and height.

    +Y is up in the picture; the target is not straight above or below the camera.
    """
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, UP)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Pinhole(
        width_px=size[0],
        height_px=size[1],
        focal_px=(focal_px, focal_px),
        center_px=(size[0] / 2, size[1] / 2),
        cam_from_world=np.column_stack([rotation, -rotation @ position]),
    )
