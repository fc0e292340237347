"""What can go wrong with a user's data, one class for each thing a caller can do something about."""

from typing import Any


class FoliageError(Exception):
    """Base of every error that the user's data or set-up causes; the command line prints it in one line, exit 2.

    Args:
        text: What is wrong, and what to do about it where that names no setting.
        remedy: What to do, as usdfoliage.remarks.Remedy has it: the front end writes its settings.
    """

    def __init__(self, text: str = "", remedy: tuple[Any, ...] = ()) -> None:
        super().__init__(text)
        self.remedy = remedy


class CaptureError(FoliageError):
    """The input is unusable: unreadable, empty, of another size, not finite."""


class FitError(FoliageError):
    """The data do not determine the model."""


class AssetError(FoliageError):
    """The output cannot be written, or an asset cannot be read as one."""


class PreviewError(FoliageError):
    """The preview interpreter or its OpenGL is missing or failed."""
