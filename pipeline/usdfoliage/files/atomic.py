"""Files that appear whole, or not at all."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from usdfoliage.errors import WriteError

_NEW = "usdfoliage-new"
_MAX_STEM = 40  # characters: the whole name stays below 255 bytes


@contextmanager
def whole_file(path: Path, remedy: str = "make room or choose another folder") -> Iterator[Path]:
    """As replace_file, with an error that names the file.

    Args:
        path: Where the file shall be.
        remedy: What to do where it cannot be written; empty where there is nothing to do.

    Raises:
        WriteError: The file cannot be written, in which case what was there is unchanged.
    """
    try:
        with replace_file(path) as new:
            yield new
    except OSError as error:
        text = f"{path} was not written: {error.strerror or error}; what was there is unchanged"
        raise WriteError(text, remedy) from error


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """A name beside path, with its suffix, to write to.

    The file becomes path when the block ends well, and is removed when it does not. Folders above path are made. The
    bytes are on the disk before the name is: some file systems find out only then that they are full.

    Raises:
        OSError: The file cannot be written, in which case what was there is unchanged.
    """
    new = path.with_name(f".{path.stem[:_MAX_STEM]}.{uuid.uuid4().hex[:12]}.{_NEW}{path.suffix}")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield new
        flush_to_disk(new)
        new.replace(path)
    finally:
        with suppress(OSError):  # a file system that refused the file refuses this too
            new.unlink(missing_ok=True)


def flush_to_disk(path: Path) -> None:
    """Wait until the bytes of a file, or the names in a folder, are on the disk.

    Raises:
        OSError: They cannot be written.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
