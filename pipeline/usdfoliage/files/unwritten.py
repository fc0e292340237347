"""What a user learns of a file that cannot be written: which one, why, and what to do. The one place of these words."""

import errno
import os
from pathlib import Path

from usdfoliage.errors import FoliageError, WriteError
from usdfoliage.files.free_space import is_full_disk, require_space

UNCHANGED = "; what was there is unchanged"
_OUTPUT = "output"
_REMEDIES = {
    errno.ENOSPC: "make room there, or name another {}",
    errno.EDQUOT: "your quota is used up: make room there, or name another {}",
    errno.EFBIG: "allow larger files (ulimit -f), or name another {}",
    errno.EACCES: "check the permissions of its folder, or name another {}",
    errno.EPERM: "check who owns it and its folder, or name another {}",
    errno.EROFS: "the disk is read-only: name another {}",
    errno.ENAMETOOLONG: "give it a shorter name",
}
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
_EITHER = "see whether the disk is full or its folder read-only, or name another {}"


def describe_unwritten(
    path: Path,
    error: OSError,
    *,
    what: str = "was not written",
    outcome: str = "",
    goes_on: bool = False,
    place: str = _OUTPUT,
) -> WriteError:
    """The error about a file, or a folder, that cannot be written.

    Args:
        path: As the user knows it, never a scratch name.
        error: Of the system.
        what: What comes between the path and the reason.
        outcome: What follows the reason in the same sentence, such as UNCHANGED.
        goes_on: Whether what is done is kept, and the same command goes on from there.
        place: What the user may name otherwise, such as "work folder".
    """
    return _describe(path, what, explain_unwritten(error, path) + outcome, advise(error, place), goes_on)


def describe_failed(
    path: Path, words: object, *, scratch: Path | None = None, outcome: str = "", goes_on: bool = False
) -> WriteError:
    """The same where a library failed, which states no number of an error: a trial finds out whether the disk is full.

    Args:
        path: As above; its folder is tried.
        words: What the library states. They are shown only where the trial finds nothing.
        scratch: The name that the library was given in place of path.
        outcome: As above.
        goes_on: As above.
    """
    try:
        require_space(_above(path if scratch is None else scratch))
    except OSError as error:
        return describe_unwritten(path, error, outcome=outcome, goes_on=goes_on)
    text = " ".join(str(words).split()).strip(". ")
    if scratch is not None:
        text = text.replace(str(scratch), str(path))
    return _describe(path, "was not written", text + outcome, _EITHER.format(_OUTPUT), goes_on)


def with_users_names(error: FoliageError, scratch: Path, path: Path) -> FoliageError:
    """The same error, in which a folder that nobody knows has the name of what takes its place."""
    renamed = type(error)(error.text.replace(str(scratch), str(path)), error.remedy)
    if isinstance(error, WriteError) and isinstance(renamed, WriteError) and error.path is not None:
        is_in = error.path.is_relative_to(scratch)
        renamed.path = path / error.path.relative_to(scratch) if is_in else error.path
    return renamed


def is_of_another_file(error: OSError, *written: Path) -> bool:
    """Whether an error names a file, and none that is being written: one that is read meanwhile, which is not at fault.

    Args:
        error: Of the system.
        written: The files and the folders that are being written, as the system knows them.
    """
    names = [name for name in (error.filename, error.filename2) if isinstance(name, str | bytes)]
    if not names or is_full_disk(error):
        return False
    return not any(Path(os.fsdecode(name)).is_relative_to(place) for name in names for place in written)


def explain_unwritten(error: OSError, path: Path) -> str:
    """Why a file cannot be written, with the room that is left where there is none."""
    reason = error.strerror or str(error) or type(error).__name__
    if error.errno not in _NO_ROOM:
        return reason
    try:
        left = os.statvfs(_above(path))
    except OSError:
        return reason
    if left.f_files and not left.f_favail and left.f_bavail:
        return f"{reason}, as the disk has as many files as it can have"
    return f"{reason}, {left.f_bavail * left.f_frsize / 1e6:,.0f} MB are free there"


def advise(error: OSError, place: str = _OUTPUT) -> str:
    """What to do where a file cannot be written."""
    return _REMEDIES.get(error.errno or 0, "name another {}").format(place)


def _describe(path: Path, what: str, reason: str, remedy: str, goes_on: bool) -> WriteError:
    more = ", then the same command goes on from here" if goes_on else ""
    made = WriteError(f"{path} {what}: {reason}", remedy + more)
    made.path = path
    return made


def _above(path: Path) -> Path:
    """The folder that a file is in, or would be in, as far as it is there."""
    there = path.parent
    while not there.is_dir() and there != there.parent:
        there = there.parent
    return there
