"""Files of a capture that appear whole, or not at all."""

import os
import uuid
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from usdfoliage.errors import CaptureError

DAMAGED = (
    OSError,
    ValueError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
    NotImplementedError,
)  # what reading a .npz raises


def find_damage(path: Path) -> str | None:
    """What is wrong with a .npz file; None for one that is whole.

    Raises:
        FileNotFoundError: It is not there.
    """
    try:
        with zipfile.ZipFile(path) as held:
            damaged = held.testzip()
    except FileNotFoundError:
        raise
    except DAMAGED as error:
        return str(error) or type(error).__name__
    return None if damaged is None else f"{damaged} is not what was written"


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A name beside path to write to; it becomes path when the block ends well, and is removed when it does not.

    Folders above path are made.

    Raises:
        CaptureError: The file cannot be written; what was there is unchanged.
    """
    new = path.with_name(f".{path.stem[:100]}.{uuid.uuid4().hex[:12]}.usdfoliage-new{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield new
            with new.open("rb") as written:
                os.fsync(written.fileno())
            new.replace(path)
        finally:
            new.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise CaptureError(
            f"{path} was not written: {reason}; what was there is unchanged: make room or choose another folder"
        ) from error
