"""The points of a cloud with the leaf that each is of, as a PLY file that anyone can open."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud_files.read import FilePoints
from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import whole_file

_CHUNK = 1 << 18  # points that are packed at once
_MAX_LINE = 200  # bytes of a line of the header
_END = b"end_header\n"
_COMMENT = "comment leaf: number of the leaf that a point is of, -1 for none"


def write_leaf_points(
    path: Path,
    parts: Callable[[], Iterator[FilePoints]],
    leaf_of: Callable[[NDArray[np.float64]], NDArray[np.int32]],
    *,
    single: bool,
) -> int:
    """Write points and leaves as binary little-endian PLY: x, y, z and the int leaf.

    The points may be more than memory holds: they are gone through twice, once to count them.

    Args:
        path: The file, replaced when it exists; other than whole it does not appear.
        parts: Gives the points, some at a time, the same each time it is called.
        leaf_of: Gives the leaf (K,) of each of a part's used points (K, 3); called once a part, in order. Points that
            were not used are of no leaf.
        single: Whether coordinates are written as float32, else as double.

    Returns:
        How many points were written.

    Raises:
        WriteError: The file cannot be written; what was there is unchanged.
    """
    total = sum(len(part.points) for part in parts())
    word = "float" if single else "double"
    row = _row(single)
    header = ["ply", "format binary_little_endian 1.0", _COMMENT, f"element vertex {total}"]
    header += [f"property {word} {axis}" for axis in "xyz"]
    header += ["property int leaf", "end_header"]
    with whole_file(path) as new, new.open("xb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        for points, used in parts():
            leaf = np.full(len(points), -1, np.int32)
            leaf[used] = leaf_of(points[used])
            for start in range(0, len(points), _CHUNK):
                chunk = slice(start, start + _CHUNK)
                packed = np.empty(len(points[chunk]), row)
                for axis, name in enumerate("xyz"):
                    with np.errstate(over="ignore"):  # of a point that was not used, too far for a float
                        packed[name] = points[chunk, axis]
                packed["leaf"] = leaf[chunk]
                file.write(packed.tobytes())
    return total


def renumber_leaf_points(path: Path, number_of: NDArray[np.int32]) -> None:
    """Give the leaves in a file of write_leaf_points other numbers.

    Args:
        path: The file, replaced; other links to it stay as they are.
        number_of: (L,), the new number of each leaf, -1 for none.

    Raises:
        WriteError: The file cannot be written; what was there is unchanged.
        CaptureError: It is none of these files.
    """
    numbers = np.append(number_of, np.int32(-1)).astype(np.int32)  # the last is that of -1
    with path.open("rb") as old, whole_file(path) as new, new.open("xb") as file:
        header = b""
        while not header.endswith(_END):
            line = old.readline(_MAX_LINE)
            header += line
            if not line or len(header) > _MAX_LINE * 20:
                raise CaptureError(f"{path} is not a file of points and their leaves", "build the plant again")
        file.write(header)
        row = _row(b"property float x" in header)
        while data := old.read(_CHUNK * row.itemsize):
            if len(data) % row.itemsize:
                raise CaptureError(f"{path} is truncated", "build the plant again")
            rows = np.frombuffer(data, row).copy()
            if int(rows["leaf"].max()) >= len(number_of) or int(rows["leaf"].min()) < -1:
                raise CaptureError(f"{path} has leaves that the plant has not", "build the plant again")
            rows["leaf"] = numbers[rows["leaf"]]
            file.write(rows.tobytes())


def _row(single: bool) -> np.dtype[np.void]:
    kind = "<f4" if single else "<f8"
    return np.dtype([("x", kind), ("y", kind), ("z", kind), ("leaf", "<i4")])
