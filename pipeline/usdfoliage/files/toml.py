"""Reading TOML that others wrote: no content exhausts the reader's memory, stack or time."""

import tomllib
from pathlib import Path
from typing import Any

from usdfoliage.files.reading import IrregularFileError, read_regular

MAX_BYTES = 1 << 20  # a library of thousands of species
MAX_DOTS = 200  # in a line: tomllib takes the square of the parts of a key
_MAX_DIGITS = 300  # a number of more is no float


def read_toml(path: Path) -> dict[str, Any]:
    """The values of a TOML file.

    Raises:
        OSError: It is missing, a folder, or cannot be read.
        ValueError: It is no TOML in UTF-8, no regular file, or larger, deeper or with longer numbers than settings are;
            the message states why and does not name the file.
    """
    try:
        data = read_regular(path, MAX_BYTES + 1)
    except IrregularFileError as error:
        raise ValueError(error.strerror) from error
    if len(data) > MAX_BYTES:
        raise ValueError(f"it has more than {MAX_BYTES:,} bytes")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"byte {error.start} is no UTF-8; save it as UTF-8") from error
    return parse_toml(text)


def parse_toml(text: str) -> dict[str, Any]:
    """The values of a text in TOML.

    Raises:
        ValueError: As read_toml.
    """
    for number, line in enumerate(text.splitlines(), 1):
        if line.count(".") > MAX_DOTS and not line.lstrip().startswith("#"):
            raise ValueError(f"line {number} has more than {MAX_DOTS} dots")
    try:
        values = tomllib.loads(text)
        _check_numbers(values)
    except RecursionError as error:
        raise ValueError("its lists or tables are too deep") from error
    return values


def _check_numbers(value: Any) -> None:
    """Refuse whole numbers that no float holds: whoever counts with them would fail."""
    if isinstance(value, dict):
        for one in value.values():
            _check_numbers(one)
    elif isinstance(value, list):
        for one in value:
            _check_numbers(one)
    elif isinstance(value, int) and abs(value) >= 10**_MAX_DIGITS:
        raise ValueError(f"a whole number has more than {_MAX_DIGITS} digits")
