"""The work folder of a capture: results by the hash of what they were made of, and one run at a time.

A result that is there whole is as good as one made anew, so a run that was killed goes on where it was, and one with
other photographs or settings does again only what they touch. The folder may be deleted whenever no run uses it.
"""

import errno
import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import replace_file
from usdfoliage.files.locks import lacks_locks, open_lock, try_lock
from usdfoliage.files.npz import DAMAGED, find_damage, read_arrays, write_arrays
from usdfoliage.files.unwritten import describe_unwritten

logger = logging.getLogger(__name__)

WORK = ".usdfoliage/capture"
_LOCK = "lock"


@contextmanager
def lock_work(folder: Path) -> Iterator[None]:
    """Have the work folder for oneself; it is made where there is none.

    Raises:
        CaptureError: Another run has it.
        WriteError: It cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = open_lock(folder / _LOCK)
    except OSError as error:
        raise describe_unwritten(folder, error, what="cannot be written") from error
    try:
        if not _lock(lock, folder):
            holder = os.read(lock, 80).decode(errors="replace").strip() or "unknown"
            raise CaptureError(f"{folder} is in use by another run ({holder})", "wait until it ends, or end it")
        with suppress(OSError):  # on a full disk: who has it is a help for others, and what is written next is named
            os.ftruncate(lock, 0)
            os.pwrite(lock, f"process {os.getpid()} on {os.uname().nodename}\n".encode(), 0)
        yield
    finally:
        os.close(lock)


def _lock(lock: int, folder: Path) -> bool:
    """Whether nobody else has the lock, as far as can be found out."""
    try:
        return try_lock(lock)
    except OSError as error:
        if lacks_locks(error):
            logger.warning("%s: the file system has no locks; let no other run use the folder", folder)
        return lacks_locks(error)


def write_result(path: Path, arrays: Mapping[str, NDArray[np.generic]], *, compressed: bool = False) -> None:
    """Keep the arrays of a result; the file appears whole.

    Raises:
        WriteError: It cannot be written.
    """
    try:
        write_arrays(path, arrays, compressed=compressed)
    except OSError as error:
        raise describe_unwritten(path, error, goes_on=True) from error


def read_result(path: Path, names: Iterable[str] | None = None) -> dict[str, NDArray[np.generic]] | None:
    """The arrays of a result, or those of these names; None where there is none, or what is read is damaged."""
    try:
        return read_arrays(path, names, sealed=True)
    except FileNotFoundError:
        return None
    except DAMAGED as error:
        logger.warning("%s is damaged (%s) and is made again", path, error)
        return None


def has_result(path: Path) -> bool:
    """Whether a result is there and whole."""
    try:
        damaged = find_damage(path)
    except FileNotFoundError:
        return False
    if damaged is not None:
        logger.warning("%s is damaged (%s) and is made again", path, damaged)
    return damaged is None


def write_whole(path: Path, data: bytes | memoryview) -> None:
    """Put data into the work folder; the file appears whole.

    Raises:
        WriteError: It cannot be written.
    """
    try:
        with replace_file(path) as new:
            new.write_bytes(data)
    except OSError as error:
        raise describe_unwritten(path, error, goes_on=True) from error


def forget(folder: Path, keep: Iterable[Path] = ()) -> None:
    """Remove the files below a part of the work folder, but those to keep; what cannot go stays."""
    kept = set(keep)
    for path in sorted(folder.rglob("*"), reverse=True):  # what is in a folder before the folder
        try:
            if path.is_dir() and not path.is_symlink():
                path.rmdir()
            elif path not in kept:
                path.unlink()
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.ENOENT):
                logger.warning("%s is no longer needed and could not be removed: %s", path, error.strerror)
