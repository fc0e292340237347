"""Meshes in OBJ files: their points and their faces, as triangles.

Source: Wavefront, Advanced Visualizer Manual, appendix B1, Object Files.
"""

from array import array
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.files.printable import printable
from usdfoliage.files.reading import describe_unread, open_regular

MAX_BYTES = 1 << 31
FARTHEST = 1e11  # from the origin; the Earth is smaller, in millimetres too
_LONGEST_LINE = 1 << 20
_QUOTED = 60  # characters of a line, in an error


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjMesh:
    """A mesh as the file has it."""

    points: NDArray[np.float64]  # (V, 3), finite
    triangles: NDArray[np.int64]  # (F, 3), at least one


def read_obj(path: Path, name: str) -> ObjMesh:
    """Read the points and faces of an OBJ file; a face of more corners is a fan of triangles.

    Colours after the coordinates, normals, texture coordinates, groups, materials, lines and points are left out.

    Args:
        path: The file.
        name: What it is to the user, for errors.

    Raises:
        CaptureError: It cannot be read, is too large, has no faces, a coordinate that is no finite number, or a face
            of corners that are not there.
    """
    points, corners = array("d"), array("q")
    try:
        with open_regular(path) as file:
            size = file.seek(0, 2)
            if size > MAX_BYTES:
                raise CaptureError(
                    f"{name} {path} has {size:,} bytes, and may have {MAX_BYTES:,}", "give a mesh of fewer faces"
                )
            file.seek(0)
            number = 0
            while line := file.readline(_LONGEST_LINE):
                number += 1
                while line.endswith((b"\\\n", b"\\\r\n")) and len(line) < _LONGEST_LINE:
                    number += 1
                    line = line.rstrip(b"\\\r\n") + b" " + file.readline(_LONGEST_LINE)
                words = line.split()
                if not words:
                    continue
                good = True
                if words[0] == b"v":
                    good = _add_point(words, points)
                elif words[0] == b"f":
                    good = _add_face(words, len(points) // 3, corners)
                if not good or len(line) >= _LONGEST_LINE:
                    raise _refuse_line(path, name, number, line, is_face=words[0] == b"f")
    except OSError as error:
        raise describe_unread(error) from error
    if not corners:
        what = f"{len(points) // 3:,} points and no faces" if points else "no points and no faces"
        raise CaptureError(f"{name} {path} has {what}", "export the ground as an OBJ mesh with faces")
    return ObjMesh(
        points=np.frombuffer(points, np.float64).reshape(-1, 3),
        triangles=np.frombuffer(corners, np.int64).reshape(-1, 3),
    )


def _add_point(words: list[bytes], points: "array[float]") -> bool:
    try:
        place = float(words[1]), float(words[2]), float(words[3])
    except (ValueError, IndexError):
        return False
    points.extend(place)
    return all(abs(each) <= FARTHEST for each in place)  # which no NaN is


def _add_face(words: list[bytes], count: int, corners: "array[int]") -> bool:
    """Corners are counted from 1, or back from the last point with -1; what follows a slash belongs to other lists."""
    try:
        named = [int(word.partition(b"/")[0]) for word in words[1:]]
    except ValueError:
        return False
    own = [each - 1 if each > 0 else count + each for each in named]
    if len(own) < 3 or 0 in named or min(own) < 0 or max(own) >= count:
        return False
    for second, third in pairwise(own[1:]):
        corners.extend((own[0], second, third))
    return True


def _refuse_line(path: Path, name: str, number: int, line: bytes, *, is_face: bool) -> CaptureError:
    text = printable(line[: _QUOTED + 1].decode("utf-8", "replace").strip())
    quoted = text if len(text) <= _QUOTED else f"{text[:_QUOTED]}…"
    wrong = (
        "no face of three or more points above it" if is_face else f"no point of three numbers of at most {FARTHEST:g}"
    )
    return CaptureError(f"{name} {path} has in line {number:,} {wrong}: {quoted!r}", "export the mesh again")
