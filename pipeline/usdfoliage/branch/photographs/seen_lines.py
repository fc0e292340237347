"""The lines of a posed photograph in space: through each middle a ray, and through its line a plane."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.photographs.lines import Lines
from usdfoliage.geometry.pinhole import Pinhole


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenLines:
    """Middles of lines, as one photograph sees them in the world, line after line."""

    position_m: NDArray[np.float64]  # (3,), of the camera
    pixel_rad: float  # angle between neighbouring pixels in the middle of the photograph
    ray: NDArray[np.float64]  # (N, 3), from the camera through the middle, of length 1
    plane: NDArray[np.float64]  # (N, 3), normal of length 1 of the plane that holds the camera and the line there
    width: NDArray[np.float64]  # (N,), metres for each metre of distance
    color: NDArray[np.float32]  # (N, 3), CIELAB
    line: NDArray[np.int64]  # (N,), number of the line, never falling

    def __len__(self) -> int:
        return len(self.line)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.integer]) -> "SeenLines":
        """These middles alone, in their order."""
        every = (each.name for each in fields(self) if each.name not in ("position_m", "pixel_rad"))
        return replace(self, **{name: getattr(self, name)[chosen] for name in every})


def place_lines(lines: Lines, camera: Pinhole) -> SeenLines:
    """Lines of a photograph without lens distortion, in the world of its camera."""
    focal_px, center_px = np.array(camera.focal_px), np.array(camera.center_px)
    in_cam = np.column_stack([(lines.places_px - center_px) / focal_px, np.ones(len(lines))])
    along = np.stack([-np.sin(lines.normal_rad), np.cos(lines.normal_rad)], axis=1) / focal_px
    normal = np.cross(in_cam, np.column_stack([along, np.zeros(len(lines))]))
    length = np.linalg.norm(in_cam, axis=1)
    turn = camera.cam_from_world[:, :3]
    pixel_rad = float(1 / np.sqrt(np.prod(focal_px)))
    return SeenLines(
        position_m=camera.position_m,
        pixel_rad=pixel_rad,
        ray=in_cam / length[:, None] @ turn,
        plane=normal / np.linalg.norm(normal, axis=1, keepdims=True) @ turn,
        width=lines.width_px * pixel_rad / length,
        color=lines.color,
        line=lines.line,
    )


def ranges_in_box(seen: SeenLines, box_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N,) distances at which rays enter and leave a box (2, 3), lowest and highest corner; 0 and 0 where they miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        to_low, to_high = ((corner_m - seen.position_m) / seen.ray for corner_m in box_m)
    near_m = np.nanmax(np.minimum(to_low, to_high), axis=1)
    far_m = np.nanmin(np.maximum(to_low, to_high), axis=1)
    # A camera in the box sees it from its very position on.
    near_m = np.maximum(near_m, 1e-3 * float(np.linalg.norm(box_m[1] - box_m[0])))
    hit = far_m > near_m
    return np.where(hit, near_m, 0.0), np.where(hit, far_m, 0.0)
