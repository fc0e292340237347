"""The one gate for what a command writes: nothing that it reads may lie in what it replaces, or the other way round.

Files are compared by device and inode and not by their names, so that symbolic links, hard links, bind mounts and file
systems that ignore case are seen through. No option opens the gate.
"""

import os
import stat
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from usdfoliage.errors import AssetError

MAX_ENTRIES = 1_000_000  # that are looked at in a folder, with what its links lead to: some seconds
_Identity = tuple[int, int]  # device and inode


@dataclass(frozen=True, kw_only=True)
class Access:
    """What a command reads, and what it writes.

    Attributes:
        reads: Files and folders. All that is in a folder counts, and what its symbolic links lead to.
        replaces: Files and folders that are made, or replaced whole.
        fills: Folders that files are put into; what else is in them stays.
        keeps: Of reads, files that may lie in what is replaced, and folders that may be what is replaced, since the run
            keeps what it read of them: the asset that bake replaces by itself.
    """

    reads: tuple[Path, ...] = ()
    replaces: tuple[Path, ...] = ()
    fills: tuple[Path, ...] = ()
    keeps: tuple[Path, ...] = ()


def check_access(access: Access) -> None:
    """Refuse a run that would replace what it reads; nothing is written.

    Time grows with the number of paths and of what is in them, not with its square: a list may have 100,000 plants.

    Raises:
        AssetError: What is read lies in what would be replaced, or the other way round; one place that is written lies
            in another one that is replaced; or a folder holds more than can be looked through.
    """
    folders: dict[Path, _Folder] = {}
    replaced = [_Place.find(path, folders) for path in access.replaces]
    kept = [_Place.find(path, folders) for path in access.keeps]
    filled = [_Place.find(path, folders) for path in access.fills]
    of_replaced = _Index.of(replaced, look_below=bool(access.reads))
    of_filled = _Index.of(filled, look_below=False)
    for path in access.reads:
        read = _Place.find(path, folders)
        is_kept = any(read.is_same(each) for each in kept)
        for number in of_replaced.meeting(read, folders) if replaced else ():
            place = replaced[number]
            if not (is_kept and (read.is_same(place) or not read.is_folder)):
                _check_pair(read, place)
        for number in of_filled.holding(read):
            raise AssetError(
                f"{read.named} is read, and {_lies_in(read, filled[number])}, which this command fills", _ANOTHER
            )
    for own, other in enumerate([*replaced, *filled]):
        for number in of_replaced.holding(other):
            if number != own:
                raise AssetError(
                    f"{other.named} is written, and {_lies_in(other, replaced[number])}, which would be replaced",
                    _ANOTHER,
                )


_ANOTHER = "name another output"


@dataclass(frozen=True, kw_only=True)
class _Folder:
    """A folder in which paths were looked for, after all links."""

    real: Path
    identities: tuple[_Identity, ...]  # its own, and those of the folders that it is in


@dataclass(frozen=True, kw_only=True)
class _Place:
    """A path, followed to its end."""

    named: Path  # as the user named it
    real: Path
    identity: _Identity | None  # None where there is nothing yet
    is_folder: bool
    above: tuple[_Identity, ...]  # of the folders that it is in
    _trees: dict[bool, "_Tree"] = field(default_factory=dict, compare=False)  # what was found below, once

    @classmethod
    def find(cls, path: Path, folders: dict[Path, _Folder] | None = None) -> "_Place":
        """Follow a path; folders are those that paths were found in before, and are added to."""
        folders = {} if folders is None else folders
        known = folders.get(path.parent) if path.name not in ("", "..") else None
        real = Path(os.path.realpath(path)) if known is None else known.real / path.name
        if known is not None and os.path.islink(real):  # noqa: PTH114 - Path.is_symlink raises for names too long
            real, known = Path(os.path.realpath(real)), None
        if known is None:
            identities = tuple(_identity(each) for each in map(_stat, real.parents) if each is not None)
            known = _Folder(real=real.parent, identities=identities)
            if path.name == real.name and os.path.realpath(path.parent) == str(real.parent):
                folders[path.parent] = known
        found = _stat(real)
        is_folder = found is not None and stat.S_ISDIR(found.st_mode)
        identity = None if found is None else _identity(found)
        return cls(named=path, real=real, identity=identity, is_folder=is_folder, above=known.identities)

    def is_same(self, other: "_Place") -> bool:
        if self.identity is None or other.identity is None:
            return self.real == other.real
        return self.identity == other.identity

    def holds(self, other: "_Place") -> bool:
        """Whether other is this place, or lies in it."""
        if self.identity is None:
            return other.real.is_relative_to(self.real)
        return self.is_same(other) or self.identity in other.above

    def look_below(self, *, follow: bool) -> "_Tree":
        """What is in it, with what its symbolic links lead to or without."""
        if self.identity is None:  # of 100,000 inputs that are not there, nothing is looked for
            return _NOTHING
        if follow not in self._trees:
            self._trees[follow] = _walk(self.real, follow=follow)
        return self._trees[follow]


@dataclass(frozen=True, kw_only=True)
class _Tree:
    """What is in a folder, or of a file, and can be reached by another name."""

    folders: dict[_Identity, Path]
    hard_links: dict[_Identity, Path]  # files with several names
    links: dict[Path, Path]  # symbolic links, and where they lead


_NOTHING = _Tree(folders={}, hard_links={}, links={})


@dataclass(frozen=True, kw_only=True)
class _Index:
    """Which of some places hold a path, or have to do with it, by their numbers."""

    same: dict[_Identity, list[int]]  # by what the place is
    absent: dict[str, list[int]]  # of places where there is nothing yet, by their paths
    above: dict[_Identity, list[int]]  # by the folders that the place is in
    below: dict[_Identity, list[int]]  # by what is in the place and can be reached by another name
    _around: dict[str, tuple[int, ...]] = field(default_factory=dict)  # of folders: places that they are, or lie in

    @classmethod
    def of(cls, places: Sequence[_Place], *, look_below: bool) -> "_Index":
        index = cls(same={}, absent={}, above={}, below={})
        for number, place in enumerate(places):
            if place.identity is None:
                index.absent.setdefault(str(place.real), []).append(number)
            else:
                index.same.setdefault(place.identity, []).append(number)
                tree = place.look_below(follow=False) if look_below else None
                for each in (*tree.folders, *tree.hard_links) if tree is not None else ():
                    index.below.setdefault(each, []).append(number)
            for each in place.above:
                index.above.setdefault(each, []).append(number)
        return index

    def holding(self, other: _Place) -> list[int]:
        """The places that other is, or lies in."""
        numbers: list[int] = []
        if self.same:
            for each in other.above if other.identity is None else (other.identity, *other.above):
                numbers += self.same.get(each, ())
        if self.absent:
            path = str(other.real)
            numbers += self.absent.get(path, ())
            folder = os.path.dirname(path)  # noqa: PTH120 - texts, as a Path takes ten times as long
            if folder != path:
                numbers += self._absent_around(folder)
        return sorted(numbers)

    def _absent_around(self, folder: str) -> tuple[int, ...]:
        """The places, of those where there is nothing yet, that a folder is, or lies in."""
        if folder not in self._around:
            numbers: list[int] = []
            path, earlier = folder, ""
            while path != earlier:
                numbers += self.absent.get(path, ())
                path, earlier = os.path.dirname(path), path  # noqa: PTH120
            self._around[folder] = tuple(numbers)
        return self._around[folder]

    def meeting(self, read: _Place, folders: dict[Path, _Folder]) -> list[int]:
        """The places that may have to do with what is read there."""
        numbers = set(self.holding(read))
        seen = read.look_below(follow=True)
        for target in seen.links.values():
            numbers.update(self.holding(_Place.find(target, folders)))
        for each in (*seen.folders, *seen.hard_links, *read.above):
            if each in self.below:
                numbers.update(self.below[each])
        for each in seen.folders if read.identity is None else (read.identity, *seen.folders):
            numbers.update(self.above.get(each, ()))
        return sorted(numbers)


def _check_pair(read: _Place, place: _Place) -> None:
    if place.holds(read):
        raise AssetError(f"{read.named} is read, and {_lies_in(read, place)}, which would be replaced", _ANOTHER)
    if read.is_folder and read.holds(place):
        raise AssetError(
            f"{place.named} would be replaced, and {_lies_in(place, read)}, which is read",
            f"name an output outside {read.named}",
        )
    seen = read.look_below(follow=True)
    for link, target in seen.links.items():
        if place.holds(_Place.find(target)):
            raise AssetError(
                f"{link} is read, and leads to {target}, which would be replaced with {place.named}", _ANOTHER
            )
    if place.identity is None:
        same = next((seen.folders[each] for each in place.above if each in seen.folders), None)
    else:
        there = place.look_below(follow=False)  # of a link only the link is replaced
        of_place = {**there.folders, **there.hard_links}
        of_read = {**seen.folders, **seen.hard_links}
        # A folder in the output, or the one that it is in, may be mounted where the input lies, or the other way round.
        meeting = [each for each in (*of_read, *read.above) if each in of_place]
        meeting += [each for each in place.above if each in seen.folders]
        same = next((of_place.get(each) or of_read[each] for each in meeting), None)
    if same is not None:
        raise AssetError(
            f"{same} is the same file or folder in {read.named}, which is read, and in {place.named}, which would be "
            "replaced",
            _ANOTHER,
        )


def _lies_in(inner: _Place, outer: _Place) -> str:
    where = f"{outer.named}" if outer.named.is_absolute() == inner.named.is_absolute() else f"{outer.real}"
    return f"is the same as {where}" if inner.is_same(outer) else f"lies in {where}"


def _walk(top: Path, *, follow: bool) -> _Tree:
    """What is at and below a path; where symbolic links are followed, each folder is looked at once.

    Raises:
        AssetError: There are more than MAX_ENTRIES, as behind a link to the root of the file system.
    """
    folders: dict[_Identity, Path] = {}
    hard_links: dict[_Identity, Path] = {}
    links: dict[Path, Path] = {}
    ahead, count = [top], 0
    while ahead:
        path = ahead.pop()
        found = _stat(path)
        if found is None:
            continue
        identity = _identity(found)
        if not stat.S_ISDIR(found.st_mode):
            if found.st_nlink > 1:
                hard_links[identity] = path
            continue
        if identity in folders:
            continue
        folders[identity] = path
        for entry in _entries(path):
            count += 1
            if entry.is_symlink():
                links[Path(entry.path)] = Path(os.path.realpath(entry.path))
                if follow:
                    ahead.append(links[Path(entry.path)])
            elif entry.is_dir() or _has_links(entry):
                ahead.append(Path(entry.path))
        if count > MAX_ENTRIES:
            raise AssetError(
                f"{top} and what its links lead to hold more than {MAX_ENTRIES:,} files, too many to see whether one "
                "would be replaced",
                "name a smaller folder, or remove links to large ones",
            )
    return _Tree(folders=folders, hard_links=hard_links, links=links)


def _has_links(entry: os.DirEntry[str]) -> bool:
    """Whether a file has several names."""
    try:
        return entry.stat(follow_symlinks=False).st_nlink > 1
    except OSError:
        return False


def _entries(folder: Path) -> Iterator[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            yield from sorted(entries, key=lambda entry: entry.name)
    except OSError:
        return  # who reads it or replaces it reports that


def _stat(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except (OSError, ValueError):  # nothing is there, a loop of links, no permission, no name of a file
        return None


def _identity(found: os.stat_result) -> _Identity:
    return found.st_dev, found.st_ino


def join_access(parts: Sequence[Access]) -> Access:
    """One declaration of several, as of all plants of a list."""
    return Access(
        reads=tuple(path for part in parts for path in part.reads),
        replaces=tuple(path for part in parts for path in part.replaces),
        fills=tuple(dict.fromkeys(path for part in parts for path in part.fills)),
        keeps=tuple(path for part in parts for path in part.keeps),
    )
