"""Plants that are known in closed form, and photographs of them by rays: points, pictures, masks and depth."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from usdfoliage.crown.views import CrownPicture, CrownView
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.cubemap import face_directions
from usdfoliage.geometry.pinhole import Pinhole

Radius = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # of unit directions (..., 3)
CENTER_M = np.array([0.3, 2.0, -0.4])
BACKGROUND = (40, 40, 200)


def sphere(directions):
    return np.ones(directions.shape[:-1])


def ellipsoid(directions, axes=(1.3, 0.8, 1.0)):
    return 1 / np.linalg.norm(directions / np.array(axes), axis=-1)


def lumpy(directions):
    x, y, z = np.moveaxis(directions, -1, 0)
    return 1 + 0.12 * np.sin(5 * x + 1) * np.cos(4 * y) + 0.1 * np.sin(6 * z + 2 * x)


def true_color(directions):
    """Linear colours, smooth on the sphere."""
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack([0.2 + 0.1 * x, 0.35 + 0.15 * y * z, 0.12 + 0.06 * z], axis=-1)


def surface_points(radius: Radius, count=20_000, seed=0):
    """Points on the surface about CENTER_M, evenly in direction."""
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return CENTER_M + directions * radius(directions)[:, None]


def look_at(position_m, target_m=CENTER_M, width_px=128, height_px=120, focal_px=166.0):
    forward = target_m - position_m
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0] if abs(forward[1]) < 0.99 else [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Pinhole(
        width_px=width_px,
        height_px=height_px,
        focal_px=(focal_px, focal_px),
        center_px=(width_px / 2, height_px / 2),
        cam_from_world=np.column_stack([rotation, -rotation @ position_m]),
    )


def ring(count, distance_m=4.0, rises=(0.15, 0.75)):
    """Cameras around CENTER_M, by turns low and high."""
    angle = 2 * np.pi * np.arange(count) / count
    rise = np.array([rises[number % len(rises)] for number in range(count)])
    place = np.column_stack([np.cos(angle) * np.cos(rise), np.sin(rise), np.sin(angle) * np.cos(rise)])
    return [look_at(CENTER_M + distance_m * one) for one in place]


def photograph(camera, radius: Radius, color=true_color, steps=100):
    """A picture of the plant by marching along rays: (H, W, 3) sRGB, mask, planar depth."""
    rays = camera.rays() @ camera.cam_from_world[:, :3]
    middle_m = float(camera.project(CENTER_M[None])[1][0])
    srgb = np.full((camera.height_px, camera.width_px, 3), BACKGROUND, np.uint8)
    depth_m = np.zeros(rays.shape[:2], np.float32)
    offset_m = camera.position_m - CENTER_M
    open_rays = np.ones(rays.shape[:2], bool)
    for depth in np.linspace(middle_m - 1.6, middle_m + 1.6, steps):
        at = offset_m + depth * rays
        away = np.linalg.norm(at, axis=-1)
        hit = open_rays & (away <= radius(at / away[..., None]))
        depth_m[hit] = depth
        srgb[hit] = np.rint(encode_srgb(color(at[hit] / away[hit][:, None])) * 255)
        open_rays &= ~hit
    return srgb, ~open_rays, depth_m


def views_of(cameras, radius: Radius, *, masks=True, depth=False, color=true_color):
    """Views of a plant, photographed once when they are made."""

    def view(number, camera):
        srgb, mask, depth_m = photograph(camera, radius, color)
        picture = CrownPicture(srgb=srgb, mask=mask if masks else None, depth_m=depth_m if depth else None)
        return CrownView(name=f"{number:03d}.png", camera=camera, read=lambda: picture)

    return [view(number, camera) for number, camera in enumerate(cameras)]


def true_radius(radius: Radius, center_m, size):
    """Radius (6, size, size) of the surface about another centre, by marching outwards."""
    directions = face_directions(size)
    reach = np.full(directions.shape[:-1], 0.0)
    for step in np.linspace(0.02, 3.0, 1200):
        at = center_m + step * directions - CENTER_M
        away = np.linalg.norm(at, axis=-1)
        reach = np.where(away <= radius(at / away[..., None]), step, reach)
    return reach
