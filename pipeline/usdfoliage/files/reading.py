"""The one way into a file that a user, or a stranger, gives: regular files only, opened without waiting.

Whoever opens a pipe waits for a writer, a device may have no end, and a check before the opening may be of another file
than the one that is opened then. So the file is opened first, in a way that does not wait, and then it is checked.
"""

import errno
import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from usdfoliage.errors import FoliageError
from usdfoliage.files.printable import printable

_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
_REASONS = {
    errno.ELOOP: "its links lead in a circle",
    errno.ENOENT: "it is not there",
    errno.EACCES: "its permissions do not allow it",
    errno.EPERM: "its permissions do not allow it",
}
_REMEDIES = {
    errno.ELOOP: "remove the link, or put the file there",
    errno.EACCES: "check the permissions of it and of its folders",
    errno.EPERM: "check the permissions of it and of its folders",
    errno.EINVAL: "put a regular file there",
    errno.ENAMETOOLONG: "give it a shorter name",
    errno.ENOTDIR: "check the path",
    errno.EISDIR: "name a file",
    errno.EROFS: "choose a folder that can be written",
}


class IrregularFileError(OSError):
    """A path leads to a pipe, a socket or a device, which no reader may open."""

    def __init__(self, path: Path, kind: str) -> None:
        super().__init__(errno.EINVAL, f"it is {kind}, no regular file", str(path))


def open_regular(path: Path) -> io.BufferedReader:
    """Open a regular file for reading its bytes; never waits.

    Raises:
        IrregularFileError: It is a pipe, a socket or a device.
        OSError: It is missing, a folder, in a circle of links, or cannot be read.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0))
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        for is_kind, name in _KINDS:
            if is_kind(mode):
                raise IrregularFileError(path, name)
        return io.BufferedReader(io.FileIO(descriptor, "rb"))
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: Path, max_bytes: int | None = None) -> bytes:
    """The bytes of a regular file, or so many of its first.

    Raises:
        OSError: As open_regular.
    """
    with open_regular(path) as file:
        return file.read() if max_bytes is None else file.read(max_bytes)


def why_irregular(path: Path) -> str:
    """Why a path is no file that can be read; empty for a regular file and for a folder. Nothing is opened."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        return reason_of(error)
    return next((f"it is {name}, no regular file" for is_kind, name in _KINDS if is_kind(mode)), "")


def refuse_circle(path: Path) -> None:
    """Refuse a path through links that lead in a circle, as its end or on the way to what is not there yet.

    Raises:
        OSError: It is one, ELOOP.
    """
    try:
        path.stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise
    except ValueError:  # a zero byte, which whoever opens it refuses
        pass


def reason_of(error: OSError | ValueError) -> str:
    """Why a file cannot be opened, in words of ours where USD's or the system's are no help."""
    if not isinstance(error, OSError):
        return str(error)
    return _REASONS.get(error.errno or 0, error.strerror or "no reason given")


def describe_unread(error: OSError) -> FoliageError:
    """The error about a file that is read and that the system refuses."""
    text, remedy = explain_refusal(error) or (
        f"{printable(os.fsdecode(error.filename))} cannot be used: {reason_of(error)}",
        "see whether its disk is at fault, and run again",
    )
    return FoliageError(text, remedy)


@contextmanager
def refusals_described() -> Iterator[None]:
    """What the system refuses of a file that is read, as the error of a user's file.

    Raises:
        FoliageError: The body raised OSError about a file that the user can do something about.
    """
    try:
        yield
    except OSError as error:
        if explain_refusal(error) is None:
            raise
        raise describe_unread(error) from error


def explain_refusal(error: OSError) -> tuple[str, str] | None:
    """What is wrong with a file that the system refuses and what to do; None where the file is not the reason."""
    if error.filename is None or error.errno not in _REMEDIES:
        return None
    return f"{printable(os.fsdecode(error.filename))} cannot be used: {reason_of(error)}", _REMEDIES[error.errno]
