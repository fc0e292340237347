"""Strokes that somebody drew over a photograph: a crown's outline, and branches from the root up, of each tree."""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import whole_file
from usdfoliage.files.json import read_json
from usdfoliage.geometry.lines import arc_lengths, points_at
from usdfoliage.sketch.choices import SketchChoices, parse_choices
from usdfoliage.sketch.foliage import fill_outline

SUFFIX = ".strokes.json"  # after the photograph's name
MAX_TREES, MAX_BRANCHES, MAX_POINTS = 100, 1000, 100_000
MAX_BYTES = 20_000_000  # of the file
MAX_CROSSED = 0.1  # of a crown's area, or of the length of a branch, that a stroke may go around twice
_PLACES = 500  # on a stroke, between which it is looked at
_WORK_PX = 400  # longer side of the picture in which areas are measured
OUTSIDE = 0.02  # of the picture's longer side, that a stroke may go beyond its border
MIN_STEM = 0.03  # of the crown's longer side, that a first branch has in length; less is a click, or no stem
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
    choices: SketchChoices = field(default_factory=SketchChoices)


def strokes_beside(photo: Path) -> Path:
    """Where the strokes of a photograph are kept: beside it, by its name."""
    return photo.with_name(photo.stem + SUFFIX)


def name_tree(number: int) -> str:
    """What one of several trees of a photograph is called, counted from 1."""
    return f"tree_{number:02d}"


def find_strokes(photo: Path) -> Path | None:
    """The strokes beside a photograph; None where there is no such file."""
    if not photo.name:  # a folder such as "." or "/"
        return None
    beside = strokes_beside(photo)
    return beside if os.path.isfile(beside) else None  # noqa: PTH113 (Path.is_file raises for names too long)


def read_strokes(path: Path) -> Strokes:
    """Strokes of a file, as the window and other programs write them.

    Args:
        path: JSON: image, width, height, and trees, a list of tables with crown and branches; a file with crown and
            branches at the top is one tree. A table of settings may stand beside them (SketchChoices).

    Raises:
        CaptureError: The file cannot be read, or holds no strokes.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise CaptureError(f"the strokes {path} have {size:,} bytes, at most {MAX_BYTES:,} are allowed", _DRAW)
        found = read_json(path)
    except OSError as error:
        raise CaptureError(f"the strokes {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise CaptureError(f"the strokes {path} are no JSON: {error}") from error
    return parse_strokes(found, path)


def parse_strokes(found: Any, path: Path) -> Strokes:
    """Strokes as JSON has them; path is named where they are none.

    Raises:
        CaptureError: They are none.
    """
    if not isinstance(found, dict):
        raise CaptureError(f"{path} holds no strokes: it is no table with image, width, height and trees", _DRAW)
    listed = found.get("trees", [found] if "crown" in found else None)
    if not isinstance(listed, list) or not listed:
        raise CaptureError(f"{path} holds no strokes: neither trees nor a crown", _DRAW)
    if len(listed) > MAX_TREES:
        raise CaptureError(f"{path} has {len(listed):,} trees, at most {MAX_TREES} are allowed")
    width, height = (_whole(found, name, path) for name in ("width", "height"))
    image = found.get("image")
    try:
        choices = parse_choices(found.get("settings", {}))
    except ValueError as error:
        raise CaptureError(f"{path}: {error}", "correct it, or leave settings out") from error
    return Strokes(
        image=image if isinstance(image, str) else "",
        width_px=width,
        height_px=height,
        trees=tuple(_tree(each, number, path) for number, each in enumerate(listed, 1)),
        choices=choices,
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
    chosen = {"settings": strokes.choices.table} if strokes.choices.table else {}
    return json.dumps({**head, **(trees[0] if len(trees) == 1 else {"trees": trees}), **chosen}) + "\n"


def check_strokes(strokes: Strokes, width_px: int, height_px: int, name: str) -> None:
    """See that strokes are of a photograph.

    Args:
        strokes: As they were read.
        width_px: Of the photograph.
        height_px: Likewise.
        name: Of the strokes' file, for the message.

    Raises:
        CaptureError: They were drawn over a picture of another size, lie outside of this one, cross themselves, or are
            too small, or a tree's first branch does not go up.
    """
    if (strokes.width_px, strokes.height_px) != (width_px, height_px):
        raise CaptureError(
            f"the strokes {name} are of a picture of {strokes.width_px} x {strokes.height_px} pixels, and the "
            f"photograph has {width_px} x {height_px}",
            _DRAW,
        )
    _check_places(strokes, width_px, height_px, name)
    for number, tree in enumerate(strokes.trees, 1):
        if _encloses_nothing(tree.crown_px):
            raise CaptureError(
                f"the crown of tree {number} in {name} encloses nothing", "draw it around the leaves of the tree"
            )
        if _crosses_itself(tree.crown_px):
            raise CaptureError(
                f"the crown of tree {number} in {name} crosses itself", "draw it once around the leaves, in one turn"
            )
        for k, line in enumerate(tree.branches_px, 1):
            if _loop_share(line) > MAX_CROSSED:
                raise CaptureError(
                    f"branch {k} of tree {number} in {name} crosses itself", "draw it along the branch, from its foot"
                )
        fewest = MIN_STEM * float(np.ptp(tree.crown_px, axis=0).max())
        if tree.branches_px and (length := _length(tree.branches_px[0])) < fewest:
            raise CaptureError(
                f"the first branch of tree {number} in {name} is {length:.1f} pixels long, at least {fewest:.1f} are "
                "needed for this crown",
                "draw it from the root up into the crown",
            )
        if tree.branches_px and _goes_down(tree.branches_px[0]):
            first = tree.branches_px[0]
            raise CaptureError(
                f"the first branch of tree {number} in {name} goes down the picture, from y {first[0, 1]:.0f} to "
                f"{first[-1, 1]:.0f}",
                "draw it from the root upwards",
            )


def check_roots(strokes: Strokes, is_sky: NDArray[np.bool_], name: str) -> None:
    """See that trees stand on something.

    Args:
        strokes: Of the photograph.
        is_sky: (h, w), which pixels of the photograph, made smaller, are sky.
        name: Of the strokes' file, for the message.

    Raises:
        CaptureError: A tree has its root in the sky.
    """
    height, width = is_sky.shape
    reach = max(1, round(OUTSIDE * max(width, height)))
    for number, tree in enumerate(strokes.trees, 1):
        if not tree.branches_px:
            continue
        root = tree.branches_px[0][0] * [width / strokes.width_px, height / strokes.height_px]
        x, y = np.clip(np.floor(root).astype(int), 0, [width - 1, height - 1]).tolist()
        around = is_sky[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1]
        if around.all():
            x_px, y_px = tree.branches_px[0][0]
            raise CaptureError(
                f"the first branch of tree {number} in {name} begins in the sky, at x {x_px:.0f}, y {y_px:.0f}",
                "begin it at the root, where the stem leaves the ground",
            )


def _check_places(strokes: Strokes, width_px: int, height_px: int, name: str) -> None:
    """See that all strokes lie in the picture; CaptureError as check_strokes."""
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


def _encloses_nothing(outline: NDArray[np.float64]) -> bool:
    """Whether a closed stroke goes to and fro on one line: it then bounds less than the pixels along itself."""
    _, filled = _fill_small(outline)
    return not cv2.erode(filled.astype(np.uint8), np.ones((3, 3), np.uint8)).any()


def _fill_small(outline: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A closed stroke (N, 2) that is _WORK_PX long, and (H, W) what it bounds."""
    line = (outline - outline.min(axis=0)) * (_WORK_PX / max(float(np.ptp(outline, axis=0).max()), 1e-9))
    size = np.ceil(line.max(axis=0)).astype(int) + 2
    return line, fill_outline(line, (int(size[0]), int(size[1])))


def _crosses_itself(outline: NDArray[np.float64]) -> bool:
    """Whether a closed stroke goes around more, or less, than the area that it bounds: as an 8 does, or two turns."""
    line, filled = _fill_small(outline)
    bounded = float(filled.sum())
    around = 0.5 * abs(float(np.sum(line[:, 0] * np.roll(line[:, 1], -1) - line[:, 1] * np.roll(line[:, 0], -1))))
    edge = float(np.linalg.norm(np.diff(line, axis=0, append=line[:1]), axis=1).sum())  # whose pixels count wholly
    return abs(bounded - around) > MAX_CROSSED * bounded + edge


def _loop_share(line: NDArray[np.float64]) -> float:
    """The share of a stroke's length that lies in the longest loop of it."""
    point = points_at(line, np.linspace(0, _length(line), _PLACES))
    start, step = point[:-1], np.diff(point, axis=0)

    def side(of: NDArray[np.float64]) -> NDArray[np.float64]:
        """(S, S) on which side of each segment points lie."""
        return np.asarray(
            step[:, None, 0] * (of[None, :, 1] - start[:, None, 1])
            - step[:, None, 1] * (of[None, :, 0] - start[:, None, 0])
        )

    apart = side(start) * side(start + step) < 0
    first, second = np.nonzero(np.triu(apart & apart.T, 2))
    return 0.0 if not len(first) else float((second - first).max() / (_PLACES - 1))


def _goes_down(line: NDArray[np.float64]) -> bool:
    """Whether a stroke ends clearly below its first point."""
    return bool(line[-1, 1] - line[0, 1] > 0.5 * _length(line))


def _length(line: NDArray[np.float64]) -> float:
    """Of a stroke, in pixels."""
    return float(arc_lengths(line)[-1])


def _whole(table: dict[str, Any], name: str, path: Path) -> int:
    value = table.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= 1_000_000:
        raise CaptureError(f"{path}: {name} must be the {name} of the photograph in pixels, not {value!r:.60}", _DRAW)
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
        and all(abs(each) < 1e9 for each in value)  # which no NaN is, and an int may be beyond all floats
    )
