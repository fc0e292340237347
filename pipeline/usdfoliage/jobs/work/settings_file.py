"""Settings as a TOML file: every field of nested frozen dataclasses by its name, each class a table.

A setting that may be None is written as "auto".
"""

import dataclasses
import json
import math
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from usdfoliage.errors import FoliageError
from usdfoliage.files.toml import read_toml
from usdfoliage.jobs.work.field_comments import field_comments
from usdfoliage.jobs.work.renamed_settings import with_new_names

AUTO = "auto"
MAX_COUNT = 1_000_000_000  # of whole numbers but for seeds: compiled code counts in 32 bits
_GIVEN_ONCE = ("seed", "threads")  # for all tables at once, at the top or by an option

Settings = TypeVar("Settings")


@dataclasses.dataclass(frozen=True, kw_only=True)
class SettingText:
    """A line of TOML."""

    text: str
    name: str = ""  # of the setting, with its tables, as list_settings has it; empty where the line is no setting
    value: str = ""  # of the setting, as TOML


def read_settings_file(path: Path, defaults: Settings) -> Settings:
    """Settings with the values of a file in place of the defaults.

    Args:
        path: TOML; what it leaves out stays as it is. Names of the version before are read too, with a warning.
        defaults: A dataclass of numbers, texts, tuples of these and further dataclasses.

    Raises:
        FoliageError: There is no such file, it is no TOML, or it has an unknown setting or a value that cannot be.
    """
    try:
        table = read_toml(path)
    except OSError as error:
        raise FoliageError(f"the settings cannot be read: {error.strerror} ({path})") from error
    except ValueError as error:
        raise FoliageError(f"the settings are no TOML: {error} ({path})") from error
    return _replace(defaults, with_new_names(table, defaults, path), "", path)


def format_settings(settings: object, *, documented: bool = False) -> str:
    """Settings as TOML that read_settings_file takes; documented adds what each setting and each table means."""
    tables: list[list[SettingText]] = []
    _format_table(settings, "", tables, documented)
    return "\n\n".join("\n".join(line.text for line in table) for table in tables) + "\n"


def list_lines(settings: object) -> tuple[SettingText, ...]:
    """The lines of format_settings, with an empty one between two tables."""
    tables: list[list[SettingText]] = []
    _format_table(settings, "", tables, documented=False)
    lines = [line for table in tables for line in (*table, SettingText(text=""))]
    return tuple(lines[:-1])


def list_settings(settings: object) -> dict[str, str]:
    """Every setting's value by its name with the tables before it, such as fit.tolerance."""
    listed: dict[str, str] = {}
    for field in dataclasses.fields(settings):  # type: ignore[arg-type]  # mypy has no name for any dataclass
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value):
            listed.update({f"{field.name}.{name}": text for name, text in list_settings(value).items()})
        else:
            listed[field.name] = format_value(value).strip('"')
    return listed


def _replace(defaults: Any, table: Mapping[str, Any], place: str, path: Path) -> Any:
    types_by_name = typing.get_type_hints(type(defaults))
    names = [field.name for field in dataclasses.fields(defaults)]
    changes: dict[str, Any] = {}
    for name, value in table.items():
        key = f"{place}{name}"
        if name not in names:
            where = f"[{place[:-1]}] has" if place else "there are"
            raise FoliageError(f"there is no setting {key}; {where} {', '.join(names)} ({path})")
        current = getattr(defaults, name)
        if dataclasses.is_dataclass(current):
            if not isinstance(value, dict):
                raise FoliageError(f"{key} is a table, [{key}], not {value!r} ({path})")
            changes[name] = _replace(current, value, f"{key}.", path)
        else:
            changes[name] = _check(value, types_by_name[name], key, path)
    try:
        return dataclasses.replace(defaults, **changes)
    except ValueError as error:
        raise FoliageError(f"{f'[{place[:-1]}] ' if place else ''}{error} ({path})") from error


def _check(value: Any, wanted: Any, key: str, path: Path) -> Any:
    """A value of TOML as its field wants it."""
    origin, inside = typing.get_origin(wanted), typing.get_args(wanted)
    if origin in (typing.Union, types.UnionType):
        if value == AUTO and type(None) in inside:
            return None
        (wanted,) = (kind for kind in inside if kind is not type(None))
        if isinstance(value, str) and wanted is not str:
            raise FoliageError(f'{key} must be {_describe(wanted)} or "{AUTO}", not {value!r} ({path})')
        return _check(value, wanted, key, path)
    if origin is typing.Literal:
        if value not in inside:
            raise FoliageError(f"{key} must be one of {', '.join(map(str, inside))}, not {value!r} ({path})")
        return value
    if origin is tuple:
        kinds = inside[:1] * len(value) if isinstance(value, list) and inside[-1] is Ellipsis else inside
        if not isinstance(value, list) or len(value) != len(kinds):
            raise FoliageError(f"{key} must be a list of {len(kinds)}, not {value!r} ({path})")
        return tuple(_check(one, kind, key, path) for one, kind in zip(value, kinds, strict=True))
    if dataclasses.is_dataclass(wanted):
        return _make(wanted, value, key, path)
    # A bool is an int to Python, and 1 is a float to everybody.
    fits = isinstance(value, wanted) and (wanted is bool or not isinstance(value, bool))
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if wanted is float and isinstance(value, float) and not math.isfinite(value):
        raise FoliageError(f"{key} must be a finite number, not {value!r} ({path})")
    if not fits:
        raise FoliageError(f"{key} must be {_describe(wanted)}, not {value!r} ({path})")
    if wanted is int and abs(value) > MAX_COUNT and key.rpartition(".")[2] != "seed":
        raise FoliageError(f"{key} must be {-MAX_COUNT:,} to {MAX_COUNT:,}, not {value:,} ({path})")
    return value


def _make(wanted: Any, value: Any, key: str, path: Path) -> Any:
    """One of a list of tables: a field without a default must be given."""
    fields = dataclasses.fields(wanted)
    names = {field.name for field in fields}
    needed = {field.name for field in fields if dataclasses.MISSING is field.default is field.default_factory}
    if not isinstance(value, dict) or not needed <= set(value) <= names:
        listed = ", ".join(field.name for field in fields)
        raise FoliageError(f"{key} must be a list of tables with {listed}, not {value!r} ({path})")
    kinds = typing.get_type_hints(wanted)
    try:
        return wanted(**{name: _check(inner, kinds[name], f"{key}.{name}", path) for name, inner in value.items()})
    except ValueError as error:
        raise FoliageError(f"[{key}] {error} ({path})") from error


def _describe(kind: type) -> str:
    return {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}.get(kind, "a table")


def _format_table(settings: Any, place: str, tables: list[list[SettingText]], documented: bool) -> None:
    lines = [SettingText(text=f"[{place}]")] if place else []
    comments = field_comments(type(settings)) if documented else {}  # type: ignore[arg-type]
    if documented:
        lines.insert(0, SettingText(text=f"# {(type(settings).__doc__ or '').splitlines()[0]}"))
    nested = []
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        name = f"{place}.{field.name}" if place else field.name
        if dataclasses.is_dataclass(value):
            nested.append((name, value))
        elif not (documented and place and field.name in _GIVEN_ONCE):
            comment = comments.get(field.name)
            written = format_value(value)
            text = f"{field.name} = {written}{f'  # {comment}' if comment else ''}"
            lines.append(SettingText(text=text, name=name, value=written))
    if len(lines) > documented:
        tables.append(lines)
    for name, value in nested:
        _format_table(value, name, tables, documented)


def format_value(value: Any) -> str:
    if value is None:
        return f'"{AUTO}"'
    if isinstance(value, bool):
        return str(value).lower()
    if dataclasses.is_dataclass(value):
        inside = (f"{field.name} = {format_value(getattr(value, field.name))}" for field in dataclasses.fields(value))
        return f"{{ {', '.join(inside)} }}"
    if isinstance(value, tuple):
        return f"[{', '.join(map(format_value, value))}]"
    if isinstance(value, float):
        return repr(value)  # 1e-06 is TOML too
    if isinstance(value, int):
        return str(value)
    # A JSON text is a TOML text, but for one control character.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def set_everywhere(settings: Settings, name: str, value: object) -> Settings:
    """Settings with every field of this name set, in them and in all below them."""
    changes: dict[str, Any] = {}
    for each in dataclasses.fields(settings):  # type: ignore[arg-type]  # mypy has no name for any dataclass
        current = getattr(settings, each.name)
        if dataclasses.is_dataclass(current):
            changes[each.name] = set_everywhere(current, name, value)
        elif each.name == name:
            changes[name] = value
    return dataclasses.replace(settings, **changes)  # type: ignore[type-var]  # likewise
