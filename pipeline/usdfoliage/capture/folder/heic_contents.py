"""The tables of a HEIC file: which pictures are in it, what they are made of, and where their bytes are.

Source: ISO/IEC 23008-12:2022, High Efficiency Image File Format, 6 and 9; ISO/IEC 14496-12:2022, 8.11.
"""

import struct
from dataclasses import dataclass, field
from pathlib import Path

from usdfoliage.capture.folder.boxes import Box, ByteReader, find_box, list_boxes
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import read_regular

_MAX_FILE_BYTES = 1 << 30


@dataclass(frozen=True, kw_only=True)
class HeicItem:
    """A picture, or a piece of one, or a block of data."""

    kind: bytes
    properties: tuple[tuple[bytes, bytes], ...] = ()  # kind and content, in the order in which they are applied

    def of(self, kind: bytes) -> bytes | None:
        return next((content for name, content in self.properties if name == kind), None)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of its stored pixels; ValueError where none is stated."""
        content = self.of(b"ispe")
        if content is None or len(content) < 12:
            raise ValueError("a picture has no size")
        width, height = struct.unpack_from(">II", content, 4)
        return width, height


@dataclass(frozen=True, kw_only=True)
class _Extent:
    start: int
    length: int


@dataclass(kw_only=True)
class HeicContents:
    """The tables of a file."""

    data: bytes
    primary: int = 0
    items: dict[int, HeicItem] = field(default_factory=dict)
    places: dict[int, tuple[_Extent, ...]] = field(default_factory=dict)  # of each item's bytes, in the file
    made_of: dict[int, tuple[int, ...]] = field(default_factory=dict)  # items that an item is put together of
    described_by: dict[int, list[int]] = field(default_factory=dict)  # items with data on an item

    def bytes_of(self, number: int) -> bytes:
        return b"".join(self.data[place.start : place.start + place.length] for place in self.places.get(number, ()))


def read_contents(path: Path) -> HeicContents:
    """The tables of a file, and its bytes.

    Raises:
        CaptureError: The file cannot be read, or is too large.
        ValueError: It is truncated or damaged.
    """
    try:
        size = path.stat().st_size
        if size > _MAX_FILE_BYTES:
            raise CaptureError(f"{path} has {size / 1e6:,.0f} MB, no picture has as many", "give the original")
        data = read_regular(path)
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error
    meta = find_box(data, (b"meta",))
    if meta is None:
        raise ValueError("it has no table of its pictures")
    inside = {box.kind: box for box in reversed(list_boxes(data, meta.start + 4, meta.end))}
    contents = HeicContents(data=data)
    if b"pitm" not in inside:
        raise ValueError("it names no primary picture")
    primary = ByteReader(data, inside[b"pitm"].start, inside[b"pitm"].end)
    contents.primary = primary.number(2 if primary.number(4) >> 24 == 0 else 4)
    kinds = _read_kinds(data, inside[b"iinf"]) if b"iinf" in inside else {}
    properties = _read_properties(data, inside[b"iprp"]) if b"iprp" in inside else {}
    contents.items = {
        number: HeicItem(kind=kind, properties=properties.get(number, ())) for number, kind in kinds.items()
    }
    if b"iloc" in inside:
        contents.places = _read_places(data, inside[b"iloc"], inside.get(b"idat"))
    if b"iref" in inside:
        _read_references(contents, inside[b"iref"])
    if contents.primary not in contents.items:
        raise ValueError(f"its primary picture {contents.primary} is missing")
    return contents


def _read_kinds(data: bytes, box: Box) -> dict[int, bytes]:
    """Kinds of items, by their numbers."""
    reader = ByteReader(data, box.start, box.end)
    reader.take(2 if reader.number(4) >> 24 == 0 else 4)
    kinds = {}
    for entry in list_boxes(data, reader.at, box.end):
        one = ByteReader(data, entry.start, entry.end)
        version = one.number(4) >> 24
        if entry.kind == b"infe" and version >= 2:
            number = one.number(2 if version == 2 else 4)
            one.take(2)
            kinds[number] = one.take(4)
    return kinds


def _read_properties(data: bytes, box: Box) -> dict[int, tuple[tuple[bytes, bytes], ...]]:
    """Kind and content of the properties of each item."""
    container = find_box(data, (b"ipco",), box.start, box.end)
    if container is None:
        raise ValueError("its pictures have no properties")
    listed = [(one.kind, data[one.start : one.end]) for one in list_boxes(data, container.start, container.end)]
    found: dict[int, tuple[tuple[bytes, bytes], ...]] = {}
    for table in list_boxes(data, box.start, box.end):
        if table.kind != b"ipma":
            continue
        reader = ByteReader(data, table.start, table.end)
        head = reader.number(4)
        is_long = head & 1  # of places in the list
        for _ in range(reader.number(4)):
            number = reader.number(2 if head >> 24 == 0 else 4)
            places = [
                reader.number(2) & 0x7FFF if is_long else reader.number(1) & 0x7F for _ in range(reader.number(1))
            ]
            found[number] = tuple(listed[place - 1] for place in places if 0 < place <= len(listed))
    return found


def _read_places(data: bytes, box: Box, stored: Box | None) -> dict[int, tuple[_Extent, ...]]:
    """Where the bytes of each item are."""
    reader = ByteReader(data, box.start, box.end)
    version = reader.number(4) >> 24
    sizes = reader.number(2)
    offset_size, length_size, base_size, index_size = ((sizes >> shift) & 15 for shift in (12, 8, 4, 0))
    places = {}
    for _ in range(reader.number(2 if version < 2 else 4)):
        number = reader.number(2 if version < 2 else 4)
        method = reader.number(2) & 15 if version else 0
        reader.take(2)
        base = reader.number(base_size)
        extents = []
        for _ in range(reader.number(2)):
            reader.take(index_size if version else 0)
            start, length = base + reader.number(offset_size), reader.number(length_size)
            end = len(data)
            if method == 1:
                if stored is None:
                    raise ValueError("it refers to data that are not there")
                start, end = start + stored.start, stored.end
            elif method != 0:
                continue  # put together of other items: never a picture of a phone
            if start + length > end:
                raise ValueError(f"data are to be at bytes {start:,} to {start + length:,} of {end:,}")
            extents.append(_Extent(start=start, length=length or end - start))
        places[number] = tuple(extents)
    return places


def _read_references(contents: HeicContents, box: Box) -> None:
    reader = ByteReader(contents.data, box.start, box.end)
    size = 2 if reader.number(4) >> 24 == 0 else 4
    for reference in list_boxes(contents.data, reader.at, box.end):
        one = ByteReader(contents.data, reference.start, reference.end)
        source = one.number(size)
        targets = tuple(one.number(size) for _ in range(one.number(2)))
        if reference.kind == b"dimg":
            contents.made_of[source] = targets
        elif reference.kind == b"cdsc":
            for target in targets:
                contents.described_by.setdefault(target, []).append(source)
