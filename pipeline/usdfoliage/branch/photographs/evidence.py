"""What all photographs show of a place on a line: a stem, the border or a vein of a leaf, or nothing. Our own.

A stem is a line in every photograph that sees it, and its surface ends on both sides. A leaf seen from its edge, or a
strip along its border, is a line in some photographs; in the others its surface goes on at one side or at both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.photographs.seen_lines import SeenLines
from usdfoliage.geometry.pinhole import Pinhole

_NEAREST = 4  # middles of a photograph that are compared with a place
_END_ON = 0.3  # sine of the angle between a line and the ray to it, below which it is a spot


@dataclass(frozen=True, kw_only=True)
class EvidenceSettings:
    """What is evidence of a stem. Lengths with _px are on the photograph that looks."""

    line_px: float = 1.7  # A place is on a line up to this far from its middle. Range: above 0.
    line_widths: float = 0.3  # Likewise, in widths of the line.
    parallel: float = 0.3  # Sine of the angle between the place's line and the photograph's, at most.
    width: float = 0.5  # Logarithm by which both may differ in width.
    hidden: float = 0.006  # A place is hidden where depth is less than its own by more than this share of it.
    beside_px: float = 7.0  # So far beside a line's edge a surface that goes on is a leaf's. Range: above 0.
    surface: float = 0.0035  # A surface goes on where depth differs by less than this share of it.
    slant: float = 0.5  # and by this for each length that it lies aside.

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True, eq=False)
class StemEvidence:
    """What photographs show at each place."""

    seen: NDArray[np.int64]  # (M,), photographs in which it is neither hidden nor seen end-on
    lines: NDArray[np.int64]  # (M,), those among them that have a line there, in its direction and as wide
    beside: NDArray[np.float64]  # (M,), sides on which its surface goes on, in their mean: 0 to 2

    @property
    def share(self) -> NDArray[np.float64]:
        """(M,) share of the photographs that see the place, that have a line there."""
        return np.asarray(self.lines / np.maximum(self.seen, 1))


def collect_evidence(
    points_m: NDArray[np.float64],
    along: NDArray[np.float64],
    radius_m: NDArray[np.float64],
    seen: Sequence[SeenLines],
    cameras: Sequence[Pinhole],
    depths_m: Sequence[NDArray[np.float32]],
    settings: EvidenceSettings = EvidenceSettings(),
) -> StemEvidence:
    """Ask every photograph about places on lines.

    Args:
        points_m: (M, 3), in the world.
        along: (M, 3), directions of the lines, of length 1.
        radius_m: (M,).
        seen: The lines of each photograph.
        cameras: Of each photograph.
        depths_m: (H, W) of each photograph, 0 where there is none.
        settings: What is evidence.
    """
    count = len(points_m)
    sees, lines, sides = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros(count)
    for own, camera, depth_m in zip(seen, cameras, depths_m, strict=True):
        places, away_m = camera.project(points_m)
        inside = np.isfinite(places).all(axis=1) & (away_m > 0)
        inside &= ((places >= 0) & (places < (camera.width_px, camera.height_px))).all(axis=1)
        chosen = np.flatnonzero(inside)
        ray = points_m[chosen] - own.position_m
        distance_m = np.linalg.norm(ray, axis=1)
        ray /= distance_m[:, None]
        across = np.cross(ray, along[chosen])
        sine = np.linalg.norm(across, axis=1)
        behind_m = _look_up(depth_m, places[chosen])
        free = ~((behind_m > 0) & (behind_m < (1 - settings.hidden) * away_m[chosen])) & (sine > _END_ON)
        chosen, ray, distance_m, across, sine = (each[free] for each in (chosen, ray, distance_m, across, sine))
        across /= sine[:, None]
        sees[chosen] += 1
        lines[chosen] += _on_lines(ray, across, 2 * radius_m[chosen] / distance_m, own, settings)
        sides[chosen] += _sides_going_on(
            points_m[chosen], across, radius_m[chosen], away_m[chosen], camera, depth_m, settings
        )
    return StemEvidence(seen=sees, lines=lines, beside=sides / np.maximum(sees, 1))


def _on_lines(
    ray: NDArray[np.float64],
    across: NDArray[np.float64],
    width: NDArray[np.float64],
    own: SeenLines,
    settings: EvidenceSettings,
) -> NDArray[np.bool_]:
    """(K,) whether a photograph has a line where rays (K, 3) meet it, across them (K, 3), as wide (K,)."""
    if not len(own) or not len(ray):
        return np.zeros(len(ray), bool)
    reach = 2 * settings.line_px * own.pixel_rad
    nearest = min(_NEAREST, len(own))
    away, at = cKDTree(own.ray).query(ray, k=nearest, distance_upper_bound=reach)
    away, at = np.asarray(away).reshape(len(ray), nearest), np.asarray(at).reshape(len(ray), nearest)
    found = np.isfinite(away)
    at = np.where(found, at, 0)
    plane = own.plane[at]
    aside = np.abs(np.einsum("kni,ki->kn", plane, ray))
    cosine = np.abs(np.einsum("kni,ki->kn", plane, across))
    wider = np.abs(np.log(own.width[at] / width[:, None]))
    near = np.maximum(settings.line_px * own.pixel_rad, settings.line_widths * width)[:, None]
    good = found & (aside < near) & (cosine > np.sqrt(1 - settings.parallel**2)) & (wider < settings.width)
    return np.asarray(good.any(axis=1))


def _sides_going_on(
    points_m: NDArray[np.float64],
    across: NDArray[np.float64],
    radius_m: NDArray[np.float64],
    away_m: NDArray[np.float64],
    camera: Pinhole,
    depth_m: NDArray[np.float32],
    settings: EvidenceSettings,
) -> NDArray[np.int64]:
    """(K,) sides, 0 to 2, on which depth beside a line is that of the line."""
    focal_px = float(np.sqrt(np.prod(camera.focal_px)))
    aside_m = radius_m + settings.beside_px / focal_px * away_m
    sides = np.zeros(len(points_m), np.int64)
    for side in (-1, 1):
        places, _ = camera.project(points_m + side * aside_m[:, None] * across)
        there_m = _look_up(depth_m, places)
        same_m = settings.surface * away_m + settings.slant * aside_m
        sides += (there_m > 0) & (np.abs(there_m - away_m) < same_m)
    return sides


def _look_up(depth_m: NDArray[np.float32], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K,) depth at places (K, 2), x and y; 0 outside the map."""
    height, width = depth_m.shape
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((places >= 0) & (places < (width, height))).all(axis=1))
    column, row = np.where(inside[:, None], places, 0).astype(np.int64).T
    return np.where(inside, depth_m[row, column], 0).astype(np.float64)
