"""Clouds in PLY files: ours, and those of other programs.

Source: G. Turk, The PLY Polygon File Format, 1994.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import DTypeLike, NDArray

from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.capture.cloud_files.chunks import PART_POINTS, CloudPart, CloudParts
from usdfoliage.capture.cloud_files.ply_header import (
    PlyElement,
    PlyHeader,
    PlyProperty,
    find_vertices,
    read_header,
)
from usdfoliage.capture.cloud_files.units import find_stated_unit, find_stated_up
from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import whole_file
from usdfoliage.files.reading import open_regular

logger = logging.getLogger(__name__)

GREY = 128  # of points whose file has no colours
MAX_LIST = 1 << 16  # numbers in a list of one row
_CHUNK = 1 << 20  # points that are packed at once
_ROUNDING = 2.0**-24  # of float32, relative
_OF_SPACING = 1e-3  # share of the distance between points that rounding may move them

# What programs call the same, the most common name first.
_PLACE = (("x",), ("y",), ("z",))
_NORMAL = (("nx", "normal_x"), ("ny", "normal_y"), ("nz", "normal_z"))
_COLOR = (("red", "r", "diffuse_red"), ("green", "g", "diffuse_green"), ("blue", "b", "diffuse_blue"))
_CONFIDENCE = (("confidence", "scalar_confidence", "quality"),)
_VIEWS = (("views", "scalar_views"),)


@dataclass(frozen=True, kw_only=True, eq=False)
class CloudFile:
    """What a PLY file holds."""

    cloud: Cloud  # in the order of the file
    has_normals: bool  # else they are 0
    has_colors: bool  # else they are grey
    has_confidence: bool  # else it is 1
    has_views: bool  # else it is 1
    not_finite: int  # points left out because a coordinate was not


def write_cloud(path: Path, cloud: Cloud, comments: Sequence[str] = (), metres_per_unit: float = 1.0) -> None:
    """Write a cloud as binary little-endian PLY: x, y, z, nx, ny, nz, red, green, blue, confidence and views.

    Coordinates are float32 where rounding moves no point by more than a thousandth of the distance between points, as
    far from the origin it does; then they are double. The same cloud gives the same bytes.

    Args:
        path: The file, replaced when it exists; other than whole it does not appear.
        cloud: In the world of its cameras, in metres.
        comments: Lines for the header, in ASCII.
        metres_per_unit: Of the file's coordinates.

    Raises:
        ValueError: A comment is not one printable line of ASCII, or a place is not finite.
        WriteError: The file cannot be written; what was there is unchanged.
    """
    for comment in comments:
        if not (comment.isascii() and comment.isprintable()):
            raise ValueError(f"a comment is one printable line of ASCII, not {comment!r}")
    if not (np.isfinite(metres_per_unit) and metres_per_unit > 0):
        raise ValueError(f"metres_per_unit must be above 0, not {metres_per_unit}")
    if not np.isfinite(cloud.points_m).all():
        raise ValueError(f"{np.count_nonzero(~np.isfinite(cloud.points_m).all(axis=1))} points are not finite")
    place = "f4" if fits_single(cloud.points_m) else "f8"
    names = ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "confidence", "views")
    types = (*[place] * 3, *["f4"] * 3, *["u1"] * 3, "f4", "i4")
    words = {"f4": "float", "f8": "double", "u1": "uchar", "i4": "int"}
    header = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    header.append(f"element vertex {len(cloud)}")
    header += [f"property {words[kind]} {name}" for name, kind in zip(names, types, strict=True)]
    row = np.dtype([(name, "<" + kind) for name, kind in zip(names, types, strict=True)])
    with whole_file(path) as new, new.open("xb") as file:
        file.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii"))
        for start in range(0, len(cloud), _CHUNK):
            part = slice(start, start + _CHUNK)
            packed = np.empty(len(cloud.points_m[part]), row)
            for axis in range(3):
                packed[names[axis]] = cloud.points_m[part, axis] / metres_per_unit
                packed[names[3 + axis]] = cloud.normals[part, axis]
                packed[names[6 + axis]] = cloud.srgb[part, axis]
            packed["confidence"] = cloud.confidence[part]
            packed["views"] = cloud.views[part]
            file.write(packed.tobytes())


def fits_single(points_m: NDArray[np.float64]) -> bool:
    """Whether points (N, 3) on surfaces stay apart in float32.

    The distance between them is taken to be that of as many points in a square as large as their bounds.
    """
    if not len(points_m):
        return True
    extent_m = float(np.linalg.norm(np.ptp(points_m, axis=0)))
    if extent_m == 0:  # of points in one place it is not known how exact it must be
        return bool((points_m == points_m.astype(np.float32)).all())
    rounding_m = float(np.abs(points_m).max()) * _ROUNDING
    return rounding_m <= _OF_SPACING * extent_m / np.sqrt(len(points_m))


def read_cloud(path: Path, metres_per_unit: float = 1.0) -> Cloud:
    """The cloud of a PLY file (see read_cloud_file); what it lacks, and how many points were left out, is logged.

    Raises:
        CaptureError: As read_cloud_file.
    """
    loaded = read_cloud_file(path, metres_per_unit)
    if loaded.not_finite:
        logger.warning("%s: %d points are not finite and left out", path, loaded.not_finite)
    lacking = [name for name, has in (("normals", loaded.has_normals), ("colours", loaded.has_colors)) if not has]
    if lacking:
        logger.warning("%s has no %s", path, " and no ".join(lacking))
    return loaded.cloud


def read_cloud_file(path: Path, metres_per_unit: float = 1.0) -> CloudFile:
    """Read the vertices of a PLY file, of text or binary, from whatever program.

    Properties may be of any type and in any order; lists, unknown properties and other elements are skipped. Colours
    that are floats are taken as 0 to 1, unless one is above 1; of 16 bits they are scaled to 8. Normals are made unit.

    Args:
        path: The file.
        metres_per_unit: What its coordinates are multiplied with.

    Raises:
        CaptureError: The file is missing, damaged or truncated, or has no vertices with x, y and z.
    """
    if not (np.isfinite(metres_per_unit) and metres_per_unit > 0):
        raise ValueError(f"metres_per_unit must be above 0, not {metres_per_unit}")
    if not path.is_file():
        raise CaptureError(f"{path} does not exist or is no file", "give a cloud in PLY")
    try:
        with open_regular(path) as file:
            header = read_header(path, file)
            columns, count = _read_vertices(path, file, header)
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error
    except MemoryError as error:
        raise CaptureError(f"{path} does not fit into memory", "thin the cloud") from error
    return _as_cloud(columns, count, metres_per_unit)


def open_cloud_parts(path: Path) -> CloudParts:
    """Open a PLY file whose points come in parts; only binary vertices with lists in them are read at once.

    Raises:
        CaptureError: As read_cloud_file; what is wrong with the points is raised when their part is read.
    """
    header, vertices = _open_vertices(path)
    by_name = {one.name: one.type for one in reversed(vertices.properties) if one.count_type is None}
    colors = [next((by_name[name] for name in known if name in by_name), None) for known in _COLOR]
    levels: tuple[float, ...] = (255.0,)
    if "u2" in colors:
        levels = (65535.0,)
    elif any(kind is not None and kind.startswith("f") for kind in colors):
        levels = (1.0, 255.0)
    return CloudParts(
        parts=_read_parts(path, header, None not in colors),
        work=vertices.rows,
        metres_per_unit=find_stated_unit(header.comments),
        up_axis=find_stated_up(header.comments),
        color_levels=levels,
        is_single=bool(header.order) and all(by_name[name] == "f4" for name in ("x", "y", "z")),
    )


def _open_vertices(path: Path) -> tuple[PlyHeader, PlyElement]:
    """The header, and of its elements the vertices, which are complete as far as the file's size shows."""
    if not path.is_file():
        raise CaptureError(f"{path} does not exist or is no file", "give a cloud in PLY")
    try:
        with open_regular(path) as file:
            header = read_header(path, file)
            file.seek(0, 2)
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error
    return header, find_vertices(path, header)


def _read_parts(path: Path, header: PlyHeader, has_colors: bool) -> Iterator[CloudPart]:
    try:
        with open_regular(path) as file:
            read_header(path, file)  # to where the data begin
            for element in header.elements:
                wanted = element.name == "vertex"
                for first, columns in _read_element_parts(path, file, element, header.order, wanted):
                    count = min(PART_POINTS, element.rows - first)
                    points = _stack(columns, _PLACE, count)
                    assert points is not None  # their properties were looked for
                    colors = _stack(columns, _COLOR, count) if has_colors else None
                    yield CloudPart(points, None if colors is None else colors.astype(np.float32), count)
                if wanted:
                    return
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error
    except MemoryError as error:
        raise CaptureError(f"{path} does not fit into memory", "thin the cloud") from error


def _read_element_parts(
    path: Path, file: BinaryIO, element: PlyElement, order: str, wanted: bool
) -> Iterator[tuple[int, dict[str, NDArray[np.generic]]]]:
    """The rows of an element in parts, with the number of each part's first; none where they are not wanted."""
    has_lists = any(one.count_type for one in element.properties)
    if not wanted or (order and has_lists):
        columns = _read_element(path, file, element, order, wanted)
        for first in range(0, element.rows if wanted else 0, PART_POINTS):
            yield first, {name: column[first : first + PART_POINTS] for name, column in columns.items()}
        return
    if order:  # reported before anything is read
        size = _row_type(element.properties, order, {}).itemsize
        if element.rows * size > _bytes_left(file):
            raise _truncated(path, element, _bytes_left(file) // size)
    for first in range(0, element.rows, PART_POINTS):
        part = element._replace(rows=min(PART_POINTS, element.rows - first))
        try:
            yield first, _read_element(path, file, part, order, wanted)
        except _TruncatedError as error:
            raise _truncated(path, element, first + error.found) from error


def _read_vertices(path: Path, file: BinaryIO, header: PlyHeader) -> tuple[dict[str, NDArray[np.generic]], int]:
    """The single numbers of the vertices by their names, each (N,), and N."""
    vertices = find_vertices(path, header)
    for element in header.elements:
        columns = _read_element(path, file, element, header.order, element is vertices)
        if element is vertices:
            return columns, element.rows
    raise AssertionError("an element vertex was looked for above")


def _read_element(
    path: Path, file: BinaryIO, element: PlyElement, order: str, wanted: bool
) -> dict[str, NDArray[np.generic]]:
    if not order:
        return _read_text(path, file, element, wanted)
    if any(one.count_type for one in element.properties):
        return _read_lists(path, file, element, order, wanted)
    return _read_rows(path, file, element, order, wanted)


def _read_rows(
    path: Path, file: BinaryIO, element: PlyElement, order: str, wanted: bool
) -> dict[str, NDArray[np.generic]]:
    """Rows of one size."""
    row = _row_type(element.properties, order, {})
    start, left = file.tell(), _bytes_left(file)
    if element.rows * row.itemsize > left:
        raise _truncated(path, element, left // row.itemsize)
    if not wanted:
        file.seek(start + element.rows * row.itemsize)
        return {}
    return _columns(np.fromfile(file, row, element.rows), element.properties)


def _read_lists(
    path: Path, file: BinaryIO, element: PlyElement, order: str, wanted: bool
) -> dict[str, NDArray[np.generic]]:
    """Rows with lists in them: at once where all lists are as long as those of the first row, as in most files."""
    start = file.tell()
    data = file.read()
    if not element.rows:
        file.seek(start)
        return {}
    lengths, size = _measure_row(path, data, 0, element, order, 0)
    row = _row_type(element.properties, order, lengths)
    lists = [f"n{number}" for number, one in enumerate(element.properties) if one.count_type]
    if element.rows * row.itemsize <= len(data):
        rows = np.frombuffer(data, row, element.rows)
        if all((rows[name] == rows[name][0]).all() for name in lists):
            file.seek(start + rows.nbytes)
            return _columns(rows, element.properties) if wanted else {}
    at, blocks = 0, []
    for number in range(element.rows):
        lengths, size = _measure_row(path, data, at, element, order, number)
        if wanted:
            row = _row_type(element.properties, order, lengths)
            one = np.frombuffer(data, row, 1, at)
            blocks.append(_columns(one, element.properties))
        at += size
    file.seek(start + at)
    return {name: np.concatenate([columns[name] for columns in blocks]) for name in blocks[0]} if blocks else {}


def _measure_row(
    path: Path, data: bytes, at: int, element: PlyElement, order: str, number: int
) -> tuple[dict[int, int], int]:
    """How long the lists of one row are, by the property's number, and how many bytes the row has."""
    lengths: dict[int, int] = {}
    start = at
    for index, one in enumerate(element.properties):
        width = np.dtype(one.type).itemsize
        if one.count_type is None:
            at += width
            continue
        count_type = np.dtype(order + one.count_type)
        if at + count_type.itemsize > len(data):
            raise _truncated(path, element, number)
        length = int(np.frombuffer(data, count_type, 1, at)[0])
        if not 0 <= length <= MAX_LIST:
            raise CaptureError(
                f"row {number} of {element.name} in {path} has a list of {length} numbers; 0 to {MAX_LIST} are read"
            )
        lengths[index] = length
        at += count_type.itemsize + length * width
    if at > len(data):
        raise _truncated(path, element, number)
    return lengths, at - start


def _row_type(properties: Sequence[PlyProperty], order: str, lengths: Mapping[int, int]) -> np.dtype[np.void]:
    """Fields are called by their number: two properties may have one name."""
    fields: list[tuple[str, DTypeLike] | tuple[str, DTypeLike, tuple[int]]] = []
    for number, one in enumerate(properties):
        if one.count_type is None:
            fields.append((f"p{number}", order + one.type))
        else:
            fields.append((f"n{number}", order + one.count_type))
            fields.append((f"p{number}", order + one.type, (lengths[number],)))
    return np.dtype(fields)


def _columns(rows: NDArray[np.void], properties: Sequence[PlyProperty]) -> dict[str, NDArray[np.generic]]:
    columns: dict[str, NDArray[np.generic]] = {}
    for number, one in enumerate(properties):
        if one.count_type is None:
            columns.setdefault(one.name, rows[f"p{number}"])
    return columns


def _read_text(path: Path, file: BinaryIO, element: PlyElement, wanted: bool) -> dict[str, NDArray[np.generic]]:
    """Rows of text, a line each."""
    left = _bytes_left(file)
    if element.rows * 2 * max(len(element.properties), 1) > left + 1:  # a digit and what parts it from the next
        raise _truncated(path, element, left // (2 * max(len(element.properties), 1)))
    singles = [one for one in element.properties if one.count_type is None]
    values = np.empty((element.rows if wanted else 0, len(singles)))
    try:
        if wanted and element.rows and len(singles) == len(element.properties):  # no lists: a fifth of the time
            values = np.loadtxt(
                file, max_rows=element.rows, usecols=range(len(singles)), comments=None, ndmin=2, encoding="latin-1"
            )
            if len(values) < element.rows:
                raise _truncated(path, element, len(values))
        else:
            for number in range(element.rows):
                line = file.readline()
                if not line:
                    raise _truncated(path, element, number)
                if wanted:
                    values[number] = _single_numbers(line.split(), element.properties)
    except (IndexError, ValueError) as error:
        raise CaptureError(
            f"{path} has a line of {element.name} that is not {len(element.properties)} properties", "copy it again"
        ) from error
    columns: dict[str, NDArray[np.generic]] = {}
    for index, one in enumerate(singles[: values.shape[1]]):
        kind = np.dtype(one.type)
        column = values[:, index]
        if kind.kind in "iu":
            limits = np.iinfo(kind)
            with np.errstate(invalid="ignore"):
                column = np.clip(np.nan_to_num(column), limits.min, limits.max).astype(kind)
        columns.setdefault(one.name, column)
    return columns


def _single_numbers(words: list[bytes], properties: Sequence[PlyProperty]) -> list[float]:
    """The numbers of a line that are in no list."""
    numbers, at = [], 0
    for one in properties:
        if one.count_type is None:
            numbers.append(float(words[at]))
            at += 1
        else:
            length = int(words[at])
            if length < 0:
                raise ValueError
            at += 1 + length
    if at > len(words):
        raise ValueError
    return numbers


def _bytes_left(file: BinaryIO) -> int:
    at = file.tell()
    end = file.seek(0, 2)
    file.seek(at)
    return end - at


class _TruncatedError(CaptureError):
    """There are fewer rows than the header states."""

    found: int


def _truncated(path: Path, element: PlyElement, found: int) -> _TruncatedError:
    error = _TruncatedError(
        f"{path} is truncated: its header states {element.rows:,} rows of {element.name}, there are at most {found:,}",
        "copy it again",
    )
    error.found = found
    return error


def _as_cloud(columns: Mapping[str, NDArray[np.generic]], count: int, metres_per_unit: float) -> CloudFile:
    points_m = _stack(columns, _PLACE, count)
    assert points_m is not None  # their properties were looked for
    with np.errstate(over="ignore"):
        points_m = points_m * metres_per_unit
    finite = np.asarray(np.isfinite(points_m).all(axis=1))
    normals = _stack(columns, _NORMAL, count)
    srgb = _colors(columns, count)
    confidence = _stack(columns, _CONFIDENCE, count)
    views = _stack(columns, _VIEWS, count)
    cloud = Cloud(
        points_m=points_m,
        normals=np.zeros((count, 3), np.float32) if normals is None else _unit(normals),
        srgb=np.full((count, 3), GREY, np.uint8) if srgb is None else srgb,
        confidence=np.ones(count, np.float32)
        if confidence is None
        else np.clip(np.nan_to_num(confidence[:, 0], posinf=1), 0, 1).astype(np.float32),
        views=np.ones(count, np.int32)
        if views is None
        else np.clip(np.nan_to_num(views[:, 0]), 0, 2**31 - 1).astype(np.int32),
    )
    return CloudFile(
        cloud=cloud if finite.all() else cloud.take(finite),
        has_normals=normals is not None,
        has_colors=srgb is not None,
        has_confidence=confidence is not None,
        has_views=views is not None,
        not_finite=int(np.count_nonzero(~finite)),
    )


def _stack(
    columns: Mapping[str, NDArray[np.generic]], names: Sequence[Sequence[str]], count: int
) -> NDArray[np.float64] | None:
    """(N, len(names)), each column by the first of its names that there is; None where one is missing."""
    stacked = np.empty((count, len(names)))
    for axis, known in enumerate(names):
        found = next((columns[name] for name in known if name in columns), None)
        if found is None and count:
            return None
        if found is not None:
            with np.errstate(invalid="ignore"):  # of bytes that are no number at all
                stacked[:, axis] = found
    return stacked


def _colors(columns: Mapping[str, NDArray[np.generic]], count: int) -> NDArray[np.uint8] | None:
    values = _stack(columns, _COLOR, count)
    if values is None:
        return None
    kinds = {columns[name].dtype.kind + str(columns[name].dtype.itemsize) for known in _COLOR for name in known
             if name in columns}  # fmt: skip
    values = np.nan_to_num(values, posinf=0, neginf=0)
    if "u2" in kinds:
        values = values / 257
    elif any(kind.startswith("f") for kind in kinds) and values.max(initial=0) <= 1:
        values = values * 255
    return np.rint(np.clip(values, 0, 255)).astype(np.uint8)


def _unit(normals: NDArray[np.float64]) -> NDArray[np.float32]:
    normals = np.where(np.isfinite(normals).all(axis=1, keepdims=True), normals, 0)
    largest = np.abs(normals).max(axis=1, keepdims=True, initial=0)  # their squares may be beyond what a number holds
    scaled = np.divide(normals, largest, out=np.zeros_like(normals), where=largest > 0)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return np.divide(scaled, length, out=np.zeros_like(scaled), where=length > 0).astype(np.float32)
