"""A folder that appears whole, or not at all.

Everything is written into a hidden sibling of the output folder, on the same file system, and takes its place in one
rename. The names of a run's files beside ``oak``::

    .oak.TOKEN.usdfoliage-lock   locked (flock) while the run lives, so that the next run recognizes a killed one
    .oak.TOKEN.usdfoliage-new    what the run has written so far; after the exchange, what it replaces
    .oak.TOKEN.usdfoliage-old    only where a file system cannot exchange two folders: the old one, for an instant

A killed run leaves some of them. The next run for the same folder puts a stranded old folder back, if that is all there
is, and removes the rest.
"""

import ctypes
import errno
import json
import logging
import os
import re
import shutil
import sys
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from usdfoliage.asset.locate import check_usd_name, usd_files_at_top
from usdfoliage.asset.look_layer import CUSTOM_DATA_KEY
from usdfoliage.asset.packed_files import is_package
from usdfoliage.errors import AssetError, WriteError
from usdfoliage.files.atomic import flush_to_disk
from usdfoliage.files.json import read_json
from usdfoliage.files.locks import open_lock, open_old_lock, try_lock, wait_for_lock
from usdfoliage.remarks import Argument

logger = logging.getLogger(__name__)

_LOCK, _NEW, _OLD = "usdfoliage-lock", "usdfoliage-new", "usdfoliage-old"
FILES_LIST = "report/files.json"  # of an asset: the files that were written, itself among them
_FILES = "files"  # of an asset's record: FILES_LIST; in assets of earlier versions the list itself
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
# What renameat2 fails with where the kernel or the file system does not know it.
_NO_EXCHANGE = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EPERM)


@contextmanager
def publish_folder(out: Path, force: bool = False) -> Iterator[Path]:
    """Give the body an empty folder to write into; when it ends well, that folder is out.

    Until then out is as it was, whatever happens: an exception, a full disk, a kill. What was in out before is gone
    afterwards, so out must be an asset of ours, empty or absent.

    Args:
        out: The folder to make or to replace. A symbolic link stays, and what it points to is replaced.
        force: Replace a folder that is not ours too.

    Raises:
        AssetError: out is a file, somebody else's folder, or cannot be written; or the body raised OSError.
    """
    try:
        target = _resolve(out)
        made = _make_parents(target.parent)
    except OSError as error:
        raise WriteError(_refuse(out, error)) from error
    try:
        lock, new = _begin(target)
        try:
            _recover(target)
            _check_replaceable(out, target, force)
            yield new
            _record_files(new)
            _flush(new)
            if target.exists():
                shutil.copymode(target, new)
            # Somebody may have put something there meanwhile.
            _check_replaceable(out, target, force)
            _take_place(new, target)
            made = []
        except AssetError as error:  # a file's name as the user knows it
            raise type(error)(error.text.replace(str(new), str(out)), error.remedy) from error
        finally:
            _end(lock, new)
    except OSError as error:
        raise WriteError(_explain(out, target, error)) from error
    finally:
        with suppress(OSError):  # one of them is in use by now
            for folder in reversed(made):
                folder.rmdir()


def plan_folder(out: Path, interface: str, force: bool = False) -> str:
    """What publish_folder would do, in a line for a dry run; writes nothing.

    Args:
        out: The folder to make or to replace.
        interface: The file that will stand at its top.
        force: Replace a folder that is not ours too.

    Raises:
        AssetError: publish_folder would refuse out.
    """
    try:
        target = _resolve(out)
        stands = target.exists()
        parent = target.parent
        while not parent.exists():
            parent = parent.parent
        if not parent.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        if not os.access(parent, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        _check_replaceable(out, target, force)
    except OSError as error:
        raise WriteError(_refuse(out, error)) from error
    return f"would {'replace' if stands else 'write'}: {out / interface}"


def is_asset_folder(folder: Path) -> bool:
    """Whether exactly one USD file stands at the top of folder and usdfoliage wrote it."""
    return _read_record(folder) is not None


def foreign_files(folder: Path) -> list[str]:
    """Files in an asset's folder that usdfoliage did not write, by their path from there, sorted.

    Raises:
        AssetError: The list of the asset's own files, FILES_LIST, is lost or damaged.
    """
    record = _read_record(folder)
    ours = _own_files(folder, record) if record else set()
    return [name for name in _list_files(folder) if name not in ours] if ours else []


def _own_files(folder: Path, record: Mapping[str, Any]) -> set[str]:
    """What usdfoliage wrote, as the record of an asset knows it; empty where it does not."""
    entry = record.get(_FILES, ())
    if not isinstance(entry, str):
        return set(entry)
    try:
        listed = read_json(folder / FILES_LIST)["files"]
        if not all(isinstance(name, str) for name in listed):
            raise ValueError("it holds other things than names of files")
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise AssetError(
            f"{folder / FILES_LIST}, the list of the asset's own files, cannot be read ({reason})",
            ("move what is yours out of the folder, and use ", Argument(name="force"), " to replace the rest"),
        ) from error
    return set(listed)


def _interface(folder: Path) -> Path | None:
    """The one USD file at the top of folder; None where it is a package, which users make, and put where they like."""
    layers = usd_files_at_top(folder)
    return layers[0] if len(layers) == 1 and not is_package(layers[0]) else None


def _read_record(folder: Path) -> dict[str, Any] | None:
    """What usdfoliage wrote into the interface layer of itself; None where it is no asset of ours."""
    interface = _interface(folder)
    if interface is None:
        return None
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(interface), metadataOnly=True)
    except Tf.ErrorException:
        return None
    return layer.customLayerData.get(CUSTOM_DATA_KEY) if layer is not None else None


def _list_files(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir())


def _record_files(folder: Path) -> None:
    """List which files are ours, so that a later run does not take others with them, and name the list in the
    interface layer."""
    record = _read_record(folder)
    interface = _interface(folder)
    if record is None or interface is None:
        return
    path = folder / FILES_LIST
    path.parent.mkdir(exist_ok=True)
    files = sorted({*_list_files(folder), FILES_LIST})
    path.write_text(json.dumps({"files": files}, indent=1) + "\n", encoding="utf-8")
    layer = Sdf.Layer.OpenAsAnonymous(str(interface))
    layer.customLayerData = {**layer.customLayerData, CUSTOM_DATA_KEY: {**record, _FILES: FILES_LIST}}
    try:
        written = layer.Export(str(interface))
    except Tf.ErrorException as error:
        raise WriteError(f"{interface.name} cannot be written: {error}") from error
    if not written:
        raise WriteError(f"{interface.name} cannot be written")


def _resolve(out: Path) -> Path:
    """The folder that out names, behind symbolic links."""
    check_usd_name(out)
    try:
        out.lstat()
    except FileNotFoundError:
        return Path(os.path.realpath(out))
    try:
        target = Path(os.path.realpath(out, strict=True))
    except FileNotFoundError as error:
        raise AssetError(
            f"{out} is a symbolic link to {out.readlink()}, which is missing", "remove the link"
        ) from error
    except OSError as error:
        raise AssetError(f"{out} cannot be followed: {error.strerror}", "name a folder") from error
    if not target.name:
        raise AssetError(f"{out} is the root of the file system", "name a folder for the asset")
    return target


def _make_parents(parent: Path) -> list[Path]:
    """Create the folders that are missing above the output; returns those, outermost first."""
    missing = []
    while not parent.exists():
        missing.append(parent)
        parent = parent.parent
    for folder in reversed(missing):
        folder.mkdir()
    return missing[::-1]


def _check_replaceable(out: Path, target: Path, force: bool) -> None:
    if not target.exists():
        return
    if not target.is_dir():
        raise AssetError(f"{out} is a file", "name a folder for the asset")
    if target.is_mount():
        raise AssetError(f"{out} is where a file system is mounted, and cannot be replaced", "name a folder in it")
    if not any(target.iterdir()):
        return
    if is_asset_folder(target):
        foreign = [] if force else foreign_files(target)
        if foreign:
            more = f" and {len(foreign) - 3} more" if len(foreign) > 3 else ""
            raise AssetError(
                f"{out} holds files that are not the asset's: {', '.join(foreign[:3])}{more}",
                ("move them elsewhere, or use ", Argument(name="force"), " to lose them"),
            )
        return
    if not force:
        raise AssetError(
            f"{out} is a folder with other things than one asset of usdfoliage, and would be replaced",
            ("name another folder, or use ", Argument(name="force"), " to lose what is in it"),
        )
    here = Path.cwd()
    if target in (here, *here.parents) or target in (Path.home(), *Path.home().parents):
        raise AssetError(f"{out} holds the home or the current folder, which is never replaced")


def _begin(target: Path) -> tuple[int, Path]:
    """Lock a fresh token and make its folder; returns the lock's descriptor and the folder."""
    while True:
        token = uuid.uuid4().hex[:12]
        lock_path = _sibling(target, token, _LOCK)
        lock = open_lock(lock_path, must_be_new=True)
        with suppress(OSError):  # a file system without locks: nobody will take this run for a dead one there
            wait_for_lock(lock)
        # Before the lock was taken, a run that cleans up may have removed the file as that of a killed run.
        if lock_path.exists() and os.path.samestat(os.fstat(lock), lock_path.stat()):
            break
        os.close(lock)
    new = _sibling(target, token, _NEW)
    try:
        new.mkdir()
    except OSError:
        _end(lock, new)
        raise
    return lock, new


def _end(lock: int, new: Path) -> None:
    """Remove what is left of a run, its lock file last: with that the next run finds what could not be removed."""
    base = new.name.removesuffix(_NEW)
    if _remove(new) and _remove(new.with_name(base + _OLD)):
        new.with_name(base + _LOCK).unlink(missing_ok=True)
    os.close(lock)


def _sibling(target: Path, token: str, what: str) -> Path:
    return target.with_name(f".{target.name}.{token}.{what}")


def _runs(target: Path) -> list[tuple[Path, str]]:
    """The lock file and the token of every run for target, living or killed."""
    pattern = re.compile(rf"\.{re.escape(target.name)}\.([0-9a-f]{{12}})\.{_LOCK}")
    matches = [(path, pattern.fullmatch(path.name)) for path in target.parent.iterdir()]
    return sorted((path, match.group(1)) for path, match in matches if match)


def _recover(target: Path) -> None:
    """Put back or remove what killed runs left."""
    for lock_path, token in _runs(target):
        try:
            lock = open_old_lock(lock_path)
        except FileNotFoundError:
            continue  # that run has just ended
        try:
            is_dead = try_lock(lock)
        except OSError:  # the file system has no locks: nobody can know
            is_dead = False
        if not is_dead:
            os.close(lock)
            continue
        old = _sibling(target, token, _OLD)
        if old.exists() and not target.exists():
            logger.warning("%s was left aside by a killed run; putting it back", target)
            old.rename(target)
        _end(lock, _sibling(target, token, _NEW))


def _take_place(new: Path, target: Path) -> None:
    """Put new where target is, in one step where the system can; what was there is removed."""
    old = new.with_name(new.name.removesuffix(_NEW) + _OLD)
    while True:
        try:
            if not target.exists():
                new.rename(target)
            elif _exchange(new, target):
                pass  # what was there is now called new, and goes with it
            else:
                _swap_in_two_steps(new, target, old)
            break
        except FileNotFoundError:
            if target.exists() or not new.exists():
                raise
        except OSError as error:
            # Another run has put its asset there in between: ours replaces it.
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST) or not new.exists():
                raise
            _remove(old)
    _sync(target.parent)


def _swap_in_two_steps(new: Path, target: Path, old: Path) -> None:
    """Where folders cannot be exchanged: for an instant target is absent, and old is what it was."""
    target.rename(old)
    try:
        new.rename(target)
    finally:
        if not target.exists():
            old.rename(target)


def _exchange(first: Path, second: Path) -> bool:
    """Swap two folders atomically; False where the system cannot."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None) if sys.platform == "linux" else None
    if rename is None:
        return False
    if rename(_AT_FDCWD, os.fsencode(first), _AT_FDCWD, os.fsencode(second), _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in _NO_EXCHANGE:
        return False
    raise OSError(code, os.strerror(code), str(second))


def _flush(folder: Path) -> None:
    """Make sure that every file and name in folder is on the disk: the rename must not overtake them."""
    for path, folders, files in os.walk(folder, topdown=False):
        for name in files:
            _sync(Path(path) / name)
        for name in folders:
            _sync(Path(path) / name)
    _sync(folder)


def _sync(path: Path) -> None:
    if not path.is_symlink():
        flush_to_disk(path)


def _remove(folder: Path) -> bool:
    """Remove a folder if it is there; returns whether it is gone."""
    if not folder.exists():
        return True
    shutil.rmtree(folder, ignore_errors=True)
    if folder.exists():
        logger.warning("%s is no longer needed and could not be removed", folder)
        return False
    return True


def _refuse(out: Path, error: OSError) -> str:
    return f"{out} cannot be written: {error.strerror}; nothing was written"


def _explain(out: Path, target: Path, error: OSError) -> str:
    what = f"{out} was not written: {error.strerror or error}"
    if error.filename2 or error.filename:
        what += f" ({error.filename2 or error.filename})"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return (
            f"{what}; {shutil.disk_usage(target.parent).free / 1e6:.0f} MB are free there; what was there is unchanged"
        )
    return f"{what}; what was there is unchanged"
