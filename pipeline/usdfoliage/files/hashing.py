"""SHA-256 of files and of values: the one place where anything is hashed."""

import dataclasses
import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import open_regular

_NOT_HASHED = "threads"  # changes no result


def hash_bytes(*parts: bytes) -> bytes:
    """The 32 bytes of the hash of these bytes, one part after the other."""
    return hash_each(parts)


def hash_each(parts: Iterable[bytes]) -> bytes:
    """The same of parts that need not be in memory together."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.digest()


def hash_file(path: Path) -> bytes:
    """The 32 bytes of the hash of a file's bytes.

    Raises:
        OSError: It cannot be read.
    """
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").digest()


def hash_files(files: Iterable[tuple[str, Path]]) -> bytes:
    """The hash of files' bytes and of the names given with them, in this order.

    Raises:
        OSError: One cannot be read.
    """
    return hash_each(part for name, path in files for part in (name.encode(), hash_file(path)))


def digest_file(path: Path) -> str:
    """The hash of a file's bytes, in 64 hexadecimal digits.

    Raises:
        CaptureError: It cannot be read.
    """
    try:
        return hash_file(path).hex()
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error


def digest_files(files: Iterable[Path | None]) -> str:
    """The hash of files' bytes in this order, in 64 hexadecimal digits; None counts for nothing.

    Raises:
        OSError: One cannot be read.
    """
    return hash_each(hash_file(path) for path in files if path is not None).hex()


def digest_text(text: str) -> str:
    """The hash of a text in UTF-8, in 64 hexadecimal digits."""
    return hash_bytes(text.encode()).hex()


def digest_values(*parts: object) -> str:
    """The hash of values, in 64 hexadecimal digits.

    Args:
        parts: Numbers, texts, arrays, None, sequences of them, and dataclasses of them, whose threads do not count.

    Raises:
        TypeError: A part is of another kind.
    """
    return hash_each(piece for part in parts for piece in _pieces(part)).hex()


def _pieces(part: object) -> Iterator[bytes]:
    """Kinds and lengths count too: else a text could run over into the next one."""
    import numpy as np  # here: the process that waits for a command in a box needs none of it

    if part is None or isinstance(part, bool | int | float | str):
        yield f"{type(part).__name__} {part!r}\n".encode()
    elif isinstance(part, np.ndarray):
        yield f"array {part.dtype.str} {part.shape}\n".encode()
        yield np.ascontiguousarray(part).tobytes()
    elif isinstance(part, tuple | list):
        yield f"sequence {len(part)}\n".encode()
        for each in part:
            yield from _pieces(each)
    elif dataclasses.is_dataclass(part):
        yield f"{type(part).__name__}\n".encode()
        for field in dataclasses.fields(part):
            if field.name != _NOT_HASHED:
                yield f"{field.name}\n".encode()
                yield from _pieces(getattr(part, field.name))
    else:
        raise TypeError(f"a {type(part).__name__} has no hash that lasts")
