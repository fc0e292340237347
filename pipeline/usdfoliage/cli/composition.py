"""The layers that an asset is composed of, and how large they are, before USD opens one of them.

The limits of a box (usdfoliage.cli.box) follow from these sizes, so that neither a scene of large assets elsewhere is
refused, nor a small file gets what a large one needs. Nothing here trusts a file: all that is read is bounded, a file
that is no layer counts nothing, and what is not found leaves the limits lower.
"""

import contextlib
import itertools
import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from usdfoliage.files.reading import open_regular

USD_SUFFIXES = (".usda", ".usdc", ".usd", ".usdz")
MAX_ENTRIES = 20_000  # of folders, and layers, that are looked at
MAX_TEXT_BYTES = 64 << 20  # of all text layers together that are looked through for names of others
MAX_TOKEN_BYTES = 1 << 20  # of the names in one crate
MAX_TAIL_BYTES = 22 + (1 << 16)  # in which a package has the record of its directory
MAX_DIRECTORY_BYTES = 16 << 20  # of all packages in a file
_TEXT, _CRATE, _PACKAGE = b"#usda", b"PXR-USDC", b"PK\x03\x04"
_PACKAGE_ENTRY, _PACKAGE_END = b"PK\x01\x02", b"PK\x05\x06"
_Identity = tuple[int, int]  # device and inode
_NAMED = re.compile(rb"@{1,3}([^@\n]{1,4096})@")


@dataclass(frozen=True, kw_only=True)
class Composition:
    """What an asset is read from.

    Attributes:
        size_bytes: Of all files, as they lie on the disk: those of the asset's folder, and layers elsewhere.
        text_bytes: The size of the largest text layer, in a package too.
        text: That layer, or its package; None without one.
    """

    size_bytes: int
    text_bytes: int = 0
    text: Path | None = None


def measure_composition(asset: Path) -> Composition:
    """The sizes of an asset, a look or a scene: its folder or file, what lies around it, and all layers that it names.

    Args:
        asset: The folder, or a file. The folder of an asset, one layer at its top, counts whole, here and elsewhere.
    """
    sizes: dict[_Identity, int] = {}
    folders: set[Path] = set()
    waiting = _layers(asset) if asset.is_dir() else [asset]
    if asset.is_dir():
        _count_folder(asset, sizes)
    seen: set[_Identity] = set()
    text_left, largest_bytes, largest = MAX_TEXT_BYTES, 0, None
    while waiting and len(seen) < MAX_ENTRIES:
        path = waiting.pop()
        try:
            with open_regular(path) as file:
                found = os.fstat(file.fileno())
                start = file.read(8)
                if (identity := (found.st_dev, found.st_ino)) in seen:
                    continue
                if not start.startswith((_TEXT, _CRATE, _PACKAGE)):
                    continue
                seen.add(identity)
                sizes[identity] = found.st_blocks * 512
                if start == _CRATE:
                    file.seek(0)
                    names = list(_crate_names(file.read(88), file.fileno()))
                elif start.startswith(_TEXT):
                    text = file.read(text_left)
                    text_left -= len(text)
                    names = [match[1] for match in _NAMED.finditer(text)]
                    if found.st_size > largest_bytes:
                        largest_bytes, largest = found.st_size, path
                else:
                    names = []
                    inside_bytes = max(_packed_texts(file.fileno(), found.st_size), default=0)
                    if inside_bytes > largest_bytes:
                        largest_bytes, largest = inside_bytes, path
        except (OSError, ValueError, struct.error):  # who reads it reports that
            continue
        if path.parent not in folders and len(_layers(path.parent)) == 1:  # of an asset, whose pictures are read too
            _count_folder(path.parent, sizes)
        folders.add(path.parent)
        for name in dict.fromkeys(names):
            text_name = os.fsdecode(name.split(b":SDF_FORMAT_ARGS:")[0].strip(b"@"))
            if os.path.splitext(text_name)[1].lower() in USD_SUFFIXES:  # noqa: PTH122
                waiting.append(path.parent / text_name)
        del waiting[MAX_ENTRIES:]
    return Composition(size_bytes=sum(sizes.values()), text_bytes=largest_bytes, text=largest)


def _count_folder(folder: Path, sizes: dict[_Identity, int]) -> None:
    """Add the files of a folder."""
    for place, _, names in os.walk(folder):
        for name in names:
            if len(sizes) >= MAX_ENTRIES:
                return
            with contextlib.suppress(OSError):
                found = os.lstat(os.path.join(place, name))  # noqa: PTH118  # a Path takes ten times as long
                sizes[found.st_dev, found.st_ino] = found.st_blocks * 512


def _layers(folder: Path) -> list[Path]:
    """The layers at the top of a folder: one in that of an asset."""
    try:
        with os.scandir(folder) as entries:
            names = [entry.name for entry in itertools.islice(entries, MAX_ENTRIES)]
    except OSError:
        return []
    return [folder / name for name in names if os.path.splitext(name)[1].lower() in USD_SUFFIXES]  # noqa: PTH122


def _crate_names(header: bytes, descriptor: int) -> Iterator[bytes]:
    """The tokens of a crate, among which are the names of all layers that it names.

    Source:
        OpenUSD, pxr/usd/sdf/crateFile.cpp: _BootStrap, _TableOfContents, _Section, _ReadTokens.
    """
    (table,) = struct.unpack_from("<q", header, 16)
    (count,) = struct.unpack("<Q", os.pread(descriptor, 8, table))
    entries = os.pread(descriptor, 32 * min(count, 64), table + 8)
    for name, start, size in struct.iter_unpack("<16sqq", entries):
        if name.rstrip(b"\0") == b"TOKENS" and header[8:10] >= b"\x00\x04":
            data = os.pread(descriptor, min(size, MAX_TOKEN_BYTES), start)
            _, plain, packed = struct.unpack_from("<QQQ", data)
            yield from _unpack(data[24 : 24 + packed], min(plain, 8 * MAX_TOKEN_BYTES)).split(b"\0")


def _packed_texts(descriptor: int, size: int) -> Iterator[int]:
    """The sizes of the text layers in a package, and in packages in it; descriptor is of its open file.

    Source:
        PKWARE, APPNOTE.TXT, 4.3.12 and 4.3.16: headers of the directory, and the record at its end; USDZ specification:
        members are stored as they are.
    """
    waiting, looked_at, left = [(0, size)], 0, MAX_DIRECTORY_BYTES
    while waiting and looked_at < MAX_ENTRIES:
        start, end = waiting.pop()
        tail_at = max(start, end - MAX_TAIL_BYTES)
        tail = os.pread(descriptor, end - tail_at, tail_at)
        found = tail.rfind(_PACKAGE_END)
        if found < 0 or len(tail) < found + 22:
            continue
        directory_size, offset = struct.unpack_from("<II", tail, found + 12)
        directory = os.pread(descriptor, min(directory_size, left), start + offset)
        left -= len(directory)
        at = 0
        while directory[at : at + 4] == _PACKAGE_ENTRY and len(directory) >= at + 46 and looked_at < MAX_ENTRIES:
            (member_size,) = struct.unpack_from("<I", directory, at + 24)
            (member_at,) = struct.unpack_from("<I", directory, at + 42)
            at, looked_at = at + 46 + sum(struct.unpack_from("<HHH", directory, at + 28)), looked_at + 1
            header = os.pread(descriptor, 30, start + member_at)
            if len(header) < 30:
                continue
            begin = start + member_at + 30 + sum(struct.unpack_from("<HH", header, 26))
            first = os.pread(descriptor, 8, begin)
            if first.startswith(_TEXT):
                yield member_size
            elif first.startswith(_PACKAGE):
                waiting.append((begin, min(end, begin + member_size)))


def _unpack(data: bytes, bytes_allowed: int) -> bytes:
    """The text that USD packed; its start, where it is damaged or longer.

    Source:
        OpenUSD, pxr/base/tf/fastCompression.cpp: a number of chunks, 0 for a single one, then LZ4 blocks. The format of
        those: lz4_Block_format.md of LZ4.
    """
    if not data or data[0]:  # more chunks are of more than 2 GB
        return b""
    out, at, end = bytearray(), 1, len(data)
    while at < end and len(out) < bytes_allowed:
        token = data[at]
        at += 1
        length = token >> 4
        if length == 15:
            at, length = _longer(data, at, length)
        out += data[at : at + length]
        at += length
        if at + 2 > end:
            break
        offset = data[at] | data[at + 1] << 8
        at += 2
        length = token & 15
        if length == 15:
            at, length = _longer(data, at, length)
        length = min(length + 4, bytes_allowed)
        if not 0 < offset <= len(out):
            break
        first = len(out) - offset
        piece = out[first : first + length]
        out += piece if len(piece) == length else (piece * (length // offset + 1))[:length]
    return bytes(out)


def _longer(data: bytes, at: int, length: int) -> tuple[int, int]:
    while at < len(data):
        length += data[at]
        at += 1
        if data[at - 1] != 255:
            break
    return at, length
