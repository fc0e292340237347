"""The cloud of a plant, as its branches are traced through it: upright, in metres, without ground, with its roots."""

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.ground import find_ground
from usdfoliage.branch.roots import RootSettings, find_roots
from usdfoliage.capture.cloud_input import CloudInput, CloudInputSettings, read_cloud_input
from usdfoliage.capture.cloud_thinning import PointThinner
from usdfoliage.capture.cloud_units import UNITS
from usdfoliage.capture.cloud_up import axis_vector, find_cloud_up, turn_to_y_up
from usdfoliage.errors import FitError, FoliageError
from usdfoliage.steps import StepProgress

LEAST_POINTS = 50  # of a plant without its ground


@dataclass(frozen=True, kw_only=True)
class PlantCloudRequest:
    """Which cloud, and what the user knows of it."""

    path: Path
    roots: RootSettings
    given_roots: Sequence[tuple[float, float, float]] = ()  # in the cloud's own coordinates
    up: str | None = None  # an axis of the cloud; None: told by the cloud
    unit: str | None = None  # of UNITS; None: told by the file
    most_points: int = 400_000  # that branches are traced through

    @classmethod
    def from_options(cls, options: argparse.Namespace) -> "PlantCloudRequest":
        """The cloud that a command line names; FoliageError for values that cannot be."""
        roots, given = read_roots(options.roots)
        if options.most_points < LEAST_POINTS:
            raise FoliageError(f"--most-points must be at least {LEAST_POINTS}, not {options.most_points}")
        return cls(
            path=options.cloud,
            roots=roots,
            given_roots=given,
            up=read_up(options.up),
            unit=read_unit(options.unit),
            most_points=options.most_points,
        )

    def describe(self) -> dict[str, str]:
        """Settings by the names of their options."""
        roots = ";".join(",".join(f"{c:.12g}" for c in place) for place in self.given_roots)
        return {
            "roots": roots or str(self.roots.count or "auto"),
            "up": self.up or "auto",
            "unit": self.unit or "auto",
            "most-points": str(self.most_points),
        }


def read_roots(text: str) -> tuple[RootSettings, tuple[tuple[float, float, float], ...]]:
    """auto, a number of roots, or the places of some, in the cloud's coordinates: x,y,z or x,y,z;x,y,z.

    Raises:
        FoliageError: It is none of these.
    """
    if text == "auto":
        return RootSettings(), ()
    try:
        if re.fullmatch(r"\s*\d+\s*", text):
            return RootSettings(count=int(text)), ()
        places = tuple(tuple(float(part) for part in place.split(",")) for place in text.split(";"))
    except ValueError as error:
        raise FoliageError(f"--roots must be auto, a number above 0, or x,y,z, not {text!r}") from error
    if not all(len(place) == 3 and np.isfinite(place).all() for place in places):
        raise FoliageError(f"--roots must be auto, a number above 0, or x,y,z, not {text!r}")
    return RootSettings(count=len(places)), tuple((place[0], place[1], place[2]) for place in places)


def read_up(text: str) -> str | None:
    """An axis, or None for auto; FoliageError for anything else."""
    if text == "auto":
        return None
    if not re.fullmatch(r"[+-]?[XYZxyz]", text):
        raise FoliageError(f"--up must be auto or one of X, Y, Z, -X, -Y and -Z, not {text!r}")
    return text.upper()


def read_unit(text: str) -> str | None:
    """A unit, or None for auto; FoliageError for one that is not known."""
    if text == "auto":
        return None
    if text not in UNITS:
        raise FoliageError(f"--unit must be auto or one of {', '.join(UNITS)}, not {text!r}")
    return text


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantCloud:
    """A cloud as branches are traced through it."""

    points_m: NDArray[np.float64]  # (N, 3), Y up, the first root at the origin, without ground
    roots_m: NDArray[np.float64]  # (R, 3)
    asset_from_cloud: NDArray[np.float64]  # (4, 4), from the file's coordinates
    source: CloudInput
    ground: int  # points that were left out as ground
    notes: tuple[str, ...]


def read_plant_cloud(request: PlantCloudRequest, progress: StepProgress | None = None) -> PlantCloud:
    """Read a cloud, turn it upright, leave out its ground and find the roots.

    Raises:
        CaptureError: The cloud cannot be used.
        FitError: Nothing is left without the ground, or a root is given that is nowhere near the plant.
    """
    source = read_cloud_input(
        request.path,
        CloudInputSettings(metres_per_unit=None if request.unit is None else UNITS[request.unit]),
        (lambda done, total: progress("read", done / max(total, 1))) if progress else None,
    )
    notes = list(source.notes)
    if request.up is not None:
        axis = axis_vector(request.up)
    else:
        up = find_cloud_up(source.points_m, source.stated_up, source.usual_up)
        axis = up.axis
        notes.append(up.how if up.sure else f"{up.how}; say it with --up if that is wrong")
    turn = turn_to_y_up(axis)
    points_m = source.points_m @ turn.T
    ground = find_ground(points_m)
    if ground.points.any():
        notes.append(f"{int(ground.points.sum()):,} points are ground and left out")
    points_m = points_m[~ground.points]
    if len(points_m) > request.most_points:  # of the plant: ground would take their share
        thinner = PointThinner(request.most_points)
        thinner.add(points_m, None)
        thinned = thinner.finish()
        points_m = thinned.points
        notes.append(f"branches are traced through {len(points_m):,} points, one in {1000 * thinned.cell:.1f} mm")
    if len(points_m) < LEAST_POINTS:
        raise FitError(f"{len(points_m)} points are left without the ground, {LEAST_POINTS} needed ({source.path})")
    if request.given_roots:
        given = np.array(request.given_roots) * source.metres_per_unit - source.origin_m
        roots_m = given @ turn.T
        _check_roots(roots_m, points_m, request)
    else:
        roots_m = find_roots(points_m, request.roots)
        if request.roots.count is not None and len(roots_m) < request.roots.count:
            notes.append(f"{len(roots_m)} of {request.roots.count} roots were found")
    asset_from_cloud = np.eye(4)
    asset_from_cloud[:3, :3] = turn * source.metres_per_unit
    asset_from_cloud[:3, 3] = -turn @ source.origin_m - roots_m[0]
    return PlantCloud(
        points_m=points_m - roots_m[0],
        roots_m=roots_m - roots_m[0],
        asset_from_cloud=asset_from_cloud,
        source=source,
        ground=int(ground.points.sum()),
        notes=tuple(notes),
    )


def _check_roots(roots_m: NDArray[np.float64], points_m: NDArray[np.float64], request: PlantCloudRequest) -> None:
    """FitError for a root (R, 3) that is farther from points (N, 3) than these are high: of another unit or cloud."""
    away_m = np.asarray(cKDTree(points_m).query(roots_m)[0])
    for place, own_m in zip(request.given_roots, away_m.tolist(), strict=True):
        if own_m > np.ptp(points_m[:, 1]):
            told = ",".join(f"{c:.12g}" for c in place)
            raise FitError(
                f"--roots {told} is {own_m:.1f} m from the nearest point of {request.path}; "
                "roots are in the cloud's own coordinates"
            )
