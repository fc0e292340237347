"""A folder for temporary files, and the message where its disk is full.

Who has a folder has it locked, and a lock ends with its process. So whoever makes the next one, or begins the next
command, knows which folders killed processes have left, and removes them.
"""

import os
import platform
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from usdfoliage.errors import FoliageError, WriteError
from usdfoliage.files.hashing import digest_text
from usdfoliage.files.locks import try_lock

# Libraries and other programs report a full disk in words of their own, or not at all; where less than this is free, a
# full disk is taken for the cause.
_LITTLE_BYTES = 16 * 2**20
_VARIABLES = ("TMPDIR", "TEMP", "TMP")  # in the order in which tempfile asks them


@contextmanager
def temporary_folder(purpose: str, failure: type[FoliageError] = FoliageError) -> Iterator[Path]:
    """A new folder where the system keeps temporary files (TMPDIR), removed at the end.

    Args:
        purpose: Part of its name, small letters.
        failure: What is raised where it is no FoliageError yet.

    Raises:
        FoliageError: It cannot be made, or the block failed while its disk was full. A WriteError about a file
            elsewhere stays as it is.
    """
    try:
        folder, lock = _make(purpose)
        remove_abandoned(folder.parent)
    except OSError as error:
        raise failure(
            f"there is no place for temporary files: {error.strerror}", "make room, or name a folder in TMPDIR"
        ) from error
    try:
        yield folder
    except Exception as error:
        if isinstance(error, WriteError) and error.path is not None and not error.path.is_relative_to(folder):
            raise
        free_bytes = _LITTLE_BYTES + 1
        with suppress(OSError):  # the folder may be gone; the error of the block is reported
            free_bytes = shutil.disk_usage(folder.parent).free
        if free_bytes > _LITTLE_BYTES:
            raise
        kind = type(error) if isinstance(error, FoliageError) else failure
        raise kind(
            f"{error}; {free_bytes / 2**20:.0f} MB are free for temporary files in {folder.parent}",
            "make room there, or name another folder in TMPDIR",
        ) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def remove_abandoned(place: Path | None = None) -> None:
    """Remove the temporary folders that killed processes of this user have left on this machine.

    Args:
        place: Where; None: where the environment has temporary files.
    """
    if place is None:
        place = Path(next((os.environ[name] for name in _VARIABLES if os.environ.get(name)), "/tmp"))
    pattern = re.compile(rf"usdfoliage-[a-z]+-{_machine()}-\w{{8}}")
    with suppress(OSError):
        for entry in list(os.scandir(place)):
            if pattern.fullmatch(entry.name):
                with suppress(OSError):
                    _remove_unlocked(Path(entry))


def _remove_unlocked(folder: Path) -> None:
    """OSError where it is none, or where nobody can know whether it is in use."""
    lock = _open_folder(folder)
    try:
        if os.fstat(lock).st_uid == os.geteuid() and try_lock(lock):
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(lock)


def _make(purpose: str) -> tuple[Path, int]:
    """A new folder, and the descriptor with its lock."""
    prefix = f"usdfoliage-{purpose}-{_machine()}-"
    while True:
        folder = Path(tempfile.mkdtemp(prefix=prefix))
        with suppress(FileNotFoundError):  # before it was locked, another run took it for one that is left
            lock = _open_folder(folder)
            try:
                has_lock = try_lock(lock, shared=True)  # shared, as with who writes whole files in it
            except OSError:  # no locks there: nobody removes what others have made
                return folder, lock
            with suppress(OSError):
                if has_lock and os.path.samestat(os.fstat(lock), folder.lstat()):
                    return folder, lock
            os.close(lock)


def _open_folder(folder: Path) -> int:
    return os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)


def _machine() -> str:
    """A word for this machine: one that shares the folder may not see the locks."""
    return digest_text(platform.node())[:8]
