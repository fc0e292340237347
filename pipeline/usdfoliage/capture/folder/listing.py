"""The files of a capture folder: which there are, which belong together, which of them a user means."""

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath

from usdfoliage.capture.folder.camera_raw import is_camera_raw
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import reason_of

IMAGES, CAMERAS, MASKS = "images", "cameras", "masks"  # folders of a capture
VIDEOS = "videos"  # one that takes the place of images
PHOTO_KINDS = "JPEG, HEIC, PNG, TIFF, EXR or raw files of a camera"
_HEIC = {".heic", ".heif", ".hif"}
_PICTURES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr", *_HEIC}
_VIDEO_SUFFIXES = {
    *(".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts", ".m2ts", ".wmv", ".mpg", ".mpeg", ".3gp", ".insv")
}
_NAMED = 5  # files that a note names; it counts the others


def folder_below(folder: Path, name: str) -> Path:
    """A folder of the capture, by its name; nothing outside, and not the truth of a benchmark."""
    parts = PurePosixPath(name).parts
    if not parts or PurePosixPath(name).is_absolute() or ".." in parts or parts[0].lower() == "truth":
        raise CaptureError(f"{name!r} is not the name of a folder in {folder} that may be read")
    return folder / name


def files_below(folder: Path) -> dict[str, Path]:
    """The files below a folder by their names there, sorted; hidden ones left out.

    Raises:
        CaptureError: The folder cannot be read, or a symbolic link in it leads to nothing.
    """
    found: dict[str, Path] = {}
    try:
        for path in _walk(folder):
            if path.is_file():
                found[path.relative_to(folder).as_posix()] = path
            elif leads_nowhere(path):
                raise CaptureError(explain_lost_link(path))
    except OSError as error:
        raise CaptureError(
            f"{error.filename or folder} cannot be read: {reason_of(error)}", "check its permissions"
        ) from error
    return {name: found[name] for name in sorted(found)}


def _walk(folder: Path) -> Iterator[Path]:
    """What is no folder, at any depth, hidden ones left out; OSError for a folder that cannot be listed."""
    for above, folders, names in os.walk(folder, onerror=_raise_listed):
        folders[:] = [name for name in folders if not name.startswith(".")]
        yield from (Path(above, name) for name in names if not name.startswith("."))


def _raise_listed(error: OSError) -> None:
    if not isinstance(error, FileNotFoundError):  # a folder that is not there has no files
        raise error


def leads_nowhere(path: Path) -> bool:
    """Whether it is a symbolic link to what is not there."""
    return path.is_symlink() and not path.exists()


def explain_lost_link(path: Path) -> str:
    """What is wrong with such a link, and what to do."""
    return f"{path} is a link to {path.readlink()}, which is not there; publish that file again, or remove the link"


def parts_of_input(source: Path | None, output: Path | None) -> tuple[Path, ...]:
    """What is read of an input that may be a folder: all of it, but an output in it that is none of its own folders.

    Nothing where no input is named: the command reports that, if it needs one.
    """
    if source is None:
        return ()
    whole = (source,)
    if output is None or not os.path.isdir(source):  # noqa: PTH112 - Path.is_dir raises for names too long
        return whole
    real, place = Path(os.path.realpath(source)), Path(os.path.realpath(output))
    if place == real or not place.is_relative_to(real):
        return whole
    top = place.relative_to(real).parts[0]
    if top in (IMAGES, MASKS, CAMERAS, VIDEOS, "depth", "normals", "confidence"):
        return whole
    try:
        return tuple(source / name for name in sorted(os.listdir(source)) if name != top)  # noqa: PTH208
    except OSError:  # who reads it reports that
        return whole


def is_picture(name: str) -> bool:
    """Whether a file is named as photographs are."""
    return PurePosixPath(name).suffix.lower() in _PICTURES or is_camera_raw(name)


def is_video(name: str) -> bool:
    """Whether a file is named as videos are."""
    return PurePosixPath(name).suffix.lower() in _VIDEO_SUFFIXES


def list_pictures(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Which files are photographs, and which raw or HEIC files are not used beside a photograph of their name.

    Cameras write a JPEG beside each raw file, and phones export one beside HEIC: two pictures of one moment, from one
    place. Of raw and HEIC the HEIC is used.
    """
    pictures = [name for name in names if is_picture(name)]
    best: dict[str, int] = {}
    for name in pictures:
        stem = _stem(name)
        best[stem] = min(best.get(stem, 2), _rank(name))
    used = [name for name in pictures if _rank(name) == best[_stem(name)]]
    return used, [name for name in pictures if _rank(name) > best[_stem(name)]]


def _stem(name: str) -> str:
    return PurePosixPath(name).with_suffix("").as_posix()


def _rank(name: str) -> int:
    return 2 if is_camera_raw(name) else int(PurePosixPath(name).suffix.lower() in _HEIC)


def file_of(name: str, files: dict[str, Path], suffixes: Sequence[str]) -> Path | None:
    """The file of a photograph among depth maps or masks: a.exr or a.jpg.exr for a.jpg."""
    stem = PurePosixPath(name).with_suffix("").as_posix()
    candidates = (base + suffix for suffix in suffixes for base in (stem, name))
    return next((files[candidate] for candidate in candidates if candidate in files), None)


def depth_folders(folder: Path) -> str:
    """The names of folders that hold OpenEXR files, for a message."""
    names = sorted({path.parent.name for path in folder.glob("*/*.exr")} - {"images", "truth"})
    return ", ".join(names) or "none"


def parse_views(views: str | Sequence[str | int], names: Sequence[str]) -> tuple[int, ...]:
    """Which views a user means.

    Args:
        views: Separated by commas, or in a list: a file's name, with or without its suffix; a place in names, from 0,
            negative ones from the end; or start:stop:step as in Python. "0,3,5", "0:10:2", "a.jpg,b.jpg".
        names: Of all views.

    Returns:
        Places in names, each once, in the order given.

    Raises:
        CaptureError: A view that does not exist, or no view at all.
    """
    if isinstance(views, str):
        views = [views] if views in names else [part.strip() for part in views.split(",")]
    chosen: dict[int, None] = {}
    for view in views:
        for index in _places(view, names):
            chosen[index] = None
    if not chosen:
        raise CaptureError(f"no view of {len(names)} is chosen; there are {named(list(names))}")
    return tuple(chosen)


def _places(view: str | int, names: Sequence[str]) -> Iterable[int]:
    text = str(view)
    if text in names:
        return [names.index(text)]
    try:
        if ":" in text:
            limits = [int(part) if part.strip() else None for part in text.split(":")]
            if len(limits) <= 3:
                return range(len(names))[slice(*limits)]
        index = int(text)
        if -len(names) <= index < len(names):
            return [index % len(names)]
    except ValueError:
        pass
    same_stem = [index for index, name in enumerate(names) if PurePosixPath(name).with_suffix("").as_posix() == text]
    if len(same_stem) == 1:
        return same_stem
    raise CaptureError(
        f"there is no view {text[:80]!r} among {counted(len(names), 'posed photograph')}: {named(list(names))}",
        f"give a name, a place from 0 to {len(names) - 1}, or start:stop:step",
    )


def named(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    more = len(names) - _NAMED
    printable = [
        name.encode(errors="backslashreplace").decode() for name in names[:_NAMED]
    ]  # file systems take any bytes
    return (", ".join(printable) + (f" and {more} more" if more > 0 else "")) or "none"


def counted(count: int, noun: str, plural: str = "") -> str:
    """A number with its noun, in the plural where there is not one. plural: of a noun that takes more than an s."""
    return f"{count} {noun}" if count == 1 else f"{count} {plural or noun + 's'}"
