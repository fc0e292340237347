"""A folder that appears whole, or not at all.

Everything is written into a hidden sibling of the output folder, on the same file system, and takes its place in one
rename. The names of a run's files beside ``oak``::

    .oak.TOKEN.usdfoliage-lock   locked (flock) while the run lives, so that the next run recognizes a killed one
    .oak.TOKEN.usdfoliage-new    what the run has written so far; after the exchange, what it replaces
    .oak.TOKEN.usdfoliage-old    only where a file system cannot exchange two folders: the old one, for an instant

A killed run leaves some of them. The next run for the same folder puts a stranded old folder back, if that is all there
is, and removes the rest. The lock file holds the inode of the new folder, so that it is known which one has its name,
and whether the run keeps what it replaces.

The folder that was replaced stays until the new one is in its place and was looked at again. Then the files that its
record lists are removed, and nothing else: usdfoliage.asset.replacing.
"""

import errno
import logging
import os
import re
import shutil
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from usdfoliage.asset.asset_record import (
    AssetOrigin,
    list_files,
    listed_files,
    read_origin,
    record_files,
    remaining_files,
)
from usdfoliage.asset.locate import check_usd_name
from usdfoliage.asset.replacing import bring_foreign, check_replaceable, put_aside, retire
from usdfoliage.errors import AssetError, FoliageError, WriteError
from usdfoliage.files.atomic import exchange, flush_to_disk
from usdfoliage.files.delayed_interrupts import interrupts_delayed
from usdfoliage.files.locks import open_lock, open_old_lock, try_lock, wait_for_lock
from usdfoliage.files.reading import describe_unread
from usdfoliage.files.unwritten import UNCHANGED, describe_unwritten, is_of_another_file, with_users_names

logger = logging.getLogger(__name__)

_LOCK, _NEW, _OLD = "usdfoliage-lock", "usdfoliage-new", "usdfoliage-old"
_KEEP = " keep"  # in the lock file of a run that keeps what it replaces


@contextmanager
def publish_folder(
    out: Path, force: bool = False, *, origin: AssetOrigin | None = None, keep_old: bool = False
) -> Iterator[Path]:
    """Give the body an empty folder to write into; when it ends well, that folder is out.

    Until then out is as it was, whatever happens: an exception, a full disk, a kill. Of what was in out before, the
    files that the asset's record lists are gone afterwards, so out must be an asset of ours, empty or absent.

    Args:
        out: The folder to make or to replace. A symbolic link stays, and what it points to is replaced.
        force: Replace also an asset of another name or origin, and one whose record is lost. Files that are not the
            asset's stay: in the new one, or in a folder beside it.
        origin: Of the new asset; None: that of the old one.
        keep_old: Keep what is replaced, in a folder beside out.

    Raises:
        AssetError: out is a file, somebody else's folder, or cannot be written; or the body raised OSError.
    """
    try:
        target = _resolve(out)
        made = _make_parents(target.parent)
    except OSError as error:
        raise describe_unwritten(out, error, what="cannot be written", outcome="; nothing was written") from error
    try:
        lock, new = _begin(target, keep_old)
        try:
            with interrupts_delayed():
                _recover(target)
            check_replaceable(out, target, force, origin, keep_old)
            try:
                yield new
            except OSError as error:
                if is_of_another_file(error, new, target):
                    raise describe_unread(error) from error
                raise
            record_files(new, origin or read_origin(target))
            # Somebody may have put something there meanwhile.
            check_replaceable(out, target, force, origin, keep_old)
            brought = bring_foreign(target, new)
            _flush(new)
            if target.exists():
                shutil.copymode(target, new)
            inode = new.stat().st_ino
            sizes = {name: size for name, size in _survey(new).items() if name not in brought}
            with interrupts_delayed():  # else the old asset would stay aside, whole
                old = _take_place(new, target)
                reason = _why_not_whole(target, inode, sizes)
                if reason:
                    _take_back(new, target, old)
                    raise WriteError(
                        f"{out} was not written: {reason}; what was there is unchanged", "check the disk, and run again"
                    )
                made = []
                if old is not None:
                    retire(old, target, listed_files(old), brought, keep=keep_old)
        except FoliageError as error:  # a file's name as the user knows it
            raise with_users_names(error, new, out) from error
        except OSError as error:
            raise describe_unwritten(_as_known(error, new, out), error, outcome=UNCHANGED) from error
        finally:
            _end(lock, new)
    except OSError as error:
        raise describe_unwritten(out, error, outcome=UNCHANGED) from error
    finally:
        with suppress(OSError):  # one of them is in use by now
            for folder in reversed(made):
                folder.rmdir()


def plan_folder(
    out: Path, interface: str, force: bool = False, *, origin: AssetOrigin | None = None, keep_old: bool = False
) -> str:
    """What publish_folder would do, in a line for a dry run; writes nothing.

    Args:
        out: The folder to make or to replace.
        interface: The file that will stand at its top.
        force: As publish_folder, as the rest.
        origin: Of the new asset.
        keep_old: Whether what is replaced is kept.

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
        check_replaceable(out, target, force, origin, keep_old)
    except OSError as error:
        raise describe_unwritten(out, error, what="cannot be written", outcome="; nothing was written") from error
    return f"would {'replace' if stands else 'write'}: {out / interface}"


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


def _survey(folder: Path) -> dict[str, int]:
    """The sizes of the files in a folder, by their path from there."""
    return {name: (folder / name).lstat().st_size for name in list_files(folder)}


def _why_not_whole(target: Path, inode: int, sizes: Mapping[str, int]) -> str:
    """Look at a new asset in its place: what is wrong with it; empty where it is whole, or replaced by another run.

    Args:
        target: Where it is.
        inode: Of its folder.
        sizes: Of its files, as they were written.
    """
    try:
        found = _survey(target)
        lost = sorted(name for name, size in sizes.items() if found.get(name) != size)
        reason = f"{lost[0]} is not as it was written" if lost else ""
    except OSError as error:
        reason = f"it cannot be read again: {error.strerror}"
    try:
        return reason if target.stat().st_ino == inode else ""
    except FileNotFoundError:  # another run is about to replace it
        return ""


def _take_back(new: Path, target: Path, old: Path | None) -> None:
    """The reverse of _take_place."""
    if old == new:
        if not exchange(new, target):
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(target))
        return
    target.rename(new)
    if old is not None:
        old.rename(target)


def _begin(target: Path, keep_old: bool) -> tuple[int, Path]:
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
        os.write(lock, f"{new.stat().st_ino}{_KEEP if keep_old else ''}\n".encode())
    except OSError:
        _end(lock, new)
        raise
    return lock, new


def _end(lock: int, new: Path) -> None:
    """Remove what is left of a run, its lock file last: with that the next run finds what could not be removed.

    What was replaced is never among that: where it is still there, it is put aside whole.
    """
    base = new.name.removesuffix(_NEW)
    target = new.with_name(base[1:].rsplit(".", 2)[0])
    for replaced in (new.with_name(base + _OLD), *([new] if _is_replaced(lock, new) else [])):
        if replaced.exists():
            with suppress(OSError):
                logger.warning("what was in %s is kept in %s", target, put_aside(replaced, target))
    if not new.with_name(base + _OLD).exists() and not _is_replaced(lock, new) and _remove(new):
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
        new = _sibling(target, token, _NEW)
        for replaced in (old, *([new] if _is_replaced(lock, new) else [])):
            if replaced.exists() and target.exists():
                same = _same_files(replaced, target)
                retire(replaced, target, remaining_files(replaced), same, keep=_read_lock(lock).endswith(_KEEP))
        _end(lock, new)


def _is_replaced(lock: int, new: Path) -> bool:
    """Whether the folder with the name of a new one is what a killed run had replaced: the two were exchanged."""
    try:
        known = _read_lock(lock).removesuffix(_KEEP)
        return bool(known) and new.stat().st_ino != int(known)
    except (OSError, ValueError):
        return False


def _read_lock(lock: int) -> str:
    """What the lock file of a run holds, of an earlier version too."""
    return os.pread(lock, 64, 0).decode("ascii", errors="replace").strip()


def _same_files(old: Path, target: Path) -> list[str]:
    """Files that two folders share: those of others, which the new asset has got."""
    return [
        name
        for name in list_files(old)
        if (target / name).exists() and os.path.samestat((old / name).lstat(), (target / name).lstat())
    ]


def _take_place(new: Path, target: Path) -> Path | None:
    """Put new where target is, in one step where the system can; returns where that is which was there, if any."""
    old = new.with_name(new.name.removesuffix(_NEW) + _OLD)
    replaced: Path | None = None
    while True:
        try:
            if not target.exists():
                new.rename(target)
            elif exchange(new, target):
                replaced = new  # what was there now has this name
            else:
                _swap_in_two_steps(new, target, old)
                replaced = old
            break
        except FileNotFoundError:
            if target.exists() or not new.exists():
                raise
        except OSError as error:
            # Another run has put its asset there in between: ours replaces it.
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST) or not new.exists():
                raise
            if old.exists():
                retire(old, target, listed_files(old), (), keep=False)
    _sync(target.parent)
    return replaced


def _swap_in_two_steps(new: Path, target: Path, old: Path) -> None:
    """Where folders cannot be exchanged: for an instant target is absent, and old is what it was."""
    target.rename(old)
    try:
        new.rename(target)
    finally:
        if not target.exists():
            old.rename(target)


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


def _as_known(error: OSError, new: Path, out: Path) -> Path:
    """The file that an error is about, as the user knows it; out where it is about another one."""
    name = error.filename2 or error.filename
    if isinstance(name, str | bytes) and Path(os.fsdecode(name)).is_relative_to(new):
        return out / Path(os.fsdecode(name)).relative_to(new)
    return out
