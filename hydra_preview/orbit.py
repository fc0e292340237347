"""A camera that is led around a point with the mouse, by the habits of usdview."""

import math
from dataclasses import dataclass, replace

from framing import FIELD_OF_VIEW_RAD, Direction, Shape, camera_axes, distance_to_fit, frame_perspective
from pxr import Gf

TURN_DEG_PX = 0.25
ZOOM_PX = 0.002
WHEEL = 1 / 1000  # of a wheel's eighths of degrees


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """Where the camera stands."""

    target: Gf.Vec3d  # what it looks at and turns about
    direction: Direction
    distance: float  # from the target
    z_up: bool


def frame_all(shape: Shape, direction: Direction, z_up: bool, width_px: int, height_px: int) -> Orbit:
    """Look at the middle of a shape, from where all of it is seen."""
    distance = distance_to_fit(shape, direction, z_up, width_px, height_px)
    return Orbit(target=shape.middle, direction=direction, distance=distance, z_up=z_up)


def tumble(orbit: Orbit, x_px: float, y_px: float) -> Orbit:
    """Turn about the target, by a drag; never over the pole."""
    turn = math.radians(TURN_DEG_PX)
    elevation = min(max(orbit.direction.elevation_rad + y_px * turn, -math.pi / 2), math.pi / 2)
    azimuth = orbit.direction.azimuth_rad - x_px * turn
    return replace(orbit, direction=Direction(azimuth_rad=azimuth, elevation_rad=elevation))


def truck(orbit: Orbit, x_px: float, y_px: float, narrow_px: int) -> Orbit:
    """Move the picture with the mouse; narrow_px is the picture's shorter side."""
    right, up, _ = camera_axes(orbit.direction, orbit.z_up)
    unit = 2 * math.tan(FIELD_OF_VIEW_RAD / 2) * orbit.distance / narrow_px
    return replace(orbit, target=orbit.target - right * (x_px * unit) + up * (y_px * unit))


def zoom(orbit: Orbit, x_px: float, y_px: float) -> Orbit:
    """Come nearer by a drag to the right or downwards."""
    return _scale_distance(orbit, 1 - ZOOM_PX * (x_px + y_px))


def zoom_wheel(orbit: Orbit, delta: float) -> Orbit:
    """Come nearer by a turn of the wheel, in eighths of degrees."""
    return _scale_distance(orbit, 1 - max(-0.5, min(0.5, delta * WHEEL)))


def camera_of(orbit: Orbit, shape: Shape, width_px: int, height_px: int) -> Gf.Camera:
    """The camera, with clipping planes that hold the shape."""
    beyond = (shape.middle - orbit.target).GetLength()
    around = Shape(middle=orbit.target, corners=shape.corners, reach=shape.reach + beyond)
    return frame_perspective(around, orbit.direction, orbit.z_up, width_px, height_px, orbit.distance)


def _scale_distance(orbit: Orbit, factor: float) -> Orbit:
    return replace(orbit, distance=orbit.distance * min(max(factor, 0.1), 10.0))
