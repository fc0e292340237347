"""Arrays in .npz files that appear whole, and that may be damaged afterwards.

A file has a seal, the comment of its archive: a digest of the names, sizes and checksums of its arrays. So one that
somebody else put in its place is found too, with arrays of whatever shape.
"""

import io
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import replace_file
from usdfoliage.files.hashing import digest_text
from usdfoliage.files.reading import open_regular
from usdfoliage.files.unwritten import describe_unwritten

_ALTERED = "it is not what was written"
# What reading a damaged file raises.
DAMAGED = (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError)


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], *, compressed: bool = False) -> None:
    """Put arrays into a file that appears whole; the same bytes for the same arrays.

    Raises:
        OSError: It cannot be written.
    """
    packed = io.BytesIO()
    named: dict[str, Any] = dict(arrays)
    (np.savez_compressed if compressed else np.savez)(packed, **named)
    with zipfile.ZipFile(packed, "a") as archive:
        archive.comment = _seal(archive)
    with replace_file(path) as new:
        new.write_bytes(packed.getbuffer())


def write_model(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Put the arrays of a model into a file that one stage hands on to others, as write_arrays.

    Raises:
        WriteError: It cannot be written.
    """
    try:
        write_arrays(path, arrays)
    except OSError as error:
        raise describe_unwritten(path, error) from error


@contextmanager
def reading_model(path: Path, what: str) -> Iterator[None]:
    """The block that makes a model of the arrays of such a file.

    Args:
        path: The file.
        what: The model, in the plural or with its article, as in "holds no leaves".

    Raises:
        CaptureError: What the block reads is missing, damaged, or no such model.
    """
    try:
        yield
    except (*DAMAGED, TypeError) as error:
        raise CaptureError(f"{path} holds no {what} ({error})", "run the same command again") from error


def read_arrays(path: Path, names: Iterable[str] | None = None, *, sealed: bool = False) -> dict[str, NDArray[Any]]:
    """The arrays of a file, or those of these names.

    Args:
        path: The file.
        names: Which.
        sealed: Whether the seal of write_arrays must be right.

    Raises:
        One of DAMAGED: It is missing or damaged, or has no array of a name.
    """
    with open_regular(path) as file, np.load(file, allow_pickle=False) as arrays:  # numpy leaves a damaged one open
        if sealed and arrays.zip.comment != _seal(arrays.zip):
            raise ValueError(_ALTERED)
        return {name: arrays[name] for name in (arrays.files if names is None else names)}


def find_damage(path: Path) -> str | None:
    """What is wrong with a file; None for one that is whole.

    Raises:
        FileNotFoundError: It is not there.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
            if damaged is None and archive.comment != _seal(archive):
                return _ALTERED
    except FileNotFoundError:
        raise
    except DAMAGED as error:
        return str(error) or type(error).__name__
    return None if damaged is None else f"{damaged} is not what was written"


def _seal(archive: zipfile.ZipFile) -> bytes:
    members = [(member.filename, member.file_size, member.CRC) for member in archive.infolist()]
    return digest_text(repr(sorted(members))).encode()
