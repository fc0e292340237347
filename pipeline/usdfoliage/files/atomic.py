"""Files that appear whole, or not at all.

What is not yet whole has a hidden name beside the file. Who writes in a folder shares its lock, which ends with the
process. So who writes the same file next, and finds nobody at work there, knows those names for what killed processes
have left, and removes them.
"""

import ctypes
import errno
import os
import re
import shutil
import sys
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from usdfoliage.errors import AssetError
from usdfoliage.files.locks import try_lock
from usdfoliage.files.reading import open_regular, reason_of
from usdfoliage.files.unwritten import UNCHANGED, describe_unwritten

_NEW = "usdfoliage-new"
_COPY_BYTES = 1 << 20  # at a time
_MAX_STEM = 40  # characters: the whole name stays below 255 bytes
_TRIES, _PAUSE_S = 20, 0.02  # to share a lock that somebody else has for the moment in which he looks for leftovers
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
# What renameat2 fails with where the kernel or the file system does not know it.
_NO_EXCHANGE = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EPERM)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """As replace_file, with an error that names the file and states what to do.

    Args:
        path: Where the file shall be.

    Raises:
        WriteError: The file cannot be written, in which case what was there is unchanged.
    """
    try:
        with replace_file(path) as new:
            yield new
    except OSError as error:
        raise describe_unwritten(path, error, outcome=UNCHANGED) from error


def write_whole_files(files: Sequence[tuple[Path, bytes]]) -> None:
    """Write files that belong together: all of them appear, or none, with the folders that are missing above them.

    Args:
        files: Where each shall be, and what is in it.

    Raises:
        WriteError: One cannot be written; it is named, and what was there is unchanged.
    """
    path = files[0][0] if files else Path()
    with ExitStack() as folders, ExitStack() as undo:
        try:
            new: list[Path] = []
            for path, data in files:
                for folder in make_folders(path.parent):
                    folders.callback(_remove_folder, folder)
                undo.enter_context(_writing_beside(path))
                beside = name_beside(path)
                undo.callback(_remove_file, beside)
                beside.write_bytes(data)
                flush_to_disk(beside)
                new.append(beside)
            with ExitStack() as put_back:
                for (path, _), beside in zip(files, new, strict=True):
                    put_back.callback(_put_back, path, _keep(path, undo))
                    beside.replace(path)
                put_back.pop_all()
            folders.pop_all()
        except OSError as error:
            raise describe_unwritten(path, error, outcome=UNCHANGED) from error


def _keep(path: Path, undo: ExitStack) -> Path | None:
    """A second name of the file that is at path now; None where there is none."""
    if not path.exists():
        return None
    kept = name_beside(path)
    undo.callback(_remove_file, kept)
    try:
        os.link(path, kept)
    except OSError:  # a file system without hard links
        shutil.copyfile(path, kept)
    return kept


def _put_back(path: Path, kept: Path | None) -> None:
    if kept is None:
        _remove_file(path)
        return
    with suppress(OSError):
        kept.replace(path)


def _remove_file(path: Path) -> None:
    with suppress(OSError):  # a file system that refused the file refuses this too
        path.unlink(missing_ok=True)


def name_beside(path: Path) -> Path:
    """A hidden name that nobody has, in the folder of a file and with its suffix."""
    return path.with_name(f".{path.stem[:_MAX_STEM]}.{uuid.uuid4().hex[:12]}.{_NEW}{path.suffix}")


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """A name beside path, with its suffix, to write to.

    The file becomes path when the block ends well, and is removed when it does not. Folders above path are made. The
    bytes are on the disk before the name is: some file systems find out only then that they are full.

    Raises:
        OSError: The file cannot be written, in which case what was there is unchanged.
    """
    new = name_beside(path)
    with ExitStack() as folders:
        for folder in make_folders(path.parent):
            folders.callback(_remove_folder, folder)
        with _writing_beside(path):
            try:
                yield new
                flush_to_disk(new)
                new.replace(path)
            finally:
                _remove_file(new)
        folders.pop_all()


@contextmanager
def _writing_beside(path: Path) -> Iterator[None]:
    """Share the lock of a file's folder in the block; before it, what killed processes left of the file goes."""
    try:
        lock = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:  # what is to be written finds out, and names the file
        yield
        return
    try:
        with suppress(OSError):  # the file system has no locks: nobody can know
            if try_lock(lock):
                _remove_leftovers(path)
            for _ in range(_TRIES):
                if try_lock(lock, shared=True):
                    break
                time.sleep(_PAUSE_S)
        yield
    finally:
        os.close(lock)


def _remove_leftovers(path: Path) -> None:
    stem, suffix = re.escape(path.stem[:_MAX_STEM]), re.escape(path.suffix)
    pattern = re.compile(rf"\.{stem}\.[0-9a-f]{{12}}\.{_NEW}{suffix}")
    for name in os.listdir(path.parent):  # noqa: PTH208
        if pattern.fullmatch(name):
            _remove_file(path.with_name(name))


def exchange(first: Path, second: Path) -> bool:
    """Swap two files or folders of one file system in one step; False where the system cannot.

    Raises:
        OSError: One is not there, or may not be moved.
    """
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None) if sys.platform == "linux" else None
    if rename is None:
        return False
    if rename(_AT_FDCWD, os.fsencode(first), _AT_FDCWD, os.fsencode(second), _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in _NO_EXCHANGE:
        return False
    raise OSError(code, os.strerror(code), str(second))


def copy_whole(source: Path, target: Path) -> None:
    """Copy the bytes of a file; folders above target are made.

    Raises:
        AssetError: source cannot be read.
        WriteError: target cannot be written; it is not there then, or as it was.
    """
    with ExitStack() as closing:
        try:
            read = closing.enter_context(open_regular(source))
        except OSError as error:
            raise AssetError(
                f"{source} cannot be copied: {reason_of(error)}", "check it and its permissions"
            ) from error
        with whole_file(target) as new, new.open("xb") as written:
            shutil.copyfileobj(read, written, _COPY_BYTES)


def make_folders(folder: Path) -> list[Path]:
    """Make a folder with those that are missing above it; returns what was made, outermost first.

    Raises:
        OSError: One cannot be made; none of them stays then.
    """
    missing = []
    while not folder.is_dir():
        missing.append(folder)
        if folder == folder.parent or folder.exists():
            break
        folder = folder.parent
    made: list[Path] = []
    try:
        for each in reversed(missing):
            each.mkdir(exist_ok=True)
            made.append(each)
    except OSError:
        for each in reversed(made):
            _remove_folder(each)
        raise
    return made


def _remove_folder(folder: Path) -> None:
    with suppress(OSError):  # somebody put something into it meanwhile
        folder.rmdir()


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
