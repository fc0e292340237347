"""Headers with false values and right checksums: sizes of bombs, counts below nothing, no numbers."""

import re
import struct
import zlib
from collections.abc import Callable, Mapping

import numpy as np

from tools.fuzz.mutations import Mutate

_SIDES = (0, 1, 15, 17, 4000, 15_000, 20_000, 60_000, 65_535, 2**31 - 1, 2**32 - 1)
_COUNTS = (0, 1, 2**31, 2**32 - 1, 10**12, 2**63 - 1, 2**64 - 1)


def _choose(values: tuple[int, ...], rng: np.random.Generator) -> int:
    return values[int(rng.integers(len(values)))]


def lie_png(data: bytes, rng: np.random.Generator) -> bytes:
    """Other width, height, depth, kind of colour or interlacing; the checksum is that of the lie."""
    chunk = bytearray(data[12:29])
    field = int(rng.integers(4))
    if field < 2:
        struct.pack_into(">I", chunk, 4, _choose(_SIDES, rng))
        struct.pack_into(">I", chunk, 8, _choose(_SIDES, rng))
    else:
        chunk[12 + int(rng.integers(5))] = int(rng.integers(20))
    return data[:12] + bytes(chunk) + struct.pack(">I", zlib.crc32(chunk)) + data[33:]


def lie_jpeg(data: bytes, rng: np.random.Generator) -> bytes:
    """Another height, width, precision or number of channels in the frame's header."""
    at = max(data.find(b"\xff\xc0"), data.find(b"\xff\xc2"))
    changed = bytearray(data)
    if rng.random() < 0.7:
        struct.pack_into(">HH", changed, at + 5, min(_choose(_SIDES, rng), 65535), min(_choose(_SIDES, rng), 65535))
    else:
        changed[at + int(rng.choice((4, 9, 10, 11, 12)))] = int(rng.integers(256))
    return bytes(changed)


def lie_tiff(data: bytes, rng: np.random.Generator) -> bytes:
    """Another value, type or count in one of the first directory's entries."""
    changed = bytearray(data)
    order = "<" if data[:2] == b"II" else ">"
    (start,) = struct.unpack_from(order + "I", data, 4)
    (entries,) = struct.unpack_from(order + "H", data, start)
    at = start + 2 + 12 * int(rng.integers(entries))
    value = _choose((*_SIDES, 10**9), rng)
    kind = int(rng.integers(4))
    if kind == 0:
        struct.pack_into(order + "H", changed, at + 2, int(rng.integers(20)))
    elif kind == 1:
        struct.pack_into(order + "I", changed, at + 4, value)
    else:
        struct.pack_into(order + "HII", changed, at + 2, 4, 1, value)
    return bytes(changed)


def lie_exr(data: bytes, rng: np.random.Generator) -> bytes:
    """Another data or display window, compression, order of lines, or numbers that are none."""
    changed = bytearray(data)
    windows = [match.end() + 4 for match in re.finditer(rb"(?:dataWindow|displayWindow)\0box2i\0", data)]
    if rng.random() < 0.7 and windows:
        at = windows[int(rng.integers(len(windows)))]
        sides = [_choose((0, -1, 63, 10**9, 2**31 - 1, -(2**31), 60_000, 16_000), rng) for _ in range(4)]
        kept = rng.random(4) < 0.5
        for place in range(4):
            if not kept[place]:
                struct.pack_into("<i", changed, at + 4 * place, sides[place])
    else:
        names = (rb"compression\0compression\0", rb"lineOrder\0lineOrder\0", rb"pixelAspectRatio\0float\0")
        found = [match.end() + 4 for name in names for match in re.finditer(name, data)]
        if found:
            changed[found[int(rng.integers(len(found)))]] = int(rng.integers(256))
    return bytes(changed)


def lie_ply(data: bytes, rng: np.random.Generator) -> bytes:
    """Another number of vertices, type, name or format."""
    changes: tuple[tuple[bytes, bytes], ...] = (
        *((rb"element vertex \d+", b"element vertex %d" % count) for count in (*_COUNTS, 10**18, 10**17)),
        (rb"element vertex \d+", b"element vertex -5"),
        (rb"element vertex \d+", b"element face 1000000000000\nproperty list uchar int v\nelement vertex 100"),
        (rb"element vertex", b"element vertex 10\nelement vertex"),
        (rb"property \w+ x", b"property list uchar double x"),
        (rb"property \w+ x", b"property list uint uchar w\nproperty double x"),
        (rb"property \w+ y", b"property half y"),
        (rb"property \w+ z", b"property char z"),
        (rb"property \w+ z", b"property float x"),
        (rb"format \w+ ", b"format binary_big_endian "),
        (rb"format \w+ ", b"format ascii "),
        (rb"end_header", b"comment " + b"x" * 100_000 + b"\nend_header"),
        (rb"end_header", b"".join(b"property float a%d\n" % number for number in range(2000)) + b"end_header"),
    )
    pattern, new = changes[int(rng.integers(len(changes)))]
    return re.sub(pattern, lambda _: new, data, count=1)


def lie_las(data: bytes, rng: np.random.Generator) -> bytes:
    """Another count of points or records, size or place of points, scale, offset or bounds."""
    changed = bytearray(data)
    field = int(rng.integers(8))
    if field < 3:
        count = _choose(_COUNTS, rng)
        struct.pack_into("<Q", changed, 247, count)
        struct.pack_into("<I", changed, 107, count % 2**32)
    elif field == 3:
        struct.pack_into("<I", changed, int(rng.choice((94, 96, 100, 243))), _choose((*_SIDES, 227, 375), rng))
    elif field == 4:
        changed[104 + int(rng.integers(3))] = int(rng.integers(256))
    elif field == 5:
        struct.pack_into("<Q", changed, int(rng.choice((227, 235))), _choose(_COUNTS, rng))
    else:
        value = float(rng.choice((np.nan, np.inf, 0.0, 1e300, -1e-300, 1e15)))
        struct.pack_into("<d", changed, 131 + 8 * int(rng.integers(12)), value)
    return bytes(changed)


def lie_laz(data: bytes, rng: np.random.Generator) -> bytes:
    """As lie_las, or another size of chunks, packing, or place of the table of chunks."""
    if rng.random() < 0.5:
        return lie_las(data, rng)
    changed = bytearray(data)
    packing = data.find(b"laszip encoded") - 2 + 54
    (start,) = struct.unpack_from("<I", data, 96)
    (table,) = struct.unpack_from("<q", data, start)
    value = _choose((0, 1, 2**31 - 1, 2**32 - 1, 50_000, 3), rng)
    kind = int(rng.integers(4))
    if kind == 0:
        struct.pack_into("<I", changed, packing + 12, value)
    elif kind == 1:
        changed[packing + int(rng.integers(46))] = int(rng.integers(256))
    elif kind == 2:
        struct.pack_into("<I", changed, table + 4, value)
    else:
        struct.pack_into("<q", changed, start, int(rng.choice((-1, 0, len(data), len(data) - 4, 2**62, start))))
    return bytes(changed)


def lie_colmap(data: bytes, rng: np.random.Generator) -> bytes:
    """Another count of rows, or a number in the first row that is none."""
    changed = bytearray(data)
    if rng.random() < 0.3:
        struct.pack_into("<Q", changed, 0, _choose(_COUNTS, rng))
    elif rng.random() < 0.5:
        struct.pack_into("<I", changed, min(len(changed) - 4, 8 + 4 * int(rng.integers(8))), _choose(_SIDES, rng))
    else:
        value = float(rng.choice((np.nan, np.inf, 0.0, 1e300, -1.0)))
        struct.pack_into("<d", changed, min(len(changed) - 8, int(rng.choice((12, 20, 28, 32, 40, 48, 56)))), value)
    return bytes(changed)


def zero_rotation(data: bytes, _: np.random.Generator) -> bytes:
    """Quaternions and places of a text model that are 0."""
    return re.sub(rb"(?m)^(\d+)(?: [-\d.e]+){7} (\d+) (\S)", rb"\1 0 0 0 0 0 0 0 \2 \3", data)


def lie_usd(data: bytes, rng: np.random.Generator) -> bytes:
    """Text layers: references to itself and elsewhere, deep nesting, numbers that are none, other types."""
    changes: tuple[tuple[bytes, bytes], ...] = (
        (rb"@[^@\n]*@", b"@./spray.usda@"),
        (rb"@[^@\n]*@", b"@/dev/zero@"),
        (rb"@[^@\n]*@", b"@../../../../../../etc/passwd@"),
        (rb"@[^@\n]*@", b"@" + b"a/" * 3000 + b"b.usda@"),
        (rb"@[^@\n]*@", b"@anon:0x1234:x.usda@"),
        (rb"@[^@\n]*@", "@\u202e\U0001f333.usda@".encode()),
        (rb"@[^@\n]*@", b"@@"),
        (rb"def ", b"over "),
        (rb"(?:def|over) \w* ?\"", b'def Scope "deep" {' * 3000 + b"}" * 3000 + b'\ndef Scope "'),
        (rb"float ", b"string "),
        (rb"float3\[\]|float3", b"float3[]"),
        (rb"float3\[\]|float3", b"double"),
        (rb"metersPerUnit = \d+", b"metersPerUnit = 0"),
        (rb"metersPerUnit = \d+", b"metersPerUnit = nan"),
        (rb"metersPerUnit = \d+", b'metersPerUnit = "one"'),
        (rb'upAxis = "Y"', b'upAxis = "W"'),
        (rb'defaultPrim = "\w+"', b'defaultPrim = "nobody"'),
        (rb'defaultPrim = "\w+"', b'defaultPrim = "/../x"'),
        (rb"</[^>]*>", b"</>"),
        (rb"</[^>]*>", b"</nowhere>"),
        (rb"(?<=[(= ])-?\d+\.?\d*", b"nan"),
        (rb"(?<=[(= ])-?\d+\.?\d*", b"inf"),
        (rb"(?<=[(= ])-?\d+\.?\d*", b"-1e39"),
        (rb"int ", b"int64 "),
        (rb"#usda 1.0", b"#usda 9.9"),
        (rb"#usda 1.0", b"#sdf 1.4.32"),
    )
    for _ in range(20):
        pattern, new = changes[int(rng.integers(len(changes)))]
        found = list(re.finditer(pattern, data))
        if found:
            one = found[int(rng.integers(len(found)))]
            return data[: one.start()] + new + data[one.end() :]
    return data


LIES: Mapping[str, tuple[Mutate, ...]] = {
    **{".png": (lie_png,), ".jpg": (lie_jpeg,), ".tif": (lie_tiff,), ".exr": (lie_exr,)},
    **{".ply": (lie_ply,), ".las": (lie_las,), ".laz": (lie_laz,), ".bin": (lie_colmap,)},
    **{".usda": (lie_usd, lie_usd, lie_usd)},
}

Lie = Callable[[bytes, np.random.Generator], bytes]
