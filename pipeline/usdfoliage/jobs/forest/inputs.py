"""The files of a forest, read and brought into one coordinate system."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import read_regular
from usdfoliage.forest.ground_files import is_ground_file, read_ground
from usdfoliage.forest.ground_settings import GroundSettings
from usdfoliage.forest.planting import ForestInput
from usdfoliage.forest.plants_file import TALLEST_M, PlantsFile, read_plants_file
from usdfoliage.forest.raster import Raster, is_inside
from usdfoliage.forest.raster_files import RasterFile, is_covered, read_raster
from usdfoliage.forest.terrain import Terrain, make_terrain
from usdfoliage.forest.tree_tops import LOWEST_M
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.remarks import Argument, Remark, remark

UNITS = {  # metres, of heights as files name their units
    **dict.fromkeys(("m", "metre", "meter", "metres", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot"), 0.3048),
    **dict.fromkeys(("us-ft", "ftus", "us survey foot", "us survey feet", "foot_us", "sft"), 1200 / 3937),
    **dict.fromkeys(("dm", "decimetre", "decimeter"), 0.1),
    **dict.fromkeys(("cm", "centimetre", "centimeter"), 0.01),
    **dict.fromkeys(("mm", "millimetre", "millimeter"), 0.001),
}
MIN_COVERED = 0.05  # of the DEM, by another raster
MIN_CANOPY = 0.001  # of the pixels of a cloud, as high as trees
WHOLLY_COVERED = 0.98  # from which on there is no remark
MAX_TRUNK_BYTES = 1 << 28

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ForestFiles:
    """What the user gives."""

    dem: Path  # a raster, or a mesh or a cloud of the ground
    plants: Path
    orthophoto: Path | None = None
    canopy: Path | None = None
    vegetation: Path | None = None
    trunks: Path | None = None
    ground: GroundSettings = field(default_factory=GroundSettings)

    @property
    def by_role(self) -> dict[str, Path]:
        """All files that are given, by what they are."""
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        return {role: path for role, path in given.items() if isinstance(path, Path)}


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadForest:
    """What the files hold."""

    planted: ForestInput
    metres_per_unit: float  # of easting and northing in the DEM
    metres_per_height: float  # of its heights
    remarks: tuple[Remark, ...]


def read_forest(files: ForestFiles) -> ReadForest:
    """Read everything a forest is planted from.

    Raises:
        CaptureError: A file cannot be used; the text names it and what to do.
    """
    plants = read_plants_file(files.plants)
    if files.vegetation is None and any(row.water_m is not None for row in plants.rows):
        raise CaptureError(
            f"{files.plants} has a row with water_m, and no raster shows where water is",
            ("give ", Argument(name="vegetation"), " or leave water_m out"),
        )
    remarks: list[Remark] = []
    dem, terrain, height_unit, highest = _read_terrain(files, remarks)
    orthophoto = canopy = vegetation = None
    if files.orthophoto is not None:
        orthophoto = _read_orthophoto(files.orthophoto, terrain.heights, remarks)
    if files.canopy is not None:
        canopy = _read_canopy(files.canopy, terrain.heights, height_unit, remarks)
    elif highest is not None:
        canopy = _measure_canopy(highest * height_unit, terrain.heights, files.dem, remarks)
    if files.vegetation is not None:
        vegetation = _read_other(files.vegetation, "the vegetation", terrain.heights, remarks, classes=True).raster
        _check_codes(vegetation, plants, files.vegetation)
    trunks_m = None
    if files.trunks is not None:
        trunks_m = read_trunks(files.trunks, remarks) * dem.metres_per_unit
        inside = is_inside(terrain.heights, trunks_m)
        if not inside.any():
            raise CaptureError(
                f"none of the {len(trunks_m):,} trunks in {files.trunks} stands on the DEM",
                "write easting and northing in the DEM's coordinate system",
            )
    return ReadForest(
        planted=ForestInput(
            terrain=terrain,
            plants=plants,
            orthophoto=orthophoto,
            canopy=canopy,
            vegetation=vegetation,
            trunks_m=trunks_m,
        ),
        metres_per_unit=dem.metres_per_unit,
        metres_per_height=height_unit,
        remarks=tuple(remarks),
    )


def read_terrain(files: ForestFiles) -> Terrain:
    """The ground alone, as read_forest reads it.

    Raises:
        CaptureError: Its file cannot be used.
    """
    return _read_terrain(files, [])[1]


def _read_terrain(files: ForestFiles, remarks: list[Remark]) -> tuple[RasterFile, Terrain, float, Floats | None]:
    """The file of the ground, what it holds, the metres of one unit of height, and of a cloud its highest points."""
    dem, highest = _read_dem(files, remarks)
    height_unit = _height_unit(dem, files.dem, remarks)
    if not dem.has_crs:
        taken = "its easting, northing and heights are taken for metres"
        if dem.metres_per_unit != 1.0:
            taken = f"its unit is {dem.metres_per_unit:.4g} m"
        text = f"{files.dem.name} states no coordinate system that is known; {taken}"
        remarks.append(remark("terrain-without-crs", text))
    heights = dem.raster.values
    if heights.ndim == 3:
        raise CaptureError(f"the DEM {files.dem} has {heights.shape[2]} bands", "give a raster of one band, of heights")
    raster = Raster(values=heights * height_unit, ground_from_pixel=dem.raster.ground_from_pixel, crs=dem.raster.crs)
    terrain = make_terrain(raster, f"the DEM {files.dem}")
    if terrain.hole_share > 0:
        text = f"{terrain.hole_share:.1%} of the DEM have no height: the ground is closed there, and nothing is planted"
        remarks.append(remark("terrain-holes", text))
    return dem, terrain, height_unit, highest


def _read_dem(files: ForestFiles, remarks: list[Remark]) -> tuple[RasterFile, Floats | None]:
    """The heights of the ground, of whatever kind their file is, and of a cloud those of its highest points."""
    if is_ground_file(files.dem):
        ground = read_ground(files.dem, files.ground)
        remarks += ground.remarks
        return ground.file, ground.highest
    if files.ground.spacing_m is not None:
        raise CaptureError(
            f"the DEM {files.dem} is a raster, whose pixels are as large as they are",
            ("leave out ", Argument(name="ground_spacing"), ", which is for a mesh or a cloud"),
        )
    return read_raster(files.dem, "the DEM"), None


def read_trunks(path: Path, remarks: list[Remark]) -> Floats:
    """(N, 2) easting and northing, of a CSV: two numbers a line, more columns and a first line of names are left out.

    Args:
        path: The file.
        remarks: Gets one where other lines have no two numbers.

    Raises:
        CaptureError: It cannot be read, or has no such line.
    """
    try:
        data = read_regular(path, MAX_TRUNK_BYTES + 1)
    except OSError as error:
        raise CaptureError(f"the trunks {path} cannot be read: {error.strerror}", "name a CSV file") from error
    if len(data) > MAX_TRUNK_BYTES:
        raise CaptureError(f"the trunks {path} have more than {MAX_TRUNK_BYTES:,} bytes", "name a CSV of trunks")
    places, unread = [], []
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        words = line.replace(";", ",").replace(",", " ").split()
        try:
            place = [float(word) for word in words[:2]]
        except ValueError:
            place = []
        if len(place) == 2 and np.isfinite(place).all():
            places.append(place)
        elif words and not words[0].startswith("#") and number > 1:
            unread.append(number)
    if not places:
        raise CaptureError(f"the trunks {path} have no line of two numbers", "write easting,northing a line")
    if unread:
        text = f"{len(unread):,} lines of {path.name} have no two finite numbers; the first is line {unread[0]}"
        remarks.append(remark("trunks-unread", text, subject=path.name))
    return np.array(places, np.float64)


def _height_unit(dem: RasterFile, path: Path, remarks: list[Remark]) -> float:
    """Metres of one unit of height: as the file states it, or that of easting and northing."""
    stated = _stated_unit(dem, "the DEM", path)
    if stated is not None:
        return stated
    if dem.metres_per_unit != 1.0:
        text = f"{path.name} is in units of {dem.metres_per_unit:.4g} m; its heights are taken for the same unit"
        remarks.append(remark("terrain-height-unit", text))
    return dem.metres_per_unit


def _stated_unit(file: RasterFile, name: str, path: Path) -> float | None:
    """Metres of one unit of the values as the file states it; None where it does not."""
    if not file.value_unit:
        return None
    if file.value_unit not in UNITS:
        raise CaptureError(
            f"{name} {path} has values in the unit {file.value_unit!r}, which is not known",
            "state one of m, ft, us-ft, dm, cm and mm with 'gdal_edit -units'",
        )
    return UNITS[file.value_unit]


def _read_other(path: Path, name: str, onto: Raster, remarks: list[Remark], *, classes: bool = False) -> RasterFile:
    """A raster of one band over the ground of the DEM."""
    file = read_raster(path, name, onto, classes=classes)
    if file.raster.values.ndim == 3:
        raise CaptureError(f"{name} {path} has {file.raster.values.shape[2]} bands", "give a raster of one band")
    _check_covered(file.raster, path, name, onto, remarks)
    return file


def _read_canopy(path: Path, onto: Raster, height_unit: float, remarks: list[Remark]) -> Raster:
    """Heights above the ground in metres; without a unit of its own the file has that of the DEM."""
    file = _read_other(path, "the canopy height", onto, remarks)
    unit = _stated_unit(file, "the canopy height", path)
    heights = file.raster.values * (height_unit if unit is None else unit)
    highest = float(np.nanmax(heights, initial=0.0))
    if highest > TALLEST_M:
        raise CaptureError(
            f"the canopy height {path} goes to {highest:,.4g} m, and no plant is taller than {TALLEST_M:g} m",
            "give heights above the ground and not above the sea, and state their unit and their no-data value",
        )
    return Raster(values=heights, ground_from_pixel=file.raster.ground_from_pixel, crs=file.raster.crs)


def _measure_canopy(highest_m: Floats, onto: Raster, path: Path, remarks: list[Remark]) -> Raster | None:
    """Heights of the highest points above the ground of the DEM; None where nearly none stand on it."""
    height_m = np.maximum(highest_m - onto.values, 0)
    height_m[height_m > TALLEST_M] = np.nan  # of birds and clouds
    share = float((height_m >= LOWEST_M).mean())
    if share < MIN_CANOPY:
        return None
    text = f"the highest points of {path.name} are the canopy: {share:.1%} of it are {LOWEST_M:g} m high or more"
    remarks.append(remark("canopy-of-cloud", text))
    return Raster(values=height_m, ground_from_pixel=onto.ground_from_pixel, crs=onto.crs)


def _read_orthophoto(path: Path, onto: Raster, remarks: list[Remark]) -> Raster:
    """The orthophoto in linear colours."""
    file = read_raster(path, "the orthophoto", onto)
    values = file.raster.values
    if values.ndim != 3 or values.shape[2] < 3:
        raise CaptureError(f"the orthophoto {path} has no three bands", "give red, green and blue")
    _check_covered(file.raster, path, "the orthophoto", onto, remarks)
    colors = values[..., :3]
    if file.largest_integer:
        colors = np.asarray(decode_srgb(np.clip(colors / file.largest_integer, 0, 1)), np.float32)
    return Raster(values=colors, ground_from_pixel=file.raster.ground_from_pixel, crs=file.raster.crs)


def _check_covered(raster: Raster, path: Path, name: str, onto: Raster, remarks: list[Remark]) -> None:
    covered = is_covered(onto, raster)
    if covered < MIN_COVERED:
        raise CaptureError(
            f"{name} {path} covers {covered:.0%} of the DEM: the two are of different places or coordinate systems",
            "give rasters of one place, each with its coordinate system",
        )
    if covered < WHOLLY_COVERED:
        text = f"{name} {path.name} covers {covered:.0%} of the DEM"
        remarks.append(remark("raster-covers-less", text, subject=path.name))


def _check_codes(vegetation: Raster, plants: PlantsFile, path: Path) -> None:
    codes = np.unique(vegetation.values[np.isfinite(vegetation.values)])
    unknown = [f"{code:g}" for code in codes.tolist() if code not in plants.classes]
    if unknown:
        named = ", ".join(unknown[:8]) + (" …" if len(unknown) > 8 else "")
        raise CaptureError(
            f"the vegetation {path} has the code{'s' if len(unknown) > 1 else ''} {named}; known are "
            f"{', '.join(str(code) for code in sorted(plants.classes))}",
            f'name {"each" if len(unknown) > 1 else "it"} in [classes] of {plants.path}: {unknown[0]} = "tree"',
        )


def describe_files(files: ForestFiles) -> Sequence[str]:
    """A line for each file that is given."""
    named = (
        ("DEM", files.dem),
        ("plants", files.plants),
        ("orthophoto", files.orthophoto),
        ("canopy height", files.canopy),
        ("vegetation", files.vegetation),
        ("trunks", files.trunks),
    )
    return [f"{name}: {path}" for name, path in named if path is not None]
