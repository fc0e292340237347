"""Arrays in .npz files that appear whole, and that may be damaged afterwards."""

import io
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError, WriteError
from usdfoliage.files.atomic import replace_file
from usdfoliage.files.reading import open_regular

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
        raise WriteError(f"{path} was not written: {error.strerror or error}", "make room there") from error


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


def read_arrays(path: Path, names: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of a file, or those of these names.

    Raises:
        One of DAMAGED: It is missing or damaged, or has no array of a name.
    """
    with open_regular(path) as file, np.load(file, allow_pickle=False) as arrays:  # numpy leaves a damaged one open
        return {name: arrays[name] for name in (arrays.files if names is None else names)}


def find_damage(path: Path) -> str | None:
    """What is wrong with a file; None for one that is whole.

    Raises:
        FileNotFoundError: It is not there.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
    except FileNotFoundError:
        raise
    except DAMAGED as error:
        return str(error) or type(error).__name__
    return None if damaged is None else f"{damaged} is not what was written"
