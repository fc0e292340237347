"""A file that appears whole, or not at all."""

import os
import uuid
from pathlib import Path

from pxr import Sdf

from usdfoliage.errors import AssetError


def publish_text(path: Path, text: str) -> None:
    """Put text where path is, in one step; a layer that USD has open from there is read again.

    Raises:
        AssetError: The file cannot be written; what was there is unchanged.
    """
    new = path.with_name(f".{path.stem}.{uuid.uuid4().hex[:12]}.usdfoliage-new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with new.open("x", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            new.replace(path)
        finally:
            new.unlink(missing_ok=True)
    except OSError as error:
        raise AssetError(f"{path} was not written: {error.strerror}; what was there is unchanged") from error
    opened = Sdf.Layer.Find(str(path))
    if opened:
        opened.Reload(force=True)
