"""From the crown's surface to its radius cubemap, and what the front of it shows (thesis section 4.6)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.crown.surface import CrownSurface
from usdfoliage.errors import FitError
from usdfoliage.geometry.cubemap import face_directions, sample_cubemap


@dataclass(frozen=True, kw_only=True)
class RadiusSettings:
    """Size of the cubemap and how the base surface fills it."""

    size: int = 256  # texels a side of a face
    copies: int = 1  # copies of the surface, turned about the vertical axis by 180°/copies each (fig. 4.16)
    threads: int = 0  # 0: one per core

    def __post_init__(self) -> None:
        if not 8 <= self.size <= 4096:
            raise ValueError(f"size must be from 8 to 4096 texels, not {self.size}")
        if not 1 <= self.copies <= 4:
            raise ValueError(f"copies must be from 1 to 4, not {self.copies}")


def render_radius(surface: CrownSurface, settings: RadiusSettings = RadiusSettings()) -> NDArray[np.float64]:
    """Radius cubemap (6, N, N) of the surface and its mirror image, in cells, from the origin.

    Each texel is the exact distance to the farthest triangle on its ray. Copies are turned about the vertical axis and
    the largest radius is kept, but none may show outside the front silhouette of those before.

    Raises:
        FitError: A ray from the centre meets nothing: the centre is not inside the surface.

    Source:
        Argudo, section 4.6 and fig. 4.16.
    """
    back = surface.points * [1, 1, -1]
    points = np.concatenate([surface.points, back])
    triangles = np.concatenate([surface.triangles, surface.triangles[:, ::-1] + len(surface.points)]).astype(np.int32)
    radius = np.zeros((6, settings.size, settings.size))
    for copy in range(settings.copies):
        angle = np.pi * copy / settings.copies
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        turned = np.ascontiguousarray(points @ turn.T)
        seen, _ = _native.radius_map(turned, triangles, settings.size, settings.threads)
        radius = np.maximum(radius, within_outline(seen, front_outline(radius)) if copy else seen)
    missed = np.count_nonzero(radius <= 0)
    if missed:
        raise FitError(f"{missed} of {radius.size} rays from the crown's centre leave it without meeting its surface")
    return np.asarray(radius)


def front_outline(radius: NDArray[np.floating], angles: int = 2048, elevations: int = 181) -> NDArray[np.float64]:
    """Radius by angle (angles,) of the silhouette that a radius cubemap shows to a camera on +z, orthographically.

    The silhouette of a star-shaped surface is star-shaped: at each angle about z it is the greatest distance from the
    axis along that meridian. Angle 0 is +x, a quarter turn +y.
    """
    angle = 2 * np.pi * np.arange(angles) / angles
    elevation = np.linspace(-0.5, 0.5, elevations) * np.pi * 0.95
    flat, rise = np.cos(elevation), np.sin(elevation)
    directions = np.stack(
        [
            np.cos(angle)[:, None] * flat,
            np.sin(angle)[:, None] * flat,
            np.broadcast_to(rise, (angles, elevations)),
        ],
        axis=-1,
    )
    return np.asarray((sample_cubemap(radius, directions) * flat).max(axis=1))


def within_outline(radius: NDArray[np.floating], outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """The radius cubemap cut so that no texel shows outside a front outline (A,)."""
    directions = face_directions(radius.shape[1])
    across = np.hypot(directions[..., 0], directions[..., 1])
    angle = np.mod(np.arctan2(directions[..., 1], directions[..., 0]), 2 * np.pi)
    position = angle / (2 * np.pi) * len(outline)
    limit = np.interp(position, np.arange(len(outline) + 1), np.append(outline, outline[0]))
    return np.minimum(radius, limit / np.maximum(across, 1e-9))
