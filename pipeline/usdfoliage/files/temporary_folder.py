"""A folder for temporary files, and the message where its disk is full."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from usdfoliage.errors import FoliageError

# Libraries and other programs report a full disk in words of their own, or not at all; where less than this is free, a
# full disk is taken for the cause.
_LITTLE_BYTES = 16 * 2**20


@contextmanager
def temporary_folder(purpose: str, failure: type[FoliageError] = FoliageError) -> Iterator[Path]:
    """A new folder where the system keeps temporary files (TMPDIR), removed at the end.

    Args:
        purpose: Part of its name.
        failure: What is raised where it is no FoliageError yet.

    Raises:
        FoliageError: It cannot be made, or the block failed while its disk was full.
    """
    try:
        kept = tempfile.TemporaryDirectory(prefix=f"usdfoliage-{purpose}-", ignore_cleanup_errors=True)
    except OSError as error:
        raise failure(
            f"there is no place for temporary files: {error.strerror}", "make room, or name a folder in TMPDIR"
        ) from error
    with kept as name:
        try:
            yield Path(name)
        except Exception as error:
            free_bytes = _LITTLE_BYTES + 1
            with suppress(OSError):  # the folder may be gone; the error of the block is reported
                free_bytes = shutil.disk_usage(Path(name).parent).free
            if free_bytes > _LITTLE_BYTES:
                raise
            kind = type(error) if isinstance(error, FoliageError) else failure
            raise kind(
                f"{error}; {free_bytes / 2**20:.0f} MB are free for temporary files in {Path(name).parent}",
                "make room there, or name another folder in TMPDIR",
            ) from error
