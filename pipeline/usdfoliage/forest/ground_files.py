"""Meshes and clouds of the ground from files, as the raster of heights that a DEM is."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.forest.ground_clouds import is_cloud_file, read_ground_cloud
from usdfoliage.forest.ground_file import GroundFile, as_ground_file
from usdfoliage.forest.ground_frame import frame_ground
from usdfoliage.forest.ground_settings import GroundSettings
from usdfoliage.forest.mesh_heights import areas_in_plan, mesh_heights, spacing_of_mesh
from usdfoliage.forest.obj_file import read_obj
from usdfoliage.forest.raster_files import MAX_PIXELS
from usdfoliage.remarks import Argument, remark

_MESH = (".obj",)
_MAX_VISITS = 10 * MAX_PIXELS  # of pixels, and of rows of them, by the faces of a mesh

Floats = NDArray[np.float64]


def is_ground_file(path: Path) -> bool:
    """Whether a file is a mesh or a cloud by its suffix or its first bytes; else it is a raster."""
    return path.suffix.lower() in _MESH or is_cloud_file(path)


def read_ground(path: Path, settings: GroundSettings = GroundSettings()) -> GroundFile:
    """Read a mesh or a cloud of the ground, with easting, northing and height as x, y and z.

    A mesh in OBJ has its heights at the middles of pixels, exactly. Of a cloud in LAS or LAZ the points of class 2 are
    the ground; in clouds without any the ground is found. Heights are in the unit of the file.

    Args:
        path: The file.
        settings: How large pixels are, and which holes are filled.

    Raises:
        CaptureError: The file cannot be read, has no ground, is in degrees, or would make too many pixels.
    """
    return read_ground_cloud(path, settings) if is_cloud_file(path) else _read_mesh(path, settings)


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
    return as_ground_file(heights, frame, None, 1.0, "", [remark("terrain-gridded", text)])
