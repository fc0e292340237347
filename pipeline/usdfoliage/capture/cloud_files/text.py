"""Clouds in text files: x y z in columns, with or without colours, a header or a count of points; read in parts."""

import io
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud_files.chunks import CloudPart, CloudParts
from usdfoliage.capture.cloud_files.units import find_stated_unit, find_stated_up
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import open_regular

_BLOCK = 1 << 25  # bytes that are read at once
_HEAD = 1 << 16  # bytes that the layout is found from
_HEAD_LINES = 400
_LONGEST_LINE = 1 << 20
_MAX_BAD = 0.1  # share of the lines that may be no points; beyond, the file is something else
_COMMENTS = ("#", "//", ";", "%", "!")
_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eEdD][-+]?\d+)?$|[-+]?(?:nan|inf|infinity)$", re.IGNORECASE)
_COMMA_NUMBER = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?$")
_PLACE = (("x", "easting", "east"), ("y", "northing", "north"), ("z", "height", "elevation", "elev"))
_COLOR = (("r", "red", "rf"), ("g", "green", "gf"), ("b", "blue", "bf"))


class _Layout(NamedTuple):
    """How the lines of a file are to be read."""

    separator: str | None  # None: blanks and tabs
    decimal_comma: bool
    place: tuple[int, ...]  # columns of x, y and z
    color: tuple[int, ...] | None
    levels: tuple[float, ...]  # of the colours
    start: int  # of the first line with a point, in bytes
    declared: int | None  # how many points there are, as the line before them states
    comments: tuple[str, ...]  # comments and names of columns


def open_text_parts(path: Path) -> CloudParts:
    """Open a text file with a point a line: x y z, then colours or whatever else.

    Columns are parted by blanks, tabs, commas or semicolons, and may be named in a line above them. Without names the
    first three are the place; columns 4 to 6 of six or nine and more, or 5 to 7 of seven (as in .pts), are colours
    where they are whole numbers of 0 to 255 or 65535. Decimal commas are read where commas part nothing. Lines that
    begin with # // ; % ! are comments. A line that is no point is left out and counted.

    Raises:
        CaptureError: The file is not text, or has no line with three numbers; later, when too many lines are no points,
            or fewer come than a line at the top states.
    """
    try:
        with open_regular(path) as file:
            head = file.read(_HEAD)
            size = file.seek(0, 2)
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error
    if b"\0" in head:
        raise CaptureError(f"{path} is not plain text (it has zero bytes)", "save it as text in UTF-8 or ASCII")
    layout = _find_layout(path, head)
    return CloudParts(
        parts=_read_parts(path, layout),
        work=size,
        metres_per_unit=find_stated_unit(layout.comments),
        up_axis=find_stated_up(layout.comments),
        color_levels=layout.levels,
    )


def _find_layout(path: Path, head: bytes) -> _Layout:
    names: list[str] | None = None
    count: int | None = None
    comments: list[str] = []
    at = 3 if head.startswith(b"\xef\xbb\xbf") else 0
    ends = [at, *(match.end() for match in re.finditer(rb"\r\n|\n|\r", head))]
    if ends[-1] < len(head):
        ends.append(len(head))
    lines = [(begin, head[begin:end].decode("latin-1").strip()) for begin, end in pairwise(ends)]
    for number, (begin, line) in enumerate(lines[:_HEAD_LINES]):
        if not line or line.startswith(_COMMENTS):
            comments.append(line.lstrip("#/;%! "))
            names = _names(comments[-1]) or names
            continue
        separator, decimal_comma = _separator(line)
        words = _words(line, separator, decimal_comma)
        if len(words) >= 3 and sum(map(_is_number, words)) >= 3:
            sample = [_words(text, separator, decimal_comma) for _, text in lines[number : number + 100] if text]
            place, color, levels = _columns(names, sample)
            return _Layout(separator, decimal_comma, place, color, levels, begin, count, tuple(comments))
        if len(words) == 1 and _is_count(words[0]):
            count = int(words[0])
        else:
            comments.append(line)
            names = _names(line) or names
    raise CaptureError(
        f"{path} has no line 'x y z' among its first {min(len(lines), _HEAD_LINES)}", "give a cloud as text"
    )


def _separator(line: str) -> tuple[str | None, bool]:
    """What parts the columns, and whether commas are decimal points."""
    if ";" in line.rstrip("; "):
        return ";", any(_COMMA_NUMBER.match(word.strip()) for word in line.split(";"))
    words = line.split()
    if len(words) >= 3 and any(_COMMA_NUMBER.match(word) for word in words):
        return None, all(_COMMA_NUMBER.match(word) or _is_number(word) for word in words)
    return ("," if "," in line else None), False


def _words(line: str, separator: str | None, decimal_comma: bool) -> list[str]:
    words = [word.strip() for word in line.split(separator)] or [""]
    return [word.replace(",", ".") for word in words] if decimal_comma else words


def _is_number(word: str) -> bool:
    return _NUMBER.match(word) is not None


def _is_count(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) <= 18


def _names(line: str) -> list[str] | None:
    """Names of columns, in small letters and without their units; None where the line has no x, y and z."""
    names = [re.split(r"[\[(_ ]", word.strip(" \"'").lower())[0] for word in _words(line, *_separator(line))]
    return names if all(any(one in names for one in known) for known in _PLACE) else None


def _columns(
    names: list[str] | None, sample: list[list[str]]
) -> tuple[tuple[int, ...], tuple[int, ...] | None, tuple[float, ...]]:
    """The columns of the place and of the colours, and which may be the highest colour."""
    if names is not None and len(names) <= len(sample[0]):
        place = tuple(next(names.index(one) for one in known if one in names) for known in _PLACE)
        found = [next((names.index(one) for one in known if one in names), None) for known in _COLOR]
        color = tuple(column for column in found if column is not None)
        return place, color if len(color) == 3 else None, (1.0, 255.0, 65535.0)
    width = len(sample[0])
    if width == 6 or width >= 9:
        color = (3, 4, 5)
    elif width == 7:
        color = (4, 5, 6)
    else:
        return (0, 1, 2), None, (255.0,)
    words = [row[column] for row in sample if len(row) == width for column in color]
    whole = all(_is_count(word) and int(word) <= 65535 for word in words)
    return (0, 1, 2), color if whole else None, (255.0, 65535.0)


def _read_parts(path: Path, layout: _Layout) -> Iterator[CloudPart]:
    """Blocks that end with a line."""
    columns = [*layout.place, *(layout.color or ())]
    found = bad = 0
    try:
        with open_regular(path) as file:
            file.seek(layout.start)
            work, rest = layout.start, b""
            while True:
                block = file.read(_BLOCK)
                end = max(block.rfind(b"\n"), block.rfind(b"\r")) + 1
                if block and not end:
                    rest += block
                    if len(rest) > _LONGEST_LINE:
                        raise CaptureError(
                            f"{path} has a line of more than {_LONGEST_LINE:,} bytes", "give a cloud as text"
                        )
                    continue
                text, rest = rest + block[:end], block[end:]
                values, wrong = _numbers(text, layout, columns)
                found, bad, work = found + len(values), bad + wrong, work + len(text)
                if bad > _MAX_BAD * (found + bad) and bad > 1:
                    raise CaptureError(
                        f"{path}: {bad:,} of the first {found + bad:,} lines are not {max(columns) + 1} numbers",
                        "give a text file with a point x y z a line",
                    )
                with np.errstate(over="ignore"):
                    colors = values[:, 3:].astype(np.float32) if layout.color else None
                left_out = ((wrong, "lines that are no points"),) if wrong else ()
                yield CloudPart(values[:, :3], colors, len(text), left_out)
                if not block:
                    break
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error
    if layout.declared is not None and found + bad < layout.declared:
        raise CaptureError(
            f"{path} is truncated: its first line states {layout.declared:,} points, there are {found + bad:,}",
            "copy it again",
        )


def _numbers(text: bytes, layout: _Layout, columns: list[int]) -> tuple[NDArray[np.float64], int]:
    """The columns of all lines, and how many lines are neither that, nor empty, a comment or a count of points."""
    if layout.decimal_comma:
        text = text.replace(b",", b".")
    text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not text.strip():
        return np.zeros((0, len(columns))), 0
    try:
        return _load(io.BytesIO(text), layout, columns), 0
    except ValueError:
        pass
    # One line is no point; they are looked at one by one.
    good, bad = [], 0
    for line in text.decode("latin-1").split("\n"):
        words = _words(line.strip(), layout.separator, False)
        if words == [""] or line.lstrip().startswith(_COMMENTS) or (len(words) == 1 and words[0].isdigit()):
            continue
        if len(words) > max(columns) and all(_is_number(words[column]) for column in columns):
            good.append([float(words[column].lower().replace("d", "e")) for column in columns])
        else:
            bad += 1
    return np.array(good, np.float64).reshape(-1, len(columns)), bad


def _load(file: io.BytesIO, layout: _Layout, columns: list[int]) -> NDArray[np.float64]:
    return np.loadtxt(file, usecols=columns, comments="#", delimiter=layout.separator, ndmin=2, encoding="latin-1")
