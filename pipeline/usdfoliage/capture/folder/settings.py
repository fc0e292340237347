"""capture.toml: what the user states of a capture."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.files.toml import parse_toml, read_toml
from usdfoliage.geometry.up_turn import axis_vector
from usdfoliage.remarks import Remark, remark

FILE_NAME = "capture.toml"
AUTO = "auto"
UP_AXES = (AUTO, "X", "-X", "Y", "-Y", "Z", "-Z")
_LINE_OF_FRAME = re.compile(r"^[ \t]*(up_axis|up_vector|metres_per_unit)[ \t]*=.*\n?", re.MULTILINE)


@dataclass(frozen=True, kw_only=True)
class CaptureSettings:
    """The values of capture.toml, defaults where it has none."""

    name: str = ""
    up_axis: str = AUTO  # of the poses and clouds: X, Y or Z, with or without -, or auto: it is estimated
    up_vector: tuple[float, float, float] | None = None  # up in the axes of the poses, before up_axis; not 0
    metres_per_unit: float = 1.0  # of the poses and clouds; depth is in metres
    color_space: str | None = None  # of all photographs, as read_photo takes it; None: as each file states
    note: str = ""

    def __post_init__(self) -> None:
        if self.up_axis not in UP_AXES:
            raise ValueError(f"up_axis must be one of {', '.join(UP_AXES)}, not {self.up_axis!r}")
        if self.up_vector is not None and not (np.isfinite(self.up_vector).all() and any(self.up_vector)):
            raise ValueError(f"up_vector must be three finite numbers and not 0, not {self.up_vector}")
        if not 1e-9 <= self.metres_per_unit <= 1e9:
            raise ValueError(f"metres_per_unit must be in 1e-9 to 1e9, not {self.metres_per_unit}")

    @property
    def knows_up(self) -> bool:
        """Whether the direction of up is stated."""
        return self.up_vector is not None or self.up_axis != AUTO

    @property
    def up(self) -> NDArray[np.float64]:
        """(3,), up in the axes of the poses, of length 1; Y where it is not stated."""
        if self.up_vector is None:
            return axis_vector("Y" if self.up_axis == AUTO else self.up_axis)
        vector = np.array(self.up_vector, np.float64)
        return np.asarray(vector / np.linalg.norm(vector))


_TABLES = ("known_distance", "scale_bar")  # of other subjects, as read_capture_tables gives them
_KINDS = {
    "name": "text",
    "up_axis": "text",
    "up_vector": "three numbers",
    "metres_per_unit": "a number",
    "color_space": "text",
    "note": "text",
}


def complete_capture_settings(text: str, values: Mapping[str, str | float | list[float]]) -> str:
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
        if not _is_of_kind(value, kind):
            raise CaptureError(f"{path}: {key} must be {kind}, not {value!r}")
        known[key] = value
        if key == "up_axis":
            known[key] = AUTO if value.lower() == AUTO else value.upper().removeprefix("+")
        elif key == "up_vector":
            known[key] = tuple(float(number) for number in value)
    unknown = sorted(set(values) - {*_KINDS, *_TABLES})
    remarks: tuple[Remark, ...] = ()
    if unknown:
        text = f"{FILE_NAME}: {', '.join(unknown)} not known, and not used"
        remarks = (remark("capture-keys-unknown", text, subject=FILE_NAME),)
    try:
        return CaptureSettings(**known), remarks
    except (ValueError, OverflowError) as error:
        raise CaptureError(f"{path}: {error}") from error


def _is_of_kind(value: object, kind: str) -> bool:
    if kind == "three numbers":
        return isinstance(value, list) and len(value) == 3 and all(_is_of_kind(each, "a number") for each in value)
    return not isinstance(value, bool) and isinstance(value, str if kind == "text" else int | float)


def read_stated_unit(folder: Path) -> float | None:
    """metres_per_unit where a capture's capture.toml states it, else None.

    Raises:
        CaptureError: As read_capture_settings.
    """
    settings, _ = read_capture_settings(folder)
    return settings.metres_per_unit if "metres_per_unit" in _read(folder / FILE_NAME) else None


def frame_values(settings: CaptureSettings) -> dict[str, str | float | list[float]]:
    """What a capture.toml states of up and unit, by its keys."""
    if settings.up_vector is not None:
        return {"up_vector": list(settings.up_vector), "metres_per_unit": settings.metres_per_unit}
    return {"up_axis": settings.up_axis, "metres_per_unit": settings.metres_per_unit}


def state_frame(text: str, settings: CaptureSettings) -> str:
    """The text of a capture.toml that states up and unit as settings have them, whatever it stated of them.

    Args:
        text: As it is; "" where there is none.
        settings: With an up that is known.

    Raises:
        ValueError: The text is no TOML.
    """
    frame = frame_values(settings)
    stated = parse_toml(text.removeprefix("\ufeff"))
    kept = (
        _LINE_OF_FRAME.sub("", text) if any(stated.get(key, value) != value for key, value in frame.items()) else text
    )
    return complete_capture_settings(kept, frame)


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
