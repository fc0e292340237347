"""The work folder of builds: results of tasks by the hash of their inputs, and how damage is found.

::

    tasks/KEY.json     the stamp of a finished task: every file of its result, with size and SHA-256, and its seconds
    tasks/KEY.lock     locked (flock) while the task runs, so that two runs do not do it twice
    results/KEY/       its files
    scratch/KEY/       what a task that was killed may go on from
    views/KEY/         pictures and depth that the tasks of one set of photographs share, each file by its own hash
    views/frames/KEY/  photographs that were taken out of a video
    published/KEY.json which result was put where, and the digests of its files there
    digests/KEY.json   digests of input files, by path, size and time
    builds/KEY.json    the tasks of the latest build of a plant, and those of earlier ones: record.py
    builds/KEY.lock    locked (shared) while a task of the plant runs, so that nobody prunes what it reads

A stamp is written last, when the files are in their places. Nothing is taken for a result because it is there: a file
that is missing, cut short or altered makes its task undone. The folder may be deleted whenever no run uses it.
"""

import errno
import json
import logging
import os
import re
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from usdfoliage.capture.folder.listing import explain_lost_link, leads_nowhere
from usdfoliage.errors import FoliageError
from usdfoliage.files.hashing import digest_file, digest_text, hash_file
from usdfoliage.files.json import read_json
from usdfoliage.files.locks import lacks_locks, open_lock, open_old_lock, try_lock, wait_for_lock
from usdfoliage.files.reading import describe_unread
from usdfoliage.files.unwritten import describe_unwritten, is_of_another_file, with_users_names
from usdfoliage.jobs.work.keys import task_key
from usdfoliage.jobs.work.results import write_whole

logger = logging.getLogger(__name__)

_TRIES = 5


@dataclass(frozen=True, kw_only=True)
class ResultFile:
    """A file of a result."""

    path: str  # from the work folder
    size_bytes: int
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Stamp:
    """What is known of a finished task."""

    key: str
    name: str
    stage: str
    step: str  # what the task shares with the other chunks of its stage, or of its round of matching: Task.step
    seconds: float  # that it took
    estimate_s: float  # that it was thought to take
    files: tuple[ResultFile, ...]
    poor: bool = False  # it lacks what another run may find: good for this one, and done again by the next


@dataclass(frozen=True, kw_only=True)
class Store:
    """The places in a work folder."""

    folder: Path

    def result(self, key: str) -> Path:
        return self.folder / "results" / key

    def scratch(self, key: str) -> Path:
        return self.folder / "scratch" / key

    def views(self, key: str) -> Path:
        return self.folder / "views" / key

    def published(self, output: Path) -> Path:
        return self.folder / "published" / f"{task_key(str(output.resolve()))}.json"

    def record(self, key: str) -> Path:
        return self.folder / "builds" / f"{key}.json"

    def plant_lock(self, key: str) -> Path:
        return self.folder / "builds" / f"{key}.lock"

    def stamp(self, key: str) -> Path:
        return self.folder / "tasks" / f"{key}.json"

    def lock(self, key: str) -> Path:
        return self.folder / "tasks" / f"{key}.lock"


def read_stamp(store: Store, key: str) -> Stamp | None:
    """The stamp of a task; None where there is none, or it is damaged."""
    path = store.stamp(key)
    try:
        stored = read_json(path)
        body, seal = json.dumps(stored["stamp"], sort_keys=True), stored["seal"]
        if digest_text(body) != seal:
            raise ValueError("its seal does not match")
        stamp = stored["stamp"]
        files = tuple(ResultFile(**each) for each in stamp.pop("files"))
        if "stage" not in stamp:  # written by an earlier version
            stamp["stage"], stamp["step"] = derive_stage(stamp["name"])
        found = Stamp(files=files, **stamp)
        if found.key != key:
            raise ValueError("it is of another task")
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        logger.warning("%s is damaged (%s): the task is done again", path, error)
        return None
    return found


def derive_stage(name: str) -> tuple[str, str]:
    """Stage and step from the name of a task, for stamps of earlier versions, which keep neither."""
    step = name.split("/")[0]
    return step.split("-")[0], step


def write_stamp(store: Store, stamp: Stamp) -> None:
    """Mark a task as finished; CaptureError where it cannot be written."""
    stored = {
        "key": stamp.key,
        "name": stamp.name,
        "stage": stamp.stage,
        "step": stamp.step,
        "seconds": round(stamp.seconds, 3),
        "estimate_s": round(stamp.estimate_s, 3),
        "poor": stamp.poor,
        "files": [
            {"path": file.path, "size_bytes": file.size_bytes, "sha256": file.sha256}
            for file in sorted(stamp.files, key=lambda each: each.path)
        ],
    }
    seal = digest_text(json.dumps(stored, sort_keys=True))
    write_whole(store.stamp(stamp.key), json.dumps({"stamp": stored, "seal": seal}, indent=1).encode())


def find_finished(store: Store, key: str, *, thorough: bool) -> Stamp | None:
    """The stamp of a task whose files are all there; else None.

    Args:
        store: Where.
        key: Of the task.
        thorough: Whether every byte is looked at, else only the sizes.
    """
    stamp = read_stamp(store, key)
    if stamp is None:
        return None
    for file in stamp.files:
        path = store.folder / file.path
        try:
            good = path.stat().st_size == file.size_bytes and (not thorough or hash_file(path).hex() == file.sha256)
            reason = "altered"
        except OSError as error:
            good, reason = False, "gone" if isinstance(error, FileNotFoundError) else f"unreadable, {error.strerror}"
        if not good:
            logger.warning("%s is %s: %s is done again", path, reason, stamp.name)
            return None
    return stamp


def stamp_mark(store: Store, key: str) -> int:
    """A number that differs between a stamp and a later one of the same task; 0 where there is none."""
    try:
        return store.stamp(key).stat().st_mtime_ns
    except OSError:
        return 0


def list_files(store: Store, folder: Path, there: Path | None = None) -> tuple[ResultFile, ...]:
    """The files below a folder of the work folder, with sizes and digests, by which altered ones are found.

    Args:
        store: Where.
        folder: Which.
        there: Where it will be when it is whole; None: where it is.

    Raises:
        CaptureError: One cannot be read.
    """
    files = describe_files(store, sorted(path for path in folder.rglob("*") if path.is_file()))
    if there is None:
        return files
    new, whole = (each.relative_to(store.folder).as_posix() for each in (folder, there))
    return tuple(replace(file, path=whole + file.path.removeprefix(new)) for file in files)


def describe_files(store: Store, paths: Iterable[Path]) -> tuple[ResultFile, ...]:
    """The same of these files; CaptureError for one that cannot be read."""
    return tuple(
        ResultFile(
            path=path.relative_to(store.folder).as_posix(), size_bytes=path.stat().st_size, sha256=digest_file(path)
        )
        for path in paths
    )


@contextmanager
def fill_result(store: Store, key: str) -> Iterator[Path]:
    """An empty folder that becomes the result of a task when the body ends well, and goes when it does not.

    The stamp of an earlier result goes before that does: who still reads it sees by that what happened. Where another
    run has stamped its own meanwhile, as without locks, that stays and this one goes.

    Raises:
        FoliageError: It cannot be written.
    """
    there = store.result(key)
    new = there.with_name(f".{key}.{uuid.uuid4().hex[:12]}.new")
    before = stamp_mark(store, key)
    try:
        new.mkdir(parents=True)
        try:
            try:
                yield new
            except OSError as error:
                if is_of_another_file(error, new, there):
                    raise describe_unread(error) from error
                raise
            if stamp_mark(store, key) in (0, before):
                store.stamp(key).unlink(missing_ok=True)
                _replace(new, there)
        except FoliageError as error:
            raise with_users_names(error, new, there) from error
        finally:
            _remove(new)
    except OSError as error:
        raise describe_unwritten(there, error, goes_on=True) from error


def drop_result(store: Store, key: str) -> None:
    """Remove what a task that is not finished has made, and all that another run of it would go on from."""
    shutil.rmtree(store.scratch(key), ignore_errors=True)
    if not store.stamp(key).is_file():  # else it is of a run that finished the task
        _remove(store.result(key))
        shutil.rmtree(store.views(key), ignore_errors=True)


@contextmanager
def lock_task(store: Store, key: str) -> Iterator[Path]:
    """Have a task for oneself: waits until no other run has it.

    Yields:
        The folder for what the task may go on from when it is killed, which goes when the task ends. Where the file
        system has no locks another run may do the same task: then it is this run's own, and nobody goes on from it.

    Raises:
        FoliageError: The work folder cannot be written.
    """
    with hold_work_lock(store.lock(key), shared=False) as is_alone:
        if is_alone:
            yield store.scratch(key)
            return
        own = store.scratch(f"{key}.{uuid.uuid4().hex[:12]}")
        try:
            yield own
        finally:
            shutil.rmtree(own, ignore_errors=True)


@contextmanager
def hold_work_lock(path: Path, *, shared: bool) -> Iterator[bool]:
    """Have a lock of the work folder, alone or with others who share it: waits for whoever has it otherwise.

    Yields:
        Whether it is locked: some file systems have no locks.

    Raises:
        FoliageError: The work folder cannot be written.
    """
    lock = _open_lock(path)
    try:
        try:
            wait_for_lock(lock, shared=shared)
            has_lock = True
        except OSError as error:
            if not lacks_locks(error):
                raise FoliageError(f"{path} cannot be locked: {error.strerror}", "name another work folder") from error
            # Without locks two runs may do a task twice; each result still appears whole.
            logger.info("%s: the file system has no locks", path)
            has_lock = False
        yield has_lock
    finally:
        os.close(lock)


@contextmanager
def try_work_lock(path: Path) -> Iterator[bool]:
    """Have a lock of the work folder alone, if nobody has it; yields whether that is so.

    Raises:
        FoliageError: The work folder cannot be written, or its file system has no locks.
    """
    lock = _open_lock(path)
    try:
        try:
            free = try_lock(lock)
        except OSError as error:
            raise FoliageError(
                f"{path} cannot be locked ({error.strerror}), so that what is in use is unknown",
                "remove what you like by hand while no run uses the folder",
            ) from error
        yield free
    finally:
        os.close(lock)


def _open_lock(path: Path) -> int:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return open_lock(path)
    except OSError as error:
        raise describe_unwritten(path, error, what="cannot be written", place="work folder") from error


def copy_tree(source: Path, target: Path, *, link: bool = False) -> None:
    """A copy of a folder's files, or hard links to them where the disk allows: for what nobody changes in place.

    Of symbolic links it is the file that counts: a relative one leads elsewhere from another folder.

    Raises:
        FoliageError: It cannot be written, or a symbolic link leads to nothing.
    """
    for path in sorted(source.rglob("*")):
        there = target / path.relative_to(source)
        if leads_nowhere(path):
            raise FoliageError(explain_lost_link(path))
        try:
            if path.is_dir():
                there.mkdir(parents=True, exist_ok=True)
                continue
            there.parent.mkdir(parents=True, exist_ok=True)
            if link:
                try:
                    os.link(path.resolve() if path.is_symlink() else path, there)
                    continue
                except OSError as error:
                    if error.errno in (errno.ENOSPC, errno.EDQUOT):
                        raise
            shutil.copyfile(path, there)
        except OSError as error:
            if is_of_another_file(error, there):
                raise describe_unread(error) from error
            raise describe_unwritten(there, error, goes_on=True) from error


def remove_leftovers(store: Store) -> None:
    """Remove what killed runs left of results; who still writes one has its lock."""
    for path in store.folder.glob("results/.*"):
        key = re.search(r"[0-9a-f]{32}", path.name)
        try:
            lock = open_old_lock(store.lock(key.group() if key else "none"))
        except OSError:
            continue  # not ours, or another run was faster
        try:
            if try_lock(lock):  # else that run lives
                shutil.rmtree(path, ignore_errors=True)
        except OSError:
            continue  # the file system has no locks: nobody can know
        finally:
            os.close(lock)


def _replace(new: Path, there: Path) -> None:
    """Put a folder in the place of another one; without locks another run may put its own there in between."""
    for _ in range(_TRIES - 1):
        _remove(there)
        with suppress(OSError):
            new.rename(there)
            return
    _remove(there)
    new.rename(there)


def _remove(folder: Path) -> None:
    """A folder and what is in it; what cannot go is left to the next run."""
    if folder.exists():
        aside = folder.with_name(f".{folder.name}.{uuid.uuid4().hex[:12]}.old")
        try:
            folder.rename(aside)  # at once, so that nobody reads half of it
        except OSError:
            aside = folder
        shutil.rmtree(aside, ignore_errors=True)
