"""Meshes and clouds of the ground from files, as the raster of heights that a DEM is."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rasterio.crs import CRS

from usdfoliage.capture.cloud_files.las import open_las_parts, read_las_system
from usdfoliage.capture.cloud_files.read import check_cloud_file
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import open_regular
from usdfoliage.forest.coordinate_system import check_system, metres_per_unit, system_of
from usdfoliage.forest.ground_frame import GroundFrame, GroundSettings, frame_ground
from usdfoliage.forest.ground_points import SpacingSample, point_heights
from usdfoliage.forest.mesh_heights import areas_in_plan, mesh_heights, spacing_of_mesh
from usdfoliage.forest.obj_file import FARTHEST, read_obj
from usdfoliage.forest.raster import Raster
from usdfoliage.forest.raster_files import MAX_PIXELS, RasterFile
from usdfoliage.remarks import Argument, Remark, remark

_MESH, _CLOUD = (".obj",), (".las", ".laz")
_LAS_START = b"LASF"
_GROUND = 2  # class of points
_UNIT_NAMES = {1.0: "m", 0.3048: "ft", 1200 / 3937: "us-ft"}
_SAME_UNIT = 1e-7  # relative: feet are of two sizes, which differ by less than 1e-5
_MAX_VISITS = 10 * MAX_PIXELS  # of pixels, and of rows of them, by the faces of a mesh
_NO_DEGREES = 360.0  # no longitude is greater

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundFile:
    """A mesh or a cloud as a raster of heights, and what the user should know of it."""

    file: RasterFile
    remarks: tuple[Remark, ...]


def is_ground_file(path: Path) -> bool:
    """Whether a file is a mesh or a cloud by its suffix or its first bytes; else it is a raster."""
    return path.suffix.lower() in _MESH or _is_cloud(path)


def read_ground(path: Path, settings: GroundSettings = GroundSettings()) -> GroundFile:
    """Read a mesh or a cloud of the ground, with easting, northing and height as x, y and z.

    A mesh in OBJ has its heights at the middles of pixels, exactly. Of a cloud in LAS or LAZ the points of class 2 are
    the ground; without any, the lowest point of each pixel is. Heights are in the unit of the file.

    Args:
        path: The file.
        settings: How large pixels are, and which holes are filled.

    Raises:
        CaptureError: The file cannot be read, has no ground, is in degrees, or would make too many pixels.
    """
    return _read_cloud(path, settings) if _is_cloud(path) else _read_mesh(path, settings)


def _read_mesh(path: Path, settings: GroundSettings) -> GroundFile:
    name = f"the DEM {path}"
    mesh = read_obj(path, "the DEM")
    covers = areas_in_plan(mesh.points, mesh.triangles)
    if not covers.sum() > 0:
        raise CaptureError(f"{name} has no face that covers ground", "export it with its heights as z")
    edges = mesh.points[mesh.triangles]
    upright = np.abs(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])).sum(axis=0) / 2
    if upright[1] > 2 * upright[2]:
        raise CaptureError(f"{name} stands upright: its heights seem to be y", "export it with z up")
    used = mesh.points[np.unique(mesh.triangles[covers > 0])]
    low, high = used[:, :2].min(axis=0), used[:, :2].max(axis=0)
    cell = spacing_of_mesh(mesh.points, mesh.triangles) if settings.spacing_m is None else settings.spacing_m
    frame = frame_ground(low, high, cell, name, whole=False)
    rows = np.ptp(edges[:, :, 1], axis=1).sum() / cell
    if not covers.sum() / cell**2 + rows <= _MAX_VISITS:
        raise CaptureError(
            f"the faces of {name} would cover {covers.sum() / cell**2:,.0f} pixels, as many lie over each other",
            ("give the surface of the ground alone, or a greater length to ", Argument(name="ground_spacing")),
        )
    heights = mesh_heights(mesh.points, mesh.triangles, frame)
    text = f"{path.name} has {len(mesh.triangles):,} triangles; their heights are taken every {cell:.3g} m"
    return _as_file(heights, frame, None, 1.0, "", [remark("terrain-gridded", text)])


def _read_cloud(path: Path, settings: GroundSettings) -> GroundFile:
    name = f"the DEM {path}"
    check_cloud_file(path)
    total, count, low, high, classified = _survey(path)
    if not count:
        what = f"none of its {total:,} points can be used" if total else "it has no points"
        raise CaptureError(f"{name} has no ground: {what}", "export it again")
    if (low == high).all():
        raise CaptureError(f"all points of {name} are in one place", "export it again")
    system = read_las_system(path)
    crs = system_of(system.text, system.unit.epsg)
    if crs and crs.is_geographic and np.abs([low, high]).max() > _NO_DEGREES:
        crs = None  # what it states cannot be
    check_system(crs, (low + high) / 2, name, "PDAL's filters.reprojection to {}")
    unit = metres_per_unit(crs) if crs else system.unit.metres_per_unit or 1.0
    if settings.spacing_m is None:
        sample = SpacingSample(low, high, count)
        for part in _ground_parts(path, classified=classified):
            sample.add(part[:, :2])
        cell = sample.spacing()
    else:
        cell = settings.spacing_m / unit
    frame = frame_ground(low, high, cell, name, whole=True)
    parts = _ground_parts(path, classified=classified)
    heights = point_heights(parts, frame, settings.max_gap_m / unit, lowest=not classified)
    kind = "of the class ground" if classified else "in all"
    text = f"{path.name} has {count:,} points {kind}; their heights are taken every {cell * unit:.3g} m"
    remarks = [remark("terrain-gridded", text)]
    if not classified:
        text = f"no point of {path.name} is of the class 2, ground: the lowest point of each pixel is taken"
        remarks.append(remark("terrain-unclassified", text))
    return _as_file(heights, frame, crs, unit, _unit_name(system.unit.metres_per_height), remarks)


def _survey(path: Path) -> tuple[int, int, Floats, Floats, bool]:
    """Points in all, those that are the ground, their least and greatest easting and northing, whether by a class."""
    total = 0
    counts = np.zeros(2, np.int64)  # of all that can be used, and of those of the ground
    low, high = np.full((2, 2), np.inf), np.full((2, 2), -np.inf)
    for points, is_ground, read in _parts(path):
        total += read
        near = (np.abs(points) <= FARTHEST).all(axis=1)
        for number, chosen in enumerate((near, near & is_ground)):
            if chosen.any():
                counts[number] += int(chosen.sum())
                low[number] = np.minimum(low[number], points[chosen, :2].min(axis=0))
                high[number] = np.maximum(high[number], points[chosen, :2].max(axis=0))
    own = int(counts[1] > 0)
    return total, int(counts[own]), low[own], high[own], bool(own)


def _ground_parts(path: Path, *, classified: bool) -> Iterator[Floats]:
    """The points (N, 3) of the ground, part by part."""
    for points, is_ground, _ in _parts(path):
        near = (np.abs(points) <= FARTHEST).all(axis=1)
        yield points[near & is_ground] if classified else points[near]


def _parts(path: Path) -> Iterator[tuple[Floats, NDArray[np.bool_], int]]:
    """Points (N, 3) that are not marked as noise or withheld, (N,) which are of the class ground, how many are read."""
    for part in open_las_parts(path, unit_is_given=True).parts:
        kept = ~part.is_marked
        classes = np.zeros(len(part.points), np.uint8) if part.classes is None else part.classes
        yield part.points[kept], (classes == _GROUND)[kept], len(kept)


def _as_file(
    heights: Floats, frame: GroundFrame, crs: CRS | None, unit: float, value_unit: str, remarks: list[Remark]
) -> GroundFile:
    return GroundFile(
        file=RasterFile(
            raster=Raster(
                values=heights,
                ground_from_pixel=frame.ground_from_pixel * unit,
                crs=crs.to_wkt() if crs else "",
            ),
            metres_per_unit=unit,
            value_unit=value_unit,
            has_crs=bool(crs),
            largest_integer=0,
        ),
        remarks=tuple(remarks),
    )


def _unit_name(metres: float | None) -> str:
    """Of heights, as rasters state it; empty where nothing is stated."""
    if metres is None:
        return ""
    return next(
        (name for size, name in _UNIT_NAMES.items() if abs(metres - size) <= _SAME_UNIT * size), f"{metres:g} m"
    )


def _is_cloud(path: Path) -> bool:
    if path.suffix.lower() in _CLOUD:
        return True
    try:
        with open_regular(path) as file:
            return file.read(len(_LAS_START)) == _LAS_START
    except OSError:
        return False
