"""Species: how a plant branches and how its leaves stand, from the library of the package and a user's file."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usdfoliage.errors import FoliageError
from usdfoliage.files.toml import read_toml
from usdfoliage.remarks import Argument

LIBRARY = Path(__file__).parent / "species.toml"
GENERIC = "generic"  # what is not known of a species is that of this one

_RANGES: Mapping[str, tuple[float, float]] = {  # as a file has them
    "internode_m": (1e-4, 2.0),
    "roll_deg": (0.0, 360.0),
    "branching_deg": (0.0, 180.0),
    "exponent": (0.1, 2.0),
    "leaves_per_node": (1, 24),
    "divergence_deg": (0.0, 360.0),
    "leaf_length_m": (1e-3, 10.0),
    "leaf_width": (0.02, 1.5),
    "petiole_deg": (0.0, 180.0),
    "droop_deg": (0.0, 180.0),
    "bare_internodes": (0, 100),
    "twig_radius_m": (1e-4, 1.0),
    "shoot_m": (1e-3, 100.0),
}
_WHOLE = ("leaves_per_node", "bare_internodes")
_SLACK = 1e-9  # of a range: degrees come back from radians


@dataclass(frozen=True, kw_only=True)
class Species:
    """Parameters of one species.

    Source:
        J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, table 1 (internode length,
        roll and branching angle, diameter coefficient) and section 5.3 (what leaves are attached by).
    """

    name: str
    internode_m: float  # from a node to the next
    roll_rad: float  # about the parent shoot, from a lateral branch to the next
    branching_rad: float  # between a lateral branch and its parent shoot
    exponent: float  # gamma of the allometry
    leaves_per_node: int  # 1 alternate, 2 opposite, more a whorl
    divergence_rad: float  # about the shoot, from the leaves of a node to those of the next
    leaf_length_m: float  # of a full-grown blade
    leaf_width: float  # in leaf lengths
    petiole_rad: float  # between a leaf and the shoot
    droop_rad: float  # by which a leaf hangs from that direction
    bare_internodes: int  # at the base of a shoot
    twig_radius_m: float  # of the thickest twig with leaves
    shoot_m: float  # from the tip of a branch, as far as it carries leaves
    color: tuple[float, float, float]  # linear Rec.709

    def __post_init__(self) -> None:
        for key, (low, high) in _RANGES.items():
            number = getattr(self, _field_of(key))
            value = math.degrees(number) if key.endswith("_deg") else number
            if not low - _SLACK <= value <= high + _SLACK:  # true for NaN too
                raise ValueError(f"{key} must be {low:g} to {high:g}, not {value:g}")
        if len(self.color) != 3 or not all(0 <= channel <= 1 for channel in self.color):
            raise ValueError(f"color must be three numbers from 0 to 1, not {list(self.color)}")


def load_species(name: str, extra_file: Path | None = None) -> Species:
    """The species of this name, in any case of letters, from the library as a user's file changes it.

    Raises:
        FoliageError: There is no such species, the file cannot be read, or it has values that no species can have.
    """
    library = load_library(extra_file)
    found = library.get(_key_of(name))
    if found is None:
        where = f"the library and {extra_file} have" if extra_file else "the library has"
        raise FoliageError(
            f"there is no species {name!r}; {where} {', '.join(sorted(library))}",
            ("a file for ", Argument(name="species_file"), " adds others"),
        )
    return found


def load_library(extra_file: Path | None = None) -> dict[str, Species]:
    """Every species by its name: those of the package, those of a user's file over them.

    Raises:
        FoliageError: The file cannot be read, or it has values that no species can have.
    """
    tables = _read_tables(LIBRARY)
    common = tables[GENERIC]
    known = {name: {**common, **table} for name, table in tables.items()}
    library = {name: _make_species(name, table, LIBRARY) for name, table in known.items()}
    if extra_file is not None:
        for written, table in _read_tables(extra_file).items():
            name = _key_of(written)
            library[name] = _make_species(name, {**known.get(name, common), **table}, extra_file)
    return library


def describe_species(species: Species) -> str:
    """Every parameter, as a file has it."""
    named = {key: getattr(species, _field_of(key)) for key in _RANGES}
    described = [f"{key} {math.degrees(value) if key.endswith('_deg') else value:g}" for key, value in named.items()]
    return ", ".join([*described, f"color {' '.join(f'{channel:g}' for channel in species.color)}"])


def _key_of(name: str) -> str:
    return re.sub(r"[\s_-]+", "-", name.strip()).lower()


def _field_of(key: str) -> str:
    return f"{key.removesuffix('_deg')}_rad" if key.endswith("_deg") else key


def _read_tables(path: Path) -> dict[str, dict[str, Any]]:
    try:
        tables = read_toml(path)
    except OSError as error:
        raise FoliageError(f"the species cannot be read: {error.strerror} ({path})") from error
    except ValueError as error:
        raise FoliageError(f"the species are no TOML: {error} ({path})") from error
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise FoliageError(f"a species is a table, [{name}], and {name} = {table!r} stands in none ({path})")
        if not _key_of(name):
            raise FoliageError(f"a species has a name, [{name!r}] is none ({path})")
    return tables


def _make_species(name: str, table: Mapping[str, Any], path: Path) -> Species:
    numbers: dict[str, Any] = {}
    for key, value in table.items():
        if key == "color":
            if not isinstance(value, list) or not all(_is_number(channel) for channel in value):
                raise FoliageError(f"species {name}: color must be a list of three numbers, not {value!r} ({path})")
            numbers[key] = tuple(map(float, value))
        elif key not in _RANGES:
            known = ", ".join([*_RANGES, "color"])
            raise FoliageError(f"species {name}: there is no {key}; there are {known} ({path})")
        elif key in _WHOLE and (not isinstance(value, int) or isinstance(value, bool)):
            raise FoliageError(f"species {name}: {key} must be a whole number, not {value!r} ({path})")
        elif not _is_number(value):
            raise FoliageError(f"species {name}: {key} must be a number, not {value!r} ({path})")
        else:
            number = math.radians(value) if key.endswith("_deg") else value
            numbers[_field_of(key)] = number if key in _WHOLE else float(number)
    try:
        return Species(name=name, **numbers)
    except ValueError as error:
        raise FoliageError(f"species {name}: {error} ({path})") from error


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
