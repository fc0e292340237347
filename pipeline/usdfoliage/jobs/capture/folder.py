"""The folder of a capture: what the user gave, laid out for a run, and the results put into it."""

import errno
import filecmp
import json
import logging
import os
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from usdfoliage.capture.folder.listing import CAMERAS, IMAGES, MASKS, files_below, named
from usdfoliage.capture.folder.settings import FILE_NAME
from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import exchange
from usdfoliage.files.hashing import digest_file
from usdfoliage.files.json import read_json
from usdfoliage.files.reading import describe_unread
from usdfoliage.files.unwritten import describe_unwritten, is_of_another_file
from usdfoliage.jobs.capture.find_photographs import GivenPhotographs, is_same_file
from usdfoliage.jobs.work.results import WORK, lock_work, write_whole
from usdfoliage.remarks import Argument

logger = logging.getLogger(__name__)

_RECORD = "written.json"  # in the work folder: what usdfoliage wrote into the capture
_OLD = "aside"  # in the work folder: what was there while something new takes its place, by its name


def lay_out(given: GivenPhotographs, record: "Record", *, cameras: bool = True, force: bool = False) -> None:
    """Put photographs, masks, cameras and capture.toml of the input where the capture is to be, unless they are there.

    Photographs and masks are hard links where the disk allows, else copies. What is there of another input is replaced
    only if usdfoliage put it there and nobody changed it since.

    Args:
        given: The input, and the capture.
        record: Of the capture.
        cameras: Whether its poses are used.
        force: Whether what is not ours may be lost.

    Raises:
        CaptureError: Other files are there, or it cannot be written.
    """
    if given.in_place:
        return
    wanted = {f"{IMAGES}/{name}": path for name, path in given.photos.items()}
    if given.is_capture:
        for folder in (MASKS, CAMERAS) if cameras else (MASKS,):
            wanted.update({f"{folder}/{name}": path for name, path in files_below(given.source / folder).items()})
        if (given.source / FILE_NAME).is_file():
            wanted[FILE_NAME] = given.source / FILE_NAME
    there = [f"{folder}/{name}" for folder in (IMAGES, MASKS) for name in files_below(given.folder / folder)]
    surplus = [name for name in there if name not in wanted]
    other = [
        name
        for name, path in wanted.items()
        if (given.folder / name).exists() and not _same_bytes(path, given.folder / name)
    ]
    foreign = [name for name in (*surplus, *other) if not record.owns(given.folder, name)]
    if foreign and not force:
        raise CaptureError(
            f"{given.folder} holds other files than {given.source}: {named(foreign)}",
            (
                "name another folder with ",
                Argument(name="output"),
                ", or use ",
                Argument(name="force"),
                " to lose them",
            ),
        )
    missing = [name for name in wanted if name in other or not (given.folder / name).exists()]
    if not missing and not surplus:
        return
    for name in missing:
        _bring(wanted[name], given.folder / name, link=name.startswith((IMAGES, MASKS)))
        record.brought[name] = digest_file(wanted[name])
    for name in surplus:
        _unlink(given.folder / name)
    record.write()


def _same_bytes(first: Path, second: Path) -> bool:
    return is_same_file(first, second) or filecmp.cmp(first, second, shallow=False)


def _bring(path: Path, there: Path, *, link: bool) -> None:
    """A link or a copy of a file, whole or not at all."""
    new = there.with_name(f".{there.name}.usdfoliage-new")
    try:
        there.parent.mkdir(parents=True, exist_ok=True)
        new.unlink(missing_ok=True)
        try:
            if link:
                try:
                    os.link(path.resolve(), new)
                except OSError as error:
                    if error.errno in (errno.ENOSPC, errno.EDQUOT):
                        raise
                    shutil.copyfile(path, new)
            else:
                shutil.copyfile(path, new)
            new.replace(there)
        finally:
            new.unlink(missing_ok=True)
    except OSError as error:
        if is_of_another_file(error, there, new):
            raise describe_unread(error) from error
        raise describe_unwritten(there, error, goes_on=True) from error


def _unlink(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise CaptureError(f"{path} cannot be removed: {error.strerror}", "check its permissions") from error


class Record:
    """What usdfoliage itself put into a capture, so that it replaces nothing else."""

    def __init__(self, work: Path) -> None:
        self._path = work / _RECORD
        self.brought: dict[str, str] = {}  # digests of what came from the input, by name in the capture
        self.made: dict[str, set[str]] = {}  # digests that a result may have
        try:
            record = read_json(self._path)
            brought = {str(name): str(digest) for name, digest in record["brought"].items()}
            made = {str(name): set(map(str, digests)) for name, digests in record["made"].items()}
        except (FileNotFoundError, NotADirectoryError):
            return
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            logger.warning("%s is damaged (%s): all that is in the capture counts as the user's", self._path, error)
            return
        self.brought, self.made = brought, made

    def write(self) -> None:
        """CaptureError where it cannot be written."""
        made = {name: sorted(digests) for name, digests in sorted(self.made.items())}
        text = json.dumps({"brought": dict(sorted(self.brought.items())), "made": made}, indent=1)
        write_whole(self._path, text.encode())

    def owns(self, capture: Path, name: str) -> bool:
        """Whether a file, or all files of a folder, are as usdfoliage left them; what is absent is."""
        return all(
            digest_file(capture / file) in {self.brought.get(file, ""), *self.made.get(file, ())}
            for file in _files_of(capture, name)
        )

    def made_cameras(self, capture: Path) -> bool:
        """Whether the poses that are there were estimated by usdfoliage."""
        files = _files_of(capture, CAMERAS)
        return bool(files) and all(digest_file(capture / file) in self.made.get(file, ()) for file in files)

    def replace_made(self, names: Iterable[str], digests: Mapping[str, str]) -> None:
        """Of these files and folders, only those with these digests are there now."""
        folders = tuple(f"{name}/" for name in names)
        kept = {f: d for f, d in self.made.items() if f not in digests and not f.startswith(folders)}
        self.made = {**kept, **{file: {digest} for file, digest in digests.items()}}


def _files_of(capture: Path, name: str) -> list[str]:
    """A file, or those in a folder, by their names in the capture."""
    path = capture / name
    if not path.is_dir():
        return [name] if path.exists() else []
    return sorted(below.relative_to(capture).as_posix() for below in path.rglob("*") if not below.is_dir())


def publish(new: Path, capture: Path, names: Iterable[str], record: Record) -> None:
    """Put files and folders of results in their places, one after the other, each in one step.

    Where the system cannot exchange two folders, a folder takes two steps; see restore_replaced.

    Args:
        new: The folder where they are, on the same disk.
        capture: Where they go.
        names: In this order; whatever is there is replaced.
        record: Knows them afterwards.

    Raises:
        WriteError: A file cannot be written; the results remain in the work folder.
    """
    listed = list(names)
    digests = {file: digest_file(new / file) for name in listed for file in _files_of(new, name)}
    for file, digest in digests.items():  # a run that is killed here must know again what it replaced
        record.made.setdefault(file, set()).add(digest)
    record.write()
    for name in listed:
        there = capture / name
        try:
            if there.is_dir() and not there.is_symlink():
                _replace_folder(new / name, there, capture / WORK / _OLD / name)
            else:
                if (new / name).is_dir():
                    there.unlink(missing_ok=True)
                (new / name).replace(there)
        except OSError as error:
            raise describe_unwritten(there, error, goes_on=True) from error
    record.replace_made(listed, digests)
    record.write()


def _replace_folder(new: Path, there: Path, old: Path) -> None:
    """Put a new folder where another one is; old is where that may be meanwhile."""
    if exchange(new, there):
        shutil.rmtree(new, ignore_errors=True)
        return
    shutil.rmtree(old, ignore_errors=True)
    old.parent.mkdir(parents=True, exist_ok=True)
    there.rename(old)
    try:
        new.rename(there)
    except OSError:
        with suppress(OSError):
            old.rename(there)
        raise
    shutil.rmtree(old, ignore_errors=True)


def restore_replaced(capture: Path) -> None:
    """Finish what a run left that was killed while it replaced a folder: the old one is back, or gone.

    Raises:
        CaptureError: Another run has the work folder.
        WriteError: A folder cannot be put back.
    """
    kept = capture / WORK / _OLD
    if not kept.is_dir():
        return
    with lock_work(kept.parent):
        for old in sorted(kept.iterdir()):
            there = capture / old.name
            if not os.path.lexists(there):
                logger.warning("%s was left aside by a killed run; it is put back", there)
                try:
                    old.rename(there)
                except OSError as error:
                    raise describe_unwritten(there, error, goes_on=True) from error
        shutil.rmtree(kept, ignore_errors=True)
