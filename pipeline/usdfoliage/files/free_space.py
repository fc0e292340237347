"""Whether a disk is full: by the number of an error, or by a trial, never by the words of a message."""

import errno
import os
import tempfile
from pathlib import Path

MIN_BYTES = 2**20  # more than what any library writes at a time


def is_full_disk(error: BaseException) -> bool:
    """Whether an error, or what caused it, is a full disk: no room, or a quota or the size of a file used up."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError) and cause.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            return True
        cause = cause.__cause__
    return False


def require_space(folder: Path, size_bytes: int = MIN_BYTES) -> None:
    """Take room in a folder for a file of this size, above 0, and give it back.

    Raises:
        OSError: There is no room, or the folder cannot be written.
    """
    with tempfile.TemporaryFile(dir=folder) as file:
        os.posix_fallocate(file.fileno(), 0, size_bytes)
