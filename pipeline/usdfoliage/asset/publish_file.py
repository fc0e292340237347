"""A layer, or a file that a layer reads, that appears whole and is read again by who has it open."""

from collections.abc import Callable
from pathlib import Path

from pxr import Sdf

from usdfoliage.files.atomic import whole_file


def publish_text(path: Path, text: str) -> None:
    """Put text where path is, in one step; a layer that USD has open from there is read again.

    Raises:
        WriteError: The file cannot be written; what was there is unchanged.
    """
    publish_written(path, lambda new: new.write_text(text, encoding="utf-8"))


def publish_written(path: Path, write: Callable[[Path], object]) -> None:
    """The same for what a function writes, to a name beside path with its suffix.

    Raises:
        WriteError: The file cannot be written; what was there is unchanged.
    """
    with whole_file(path) as new:
        write(new)
    opened = Sdf.Layer.Find(str(path))
    if opened:
        opened.Reload(force=True)
