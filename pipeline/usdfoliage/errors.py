"""What can go wrong with a user's data, one class for each thing a caller can do something about."""

from pathlib import Path
from typing import Any


class FoliageError(Exception):
    """Base of every error that the user's data or set-up causes; the command line prints it in one line, exit 2.

    Args:
        text: What is wrong, without a full stop.
        remedy: What to do about it: a sentence without a full stop, or the parts of one, as usdfoliage.remarks.Remedy
            has them. A front end writes the settings among them as its user sets them; str() as a plan has them.

    Attributes:
        text: As given.
        remedy: As parts; empty where there is nothing to do.
    """

    def __init__(self, text: str = "", remedy: str | tuple[Any, ...] = ()) -> None:
        super().__init__(text, remedy)
        self.text = text
        self.remedy: tuple[Any, ...] = ((remedy,) if remedy else ()) if isinstance(remedy, str) else remedy

    def __str__(self) -> str:
        return f"{self.text}; {''.join(map(str, self.remedy))}" if self.remedy else self.text


class CaptureError(FoliageError):
    """The input is unusable: unreadable, empty, of another size, not finite."""


class FitError(FoliageError):
    """The data do not determine the model."""


class AssetError(FoliageError):
    """The output cannot be written, or an asset cannot be read as one."""


class WriteError(AssetError):
    """A file cannot be written: the disk is full, or permissions are missing.

    Attributes:
        path: What cannot be written, where it is known.
    """

    path: Path | None = None


class PreviewError(FoliageError):
    """The preview interpreter or its OpenGL is missing or failed."""


class PreviewTimeoutError(PreviewError):
    """Storm did not draw within its time."""
