"""The work folder of a capture: results by the hash of what they were made of, and one run at a time.

A result that is there whole is as good as one made anew, so a run that was killed goes on where it was, and one with
other photographs or settings does again only what they touch. The folder may be deleted whenever no run uses it.
"""

import dataclasses
import errno
import fcntl
import functools
import hashlib
import io
import logging
import os
import shutil
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__, _native
from usdfoliage.capture.whole_file import DAMAGED, find_damage
from usdfoliage.errors import CaptureError

logger = logging.getLogger(__name__)

WORK = ".usdfoliage/capture"
_LOCK = "lock"
_NEW = ".new"  # ends the name of a file that is being written
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
_NOT_HASHED = "threads"  # changes no result
# Of the package, what decides results.
_CODE = (
    "files/**/*.py",
    "geometry/**/*.py",
    "capture/**/*.py",
    "jobs/capture/depth_tasks.py",
    "jobs/capture/maps.py",
    "jobs/work/results.py",
)


def task_key(*parts: object) -> str:
    """The name of a result: a hash of this code and of all that went into it.

    Args:
        parts: Numbers, texts, arrays, None, sequences of them, and dataclasses of them, whose threads do not count.

    Raises:
        TypeError: A part is of another kind.
    """
    digest = hashlib.sha256(code_version().encode())
    for part in parts:
        _add(digest, part)
    return digest.hexdigest()[:32]


def _add(digest: "hashlib._Hash", part: object) -> None:
    """Kinds and lengths count too: else a text could run over into the next one."""
    if part is None or isinstance(part, bool | int | float | str):
        digest.update(f"{type(part).__name__} {part!r}\n".encode())
    elif isinstance(part, np.ndarray):
        digest.update(f"array {part.dtype.str} {part.shape}\n".encode())
        digest.update(np.ascontiguousarray(part).tobytes())
    elif isinstance(part, tuple | list):
        digest.update(f"sequence {len(part)}\n".encode())
        for each in part:
            _add(digest, each)
    elif dataclasses.is_dataclass(part):
        digest.update(f"{type(part).__name__}\n".encode())
        for field in dataclasses.fields(part):
            if field.name != _NOT_HASHED:
                digest.update(f"{field.name}\n".encode())
                _add(digest, getattr(part, field.name))
    else:
        raise TypeError(f"a {type(part).__name__} has no hash that lasts")


@functools.cache
def code_version() -> str:
    """The version, and a hash of the code that measures: a build between two versions is another one."""
    digest = hashlib.sha256()
    package = Path(__file__).parents[2]
    files = [path for pattern in _CODE for path in sorted(package.glob(pattern))]
    for path in (*files, Path(_native.__file__)):
        digest.update(path.name.encode() + hashlib.sha256(path.read_bytes()).digest())
    return f"{__version__} {digest.hexdigest()}"


@contextmanager
def lock_work(folder: Path) -> Iterator[None]:
    """Have the work folder for oneself; it is made where there is none.

    Raises:
        CaptureError: Another run has it, or it cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder / _LOCK, os.O_CREAT | os.O_RDWR, 0o666)
    except OSError as error:
        raise CaptureError(f"{folder} cannot be written: {error.strerror}; choose another folder with -o") from error
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                holder = os.read(lock, 80).decode(errors="replace").strip() or "unknown"
                raise CaptureError(
                    f"{folder} is in use by another run ({holder}); wait until it ends, or end it"
                ) from error
            logger.warning("%s: the file system has no locks; let no other run use the folder", folder)
        os.ftruncate(lock, 0)
        os.pwrite(lock, f"process {os.getpid()} on {os.uname().nodename}\n".encode(), 0)
        yield
    finally:
        os.close(lock)


def write_result(path: Path, arrays: Mapping[str, NDArray[np.generic]], *, compressed: bool = False) -> None:
    """Keep the arrays of a result; the file appears whole.

    Raises:
        CaptureError: It cannot be written.
    """
    packed = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(packed, **arrays)  # type: ignore[arg-type]
    write_whole(path, packed.getbuffer())


def read_result(path: Path, names: Iterable[str] | None = None) -> dict[str, NDArray[np.generic]] | None:
    """The arrays of a result, or those of these names; None where there is none, or what is read is damaged."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as held:  # numpy leaves a damaged one open
            return {name: held[name] for name in (held.files if names is None else names)}
    except FileNotFoundError:
        return None
    except (*DAMAGED, KeyError) as error:
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
        CaptureError: It cannot be written.
    """
    new = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}{_NEW}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with new.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())  # some file systems find out only now that they are full
            new.replace(path)
        finally:
            new.unlink(missing_ok=True)
    except OSError as error:
        raise CaptureError(explain(path, error)) from error


def explain(path: Path, error: OSError) -> str:
    """What the user is told of a file that cannot be written."""
    what = f"{path} was not written: {error.strerror or error}"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        there = path
        while not there.exists():
            there = there.parent
        what += f", {shutil.disk_usage(there).free / 1e6:,.0f} MB are free; make room, then"
    else:
        what += "; put that right, then"
    return f"{what} the same command goes on from here"


def digest_file(path: Path) -> str:
    """SHA-256 of a file's bytes.

    Raises:
        CaptureError: It cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}; check its permissions") from error


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
