"""HEIC files around coded pictures of tests/data/heic: tiles, turns, crops, colours, EXIF, as phones write them."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

SAMPLES = Path(__file__).parents[1] / "data" / "heic"
WIDTH, HEIGHT = 96, 64


@dataclass(frozen=True)
class Coded:
    """A picture that HEVC has coded."""

    parameters: bytes  # content of hvcC
    data: bytes


def sample(bits: int = 8) -> Coded:
    """The picture of tests/data/heic."""
    stored = (SAMPLES / f"tile{bits}.heic").read_bytes()
    contents = []
    for kind in (b"hvcC", b"mdat"):
        at = stored.index(kind)
        contents.append(stored[at + 4 : at - 4 + int.from_bytes(stored[at - 4 : at], "big")])
    return Coded(*contents)


def expected(columns: int = 1, rows: int = 1) -> np.ndarray:
    """(H, W, 3) uint8, what the sample shows, side by side."""
    down, across = np.mgrid[0:HEIGHT, 0:WIDTH]
    picture = np.dstack([0.1 + 0.8 * across / WIDTH, 0.1 + 0.8 * down / HEIGHT, np.full((HEIGHT, WIDTH), 0.4)])
    return np.tile(np.rint(255 * picture).astype(np.uint8), (rows, columns, 1))


def box(kind: str, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind.encode()) + content


def full_box(kind: str, content: bytes, version: int = 0, flags: int = 0) -> bytes:
    return box(kind, struct.pack(">I", version << 24 | flags) + content)


def nclx(primaries: int, transfer: int) -> bytes:
    return box("colr", b"nclx" + struct.pack(">HHHB", primaries, transfer, 6, 128))


def exif_block(entries: dict[int, tuple[int, int]], exif: dict[int, tuple[int, int]]) -> bytes:
    """EXIF of big-endian shorts (3) and longs (4): kind and value by tag."""

    def folder(values: dict[int, tuple[int, int]], after: bytes = b"") -> bytes:
        packed = [
            struct.pack(">HHI", tag, kind, 1) + (struct.pack(">HH", v, 0) if kind == 3 else struct.pack(">I", v))
            for tag, (kind, v) in sorted(values.items())
        ]
        return struct.pack(">H", len(values)) + b"".join(packed) + bytes(4) + after

    first = folder({**entries, 0x8769: (4, 0)})
    pointing = folder({**entries, 0x8769: (4, 8 + len(first))})
    return b"MM" + struct.pack(">HI", 42, 8) + pointing + folder(exif)


def write_heic(
    path: Path,
    *,
    bits: int = 8,
    grid: tuple[int, int, int, int] | None = None,
    properties: Sequence[bytes] = (),
    exif: bytes = b"",
    brand: str = "heic",
) -> Path:
    """Write a file whose primary picture is the sample, or so many of it.

    Args:
        path: Where.
        bits: Of the sample.
        grid: Columns, rows, width and height of a picture of tiles.
        properties: Boxes that the primary picture has besides, in this order.
        exif: A block of EXIF, from its byte order on.
        brand: Of the file.
    """
    coded = sample(bits)
    columns, rows, width, height = grid or (1, 1, WIDTH, HEIGHT)
    tiles = list(range(1, columns * rows + 1))
    primary = len(tiles) + 1 if grid else 1
    kinds = dict.fromkeys(tiles, "hvc1") | ({primary: "grid"} if grid else {})
    contents = dict.fromkeys(tiles, coded.data)
    if grid:
        contents[primary] = struct.pack(">BBBBHH", 0, 0, rows - 1, columns - 1, width, height)
    references = b""
    if grid:
        references += box("dimg", struct.pack(f">HH{len(tiles)}H", primary, len(tiles), *tiles))
    if exif:
        number = primary + 1
        kinds[number] = "Exif"
        contents[number] = struct.pack(">I", 6) + b"Exif\0\0" + exif
        references += box("cdsc", struct.pack(">HHH", number, 1, primary))

    def size_box(wide: int, high: int) -> bytes:
        return full_box("ispe", struct.pack(">II", wide, high))

    listed = [box("hvcC", coded.parameters), size_box(WIDTH, HEIGHT), size_box(width, height), *properties]
    of_primary = [*range(4, 4 + len(properties))]
    used = {tile: [1, 2] for tile in tiles}
    used[primary] = [*used.get(primary, [3]), *of_primary]
    associated = b"".join(struct.pack(f">HB{len(each)}B", n, len(each), *each) for n, each in sorted(used.items()))
    entries = b"".join(
        full_box("infe", struct.pack(">HH4sB", number, 0, kind.encode(), 0), version=2)
        for number, kind in kinds.items()
    )

    def meta(start: int) -> bytes:
        places, at = b"", start
        for number, content in contents.items():
            places += struct.pack(">HHHII", number, 0, 1, at, len(content))
            at += len(content)
        inside = full_box("hdlr", struct.pack(">I4s12xB", 0, b"pict", 0))
        inside += full_box("pitm", struct.pack(">H", primary))
        inside += full_box("iinf", struct.pack(">H", len(kinds)) + entries)
        if references:
            inside += full_box("iref", references)
        inside += box(
            "iprp", box("ipco", b"".join(listed)) + full_box("ipma", struct.pack(">I", len(used)) + associated)
        )
        inside += full_box("iloc", struct.pack(">HH", 0x4400, len(contents)) + places)
        return full_box("meta", inside)

    head = box("ftyp", brand.encode() + bytes(4) + b"mif1heic")
    start = len(head) + len(meta(0)) + 8
    path.write_bytes(head + meta(start) + box("mdat", b"".join(contents.values())))
    return path
