"""Locks of files, which end with the process that has them.

Some file systems have no locks: there nobody can know who else is at work.
"""

import errno
import fcntl
import os
from pathlib import Path

_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)


def open_lock(path: Path, *, must_be_new: bool = False) -> int:
    """The descriptor of a lock file, which is made where there is none; no symbolic link is followed.

    Args:
        path: Of the lock file; its folder exists.
        must_be_new: Whether one that is there is refused.

    Raises:
        OSError: It cannot be made or opened; FileExistsError where it must be new and is not.
    """
    return os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | (os.O_EXCL if must_be_new else 0), 0o666)


def open_old_lock(path: Path) -> int:
    """The same of a lock file that somebody else has made.

    Raises:
        OSError: It cannot be opened; FileNotFoundError where there is none.
    """
    return os.open(path, os.O_RDWR | os.O_NOFOLLOW)


def wait_for_lock(descriptor: int, *, shared: bool = False) -> None:
    """Lock an open file until the descriptor is closed; waits until whoever has it otherwise lets go.

    Args:
        descriptor: Of the file.
        shared: With others who share it; else alone.

    Raises:
        OSError: It cannot be locked; see lacks_locks.
    """
    fcntl.flock(descriptor, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)


def try_lock(descriptor: int, *, shared: bool = False) -> bool:
    """Lock an open file or folder until the descriptor is closed; False where somebody else has it.

    Args:
        descriptor: Of it.
        shared: With others who share it; else alone. One that is had otherwise becomes so.

    Raises:
        OSError: It cannot be locked; see lacks_locks.
    """
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def lacks_locks(error: OSError) -> bool:
    """Whether a lock failed because the file system has none."""
    return error.errno in _NO_LOCKS


def is_locked(path: Path) -> bool:
    """Whether anybody has the lock of a file, as far as can be found out without writing or waiting.

    The lock is tried and let go at once, and never made: who asks for it just then hardly waits.
    """
    for mode in (os.O_RDWR, os.O_RDONLY):  # NFS locks only what may be written
        try:
            lock = os.open(path, mode | os.O_NOFOLLOW)
        except OSError:
            continue  # there is none, or it is not ours to open
        try:
            return not try_lock(lock)
        except OSError:
            continue  # nobody can know
        finally:
            os.close(lock)
    return False
