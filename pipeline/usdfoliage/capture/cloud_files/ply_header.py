"""The header of a PLY file: which elements follow it, of which properties."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple

from usdfoliage.errors import CaptureError

MAX_HEADER_BYTES = 1 << 20
MAX_PROPERTIES = 1000

_TYPES: Mapping[str, str] = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8"},
}
_ORDERS: Mapping[str, str] = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


class PlyProperty(NamedTuple):
    """Numbers, or lists of these, in each row of an element."""

    name: str  # in small letters
    type: str  # numpy's, without byte order
    count_type: str | None  # of a list's length; None for a single number


class PlyElement(NamedTuple):
    """Rows of one kind."""

    name: str
    rows: int
    properties: tuple[PlyProperty, ...]


class PlyHeader(NamedTuple):
    """What follows it in the file."""

    order: str  # of bytes, numpy's; "" for text
    elements: tuple[PlyElement, ...]
    comments: tuple[str, ...]


def read_header(path: Path, file: BinaryIO) -> PlyHeader:
    """The header of a file that is read from its start; it is left where the data begin.

    Raises:
        CaptureError: It is none.
    """
    lines = _header_lines(path, file)
    order: str | None = None
    elements: list[tuple[str, int, list[PlyProperty]]] = []
    comments = []
    for number, line in enumerate(lines, 2):
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            comments.append(" ".join(words[1:]))
            continue
        try:
            if words[0] == "format":
                order = _ORDERS[words[1]]
            elif words[0] == "element":
                elements.append((words[1], _count_of(words[2]), []))
            elif words[0] == "property":
                elements[-1][2].append(_property_of(words))
            else:
                raise ValueError
        except (IndexError, KeyError, ValueError) as error:
            raise CaptureError(f"{path}:{number} {line[:60]!r} is no line of a PLY header", "write it again") from error
        if sum(len(properties) for _, _, properties in elements) > MAX_PROPERTIES:
            raise CaptureError(f"{path} has more than {MAX_PROPERTIES} properties", "write it again with fewer")
    if order is None:
        raise CaptureError(f"{path} does not state its format", "write it again as binary_little_endian")
    named = tuple(PlyElement(name, count, tuple(properties)) for name, count, properties in elements)
    return PlyHeader(order, named, tuple(comments))


def _header_lines(path: Path, file: BinaryIO) -> list[str]:
    """What stands between the first line, ply, and end_header."""
    start = file.read(MAX_HEADER_BYTES)
    if start[:3] != b"ply" or start[3:4] not in (b"\n", b"\r"):
        raise CaptureError(f"{path} is no PLY file: it begins with {start[:8]!r}", "give a cloud in PLY")
    ending = b"\r\n" if start[3:5] == b"\r\n" else start[3:4]
    at = start.find(ending + b"end_header" + ending)
    if at < 0:
        raise CaptureError(f"{path} has no end_header in its first {len(start):,} bytes", "copy it again")
    file.seek(at + len(b"end_header") + 2 * len(ending))
    return start[3 + len(ending) : at].decode("latin-1").split(ending.decode("ascii")) if at > 3 else []


def _count_of(word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) <= 18):
        raise ValueError
    return int(word)


def _property_of(words: list[str]) -> PlyProperty:
    if words[1] == "list":
        count_type = _TYPES[words[2]]
        if count_type.startswith("f"):
            raise ValueError
        return PlyProperty(words[4].lower(), _TYPES[words[3]], count_type)
    return PlyProperty(words[2].lower(), _TYPES[words[1]], None)


def find_vertices(path: Path, header: PlyHeader) -> PlyElement:
    """The element of the points.

    Raises:
        CaptureError: There is none, or it has no places.
    """
    vertices = next((element for element in header.elements if element.name == "vertex"), None)
    if vertices is None:
        raise CaptureError(f"{path} has no element vertex, but {_names(header.elements)}", "give a cloud")
    names = {one.name for one in vertices.properties if one.count_type is None}
    if not {"x", "y", "z"} <= names:
        raise CaptureError(f"the vertices of {path} have {', '.join(sorted(names)) or 'nothing'}, but no x, y and z")
    return vertices


def _names(elements: Sequence[PlyElement]) -> str:
    return ", ".join(element.name for element in elements[:5]) or "nothing"
