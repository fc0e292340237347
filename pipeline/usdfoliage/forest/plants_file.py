"""plants.toml: which plants a forest has, how often, how tall, and how they are recognized from above."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from usdfoliage.errors import CaptureError
from usdfoliage.files.toml import read_toml
from usdfoliage.forest.kinds import KINDS, PlantKind

KEYS = (
    "species",
    "kind",
    "asset",
    "leaf",
    "share",
    "height_m",
    "color",
    "form",
    "elevation_m",
    "max_slope_deg",
    "water_m",
)
WATER = "water"
TALLEST_M = 150.0


@dataclass(frozen=True, kw_only=True)
class PlantRow:
    """A plant that a forest has: one [[plant]] of the file."""

    species: str
    kind: PlantKind
    asset: Path
    share: float  # of the plants of its kind, those of all rows of the kind sum to 1
    height_m: tuple[float, float]  # the lowest and the tallest
    color: tuple[float, float, float] | None = None  # linear, as the orthophoto shows its crown
    form: float | None = None  # radius of its crown over its height
    elevation_m: tuple[float, float] | None = None  # of the ground that it may stand on
    max_slope_deg: float | None = None  # likewise
    water_m: tuple[float, float] | None = None  # how far from water it may stand, from and to
    leaf: Path | None = None  # picture of a leaf, or an asset of leaves, that its crown has; None for its own


@dataclass(frozen=True, kw_only=True)
class PlantsFile:
    """The whole file."""

    path: Path
    rows: tuple[PlantRow, ...]
    classes: Mapping[int, PlantKind | None]  # what a code of the vegetation raster is; None: no plants
    water: frozenset[int] = frozenset()  # the codes that are water


def read_plants_file(path: Path) -> PlantsFile:
    """Read plants.toml; assets and pictures are looked for from its folder.

    Raises:
        CaptureError: It cannot be read, or a row is wrong; the error names the row.
    """
    try:
        table = read_toml(path)
    except OSError as error:
        raise CaptureError(
            f"{path} cannot be read: {error.strerror}", "name a TOML file with [[plant]] rows"
        ) from error
    except ValueError as error:
        raise CaptureError(f"{path} is no TOML: {error}") from error
    unknown = sorted(set(table) - {"plant", "classes"})
    if unknown:
        raise CaptureError(f"{path} has an unknown table {unknown[0]}", "it may have [[plant]] rows and [classes]")
    rows = table.get("plant", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise CaptureError(f"plant in {path} is no list of tables", "begin each row with [[plant]]")
    if not rows:
        raise CaptureError(f"{path} has no [[plant]] row", "add one for each plant of the forest")
    read = [_read_row(row, number + 1, path) for number, row in enumerate(rows)]
    classes = table.get("classes", {})
    water = frozenset(int(code) for code, kind in classes.items() if kind == WATER) if isinstance(classes, dict) else ()
    file = PlantsFile(
        path=path, rows=_normalized(read, path), classes=_read_classes(classes, path), water=frozenset(water)
    )
    for number, row in enumerate(file.rows):
        if row.water_m is not None and not file.water:
            raise CaptureError(
                f"row {number + 1} ({row.species}) of {path} has water_m, and no class is water",
                'name the code of water in the raster of vegetation: [classes], then 9 = "water"',
            )
    return file


def _read_row(row: Mapping[str, Any], number: int, path: Path) -> PlantRow:
    name = row.get("species")
    place = f"row {number}{f' ({name})' if isinstance(name, str) and name else ''} of {path}"
    unknown = sorted(set(row) - set(KEYS))
    if unknown:
        raise CaptureError(f"{place} has an unknown key {unknown[0]}", f"the keys are {', '.join(KEYS)}")
    for key in ("species", "kind", "asset"):
        if not isinstance(row.get(key), str) or not row[key].strip():
            raise CaptureError(f"{place} has no {key}", f'add {key} = "…"')
    if row["kind"] not in KINDS:
        raise CaptureError(f"{place} has the kind {row['kind']!r}", f"the kinds are {', '.join(KINDS)}")
    leaf = row.get("leaf")
    if leaf is not None and (not isinstance(leaf, str) or not leaf.strip()):
        raise CaptureError(f"{place} has leaf that is no path", 'name a picture of one leaf: leaf = "oak_leaf.png"')
    share = _number(row, "share", place, 1.0)
    if not share >= 0:
        raise CaptureError(f"{place} has the share {share:g}", "a share is 0 or more")
    height_m = _range(row, "height_m", place)
    if height_m is None or not 0 < height_m[0] <= height_m[1] <= TALLEST_M:
        raise CaptureError(
            f"{place} has no usable height_m",
            f"write the lowest and the tallest in metres, above 0 and up to {TALLEST_M:g}: height_m = [5, 13]",
        )
    form = _number(row, "form", place, None)
    if form is not None and not 0.01 <= form <= 10:
        raise CaptureError(f"{place} has the form {form:g}", "it is the crown's radius over the height, .01 to 10")
    slope = _number(row, "max_slope_deg", place, None)
    if slope is not None and not 0 <= slope <= 90:
        raise CaptureError(f"{place} has max_slope_deg {slope:g}", "a slope is 0 to 90 degrees")
    elevation_m = _range(row, "elevation_m", place)
    if elevation_m is not None and not elevation_m[0] <= elevation_m[1]:
        raise CaptureError(f"{place} has elevation_m {list(elevation_m)}", "write the lowest first")
    water_m = _range(row, "water_m", place)
    if water_m is not None and not 0 <= water_m[0] <= water_m[1]:
        raise CaptureError(f"{place} has water_m {list(water_m)}", "write two distances from 0 on, the nearer first")
    return PlantRow(
        species=row["species"].strip(),
        kind=PlantKind(row["kind"]),
        asset=path.parent / row["asset"],
        share=share,
        height_m=height_m,
        color=_read_color(row, place),
        form=form,
        elevation_m=elevation_m,
        max_slope_deg=slope,
        water_m=water_m,
        leaf=None if leaf is None else path.parent / leaf,
    )


def _read_color(row: Mapping[str, Any], place: str) -> tuple[float, float, float] | None:
    color = row.get("color")
    if color is None:
        return None
    good = isinstance(color, list) and len(color) == 3 and all(_is_number(each) and each >= 0 for each in color)
    if not good or not sum(color) > 0:
        raise CaptureError(
            f"{place} has no usable color", "write three linear values, 0 or more: color = [.1, .15, .05]"
        )
    return float(color[0]), float(color[1]), float(color[2])


def _range(row: Mapping[str, Any], key: str, place: str) -> tuple[float, float] | None:
    value = row.get(key)
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2 or not all(_is_number(each) for each in value):
        raise CaptureError(f"{place} has {key} that is no range", f"write two numbers: {key} = [5, 13]")
    return float(value[0]), float(value[1])


def _number(row: Mapping[str, Any], key: str, place: str, default: Any) -> Any:
    value = row.get(key, default)
    if value is not default and not _is_number(value):
        raise CaptureError(f"{place} has {key} that is no number")
    return value if value is default else float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _normalized(rows: list[PlantRow], path: Path) -> tuple[PlantRow, ...]:
    """Rows whose shares sum to 1 for each kind."""
    totals = {kind: sum(row.share for row in rows if row.kind == kind) for kind in PlantKind}
    for row in rows:
        if not totals[row.kind] > 0:
            raise CaptureError(f"the shares of kind {row.kind} in {path} sum to 0", "give one of them a share")
    return tuple(replace(row, share=row.share / totals[row.kind]) for row in rows)


def _read_classes(table: Any, path: Path) -> dict[int, PlantKind | None]:
    """The four codes that are always known, and those of the file."""
    classes: dict[int, PlantKind | None] = {0: None, 1: PlantKind.TREE, 2: PlantKind.SHRUB, 3: PlantKind.GRASS}
    if not isinstance(table, dict):
        raise CaptureError(f"classes in {path} is no table", 'write [classes], then 7 = "tree"')
    for code, kind in table.items():
        if not (code.isascii() and code.isdigit() and len(code) <= 9) or kind not in (*KINDS, WATER, "none"):
            raise CaptureError(
                f"[classes] of {path} has {code} = {kind!r}",
                f'write a code and one of {", ".join(KINDS)}, water or none: 7 = "tree"',
            )
        classes[int(code)] = None if kind in (WATER, "none") else PlantKind(kind)
    return classes
