"""capture.toml: what the user states of a capture."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usdfoliage.errors import CaptureError
from usdfoliage.files.toml import parse_toml, read_toml
from usdfoliage.remarks import Remark, remark

FILE_NAME = "capture.toml"


@dataclass(frozen=True, kw_only=True)
class CaptureSettings:
    """The values of capture.toml, defaults where it has none."""

    name: str = ""
    up_axis: str = "Y"  # or Z, of the poses and clouds
    metres_per_unit: float = 1.0  # of the poses and clouds; depth is in metres
    color_space: str | None = None  # of all photographs, as read_photo takes it; None: as each file states
    note: str = ""

    def __post_init__(self) -> None:
        if self.up_axis not in ("Y", "Z"):
            raise ValueError(f"up_axis must be Y or Z, not {self.up_axis!r}")
        if not 1e-9 <= self.metres_per_unit <= 1e9:
            raise ValueError(f"metres_per_unit must be in 1e-9 to 1e9, not {self.metres_per_unit}")


_TABLES = ("known_distance", "scale_bar")  # of other subjects, as read_capture_tables gives them
_KINDS = {"name": "text", "up_axis": "text", "metres_per_unit": "a number", "color_space": "text", "note": "text"}


def complete_capture_settings(text: str, values: Mapping[str, str | float]) -> str:
    """The text of a capture.toml with the keys that it lacks put before all others; whatever is in it stays.

    Args:
        text: As it is; "" where there is none.
        values: By key, for the top of the file.

    Raises:
        ValueError: The text is no TOML.
    """
    mark, body = ("\ufeff", text[1:]) if text.startswith("\ufeff") else ("", text)
    parsed = parse_toml(body)
    missing = {key: value for key, value in values.items() if key not in parsed}
    if not missing:
        return text
    end = "\r\n" if "\r\n" in body else "\n"
    # A JSON text is a TOML text, but for one control character.
    lines = [
        f"{key} = {json.dumps(value, ensure_ascii=False)}".replace("\x7f", "\\u007f") for key, value in missing.items()
    ]
    completed = end.join(["# added by usdfoliage capture", *lines, body])
    if parse_toml(completed) != {**parsed, **missing}:
        raise ValueError(f"{', '.join(missing)} cannot be added")
    return mark + completed


def read_capture_settings(folder: Path) -> tuple[CaptureSettings, tuple[Remark, ...]]:
    """Read a capture's capture.toml; the defaults where there is none.

    Returns:
        The settings, and a remark on keys that mean nothing here.

    Raises:
        CaptureError: The file is no TOML, or a value has a wrong type or is out of range.
    """
    path = folder / FILE_NAME
    values = _read(path)
    known: dict[str, Any] = {}
    for key, kind in _KINDS.items():
        if key not in values:
            continue
        value = values[key]
        if isinstance(value, bool) or not isinstance(value, str if kind == "text" else int | float):
            raise CaptureError(f"{path}: {key} must be {kind}, not {value!r}")
        known[key] = str(value).upper() if key == "up_axis" else value
    unknown = sorted(set(values) - {*_KINDS, *_TABLES})
    remarks: tuple[Remark, ...] = ()
    if unknown:
        text = f"{FILE_NAME}: {', '.join(unknown)} not known, and not used"
        remarks = (remark("capture-keys-unknown", text, subject=FILE_NAME),)
    try:
        return CaptureSettings(**known), remarks
    except (ValueError, OverflowError) as error:
        raise CaptureError(f"{path}: {error}") from error


def read_capture_tables(folder: Path) -> dict[str, Any]:
    """The tables of capture.toml beyond CaptureSettings, unchecked: hints at the scale of poses that are not given.

    Raises:
        CaptureError: The file is no TOML.
    """
    values = _read(folder / FILE_NAME)
    return {name: values[name] for name in _TABLES if name in values}


def _read(path: Path) -> dict[str, Any]:
    """The values of a TOML file; none where it does not exist."""
    if not path.is_file():
        return {}
    try:
        return read_toml(path)
    except ValueError as error:
        raise CaptureError(f"{path} is no TOML: {error}") from error
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error
