"""Coordinate systems of the ground: which can be used, and what their unit is."""

import numpy as np
from numpy.typing import NDArray
from rasterio.crs import CRS
from rasterio.errors import RasterioError

from usdfoliage.errors import CaptureError

WEB_MERCATOR = 3857  # EPSG


def check_system(crs: CRS | None, middle: NDArray[np.float64], name: str, command: str) -> None:
    """Refuse a coordinate system whose easting and northing are no lengths on the ground.

    Args:
        crs: None where the file states none.
        middle: (2,) easting and northing amid what has it.
        name: What has it, to the user, with its file.
        command: What brings it into another one, with {} for the code of that.

    Raises:
        CaptureError: It is in degrees, or of web maps.
    """
    if crs and crs.to_epsg() == WEB_MERCATOR:
        raise CaptureError(
            f"{name} is in the coordinate system of web maps, whose metres are none on the ground",
            f"bring it into another one, for example with {command.format('EPSG:326…')} of its zone",
        )
    if crs and crs.is_geographic:
        zone = (32600 if middle[1] >= 0 else 32700) + int(middle[0] // 6) + 31
        raise CaptureError(
            f"{name} is in degrees of longitude and latitude",
            f"bring it into metres, for example with {command.format(f'EPSG:{zone}')}",
        )


def metres_per_unit(crs: CRS | None) -> float:
    """Of easting and northing; 1 where nothing is stated."""
    if not crs:
        return 1.0
    try:
        return float(crs.linear_units_factor[1])
    except (RasterioError, ValueError):
        return 1.0


def system_of(text: str, epsg: int | None) -> CRS | None:
    """The coordinate system across, of well-known text or a number; None of what is not known.

    One with heights has a system across and one of heights, of which rasters know the first alone.

    Args:
        text: Well-known text; empty for none.
        epsg: What is taken where there is no text that can be used.
    """
    for read, value in ((CRS.from_wkt, text), (CRS.from_epsg, epsg)):
        if not value:
            continue
        try:
            found = read(value)
            stated = found.to_dict(projjson=True)
            while isinstance(stated, dict) and stated.get("type") in ("CompoundCRS", "BoundCRS"):
                stated = stated["components"][0] if stated["type"] == "CompoundCRS" else stated["source_crs"]
                found = CRS.from_dict(stated)
        except (RasterioError, ValueError, KeyError, IndexError, TypeError):
            continue
        if found.is_projected or found.is_geographic:
            return found
    return None
