"""Photographs of leaves, drawn: what they show is known to the pixel."""

import numpy as np
from scipy.spatial.transform import Rotation
from usdfoliage.capture.view import View
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.reprojection import draw_leaf_ids
from usdfoliage.leaf.shape.surface import evaluate_points

WALL = np.array([0.3, 0.28, 0.27])  # linear


def front_camera(x_m=0.0, distance_m=1.0, width_px=240, height_px=180, focal_px=400.0):
    """A camera that looks along -z at the point (x_m, 0, 0), y up, and stands before it."""
    turn = np.diag([1.0, -1.0, -1.0])
    position = np.array([x_m, 0.0, distance_m])
    return Pinhole(
        width_px=width_px,
        height_px=height_px,
        focal_px=(focal_px, focal_px),
        center_px=(width_px / 2, height_px / 2),
        cam_from_world=np.column_stack([turn, -turn @ position]),
    )


def place_leaves(parameters, base_m, length_m=0.1, turn_deg=0.0, tilt_deg=0.0):
    """Leaves (N, 7, 3) in the plane of the picture, upright; turned about the ray, then tilted about x."""
    base = np.asarray(base_m, np.float64)
    count = len(base)
    shape = np.broadcast_to(np.asarray(parameters, np.float64), (count, 7, 3)).copy()
    turn = Rotation.from_euler(
        "zx", np.column_stack([np.broadcast_to(turn_deg, count), np.broadcast_to(tilt_deg, count)]), degrees=True
    )
    return Leaves(
        parameters=shape,
        base_m=base,
        orientation=turn.as_quat(),
        length_m=np.broadcast_to(np.asarray(length_m, np.float64), count).copy(),
        phase=np.zeros(count),
    )


def photograph(leaves, camera, colors, wall_m=1.5, exposure=1.0, depth=True, name="0.png"):
    """A view of leaves of linear colours (N, 3) before a wall at a planar depth, 0 for no depth of it."""
    drawn = draw_leaf_ids(leaves, camera)
    linear = np.where((drawn.ids >= 0)[..., None], np.asarray(colors)[np.maximum(drawn.ids, 0)], WALL) * exposure
    srgb = np.rint(np.clip(encode_srgb(linear), 0, 1) * 255).astype(np.uint8)
    depth_m = np.where(drawn.ids >= 0, drawn.depth_m, np.float32(wall_m)) if depth else np.zeros_like(drawn.depth_m)
    return View(name=name, camera=camera, srgb=srgb, depth_m=depth_m.astype(np.float32))


def project_silhouettes(leaves, camera, steps=24):
    """Where the silhouettes are seen: (N, 2 steps, 2), x and y in pixels, NaN behind the camera.

    Closed polygons without the first point at the end: from the base up the right side to the apex, and back on the
    left.
    """
    up = np.arange(steps) / steps
    uv = np.concatenate([np.column_stack([np.ones(steps), up]), np.column_stack([-np.ones(steps), 1 - up])])
    points = evaluate_points(leaves.parameters, uv, placements=leaves.asset_from_leaf())
    places, _ = camera.project(points.reshape(-1, 3))
    return places.reshape(len(leaves), 2 * steps, 2)
