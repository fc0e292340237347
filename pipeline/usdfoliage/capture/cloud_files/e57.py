"""Clouds in E57 files, read in parts: all scans of a file, each moved to its place by its pose.

Source: ASTM E2807-11, Standard Specification for 3D Imaging Data Exchange, Version 1.0: 8.4.3 (scans), 8.4.4 (points),
7 (pages). Coordinates are in metres.
"""

import importlib.util
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud_files.chunks import PART_POINTS, CloudPart, CloudParts
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import open_regular

E57_START, E57_SUFFIX = b"ASTM-E57", ".e57"
_HEADER = struct.Struct("<8sIIQQQQ")  # signature, version of two numbers, length, place and length of the XML, page
_PAGE_BYTES, _CHECKSUM_BYTES = 1024, 4
_MAX_XML_BYTES = 1 << 26
_MAX_SCANS = 10_000
_MAX_POINTS = 10**11  # of a file; nothing is scanned in days
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_COLORS = ("colorRed", "colorGreen", "colorBlue")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scan:
    number: int
    count: int  # of its points
    fields: frozenset[str]
    rotation: NDArray[np.float64]  # (3, 3), world from scan
    translation_m: NDArray[np.float64]  # (3,)
    color_limits: NDArray[np.float64]  # (3, 2), lowest and highest of red, green and blue

    @property
    def coordinates(self) -> tuple[str, ...]:
        return _CARTESIAN if self.fields.issuperset(_CARTESIAN) else _SPHERICAL

    @property
    def has_colors(self) -> bool:
        return self.fields.issuperset(_COLORS)

    @property
    def state(self) -> str | None:
        """The field that marks points without a place; None where there is none."""
        name = "cartesianInvalidState" if self.coordinates == _CARTESIAN else "sphericalInvalidState"
        return name if name in self.fields else None


def open_e57_parts(path: Path) -> CloudParts:
    """Open an E57 file; points that it marks as invalid are left out.

    Raises:
        CaptureError: pye57 is not installed; the file is damaged or truncated, or has no scan. What is wrong with the
            points is raised when their part is read.
    """
    check_e57_file(path)
    with _open(path) as image:
        scans = _list_scans(path, image)
    if not scans:
        raise CaptureError(f"{path} has no scan with points", "export the points with it")
    count = sum(scan.count for scan in scans)
    if count > _MAX_POINTS:
        raise CaptureError(f"{path} is damaged: it states {count:,} points", "copy it again")
    return CloudParts(
        parts=_read_parts(path, scans), work=max(count, 1), metres_per_unit=1.0, is_survey=True, color_levels=(255.0,)
    )


def check_e57_file(path: Path) -> None:
    """Refuse what is no whole file, and texts that define entities, which may grow without end when they are read.

    Raises:
        CaptureError: The file is none, or pye57 is not installed.
    """
    if importlib.util.find_spec("pye57") is None:
        raise CaptureError(
            f"{path} is E57, and the package pye57, which reads that, is not installed",
            f"install it with 'pip install pye57', or convert the file to LAZ, with 'pdal translate {path.name} "
            f"{path.stem}.laz' or CloudCompare (File, Save as LAS)",
        )
    with open_regular(path) as file:
        size = file.seek(0, 2)
        file.seek(0)
        head = file.read(_HEADER.size)
        if len(head) < _HEADER.size or not head.startswith(E57_START):
            raise CaptureError(f"{path} is no E57 file: it lacks the header of one", "export it again")
        _, version, _, length, start, xml_length, page = _HEADER.unpack(head)
        if version != 1 or page != _PAGE_BYTES:
            raise CaptureError(f"{path} is E57 of version {version} with pages of {page:,} bytes", "export it again")
        if length > size:
            raise CaptureError(f"{path} is truncated: it has {size:,} bytes of {length:,}", "copy it again")
        if xml_length > _MAX_XML_BYTES or start + xml_length > length:
            raise CaptureError(f"{path} is damaged: its description is to have {xml_length:,} bytes", "copy it again")
        file.seek(start // page * page)
        pages = file.read(2 * page + start % page + xml_length * page // (page - _CHECKSUM_BYTES))
    text = b"".join(pages[at : at + page - _CHECKSUM_BYTES] for at in range(0, len(pages), page))
    text = text[start % page : start % page + xml_length]
    if b"<!" in text.replace(b"<![CDATA[", b"").replace(b"<!--", b""):
        raise CaptureError(f"{path} is damaged: its description defines entities, which no scanner writes")


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    """The file, open; what goes wrong with it as CaptureError."""
    from pye57 import libe57

    image = None
    try:
        image = libe57.ImageFile(str(path), "r")
        yield image
    except (libe57.E57Exception, RuntimeError, ValueError, TypeError, IndexError, KeyError) as error:
        reason = str(error).split("\n")[0][:200] or type(error).__name__
        raise CaptureError(f"{path} is damaged ({reason})", "copy or export it again") from error
    except MemoryError as error:
        raise CaptureError(f"{path} is damaged: it asks for more memory than there is", "copy it again") from error
    finally:
        if image is not None:
            image.close()


def _list_scans(path: Path, image: Any) -> list[_Scan]:
    from pye57.libe57 import StructureNode

    data = _child(image.root(), "data3D")
    count = 0 if data is None else int(data.childCount())
    if count > _MAX_SCANS:
        raise CaptureError(f"{path} states {count:,} scans", "export fewer into one file")
    scans = []
    for number in range(count):
        node = _child(data, number)
        points = _child(node, "points")
        if points is None:
            continue
        prototype = StructureNode(points.prototype())
        fields = frozenset(str(prototype.get(k).elementName()) for k in range(prototype.childCount()))
        if not (fields.issuperset(_CARTESIAN) or fields.issuperset(_SPHERICAL)):
            raise CaptureError(
                f"scan {number + 1} of {path} has neither Cartesian nor spherical coordinates, only "
                f"{', '.join(sorted(fields)) or 'nothing'}",
                "export it with x, y and z",
            )
        rotation, translation_m = _read_pose(path, number, node)
        scans.append(
            _Scan(
                number=number,
                count=int(points.childCount()),
                fields=fields,
                rotation=rotation,
                translation_m=translation_m,
                color_limits=_read_color_limits(node, prototype),
            )
        )
    return [scan for scan in scans if scan.count]


def _child(node: Any, name: str | int) -> Any | None:
    """Of a structure or a list, as what it is; None where there is no such child."""
    from pye57.utils import get_node

    if isinstance(name, str) and not (hasattr(node, "isDefined") and node.isDefined(name)):
        return None
    return get_node(node, name)


def _read_pose(path: Path, number: int, node: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation matrix and translation, world from scan (8.4.3, table 12: a unit quaternion)."""
    w, x, y, z = _numbers(node, "pose/rotation", "wxyz") or (1.0, 0.0, 0.0, 0.0)
    moved = np.array(_numbers(node, "pose/translation", "xyz") or (0.0, 0.0, 0.0))
    length = float(np.sqrt(w * w + x * x + y * y + z * z))
    if not (np.isfinite(length) and length > 1e-6 and np.isfinite(moved).all()):
        raise CaptureError(f"scan {number + 1} of {path} has no pose that can be: {w, x, y, z}", "export it again")
    w, x, y, z = w / length, x / length, y / length, z / length
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return rotation, moved


def _numbers(node: Any, path: str, names: str) -> list[float] | None:
    """Numbers of a structure below a node; None where it is not there."""
    for name in path.split("/"):
        node = _child(node, name)
    values = [_value(_child(node, name)) for name in names]
    return None if None in values else [value for value in values if value is not None]


def _value(node: Any) -> float | None:
    if node is None:
        return None
    return float(node.scaledValue() if hasattr(node, "scaledValue") else node.value())


def _read_color_limits(node: Any, prototype: Any) -> NDArray[np.float64]:
    limits = np.tile([0.0, 255.0], (3, 1))
    stated = _child(node, "colorLimits")
    for k, name in enumerate(_COLORS):
        low, high = (_value(_child(stated, f"{name}{end}")) for end in ("Minimum", "Maximum"))
        channel = _child(prototype, name)
        if high is None and channel is not None and hasattr(channel, "maximum"):
            high = float(channel.maximum())
        limits[k] = [low or 0.0, 255.0 if high is None else high]
    bad = ~np.isfinite(limits).all(axis=1) | (limits[:, 1] <= limits[:, 0])
    limits[bad] = [0.0, 255.0]
    return limits


def _read_parts(path: Path, scans: list[_Scan]) -> Iterator[CloudPart]:
    has_colors = any(scan.has_colors for scan in scans)
    with _open(path) as image:
        for scan in scans:
            yield from _read_scan(path, image, scan, has_colors)


def _read_scan(path: Path, image: Any, scan: _Scan, has_colors: bool) -> Iterator[CloudPart]:
    from pye57 import libe57

    names = [*scan.coordinates, *(_COLORS if scan.has_colors else ()), *([scan.state] if scan.state else [])]
    capacity = min(PART_POINTS, scan.count)
    arrays = {name: np.zeros(capacity, np.int8 if name == scan.state else np.float64) for name in names}
    buffers = libe57.VectorSourceDestBuffer()
    for name, array in arrays.items():
        buffers.append(libe57.SourceDestBuffer(image, name, array, capacity, True, True))
    points = _child(_child(_child(image.root(), "data3D"), scan.number), "points")
    if points is None:  # it was there when the file was opened first
        raise CaptureError(f"{path} changes while it is read", "wait until it is written")
    reader = points.reader(buffers)
    done = 0
    try:
        while done < scan.count:
            count = int(reader.read())
            if not count:
                break
            done += count
            yield _as_part(scan, {name: array[:count] for name, array in arrays.items()}, has_colors)
    finally:
        reader.close()
    if done < scan.count:
        raise CaptureError(
            f"{path} is truncated: scan {scan.number + 1} states {scan.count:,} points, there are {done:,}",
            "copy it again",
        )


def _as_part(scan: _Scan, arrays: dict[str, NDArray[Any]], has_colors: bool) -> CloudPart:
    count = len(arrays[scan.coordinates[0]])
    valid = np.ones(count, bool) if scan.state is None else arrays[scan.state] == 0
    first, second, third = (arrays[name] for name in scan.coordinates)
    with np.errstate(invalid="ignore", over="ignore"):  # who asked for the part looks for what is not finite
        if scan.coordinates == _SPHERICAL:  # 8.4.4.2: range, azimuth from x towards y, elevation above the plane
            flat = first * np.cos(third)
            local = np.column_stack([flat * np.cos(second), flat * np.sin(second), first * np.sin(third)])
        else:
            local = np.column_stack([first, second, third])
        points = local @ scan.rotation.T + scan.translation_m
    colors = None
    if has_colors:
        colors = np.zeros((len(points), 3), np.float32)  # black: none
        if scan.has_colors:
            low, high = scan.color_limits.T
            stored = np.column_stack([arrays[name] for name in _COLORS])
            colors[:] = np.clip((stored - low) / (high - low), 0, 1) * 255
    marked = () if valid.all() else ((~valid, "points that the file marks as invalid"),)
    return CloudPart(points, colors, count, marked=marked)
