"""Views of flat elliptical leaves, exact from a formula."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole


@dataclass(frozen=True, kw_only=True)
class Disc:
    """A flat elliptical leaf."""

    center: tuple[float, float, float]
    half: tuple[float, float] = (0.05, 0.02)
    turn: float = 0.0  # of its length from x, in radians, before it is tilted
    tilt: float = 0.0  # about y
    color: tuple[int, int, int] = (60, 140, 50)

    @property
    def axes(self) -> np.ndarray:
        """(3, 3), rows: along, across, normal."""
        c, s, ct, st = np.cos(self.turn), np.sin(self.turn), np.cos(self.tilt), np.sin(self.tilt)
        about_y = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
        return np.array([about_y @ [c, s, 0], about_y @ [-s, c, 0], about_y @ [0, 0, 1]])


def camera(width: int = 240, height: int = 180, x: float = 0.0, scale: float = 1.0) -> Pinhole:
    """At (x, 0, 0), looking along +z: a footprint of 1 mm at 1 m for 1000 px of focal length."""
    cam_from_world = np.column_stack([np.eye(3), [-x * scale, 0, 0]])
    return Pinhole(
        width_px=width,
        height_px=height,
        focal_px=(1000.0, 1000.0),
        center_px=(width / 2, height / 2),
        cam_from_world=cam_from_world,
    )


def draw_view(
    discs: Sequence[Disc], cam: Pinhole | None = None, *, noise_m: float = 0.0, scale: float = 1.0, seed: int = 0
) -> tuple[View, np.ndarray]:
    """What a camera sees of the leaves, nothing behind them; and which leaf each pixel shows, from 0, -1 for none."""
    cam = camera(scale=scale) if cam is None else cam
    rays = cam.rays()
    depth, owner = np.full(rays.shape[:2], np.inf), np.full(rays.shape[:2], -1)
    color = np.full((*rays.shape[:2], 3), 20.0)
    at = cam.position_m
    for number, disc in enumerate(discs):
        axes, center = disc.axes, np.array(disc.center) * scale
        z = ((center - at) @ axes[2]) / (rays @ axes[2])
        local = (at + rays * z[..., None] - center) @ axes[:2].T / (np.array(disc.half) * scale)
        hit = (np.sum(local**2, axis=2) <= 1) & (z > 0) & (z < depth)
        depth[hit], owner[hit], color[hit] = z[hit], number, disc.color
    rng = np.random.default_rng(seed)
    depth = np.where(np.isfinite(depth), depth + rng.normal(0, noise_m * scale, depth.shape), 0)
    srgb = np.clip(color + rng.normal(0, 2, color.shape), 0, 255).astype(np.uint8)
    return View(name="drawn.png", camera=cam, srgb=srgb, depth_m=depth.astype(np.float32)), owner
