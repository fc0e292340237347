"""Clouds of the ground or of a whole scan from files: a raster of the ground, and the highest points above it."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud_files.las import open_las_parts, read_las_system
from usdfoliage.capture.cloud_files.las_units import LasSystem
from usdfoliage.capture.cloud_files.read import check_cloud_file, iterate_points
from usdfoliage.errors import CaptureError, FitError
from usdfoliage.files.reading import open_regular
from usdfoliage.forest.coordinate_system import check_system, metres_per_unit, system_of
from usdfoliage.forest.ground_file import GroundFile, as_ground_file
from usdfoliage.forest.ground_filter import are_on_ground, find_ground_surface
from usdfoliage.forest.ground_frame import GroundFrame, frame_ground
from usdfoliage.forest.ground_points import SpacingSample, highest_heights, lowest_points, point_heights
from usdfoliage.forest.ground_settings import GroundFilterSettings, GroundSettings
from usdfoliage.forest.obj_file import FARTHEST
from usdfoliage.remarks import Argument, remark

_LAS, _OTHERS = (".las", ".laz"), (".ply", ".e57", ".pts")
_LAS_START, _PLY_STARTS = b"LASF", (b"ply\n", b"ply\r")
_GROUND = 2  # class of points
_NO_PLANTS = (6, 9, 10, 11, 13, 14, 15, 16, 17)  # houses, water, rails, roads, wires and what bears them, bridges
_UNIT_NAMES = {1.0: "m", 0.3048: "ft", 1200 / 3937: "us-ft"}
_SAME_UNIT = 1e-7  # relative: feet are of two sizes, which differ by less than 1e-5
_NO_DEGREES = 360.0  # no longitude is greater

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


class _Part(NamedTuple):
    """Some points of a file, without those that are marked as noise or withheld, or lie too far away."""

    points: Floats  # (N, 3)
    is_ground: Mask  # (N,) of the class ground
    may_be_plant: Mask  # (N,) not of a class that no plant has
    read: int  # points, with those that are left out


class _Survey(NamedTuple):
    """The points of a cloud that are used: those of the class ground, or all."""

    total: int  # in the file
    number: int  # of those
    low: Floats  # (2,) least easting and northing
    high: Floats  # (2,) greatest
    is_classified: bool


def is_cloud_file(path: Path) -> bool:
    """Whether a file is a cloud by its suffix or its first bytes; text in .xyz is a raster, as GDAL reads it."""
    return path.suffix.lower() in _OTHERS or _is_las(path) or _start_of(path) in _PLY_STARTS


def read_ground_cloud(path: Path, settings: GroundSettings = GroundSettings()) -> GroundFile:
    """Read a cloud with easting, northing and height as x, y and z.

    Points of class 2 are the ground. Without any, the ground is found in all points. The highest points are those of
    plants, or of no class.

    Args:
        path: The file.
        settings: How large pixels are, which holes are filled, and how the ground is found.

    Raises:
        CaptureError: The file cannot be read, has no ground, is in degrees, or would make too many pixels.
    """
    name = f"the DEM {path}"
    check_cloud_file(path)
    survey = _survey(path)
    low, high = survey.low, survey.high
    if not survey.number:
        what = f"none of its {survey.total:,} points can be used" if survey.total else "it has no points"
        raise CaptureError(f"{name} has no ground: {what}", "export it again")
    if (low == high).all():
        raise CaptureError(f"all points of {name} are in one place", "export it again")
    system = read_las_system(path) if _is_las(path) else LasSystem()
    crs = system_of(system.text, system.unit.epsg)
    if crs and crs.is_geographic and np.abs([low, high]).max() > _NO_DEGREES:
        crs = None  # what it states cannot be
    check_system(crs, (low + high) / 2, name, "PDAL's filters.reprojection to {}")
    unit = metres_per_unit(crs) if crs else system.unit.metres_per_unit or 1.0
    if settings.spacing_m is None:
        sample = SpacingSample(low, high, survey.number)
        for part in _used_parts(path, survey):
            sample.add(part[:, :2])
        cell = sample.spacing()
    else:
        cell = settings.spacing_m / unit
    frame = frame_ground(low, high, cell, name, whole=True)
    parts = _used_parts(path, survey)
    if not survey.is_classified:
        units = np.array([unit, unit, system.unit.metres_per_height or unit])
        parts = _find_ground(path, survey, frame, units, settings.filter)
    heights = point_heights(parts, frame, settings.max_gap_m / unit)
    highest = highest_heights((part.points[part.may_be_plant] for part in _parts(path)), frame)
    kind = "of the class ground" if survey.is_classified else "in all"
    text = f"{path.name} has {survey.number:,} points {kind}; their heights are taken every {cell * unit:.3g} m"
    remarks = [remark("terrain-gridded", text)]
    if not survey.is_classified:
        text = f"no point of {path.name} is of the class 2, ground: the ground was found in all points"
        remarks.append(remark("terrain-unclassified", text))
    return as_ground_file(heights, frame, crs, unit, _unit_name(system.unit.metres_per_height), remarks, highest)


def _survey(path: Path) -> _Survey:
    total = 0
    counts = np.zeros(2, np.int64)  # of all that can be used, and of those of the ground
    low, high = np.full((2, 2), np.inf), np.full((2, 2), -np.inf)
    for part in _parts(path):
        total += part.read
        for number, chosen in enumerate((part.points[:, :2], part.points[part.is_ground, :2])):
            if len(chosen):
                counts[number] += len(chosen)
                low[number] = np.minimum(low[number], chosen.min(axis=0))
                high[number] = np.maximum(high[number], chosen.max(axis=0))
    own = int(counts[1] > 0)
    return _Survey(total, int(counts[own]), low[own], high[own], bool(own))


def _find_ground(
    path: Path, survey: _Survey, frame: GroundFrame, units: Floats, settings: GroundFilterSettings
) -> Iterator[Floats]:
    """The points (N, 3) of the ground, part by part, of a cloud without classes; units are metres of each coordinate.

    Raises:
        CaptureError: There is no ground in it.
    """
    origin = np.append(frame.low, 0.0)
    lows = lowest_points(_used_parts(path, survey), frame)
    try:
        surface = find_ground_surface((lows - origin) * units, settings)
    except FitError as error:
        raise CaptureError(
            f"no ground is found in {path}: {error.text}",
            ("give a scan with ground in it, or a DEM and ", Argument(name="canopy")),
        ) from error
    for part in _used_parts(path, survey):
        yield part[are_on_ground(surface, (part - origin) * units, settings.near_m)]


def _used_parts(path: Path, survey: _Survey) -> Iterator[Floats]:
    """The points (N, 3) of the ground or, without classes, all, part by part."""
    for part in _parts(path):
        yield part.points[part.is_ground] if survey.is_classified else part.points


def _parts(path: Path) -> Iterator[_Part]:
    if not _is_las(path):
        for points, used in iterate_points(path):
            chosen = points[used & _are_near(points)]
            none = np.zeros(len(chosen), bool)
            yield _Part(chosen, none, ~none, len(points))
        return
    for part in open_las_parts(path, unit_is_given=True).parts:
        kept = ~part.is_marked & _are_near(part.points)
        classes = (np.zeros(len(part.points), np.uint8) if part.classes is None else part.classes)[kept]
        yield _Part(part.points[kept], classes == _GROUND, ~np.isin(classes, _NO_PLANTS), len(kept))


def _are_near(points: Floats) -> Mask:
    return np.asarray((np.abs(points) <= FARTHEST).all(axis=1))  # which no NaN is


def _unit_name(metres: float | None) -> str:
    """Of heights, as rasters state it; empty where nothing is stated."""
    if metres is None:
        return ""
    return next(
        (name for size, name in _UNIT_NAMES.items() if abs(metres - size) <= _SAME_UNIT * size), f"{metres:g} m"
    )


def _is_las(path: Path) -> bool:
    return path.suffix.lower() in _LAS or _start_of(path) == _LAS_START


def _start_of(path: Path) -> bytes:
    """The first bytes of a file; none where it cannot be read."""
    try:
        with open_regular(path) as file:
            return file.read(len(_LAS_START))
    except OSError:
        return b""
