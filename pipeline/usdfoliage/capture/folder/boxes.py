"""The boxes that HEIC, CR3, MP4 and MOV files are made of.

Source: ISO/IEC 14496-12:2022, ISO base media file format, section 4.2.
"""

import struct
from pathlib import Path
from typing import NamedTuple

from usdfoliage.files.reading import open_regular

_MAX_BOXES = 100_000  # in one place; more are no file of a camera


class Box(NamedTuple):
    """A box, by where its content is among the bytes of the file."""

    kind: bytes  # four characters
    start: int
    end: int


def list_boxes(data: bytes, start: int = 0, end: int | None = None) -> tuple[Box, ...]:
    """The boxes that follow one another from start to end.

    Raises:
        ValueError: A box is longer than what it is in.
    """
    end = len(data) if end is None else end
    boxes: list[Box] = []
    at = start
    while at + 8 <= end:
        size, kind = struct.unpack_from(">I4s", data, at)
        head = 8
        if size == 1 and at + 16 <= end:
            (size,) = struct.unpack_from(">Q", data, at + 8)
            head = 16
        elif size == 0:  # to the end
            size = end - at
        if size < head or at + size > end:
            raise ValueError(f"box {kind!r} at byte {at:,} states {size:,} bytes, there are {end - at:,}")
        if len(boxes) == _MAX_BOXES:
            raise ValueError(f"there are more than {_MAX_BOXES:,} boxes in one place")
        boxes.append(Box(kind, at + head, at + size))
        at += size
    return tuple(boxes)


def find_box(data: bytes, path: tuple[bytes, ...], start: int = 0, end: int | None = None) -> Box | None:
    """The first box of these kinds, each in the one before; None where there is none. ValueError as list_boxes."""
    box = next((box for box in list_boxes(data, start, end) if box.kind == path[0]), None)
    if box is None or len(path) == 1:
        return box
    return find_box(data, path[1:], box.start, box.end)


def read_top_box(path: Path, kind: bytes, max_bytes: int) -> bytes | None:
    """The content of the first box of a kind at the top of a file, which may be long; None where there is none.

    Raises:
        ValueError: The boxes are damaged, or it has more than max_bytes.
        OSError: The file cannot be read.
    """
    with open_regular(path) as file:
        end = file.seek(0, 2)
        at = 0
        for _ in range(_MAX_BOXES):
            if at + 8 > end:
                return None
            file.seek(at)
            head = file.read(16)
            size, found = struct.unpack_from(">I4s", head)
            length = 8
            if size == 1 and len(head) == 16:
                (size,) = struct.unpack_from(">Q", head, 8)
                length = 16
            elif size == 0:
                size = end - at
            if size < length or at + size > end:
                raise ValueError(f"box {found!r} at byte {at:,} states {size:,} bytes, there are {end - at:,}")
            if found == kind:
                if size > max_bytes:
                    raise ValueError(f"box {found!r} has {size:,} bytes")
                file.seek(at + length)
                return file.read(size - length)
            at += size
    return None


class ByteReader:
    """Reads numbers, most significant byte first, one after the other; ValueError beyond the end."""

    def __init__(self, data: bytes, start: int = 0, end: int | None = None) -> None:
        self._data, self.at, self._end = data, start, len(data) if end is None else end

    @property
    def left(self) -> int:
        return self._end - self.at

    def number(self, count: int) -> int:
        """Of so many bytes; 0 of none."""
        return int.from_bytes(self.take(count), "big")

    def take(self, count: int) -> bytes:
        """The next bytes."""
        if not 0 <= count <= self.left:
            raise ValueError(f"{count:,} bytes are stated at byte {self.at:,}, there are {self.left:,}")
        self.at += count
        return bytes(self._data[self.at - count : self.at])

    def text(self) -> bytes:
        """The bytes before the next zero."""
        end = self._data.find(b"\0", self.at, self._end)
        if end < 0:
            raise ValueError(f"a text at byte {self.at:,} has no end")
        text = bytes(self._data[self.at : end])
        self.at = end + 1
        return text
