"""Strokes that somebody drew over a photograph: a crown's outline, and branches from the root up, of each tree."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import whole_file
from usdfoliage.files.json import read_json

SUFFIX = ".strokes.json"  # after the photograph's name
MAX_TREES, MAX_BRANCHES, MAX_POINTS = 100, 1000, 100_000
OUTSIDE = 0.02  # of the picture's longer side, that a stroke may go beyond its border
_DRAW = "draw the strokes again, over this photograph"


@dataclass(frozen=True, kw_only=True, eq=False)
class TreeStrokes:
    """The strokes of one tree, in pixels of the photograph: x to the right, y down, the first pixel's corner at 0."""

    crown_px: NDArray[np.float64]  # (N, 2), a closed outline around the leaves, at least 3 points
    branches_px: tuple[NDArray[np.float64], ...]  # (K, 2) each, at least 2 points; the first begins at the root


@dataclass(frozen=True, kw_only=True, eq=False)
class Strokes:
    """The strokes over one photograph."""

    image: str  # the photograph's file name
    width_px: int
    height_px: int
    trees: tuple[TreeStrokes, ...]


def strokes_beside(photo: Path) -> Path:
    """Where the strokes of a photograph are kept: beside it, by its name."""
    return photo.with_name(photo.stem + SUFFIX)


def read_strokes(path: Path) -> Strokes:
    """Strokes of a file, as the window and other programs write them.

    Args:
        path: JSON: image, width, height, and trees, a list of tables with crown and branches; a file with crown and
            branches at the top is one tree.

    Raises:
        CaptureError: The file cannot be read, or holds no strokes.
    """
    try:
        found = read_json(path)
    except OSError as error:
        raise CaptureError(f"the strokes {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise CaptureError(f"the strokes {path} are no JSON: {error}") from error
    if not isinstance(found, dict):
        raise CaptureError(f"{path} holds no strokes: it is no table with image, width, height and trees", _DRAW)
    listed = found.get("trees", [found] if "crown" in found else None)
    if not isinstance(listed, list) or not listed:
        raise CaptureError(f"{path} holds no strokes: neither trees nor a crown", _DRAW)
    if len(listed) > MAX_TREES:
        raise CaptureError(f"{path} has {len(listed):,} trees, at most {MAX_TREES} are allowed")
    width, height = (_whole(found, name, path) for name in ("width", "height"))
    image = found.get("image")
    return Strokes(
        image=image if isinstance(image, str) else "",
        width_px=width,
        height_px=height,
        trees=tuple(_tree(each, number, path) for number, each in enumerate(listed, 1)),
    )


def write_strokes(path: Path, strokes: Strokes) -> None:
    """Write strokes as read_strokes takes them, to a hundredth of a pixel.

    Raises:
        WriteError: The file cannot be written.
    """
    with whole_file(path) as new:
        new.write_text(format_strokes(strokes), encoding="utf-8")


def format_strokes(strokes: Strokes) -> str:
    """Strokes as JSON, to a hundredth of a pixel."""

    def rounded(line: NDArray[np.float64]) -> list[list[float]]:
        return [[float(value) for value in point] for point in np.round(line, 2)]

    trees = [
        {"crown": rounded(tree.crown_px), "branches": [rounded(line) for line in tree.branches_px]}
        for tree in strokes.trees
    ]
    head = {"image": strokes.image, "width": strokes.width_px, "height": strokes.height_px}
    return json.dumps({**head, **(trees[0] if len(trees) == 1 else {"trees": trees})}) + "\n"


def check_strokes(strokes: Strokes, width_px: int, height_px: int, name: str) -> None:
    """See that strokes are of a photograph.

    Args:
        strokes: As they were read.
        width_px: Of the photograph.
        height_px: Likewise.
        name: Of the strokes' file, for the message.

    Raises:
        CaptureError: They were drawn over a picture of another size, or lie outside of this one.
    """
    if (strokes.width_px, strokes.height_px) != (width_px, height_px):
        raise CaptureError(
            f"the strokes {name} are of a picture of {strokes.width_px} x {strokes.height_px} pixels, and the "
            f"photograph has {width_px} x {height_px}",
            _DRAW,
        )
    slack = OUTSIDE * max(width_px, height_px)
    for number, tree in enumerate(strokes.trees, 1):
        for what, line in (("crown", tree.crown_px), *(("branch", each) for each in tree.branches_px)):
            low, high = line.min(axis=0), line.max(axis=0)
            if (low < -slack).any() or high[0] > width_px + slack or high[1] > height_px + slack:
                raise CaptureError(
                    f"a stroke of the {what} of tree {number} in {name} leaves the picture of {width_px} x "
                    f"{height_px} pixels: x {low[0]:.0f} to {high[0]:.0f}, y {low[1]:.0f} to {high[1]:.0f}",
                    _DRAW,
                )


def _whole(table: dict[str, Any], name: str, path: Path) -> int:
    value = table.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= 1_000_000:
        raise CaptureError(f"{path}: {name} must be the {name} of the photograph in pixels, not {value!r}", _DRAW)
    return value


def _tree(table: Any, number: int, path: Path) -> TreeStrokes:
    where = f"{path}, tree {number}"
    if not isinstance(table, dict):
        raise CaptureError(f"{where}: a tree is a table with crown and branches, not {table!r:.60}", _DRAW)
    branches = table.get("branches", [])
    if not isinstance(branches, list) or len(branches) > MAX_BRANCHES:
        raise CaptureError(f"{where}: branches must be a list of at most {MAX_BRANCHES:,} strokes", _DRAW)
    return TreeStrokes(
        crown_px=_line(table.get("crown"), 3, f"{where}: the crown"),
        branches_px=tuple(_line(each, 2, f"{where}: branch {k}") for k, each in enumerate(branches, 1)),
    )


def _line(points: Any, fewest: int, what: str) -> NDArray[np.float64]:
    """(N, 2) the points of a stroke, none twice in a row."""
    if not isinstance(points, list) or not all(_is_point(each) for each in points):
        raise CaptureError(f"{what} must be a list of points [x, y] in pixels", _DRAW)
    if len(points) > MAX_POINTS:
        raise CaptureError(f"{what} has {len(points):,} points, at most {MAX_POINTS:,} are allowed")
    line = np.array(points, np.float64).reshape(-1, 2)
    line = line[np.append(True, (np.diff(line, axis=0) != 0).any(axis=1))[: len(line)]]
    if len(line) < fewest:
        raise CaptureError(f"{what} has {_count(line)}, at least {fewest} are needed", _DRAW)
    return line


def _count(line: Sequence[Any] | NDArray[np.float64]) -> str:
    return "1 point" if len(line) == 1 else f"{len(line)} points"


def _is_point(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 2
        and all(isinstance(each, int | float) and not isinstance(each, bool) for each in value)
        and all(math.isfinite(each) and abs(each) < 1e9 for each in value)
    )
