"""Clouds of points that are given, and cameras above the plane z = 0, for what merges and cleans clouds."""

import numpy as np
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.geometry.pinhole import Pinhole


def looking_down(x=0.0, y=0.0, height_m=2.0, size=(60, 44), focal_px=80.0):
    turn = np.diag([1.0, -1.0, -1.0])
    width, height = size
    return Pinhole(
        width_px=width,
        height_px=height,
        focal_px=(focal_px, focal_px),
        center_px=(width / 2, height / 2),
        cam_from_world=np.column_stack([turn, -turn @ (x, y, height_m)]),
    )


def cloud_of(points_m, views=None):
    """Points in order: their views are their numbers, or as given for all."""
    count = len(points_m)
    return Cloud(
        points_m=np.asarray(points_m, float),
        normals=np.tile(np.float32([0, 0, 1]), (count, 1)),
        srgb=np.zeros((count, 3), np.uint8),
        confidence=np.ones(count, np.float32),
        views=np.arange(count, dtype=np.int32) if views is None else np.full(count, views, np.int32),
    )
