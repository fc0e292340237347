"""Clouds in LAS and LAZ files, read in parts.

Source: ASPRS, LAS Specification 1.4-R15, 2019.
"""

import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import laspy
import lazrs
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud_files.chunks import PART_POINTS, CloudPart, CloudParts
from usdfoliage.capture.cloud_files.las_units import LasSystem, LasUnit, read_key_unit, read_wkt_unit
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import open_regular
from usdfoliage.remarks import Remark, remark

_NOISE = (7, 18)  # classes of points, low and high
_VARIABLE = 2**32 - 1  # size of a LAZ file's chunks, where its table has that of each
_MAX_IN_CHUNK = 10_000_000  # points; writers put 50,000 into one
_DEGREES_WIDE = 0.05  # what is wider is no plant in degrees: 5 km
_SAME_UNIT = 1e-4  # relative: feet are of two sizes, which differ by less
# What laspy and lazrs raise over bytes that are no LAS; a panic in Rust is no Exception, and has no public name.
_DAMAGED = (
    laspy.errors.LaspyException, lazrs.LazrsError, ValueError, TypeError, IndexError, KeyError, AttributeError,
    EOFError, OverflowError, RuntimeError, AssertionError, NotImplementedError, ZeroDivisionError, struct.error,
)  # fmt: skip

logging.getLogger("laspy").setLevel(logging.CRITICAL)  # it logs what it raises as well


def open_las_parts(path: Path, unit_is_given: bool = False) -> CloudParts:
    """Open a LAS or LAZ file; points that it has as withheld or as noise are marked.

    Args:
        path: The file.
        unit_is_given: The user gives the unit: what the file states does not matter.

    Raises:
        CaptureError: The file is damaged or truncated, in degrees, or its heights have another unit than its plan;
            what is wrong with the points is raised when their part is read.
    """
    _check_records(path)
    with _report_damage(path), laspy.open(path) as reader:
        header = reader.header
        count, scales, offsets = int(header.point_count), np.array(header.scales), np.array(header.offsets)
        unit = _read_unit(header)
        sides = np.array(header.maxs, np.float64) - np.array(header.mins, np.float64)
        point_size, start = int(header.point_format.size), int(header.offset_to_point_data)
        compressed = bool(header.are_points_compressed)
        packing = [record.record_data for record in header.vlrs if record.user_id == "laszip encoded"]
        has_colors = "red" in set(header.point_format.dimension_names)
    if not (np.isfinite(scales).all() and np.isfinite(offsets).all() and (scales != 0).all()):
        raise CaptureError(f"{path} is damaged: its scale is {scales}, its offset {offsets}", "write it again")
    present = (path.stat().st_size - start) // max(point_size, 1)
    if not compressed and count > present:
        raise CaptureError(
            f"{path} is truncated: its header states {count:,} points, there are at most {max(present, 0):,}",
            "copy it again",
        )
    if compressed and count:
        _check_chunk_table(path, start, count, bytes(packing[0]) if packing else b"")
    remarks: list[Remark] = []
    if not unit_is_given:
        remarks += _check_unit(path, unit, sides)
    return CloudParts(
        parts=_read_parts(path, count, has_colors),
        work=count,
        metres_per_unit=unit.metres_per_unit,
        is_survey=True,
        color_levels=(255.0, 65535.0),  # they are of 16 bits, but many programs write 8
        remarks=tuple(remarks),
    )


def read_las_system(path: Path) -> LasSystem:
    """What a LAS or LAZ file states of its coordinate system; nothing where it states none.

    Raises:
        CaptureError: The file is damaged.
    """
    _check_records(path)
    with _report_damage(path), laspy.open(path) as reader:
        texts = [text for text in _system_texts(reader.header) if text.strip("\0 ")]
        return LasSystem(text=texts[0].strip("\0 ") if texts else "", unit=_read_unit(reader.header))


def _check_records(path: Path) -> None:
    """Refuse a header that states more records than fit into the file: laspy would read on behind its end."""
    with open_regular(path) as file:
        head = file.read(247)
        size = file.seek(0, 2)
    counts = [struct.unpack_from("<I", head, at)[0] for at in (100, 243) if len(head) >= at + 4]
    is_long = len(head) > 25 and head[25] >= 4  # LAS 1.4 has records behind the points
    if any(count * 54 > size for count in counts[: 2 if is_long else 1]):  # bytes that one has at least
        raise CaptureError(f"{path} is damaged: it states more records than it has bytes for", "copy it again")


def _check_chunk_table(path: Path, start: int, count: int, packing: bytes) -> None:
    """Refuse a LAZ file whose table of chunks cannot be: lazrs would ask for as much memory as it states, and abort.

    Packing is the record of how points are packed, with the number of points in a chunk.

    Source: M. Isenburg, LASzip: lossless compression of LiDAR data, 2013, with the offset of the table before the
    points or, from writers that could not go back, at the end of the file.
    """
    with _report_damage(path), open_regular(path) as file:
        size = file.seek(0, 2)
        file.seek(start)
        (table,) = struct.unpack("<q", file.read(8))
        if table == -1:
            file.seek(size - 8)
            (table,) = struct.unpack("<q", file.read(8))
        if not start + 8 <= table <= size - 8:
            raise CaptureError(
                f"{path} is truncated or damaged: its table of chunks is to be at byte {table:,} of {size:,}",
                "copy it again",
            )
        file.seek(table)
        _, chunks = struct.unpack("<II", file.read(8))
        (in_chunk,) = struct.unpack_from("<I", packing, 12)  # all bits set: as the table has it of each
        is_fixed = in_chunk != _VARIABLE
        if is_fixed and in_chunk > max(count, _MAX_IN_CHUNK):  # lazrs asks for the memory of a whole one
            raise CaptureError(f"{path} is damaged: it states {in_chunk:,} points in a chunk", "copy it again")
        if chunks > table - start or count > chunks * in_chunk:  # none is empty
            raise CaptureError(f"{path} is damaged: it states {count:,} points in {chunks:,} chunks", "copy it again")


@contextmanager
def _report_damage(path: Path) -> Iterator[None]:
    """What goes wrong with a file as CaptureError."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise CaptureError(f"{path} cannot be read: {reason}", "check it and its permissions") from error
    except MemoryError as error:
        raise CaptureError(f"{path} is damaged: it asks for more memory than there is", "copy it again") from error
    except _DAMAGED as error:
        reason = str(error).split("\n")[0][:200] or type(error).__name__
        raise CaptureError(f"{path} is damaged or no LAS file: {reason}", "copy or export it again") from error
    except BaseException as error:
        if type(error).__name__ != "PanicException":
            raise
        raise CaptureError(f"{path} is damaged: its points cannot be unpacked", "copy or export it again") from error


def _read_parts(path: Path, count: int, has_colors: bool) -> Iterator[CloudPart]:
    done = 0
    with _report_damage(path), laspy.open(path, read_evlrs=False) as reader:
        while done < count:
            part = reader.read_points(min(PART_POINTS, count - done))
            if not len(part):
                break
            done += len(part)
            yield _as_part(part, has_colors)
    if done < count:
        raise CaptureError(
            f"{path} is truncated: its header states {count:,} points, there are {done:,}", "copy it again"
        )


def _as_part(part: "laspy.ScaleAwarePointRecord", has_colors: bool) -> CloudPart:
    points = np.column_stack([np.asarray(line, np.float64) for line in (part.x, part.y, part.z)])
    colors: NDArray[np.float32] | None = None
    if has_colors:
        colors = np.column_stack([np.asarray(line, np.float32) for line in (part.red, part.green, part.blue)])
    withheld = np.asarray(part.withheld).astype(bool)
    classes = np.asarray(part.classification).astype(np.uint8)
    noise = np.isin(classes, _NOISE) & ~withheld
    marks = ((withheld, "points that the file marks as withheld"), (noise, "points that the file marks as noise"))
    return CloudPart(points, colors, len(part), marked=tuple(each for each in marks if each[0].any()), classes=classes)


def _read_unit(header: "laspy.LasHeader") -> LasUnit:
    """By the coordinate system in text, else by that in keys, as LAS 1.4 wants it."""
    records = _system_records(header)
    for text in _system_texts(header):
        unit = read_wkt_unit(text)
        if unit != LasUnit():
            return unit
    doubles = [float(value.value) for record in records if hasattr(record, "doubles") for value in record.doubles]
    for record in records:
        if hasattr(record, "geo_keys"):
            keys = [(key.id, key.tiff_tag_location, key.count, key.value_offset) for key in record.geo_keys]
            return read_key_unit(keys, doubles)
    return LasUnit()


def _system_records(header: "laspy.LasHeader") -> list["laspy.VLR"]:
    return [record for record in (*header.vlrs, *(header.evlrs or ())) if record.user_id == "LASF_Projection"]


def _system_texts(header: "laspy.LasHeader") -> list[str]:
    records = [each for each in _system_records(header) if each.record_id == 2112 and hasattr(each, "string")]
    return [str(record.string) for record in records]


def _check_unit(path: Path, unit: LasUnit, sides: NDArray[np.float64]) -> list[Remark]:
    """Notes on the unit.

    Raises:
        CaptureError: No single length is the unit of all three coordinates.
    """
    across, height = unit.metres_per_unit, unit.metres_per_height
    if across is not None and height is not None and abs(height - across) > _SAME_UNIT * across:
        raise CaptureError(
            f"{path} has a unit of {across:g} m across and of {height:g} m in height",
            "convert it to metres, with PDAL or las2las, or give the unit of all three",
        )
    if unit.is_degrees:
        if np.max(sides[:2]) <= _DEGREES_WIDE and sides[2] > 10 * np.max(sides[:2]):
            raise CaptureError(
                f"{path} is in degrees of longitude and latitude",
                "project it to metres first, e.g. to UTM with PDAL's filters.reprojection",
            )
        text = "the file's coordinate system has degrees, but its points are too far apart for them"
        return [remark("cloud-system-in-degrees", text)]
    if across is None and unit.epsg is not None:
        text = f"the file's coordinate system is EPSG:{unit.epsg}, whose unit is not looked up"
        return [remark("cloud-system-unknown", text)]
    return []
