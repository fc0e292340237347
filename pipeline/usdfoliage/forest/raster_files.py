"""Rasters from files: GeoTIFF and whatever else GDAL reads, checked, with their units and coordinate systems."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.crs import CRS
from rasterio.enums import Resampling
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.vrt import WarpedVRT

from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import describe_unread, open_regular
from usdfoliage.forest.coordinate_system import check_system, metres_per_unit
from usdfoliage.forest.raster import Raster

MAX_PIXELS = 400_000_000  # of one raster: 20,000 x 20,000
# Each is one file that holds its pixels itself; a VRT would read whatever files and addresses it names.
DRIVERS = ("GTiff", "COG", "PNG", "JPEG", "HFA", "AAIGrid", "SRTMHGT", "JP2OpenJPEG")


@dataclass(frozen=True, kw_only=True, eq=False)
class RasterFile:
    """A raster, and what its file states of it."""

    raster: Raster
    metres_per_unit: float  # of easting and northing, in which the file has them
    value_unit: str  # of the first band, as the file states it; empty where it does not
    has_crs: bool
    largest_integer: int  # of values that are integers; 0 of floating-point numbers


def read_raster(path: Path, name: str, onto: Raster | None = None, *, classes: bool = False) -> RasterFile:
    """Read all bands of a raster.

    Args:
        path: The file.
        name: What it is to the user, for errors: the DEM, the orthophoto.
        onto: Whose coordinate system the raster is brought into, if it has another one.
        classes: Whether values are codes, of which no mean can be taken.

    Returns:
        Values as float32, NaN where the file has no data; places in metres.

    Raises:
        CaptureError: It cannot be read, is too large, is in degrees, or has no place on the ground.
    """
    try:
        open_regular(path).close()
    except OSError as error:
        raise describe_unread(error) from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path) as file:
                return _read(file, path, name, onto, Resampling.nearest if classes else Resampling.bilinear)
    except (RasterioError, ValueError, MemoryError) as error:
        raise CaptureError(
            f"{name} {path} cannot be read: {_first_line(error)}", "give a GeoTIFF that 'gdalinfo' reads"
        ) from error


def list_raster_files(path: Path) -> tuple[Path, ...]:
    """The files that a raster is read from, as those that a VRT names; the raster alone where it cannot be read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path) as file:
                named = [Path(each) for each in file.files]
    except (OSError, RasterioError, ValueError, MemoryError):  # who reads it reports that
        named = []
    return (path, *(each for each in named if each.is_file() and not each.samefile(path)))


def _read(
    file: rasterio.DatasetReader, path: Path, name: str, onto: Raster | None, resampling: Resampling
) -> RasterFile:
    if file.driver not in DRIVERS:
        raise CaptureError(f"{name} {path} has the format {file.driver}", f"give one of {', '.join(DRIVERS)}")
    if file.width * file.height > MAX_PIXELS:
        raise CaptureError(
            f"{name} {path} has {file.width:,} x {file.height:,} pixels, and may have {MAX_PIXELS:,} in all",
            "make it coarser with 'gdalwarp -tr', or cut it with 'gdal_translate -projwin'",
        )
    crs = file.crs
    if file.transform.is_identity:
        raise CaptureError(
            f"{name} {path} does not state where on the ground its pixels lie",
            "give a GeoTIFF with a geotransform, as 'gdalwarp' writes it, or put a world file beside it",
        )
    middle = np.array(file.transform, np.float64).reshape(3, 3)[:2] @ [file.width / 2, file.height / 2, 1]
    check_system(crs, middle, f"{name} {path}", "'gdalwarp -t_srs {}'")
    metres = metres_per_unit(crs)
    if onto is not None and onto.crs and crs and crs != CRS.from_wkt(onto.crs):
        wanted = CRS.from_wkt(onto.crs)
        with WarpedVRT(file, crs=wanted, resampling=resampling, nodata=np.nan, dtype="float32") as warped:
            return _take(warped, file, metres_per_unit(wanted), crs=onto.crs)
    return _take(file, file, metres, crs=crs.to_wkt() if crs else "")


def _take(
    warped: rasterio.DatasetReader | WarpedVRT, file: rasterio.DatasetReader, metres: float, crs: str
) -> RasterFile:
    """What a file holds, read as it is or in another coordinate system."""
    bands = warped.read(masked=True)
    values = np.ma.filled(bands.astype(np.float32), np.nan)
    if set(file.scales) != {1.0} or set(file.offsets) != {0.0}:
        values = values * np.array(file.scales)[:, None, None] + np.array(file.offsets)[:, None, None]
    matrix = np.array(warped.transform, np.float64).reshape(3, 3)[:2]
    integer = np.issubdtype(np.dtype(file.dtypes[0]), np.integer)
    return RasterFile(
        raster=Raster(
            values=values[0] if len(values) == 1 else np.moveaxis(values, 0, -1),
            ground_from_pixel=matrix * metres,
            crs=crs,
        ),
        metres_per_unit=metres,
        value_unit=(file.units[0] or "").strip().lower(),
        has_crs=bool(crs),
        largest_integer=int(np.iinfo(file.dtypes[0]).max) if integer else 0,
    )


def is_covered(raster: Raster, by: Raster) -> float:
    """The share of a raster's extent that another one covers, both in metres of one coordinate system."""
    mine, other = _bounds(raster), _bounds(by)
    low, high = np.maximum(mine[0], other[0]), np.minimum(mine[1], other[1])
    return float(np.prod(np.maximum(high - low, 0)) / max(float(np.prod(mine[1] - mine[0])), 1e-12))


def _bounds(raster: Raster) -> NDArray[np.float64]:
    height, width = raster.values.shape[:2]
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]], np.float64)
    ground_m = corners @ raster.ground_from_pixel.T
    return np.stack([ground_m.min(axis=0), ground_m.max(axis=0)])


def _first_line(error: BaseException) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")
