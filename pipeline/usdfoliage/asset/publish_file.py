"""A file that appears whole, or not at all."""

import os
import uuid
from collections.abc import Callable
from pathlib import Path

from pxr import Sdf

from usdfoliage.errors import AssetError


def publish_text(path: Path, text: str) -> None:
    """Put text where path is, in one step; a layer that USD has open from there is read again.

    Raises:
        AssetError: The file cannot be written; what was there is unchanged.
    """
    publish_written(path, lambda new: new.write_text(text, encoding="utf-8"))


def publish_written(path: Path, write: Callable[[Path], object]) -> None:
    """The same for what a function writes, to a name beside path with its suffix.

    Raises:
        AssetError: The file cannot be written; what was there is unchanged.
    """
    new = path.with_name(f".{path.stem}.{uuid.uuid4().hex[:12]}.usdfoliage-new{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            write(new)
            with new.open("rb") as written:
                os.fsync(written.fileno())
            new.replace(path)
        finally:
            new.unlink(missing_ok=True)
    except OSError as error:
        raise AssetError(f"{path} was not written: {error.strerror}; what was there is unchanged") from error
    opened = Sdf.Layer.Find(str(path))
    if opened:
        opened.Reload(force=True)
