"""A point cloud that a studio hands over, in whatever file: in metres, near its own origin, and not too many points."""

import logging
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud_files.chunks import CloudParts
from usdfoliage.capture.cloud_files.e57 import E57_START, E57_SUFFIX, check_e57_file, open_e57_parts
from usdfoliage.capture.cloud_files.false_colors import SampledColors, check_colors
from usdfoliage.capture.cloud_files.las import open_las_parts
from usdfoliage.capture.cloud_files.ply import fits_single, open_cloud_parts
from usdfoliage.capture.cloud_files.text import open_text_parts
from usdfoliage.capture.cloud_files.thinning import PointThinner, ThinnedPoints
from usdfoliage.capture.cloud_files.units import guess_unit, remark_unit_assumed
from usdfoliage.capture.folder.listing import named
from usdfoliage.capture.folder.settings import AUTO, read_capture_settings, read_stated_unit
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import open_regular
from usdfoliage.geometry.up_turn import parse_axis
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, remark

logger = logging.getLogger(__name__)

MIN_POINTS = 50  # in different places; with fewer nothing is known of a plant
_PLY, _LAS, _TEXT = (".ply",), (".las", ".laz"), (".xyz", ".txt", ".pts", ".csv", ".asc")
CLOUD_SUFFIXES = (*_PLY, *_LAS, E57_SUFFIX, *_TEXT)
_SURELY_CLOUDS = (*_PLY, *_LAS, E57_SUFFIX, ".xyz", ".pts")  # a capture's other text files are no clouds
_PLY_STARTS, _LAS_START = (b"ply\n", b"ply\r"), b"LASF"
_TOO_FAR = 1e11  # units: the Earth is smaller, in millimetres too
_BLOCK_BYTES = 512  # of the number of blocks of a file, on every disk
_MIN_SPARSE_BYTES = 16 << 20
_MAX_PACKED = 50  # so many times as small a disk that packs files may store a cloud
_THIN = 1e-5  # second spread over the first, of points on a line


@dataclass(frozen=True, kw_only=True)
class CloudInputSettings:
    """How a cloud is read."""

    metres_per_unit: float | None = None  # None: as capture.toml or the file states it, else guessed
    max_points: int = 3_000_000  # beyond it, one point a cell of a grid

    def __post_init__(self) -> None:
        if self.metres_per_unit is not None and not 1e-9 <= self.metres_per_unit <= 1e9:
            raise ValueError(f"metres_per_unit must be in 1e-9 to 1e9, not {self.metres_per_unit}")
        if self.max_points < MIN_POINTS:
            raise ValueError(f"max_points must be at least {MIN_POINTS}, not {self.max_points}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CloudInput:
    """A cloud as it was read: points_m + origin_m are the file's coordinates times metres_per_unit."""

    path: Path  # of the file, also where a folder was given
    points_m: NDArray[np.float64]  # (N, 3), the file's axes, from origin_m; in its order unless they were thinned
    origin_m: NDArray[np.float64]  # (3,), whole metres amid the cloud
    colors: NDArray[np.uint8] | None  # (N, 3), sRGB; black where a point has none
    metres_per_unit: float
    stated_up: str | None  # the axis that capture.toml or the file states as up, X, Y or Z with + or -
    stated_vector: NDArray[np.float64] | None  # (3,), unit, the direction that capture.toml states as up
    format_up: str | None  # the axis that is up in files of this format; None: there is none
    total: int  # points in the file, with those left out
    remarks: tuple[Remark, ...]  # on what was left out, assumed or not used


def read_cloud_input(
    path: Path,
    settings: CloudInputSettings = CloudInputSettings(),
    progress: Progress | None = None,
) -> CloudInput:
    """Read the cloud in a file, or that of a capture folder.

    Files are distinguished by their first bytes, then by their suffix: PLY, LAS, LAZ, E57, and text of a point a line.
    Points that are not finite, those that a LAS file marks as withheld or noise or an E57 file as invalid, and exact
    duplicates are left out. A cloud of more than max_points is thinned while it is read, so that memory does not grow
    with the file: one point a cell of a grid, the mean of those in it.

    The unit is, in this order: the settings'; that of capture.toml, for a folder; the file's own; for LAS metres;
    a guess (see guess_unit).

    Args:
        path: A cloud, or a capture folder with cloud.ply, .las, .laz, .e57, .xyz or another single cloud in it.
        settings: Unit, and how many points.
        progress: Called with what is done and the total, in points or bytes.

    Raises:
        CaptureError: There is no cloud there, it cannot be read, or it has no points that a plant could have.
    """
    path = Path(path)
    metres_per_unit, stated_up, stated_vector = settings.metres_per_unit, None, None
    remarks: list[Remark] = []
    if path.is_dir():
        toml_unit, stated_up, stated_vector = _read_stated(path)
        metres_per_unit = toml_unit if metres_per_unit is None else metres_per_unit
        path = find_cloud(path)
        remarks.append(remark("cloud-file-chosen", f"the capture's cloud is {path.name}", subject=path.name))
    parts = _open_parts(path, metres_per_unit is not None)
    remarks += parts.remarks
    sampled = SampledColors()
    thinned, total, highest, left_out = _read_points(parts, settings.max_points, sampled, progress)
    _check_points(path, thinned.points, total, left_out)
    if parts.is_single and not fits_single(thinned.points):
        step = float(np.spacing(np.float32(np.abs(thinned.points).max())))
        text = (
            f"coordinates are float32 and {np.abs(thinned.points).max():,.0f} from the origin, so that they are in "
            f"steps of {step:.2g}"
        )
        remedy = "export them as double, or with the offset subtracted"
        remarks.append(remark("cloud-coordinates-coarse", text, remedy=remedy))
    if metres_per_unit is None:
        metres_per_unit, unit_remarks = _find_unit(parts, thinned.points)
        remarks += unit_remarks
    elif parts.metres_per_unit is not None and abs(parts.metres_per_unit / metres_per_unit - 1) > 1e-4:
        text = f"the file states {parts.metres_per_unit:g} m a unit; {metres_per_unit:g} is used as given"
        remarks.append(remark("cloud-unit-overridden", text))
    if thinned.cell > 0:
        cell = _length_text(thinned.cell * metres_per_unit)
        text = f"{total:,} points thinned to {len(thinned.points):,}, one a {cell} cell"
        remarks.append(remark("cloud-file-thinned", text))
    if thinned.duplicates:
        left_out["exact duplicates"] += thinned.duplicates
    remarks += [remark("cloud-points-left-out", f"{count:,} {what} left out") for what, count in left_out.items()]
    colors = _as_srgb(thinned.colors, highest, parts.color_levels)
    if colors is None and thinned.colors is not None:
        remarks.append(remark("cloud-colors-black", "its colours are all black and not used"))
    if colors is not None:
        some, of_some = sampled.finish()
        ramp = check_colors(some, np.asarray(_as_srgb(of_some, highest, parts.color_levels)))
        if ramp:
            colors = None
            text = f"the cloud's colours are {ramp}, and none of a plant; they are not used, as if it had none"
            remedy = "export it with those of photographs, or without any"
            remarks.append(remark("cloud-colors-false", text, remedy=remedy))

    points_m = thinned.points * metres_per_unit
    origin_m = np.round(np.median(points_m, axis=0)) + 0.0  # outliers do not move it; -0 is 0
    points_m -= origin_m
    logger.info("%s: %d of %d points, %g m a unit", path, len(points_m), total, metres_per_unit)
    return CloudInput(
        path=path,
        points_m=points_m,
        origin_m=origin_m,
        colors=colors,
        metres_per_unit=metres_per_unit,
        stated_up=stated_up or parts.up_axis,
        stated_vector=stated_vector,
        format_up="+Z" if parts.is_survey else None,
        total=total,
        remarks=tuple(remarks),
    )


class FilePoints(NamedTuple):
    """Some points of a file, in its order, its axes and its unit."""

    points: NDArray[np.float64]  # (N, 3), all of them, not finite where the file has it so
    used: NDArray[np.bool_]  # (N,), which read_cloud_input uses, duplicates among them


def iterate_points(path: Path) -> Iterator[FilePoints]:
    """Every point of a cloud's file, those that are left out among them, in parts.

    Raises:
        CaptureError: The file cannot be read.
    """
    for part in _open_parts(path, unit_is_given=True).parts:
        yield FilePoints(part.points, _are_near(part.points) & ~part.is_marked)


def find_cloud(folder: Path) -> Path:
    """The cloud of a capture folder: cloud.ply, .las and so on in this order, else the only cloud there.

    Raises:
        CaptureError: There is none, or several and none of them is called cloud.
    """
    try:
        files = sorted(one for one in folder.iterdir() if one.is_file() and not one.name.startswith("."))
    except OSError as error:
        raise CaptureError(f"{folder} cannot be read: {error.strerror}", "check its permissions") from error
    for suffix in CLOUD_SUFFIXES:
        for file in files:
            if file.stem.lower() == "cloud" and file.suffix.lower() == suffix:
                return file
    clouds = [file for file in files if file.suffix.lower() in _SURELY_CLOUDS]
    if len(clouds) == 1:
        return clouds[0]
    if clouds:
        raise CaptureError(
            f"{folder} has {len(clouds)} clouds: {named([file.name for file in clouds])}",
            f"give one of them, or call it cloud{clouds[0].suffix}",
        )
    raise CaptureError(f"{folder} has no cloud", "put one there as cloud.ply, .las, .laz, .e57 or .xyz, or give a file")


def is_cloud_input(path: Path) -> bool:
    """Whether a file, which need not be there, is a cloud by its suffix or its first bytes.

    read_cloud_input raises what is wrong with it.
    """
    if path.is_dir():
        return False
    if path.suffix.lower() in CLOUD_SUFFIXES:
        return True
    try:
        with open_regular(path) as file:
            start = file.read(len(E57_START))
    except OSError:
        return False
    return start == E57_START or start[:4] in (*_PLY_STARTS, _LAS_START)


def _read_stated(folder: Path) -> tuple[float | None, str | None, NDArray[np.float64] | None]:
    """The unit, and the axis or the direction that is up, where capture.toml states them.

    Its defaults mean nothing for a scan.
    """
    settings, _ = read_capture_settings(folder)
    return (
        read_stated_unit(folder),
        parse_axis(settings.up_axis) if settings.up_axis != AUTO else None,
        settings.up if settings.up_vector is not None else None,
    )


def check_cloud_file(path: Path) -> bytes:
    """The first bytes of a cloud's file.

    Raises:
        CaptureError: It is not there, cannot be read, or is empty, or nearly all of it is holes, as of a copy that has
            just begun; or it is E57 and truncated, or pye57 is missing.
    """
    known = ", ".join(CLOUD_SUFFIXES)
    if not path.exists():
        raise CaptureError(f"{path} does not exist", f"give a cloud ({known}) or a capture folder")
    if not path.is_file():
        raise CaptureError(f"{path} is neither a file nor a folder", f"give a cloud ({known}) or a capture folder")
    try:
        with open_regular(path) as file:
            start = file.read(len(E57_START))
            status = os.fstat(file.fileno())
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error
    if not start:
        raise CaptureError(f"{path} is empty (0 bytes)", "copy it again")
    stored = status.st_blocks * _BLOCK_BYTES  # 0 where the file system does not know
    if status.st_size > _MIN_SPARSE_BYTES and 0 < stored < status.st_size / _MAX_PACKED:
        raise CaptureError(
            f"of the {status.st_size:,} bytes of {path} the disk has {stored:,}, the others are holes", "copy it again"
        )
    if start == E57_START or path.suffix.lower() == E57_SUFFIX:
        check_e57_file(path)
    return start


def _open_parts(path: Path, unit_is_given: bool) -> CloudParts:
    start, suffix = check_cloud_file(path), path.suffix.lower()
    if start[:4] in _PLY_STARTS or suffix in _PLY:
        return open_cloud_parts(path)
    if start[:4] == _LAS_START or suffix in _LAS:
        return open_las_parts(path, unit_is_given)
    if start == E57_START or suffix == E57_SUFFIX:
        return open_e57_parts(path)
    if suffix in _TEXT:
        return open_text_parts(path)
    raise CaptureError(
        f"{path} is no cloud that can be read: {suffix or 'no suffix'}", f"give one of {', '.join(CLOUD_SUFFIXES)}"
    )


def _read_points(
    parts: CloudParts, max_points: int, sampled: SampledColors, progress: Progress | None
) -> tuple[ThinnedPoints, int, float, Counter[str]]:
    """The points that are left, how many there were, the highest colour, and what was left out; sampled gets some."""
    thinner = PointThinner(max_points)
    left_out: Counter[str] = Counter()
    total, done, highest = 0, 0, 0.0
    for part in parts.parts:
        points, colors = part.points, part.colors
        total += len(points) + sum(count for count, _ in part.left_out)
        left_out.update({what: count for count, what in part.left_out})
        left_out.update({what: int(np.count_nonzero(marks)) for marks, what in part.marked})
        if part.marked:
            kept = ~part.is_marked
            points, colors = points[kept], None if colors is None else colors[kept]
        finite = np.asarray(np.isfinite(points).all(axis=1))
        near = _are_near(points)
        if not near.all():
            left_out["points that are not finite"] += int(np.count_nonzero(~finite))
            left_out[f"points more than {_TOO_FAR:g} from the origin"] += int(np.count_nonzero(finite & ~near))
            points, colors = points[near], None if colors is None else colors[near]
        if colors is not None:
            colors = np.maximum(np.nan_to_num(colors, nan=0, posinf=0, neginf=0), 0)
            highest = max(highest, float(colors.max(initial=0)))
            sampled.add(points, colors)
        thinner.add(points, colors)
        done += part.work
        if progress is not None:
            progress(min(done, parts.work), parts.work)
    return thinner.finish(), total, highest, +left_out


def _are_near(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,), which points are finite and where a plant can be."""
    return np.asarray((np.abs(points) <= _TOO_FAR).all(axis=1))  # which no NaN is


def _check_points(path: Path, points: NDArray[np.float64], total: int, left_out: Counter[str]) -> None:
    """Refuse what can be no plant."""
    if total == 0:
        raise CaptureError(f"{path} has no points", "export it again")
    if not len(points):
        why = ", ".join(f"{count:,} {what}" for what, count in left_out.items())
        raise CaptureError(f"{path} has no usable point: {why}", "export it again")
    local = points - points[0]
    if not local.any():
        raise CaptureError(f"all {total:,} points of {path} are in one place", "export it again")
    if len(points) < MIN_POINTS:
        repeated = total - sum(left_out.values()) >= MIN_POINTS
        raise CaptureError(
            f"{path} has {len(points)} usable points in different places, {MIN_POINTS} are needed",
            "export it again with all digits of its coordinates" if repeated else "give a scan",
        )
    local = local - local.mean(axis=0)
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(local.T @ local / len(local)), 0))
    if spread[1] <= _THIN * spread[2]:
        raise CaptureError(f"the {len(points):,} points of {path} are on a line", "check which columns or axes it has")


def _find_unit(parts: CloudParts, points: NDArray[np.float64]) -> tuple[float, list[Remark]]:
    """Metres per unit where the user gives none, and remarks on it."""
    if parts.metres_per_unit is not None:
        unit = parts.metres_per_unit
        return unit, [] if unit == 1 else [remark("cloud-unit-stated", f"the file's unit is {unit:.6g} m")]
    if parts.is_survey:
        return 1.0, [remark_unit_assumed("metres are assumed, as in most LAS files")]
    guessed = guess_unit(points)
    return guessed.metres_per_unit, [guessed.remark]


def _as_srgb(colors: NDArray[np.float32] | None, highest: float, levels: tuple[float, ...]) -> NDArray[np.uint8] | None:
    """Colours whose highest is the first of the levels that it does not exceed; None where all are black."""
    if colors is None or highest <= 0:
        return None
    level = next((level for level in levels if highest <= level), levels[-1])
    return np.rint(np.clip(colors * np.float32(255 / level), 0, 255)).astype(np.uint8)


def _length_text(length_m: float) -> str:
    return f"{1000 * length_m:.2g} mm" if length_m < 0.0995 else f"{length_m:.2g} m"
