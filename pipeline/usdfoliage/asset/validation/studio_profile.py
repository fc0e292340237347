"""The profile of a studio, a TOML file: warnings that it accepts, and rules of its own for assets.

The profile that is shipped, usd_plugins/usdFoliageValidators/studio_profile.toml, explains the tables and keys.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from usdfoliage.asset.resources import resource_folder
from usdfoliage.asset.validation.findings import Acceptance
from usdfoliage.errors import AssetError
from usdfoliage.files.toml import read_toml

SEVERITIES = ("error", "warning")  # of what the rules find


@dataclass(frozen=True, kw_only=True)
class StudioRules:
    """What a studio asks of an asset besides that it is sound; None or nothing where it does not ask."""

    severity: str = "error"
    asset_name: str | None = None  # regular expressions, of the whole name
    prim_name: str | None = None
    kinds: Sequence[str] = ()
    texture_formats: Sequence[str] = ()  # suffixes without the dot
    texture_side_px: int | None = None  # the limits are what is allowed just so
    prims: int | None = None
    points: int | None = None
    faces: int | None = None
    interface_bytes: int | None = None
    asset_bytes: int | None = None
    layers: int | None = None
    meters_per_unit: Sequence[float] = ()
    up_axes: Sequence[str] = ()
    variant_sets: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class StudioProfile:
    """What a studio accepts and what it demands."""

    accepted: Sequence[Acceptance] = ()
    rules: StudioRules = field(default_factory=StudioRules)


# Table, key: the field of StudioRules, and what its value must be.
_KEYS: Mapping[tuple[str, str], tuple[str, str]] = {
    ("rules", "severity"): ("severity", "severity"),
    ("naming", "asset"): ("asset_name", "pattern"),
    ("naming", "prim"): ("prim_name", "pattern"),
    ("kinds", "allowed"): ("kinds", "texts"),
    ("textures", "formats"): ("texture_formats", "texts"),
    ("textures", "largest_side_px"): ("texture_side_px", "count"),
    ("limits", "prims"): ("prims", "count"),
    ("limits", "points"): ("points", "count"),
    ("limits", "faces"): ("faces", "count"),
    ("limits", "interface_bytes"): ("interface_bytes", "count"),
    ("limits", "asset_bytes"): ("asset_bytes", "count"),
    ("limits", "layers"): ("layers", "count"),
    ("metadata", "meters_per_unit"): ("meters_per_unit", "numbers"),
    ("metadata", "up_axis"): ("up_axes", "texts"),
    ("variants", "required"): ("variant_sets", "texts"),
}
_WANTED = {
    "severity": f"one of {', '.join(SEVERITIES)}",
    "pattern": "a regular expression",
    "texts": "a list of texts",
    "count": "a whole number above 0",
    "numbers": "a list of numbers",
}


def default_profile() -> Path:
    """The profile that is shipped with usdfoliage."""
    return resource_folder("usd_plugins/usdFoliageValidators") / "studio_profile.toml"


def read_profile(path: Path) -> StudioProfile:
    """Read the profile of a studio.

    Raises:
        AssetError: The file is missing, no TOML, holds what is not known, or an accepted warning lacks its validator or
            its reason.
    """
    try:
        content = read_toml(path)
    except OSError as error:
        raise AssetError(f"the profile {path} cannot be read: {error.strerror}", "name a TOML file") from error
    except ValueError as error:
        raise AssetError(f"the profile {path} cannot be read: {error}") from error
    return StudioProfile(accepted=_read_accepted(path, content.pop("accepted", [])), rules=_read_rules(path, content))


def _read_rules(path: Path, content: dict[str, Any]) -> StudioRules:
    tables = sorted({table for table, _ in _KEYS})
    rules: dict[str, Any] = {}
    for table, entries in content.items():
        if table not in tables or not isinstance(entries, dict):
            raise AssetError(
                f"the profile {path}: {table} is not known; it may hold [[accepted]] entries and the tables "
                f"{', '.join(f'[{known}]' for known in tables)}"
            )
        for key, value in entries.items():
            if (table, key) not in _KEYS:
                known = ", ".join(name for owner, name in _KEYS if owner == table)
                raise AssetError(f"the profile {path}: [{table}] {key} is not known; it may hold {known}")
            name, kind = _KEYS[table, key]
            if not _is(kind, value):
                raise AssetError(f"the profile {path}: [{table}] {key} must be {_WANTED[kind]}, not {value!r}")
            rules[name] = tuple(value) if isinstance(value, list) else value
    return StudioRules(**rules)


def _is(kind: str, value: object) -> bool:
    if kind == "severity":
        return value in SEVERITIES
    if kind == "pattern":
        try:
            return isinstance(value, str) and re.compile(value) is not None
        except re.error:
            return False
    if kind == "count":
        return isinstance(value, int) and not isinstance(value, bool) and value > 0
    items = value if isinstance(value, list) else None
    wanted: tuple[type, ...] = (str,) if kind == "texts" else (int, float)
    return items is not None and all(isinstance(item, wanted) and not isinstance(item, bool) for item in items)


def _read_accepted(path: Path, entries: object) -> tuple[Acceptance, ...]:
    if not isinstance(entries, list):
        raise AssetError(f"the profile {path}: accepted must be [[accepted]] entries")
    profile = []
    for number, entry in enumerate(entries, 1):
        known = {"validator", "error", "path", "reason"}
        if not isinstance(entry, dict) or set(entry) - known or not all(isinstance(v, str) for v in entry.values()):
            raise AssetError(
                f"the profile {path}, entry {number}: only texts named {', '.join(sorted(known))} are known"
            )
        if not entry.get("validator", "").strip() or not entry.get("reason", "").strip():
            raise AssetError(f"the profile {path}, entry {number}: validator and reason must be given")
        profile.append(Acceptance(**entry))
    return tuple(profile)
