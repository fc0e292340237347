"""Which asset may be replaced, and what becomes of it: its own files go, and nothing else.

What the record of the old asset does not list is never removed: it is brought into the new one, or stays beside it in a
folder that everybody sees. Before anything is removed, the new asset is in its place and was looked at again.
"""

import errno
import logging
import os
import pwd
import shutil
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path

from usdfoliage.asset.asset_record import (
    FILES_LIST,
    AssetOrigin,
    foreign_files,
    is_asset_folder,
    list_files,
    listed_files,
    read_origin,
)
from usdfoliage.errors import AssetError
from usdfoliage.remarks import Argument

logger = logging.getLogger(__name__)


def check_replaceable(out: Path, target: Path, force: bool, origin: AssetOrigin | None, keep_old: bool) -> None:
    """Refuse an output that is neither free nor an asset that this run may replace; nothing is written.

    Args:
        out: As the user named it.
        target: The folder, behind symbolic links.
        force: Whether assets of another name or origin, and those whose record is lost, are replaced too.
        origin: Of the new asset; None: any.
        keep_old: Whether what is there is only put aside.

    Raises:
        AssetError: It may not be replaced.
        OSError: It cannot be read.
    """
    if not target.exists():
        return
    if not target.is_dir():
        raise AssetError(f"{out} is a file", "name a folder for the asset")
    if target.is_mount():
        raise AssetError(f"{out} is where a file system is mounted, and cannot be replaced", "name a folder in it")
    if not any(target.iterdir()):
        return
    if not is_asset_folder(target):
        here = Path.cwd()
        if force and target in (here, *here.parents, Path.home(), *Path.home().parents):
            raise AssetError(f"{out} holds the home or the current folder, which is never replaced", "name another")
        raise AssetError(
            f"{out} is a folder with other things than one asset of usdfoliage, which are never replaced",
            ("name another folder; ", Argument(name="force"), " is for assets alone"),
        )
    if not force:
        foreign = foreign_files(target)
        if foreign:
            more = f" and {len(foreign) - 3} more" if len(foreign) > 3 else ""
            raise AssetError(
                f"{out} holds files that are not the asset's: {', '.join(foreign[:3])}{more}",
                ("move them elsewhere, or use ", Argument(name="force"), " to keep them in the new asset"),
            )
        if listed_files(target) is None:
            raise AssetError(
                f"{out} has no list of the asset's own files",
                ("name another folder, or use ", Argument(name="force"), ", which keeps what is there beside it"),
            )
        if origin is not None:
            _check_origin(out, target, origin)
    _check_removable(out, target, keep_old=keep_old)


def _check_origin(out: Path, target: Path, origin: AssetOrigin) -> None:
    """AssetError where another asset is to be replaced than the one that this run makes."""
    remedy = ("name another folder, or use ", Argument(name="force"), " to replace it")
    old = read_origin(target)
    if old is None:
        return
    if old.name != origin.name:
        raise AssetError(f"{out} is the asset {old.name}, and not {origin.name}", remedy)
    if not old.is_same(origin):
        raise AssetError(f"{out} was made by {old.describe()}, and not by {origin.describe()}", remedy)


def bring_foreign(target: Path, new: Path) -> list[str]:
    """Give the new asset the files in target that are not the old one's; returns their names.

    Raises:
        AssetError: The new asset has another file of such a name.
        OSError: One cannot be copied.
    """
    own = listed_files(target) if target.is_dir() else None
    foreign = [] if own is None else [name for name in list_files(target) if name not in own]
    _bring_along(target, new, foreign)
    return foreign


def _check_removable(out: Path, target: Path, *, keep_old: bool) -> None:
    """Refuse a folder that this user could put aside, and then not remove.

    Args:
        out: As the user named it.
        target: The folder.
        keep_old: Whether it is only put aside.

    Raises:
        AssetError: It belongs to somebody else, or parts of it cannot be written.
    """
    parent, user = target.parent.stat(), os.geteuid()
    if parent.st_mode & 0o1000 and user not in (0, parent.st_uid, target.stat().st_uid):
        raise AssetError(
            f"{out} belongs to {_owner(target)}, who alone may replace it in {target.parent}", "name another folder"
        )
    if keep_old:
        return
    for folder, folders, files in os.walk(target):
        if (folders or files) and not os.access(folder, os.R_OK | os.W_OK | os.X_OK, effective_ids=_EFFECTIVE):
            raise AssetError(
                f"{out} cannot be replaced: {folder} belongs to {_owner(Path(folder))}, and its files cannot be "
                "removed by this user",
                ("name another folder, or keep what is there beside the new asset with ", Argument(name="keep_old")),
            )


_EFFECTIVE = os.access in os.supports_effective_ids


def _owner(path: Path) -> str:
    number = path.stat().st_uid
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"


def _bring_along(target: Path, new: Path, names: Sequence[str]) -> None:
    """Give a new asset the files of others that are in the old one: hard links where the disk allows, else copies.

    Args:
        target: The old asset.
        new: The new one, which is not in its place yet.
        names: Of the files, from the folder.

    Raises:
        AssetError: The new asset has another file of that name.
        OSError: One cannot be copied.
    """
    for name in names:
        there = new / name
        if os.path.lexists(there):
            raise AssetError(
                f"{target / name} is not the asset's, and the new asset has a file of that name", "move it elsewhere"
            )
        there.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(target / name, there, follow_symlinks=False)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise
            shutil.copy2(target / name, there, follow_symlinks=False)
    if names:
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        logger.warning("%s: not the asset's, and kept in the new one: %s%s", target, ", ".join(names[:3]), more)


def retire(old: Path, target: Path, own: Collection[str] | None, brought: Collection[str], *, keep: bool) -> None:
    """Remove what an asset's record lists from the folder that was replaced, or keep the whole.

    Args:
        old: The folder, under a hidden name beside target.
        target: Where the new asset is.
        own: The files that the record of the old one lists; None where it lists none.
        brought: Files of others that the new one has too.
        keep: Whether all of it stays.

    Raises:
        OSError: It can neither be removed nor renamed.
    """
    if not keep and own is not None:
        _remove_listed(old, {*own, *brought})
    if not os.path.lexists(old) or _is_empty(old):
        return
    kept = put_aside(old, target)
    if keep:
        logger.warning("what was in %s is kept in %s", target, kept)
    else:
        logger.warning("%s had files that no record lists as the asset's own; they are in %s", target, kept)


def _is_empty(folder: Path) -> bool:
    """Whether an empty folder was there, which then goes."""
    with suppress(OSError):
        folder.rmdir()
    return not folder.exists()


def _remove_listed(folder: Path, names: Collection[str]) -> None:
    """Remove files by their paths from the folder, and the folders that are empty then; what cannot go stays."""
    above: set[Path] = set()
    # By the two that list the files who follows a kill knows the others: these go last, the list of both at the end.
    for name in sorted(names, key=lambda name: (name == FILES_LIST, "/" not in name, name)):
        path = folder / name
        if ".." in Path(name).parts or Path(name).is_absolute():
            continue  # no file of this folder, whatever a record lists
        if any((folder / each).is_symlink() for each in Path(name).parents if each != Path()):
            continue  # it is elsewhere
        with suppress(OSError):
            path.unlink()
        above.update(folder / each for each in Path(name).parents)
    for empty in sorted(above, key=lambda path: len(path.parts), reverse=True):
        with suppress(OSError):
            empty.rmdir()


def put_aside(old: Path, target: Path) -> Path:
    """Give a folder a name beside target that everybody sees; returns it.

    Raises:
        OSError: It cannot be renamed.
    """
    number = 1
    while True:
        kept = target.with_name(f"{target.name}.old-{number}")
        try:
            kept.mkdir()  # the name is taken before it is used, or belongs to somebody
        except FileExistsError:
            number += 1
            continue
        old.rename(kept)  # onto the empty folder, in one step
        return kept
