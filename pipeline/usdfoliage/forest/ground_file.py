"""What is read of a mesh or a cloud of the ground: a raster of heights, as a DEM is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rasterio.crs import CRS

from usdfoliage.forest.ground_frame import GroundFrame
from usdfoliage.forest.raster import Raster
from usdfoliage.forest.raster_files import RasterFile
from usdfoliage.remarks import Remark

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundFile:
    """A mesh or a cloud as a raster of heights, and what the user should know of it."""

    file: RasterFile
    remarks: tuple[Remark, ...]
    highest: Floats | None = None  # (H, W) heights of the highest points of a cloud, NaN where there is none


def as_ground_file(
    heights: Floats,
    frame: GroundFrame,
    crs: CRS | None,
    unit: float,
    value_unit: str,
    remarks: list[Remark],
    highest: Floats | None = None,
) -> GroundFile:
    """Heights (H, W) as the file that a DEM would be.

    Args:
        heights: In the unit of value_unit, NaN in holes.
        frame: Of their pixels, in the file's unit.
        crs: The coordinate system; None where none is known.
        unit: Metres of one of easting and northing.
        value_unit: Of heights, as rasters state it; empty where nothing is stated.
        remarks: What the user should know.
        highest: (H, W) heights of the highest points.
    """
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
        highest=highest,
    )
