"""Cameras that show the whole of a shape. Directions are given in the asset's frame, whichever axis is up.

At azimuth 0 the camera stands before the front (on +Z in a Y-up stage, on −Y in a Z-up one); azimuth grows towards +X,
which is on the right of the front picture; elevation is positive from above.
"""

import math
from dataclasses import dataclass

from pxr import Gf

FIELD_OF_VIEW_RAD = math.radians(30.0)  # of the narrower side: flat enough to judge a shape, near enough for depth
MARGIN = 0.05  # of the picture, left free on each side
FILM_MM = 24.0


@dataclass(frozen=True, kw_only=True)
class Shape:
    """What has to be in the picture, in the stage's frame and unit."""

    middle: Gf.Vec3d  # of the bound; what cameras look at
    corners: tuple[Gf.Vec3d, ...]  # points whose convex hull holds everything
    reach: float  # diagonal of the bound, above zero


@dataclass(frozen=True, kw_only=True)
class Direction:
    """Where a camera stands, seen from the middle of the shape."""

    azimuth_rad: float
    elevation_rad: float


def camera_axes(direction: Direction, z_up: bool) -> tuple[Gf.Vec3d, Gf.Vec3d, Gf.Vec3d]:
    """Unit vectors right, up and backward (from the shape to the camera) of the picture, in the stage's frame."""
    a, e = direction.azimuth_rad, direction.elevation_rad
    axes = (
        Gf.Vec3d(math.cos(a), 0, -math.sin(a)),
        Gf.Vec3d(-math.sin(a) * math.sin(e), math.cos(e), -math.cos(a) * math.sin(e)),
        Gf.Vec3d(math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)),
    )
    if z_up:
        axes = tuple(Gf.Vec3d(v[0], -v[2], v[1]) for v in axes)
    return axes


def _coordinates(shape: Shape, axes: tuple[Gf.Vec3d, Gf.Vec3d, Gf.Vec3d]) -> list[tuple[float, float, float]]:
    """Corners of the shape about its middle, along right, up and backward."""
    return [tuple(Gf.Dot(corner - shape.middle, axis) for axis in axes) for corner in shape.corners]


def _transform(axes: tuple[Gf.Vec3d, Gf.Vec3d, Gf.Vec3d], position: Gf.Vec3d) -> Gf.Matrix4d:
    rows = [(*axis, 0.0) for axis in axes] + [(*position, 1.0)]
    return Gf.Matrix4d(*(value for row in rows for value in row))


def _half_tangents(width_px: int, height_px: int) -> tuple[float, float]:
    """Tangents of half the horizontal and half the vertical field of view, margin not yet taken off."""
    narrow = math.tan(FIELD_OF_VIEW_RAD / 2)
    side = min(width_px, height_px)
    return narrow * width_px / side, narrow * height_px / side


def distance_to_fit(shape: Shape, direction: Direction, z_up: bool, width_px: int, height_px: int) -> float:
    """How far from the shape's middle a camera that looks at it must stand to see all of it."""
    across, upward = (t * (1 - 2 * MARGIN) for t in _half_tangents(width_px, height_px))
    corners = _coordinates(shape, camera_axes(direction, z_up))
    return max(max(z + abs(x) / across, z + abs(y) / upward) for x, y, z in corners)


def frame_perspective(
    shape: Shape, direction: Direction, z_up: bool, width_px: int, height_px: int, distance: float | None = None
) -> Gf.Camera:
    """A camera that looks at the middle of the shape and sees all of it.

    Args:
        shape: What to show.
        direction: Where the camera stands.
        z_up: The stage's up axis.
        width_px, height_px: The picture, for its aspect.
        distance: From the middle, where several pictures must share one; by default just enough.
    """
    axes = camera_axes(direction, z_up)
    if distance is None:
        distance = distance_to_fit(shape, direction, z_up, width_px, height_px)
    across, upward = _half_tangents(width_px, height_px)
    camera = Gf.Camera()
    camera.projection = Gf.Camera.Perspective
    camera.transform = _transform(axes, shape.middle + axes[2] * distance)
    camera.horizontalAperture = FILM_MM
    camera.verticalAperture = FILM_MM * upward / across
    camera.focalLength = FILM_MM / (2 * across)
    # Twice the radius leaves room for geometry that a shader displaces beyond its bound.
    reach = shape.reach
    camera.clippingRange = Gf.Range1f(max(distance - reach, distance / 1000), distance + reach)
    return camera


def place_pinhole(pinhole: dict, width_px: int, height_px: int, bound: Gf.Range3d) -> Gf.Camera:
    """A camera as photogrammetry gives it, with square pixels.

    Args:
        pinhole: "focal_px"; "center_px", x and y of the principal point from the picture's top left corner;
            "cam_from_stage", 3 rows of 4 numbers for column vectors, to axes x right, y down, z forward.
        width_px, height_px: The picture.
        bound: What is in the stage; it decides the clipping planes.
    """
    right, down, forward = (Gf.Vec3d(*row[:3]) for row in pinhole["cam_from_stage"])
    moved = Gf.Vec3d(*(row[3] for row in pinhole["cam_from_stage"]))
    position = -(right * moved[0] + down * moved[1] + forward * moved[2])
    x_px, y_px = pinhole["center_px"]
    film_px = FILM_MM / width_px
    camera = Gf.Camera()
    camera.projection = Gf.Camera.Perspective
    camera.transform = _transform((right, -down, -forward), position)
    camera.horizontalAperture = FILM_MM
    camera.verticalAperture = height_px * film_px
    camera.horizontalApertureOffset = (width_px / 2 - x_px) * film_px
    camera.verticalApertureOffset = (y_px - height_px / 2) * film_px
    camera.focalLength = pinhole["focal_px"] * film_px
    depths = [Gf.Dot(bound.GetCorner(i) - position, forward) for i in range(8)]
    reach = bound.GetSize().GetLength()
    # Twice the bound, for what a shader displaces beyond it; a camera may stand within.
    far = max(max(depths) + reach, reach)
    camera.clippingRange = Gf.Range1f(max(min(depths) - reach, far / 10000), far)
    return camera


def fit_window(
    shape: Shape, direction: Direction, z_up: bool, width_px: int, height_px: int
) -> tuple[float, float, float, float]:
    """The orthographic window (left, right, bottom, top) of the picture's aspect that holds the shape and a margin.

    Coordinates are along the picture's right and up, from the stage's origin, in the stage's unit.
    """
    axes = camera_axes(direction, z_up)
    corners = _coordinates(shape, axes)
    half_x, half_y = (max(abs(corner[k]) for corner in corners) / (1 - 2 * MARGIN) for k in (0, 1))
    half_x = max(half_x, half_y * width_px / height_px)
    half_y = half_x * height_px / width_px
    x, y = Gf.Dot(shape.middle, axes[0]), Gf.Dot(shape.middle, axes[1])
    return x - half_x, x + half_x, y - half_y, y + half_y


def frame_orthographic(
    shape: Shape, direction: Direction, z_up: bool, window: tuple[float, float, float, float]
) -> Gf.Camera:
    """A camera without perspective that shows the window (left, right, bottom, top; see fit_window)."""
    axes = camera_axes(direction, z_up)
    left, right, bottom, top = window
    reach = shape.reach
    depth = Gf.Dot(shape.middle, axes[2]) + 2 * reach
    position = axes[0] * ((left + right) / 2) + axes[1] * ((bottom + top) / 2) + axes[2] * depth
    camera = Gf.Camera()
    camera.projection = Gf.Camera.Orthographic
    camera.transform = _transform(axes, position)
    camera.horizontalAperture = (right - left) / Gf.Camera.APERTURE_UNIT
    camera.verticalAperture = (top - bottom) / Gf.Camera.APERTURE_UNIT
    camera.clippingRange = Gf.Range1f(reach / 100, 4 * reach)
    return camera
