"""The unit of the coordinates in a LAS file: from its coordinate system, without a table of such systems.

Source: OGC 01-009, Coordinate Transformation Services, section 7 (WKT); OGC 18-010r7, WKT representation of coordinate
reference systems; OGC 19-008r4, GeoTIFF, sections 7.5 and 7.6 (keys); ASPRS, LAS Specification 1.4-R15, section 3.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

# Keywords of coordinate systems whose two coordinates are lengths, angles, or one of which is a height.
_FLAT = ("PROJCS", "PROJCRS", "PROJECTEDCRS", "LOCAL_CS", "LOCALCS", "ENGCRS", "ENGINEERINGCRS", "GEOCCS")
_ROUND = ("GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS")
_UPRIGHT = ("VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS")
_UNIT = ("UNIT", "LENGTHUNIT")

_KEY_MODEL, _KEY_SYSTEM, _KEY_UNIT, _KEY_UNIT_SIZE, _KEY_HEIGHT_UNIT = 1024, 3072, 3076, 3077, 4099
_MODEL_ROUND = 2
_IN_DOUBLES = 34736  # where a key's value is when it is not in the key
_LENGTHS = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}  # metres, by EPSG code

_TOKEN = re.compile(r'"((?:[^"]|"")*)"|([A-Za-z_][\w]*)\s*[\[(]|([\])])|([^\s,"\[\]()]+)')
_MAX_NODES = 10_000


class LasUnit(NamedTuple):
    """What a coordinate system states."""

    metres_per_unit: float | None = None  # across; None: not stated
    metres_per_height: float | None = None  # None: not stated, which means as across
    is_degrees: bool = False  # across, x and y are longitude and latitude
    epsg: int | None = None  # of a system that is known by its number alone


class LasSystem(NamedTuple):
    """The coordinate system of a file."""

    text: str = ""  # well-known text; empty where the file has none
    unit: LasUnit = LasUnit()


@dataclass
class _Node:
    """KEYWORD["name", 1.0, CHILD[...]]"""

    keyword: str
    values: list[str] = field(default_factory=list)
    children: list["_Node"] = field(default_factory=list)


def read_wkt_unit(text: str) -> LasUnit:
    """The units of a coordinate system in well-known text, version 1 or 2; nothing where it cannot be understood."""
    root = _parse(text)
    flat = next((_unit_of(node) for node in _walk(root) if node.keyword in _FLAT), None)
    upright = next((_unit_of(node) for node in _walk(root) if node.keyword in _UPRIGHT), None)
    is_flat = any(node.keyword in _FLAT for node in _walk(root))
    is_round = any(node.keyword in _ROUND for node in _walk(root))
    return LasUnit(flat, upright, is_round and not is_flat)


def read_key_unit(keys: Sequence[tuple[int, int, int, int]], doubles: Sequence[float]) -> LasUnit:
    """The units of a coordinate system in GeoTIFF keys.

    Args:
        keys: Of each its number, where its value is, how many values it has, and its value or the place of the first.
        doubles: Values that are not in the keys.
    """
    by_number = {number: (place, value) for number, place, _, value in keys}

    def code(number: int) -> int | None:
        place, value = by_number.get(number, (1, 0))
        return value if place == 0 else None

    metres = _LENGTHS.get(code(_KEY_UNIT) or 0)
    place, value = by_number.get(_KEY_UNIT_SIZE, (0, 0))
    if metres is None and place == _IN_DOUBLES and value < len(doubles):
        metres = _checked(doubles[value])
    system = code(_KEY_SYSTEM)
    epsg = system if system is not None and 1024 <= system <= 32766 else None
    return LasUnit(metres, _LENGTHS.get(code(_KEY_HEIGHT_UNIT) or 0), code(_KEY_MODEL) == _MODEL_ROUND, epsg)


def _unit_of(system: _Node) -> float | None:
    """Of the system itself, or in version 2 of its axes; not of those that it is built on, whose unit is an angle."""
    for node in (system, *(child for child in system.children if child.keyword == "AXIS")):
        for child in node.children:
            if child.keyword in _UNIT and len(child.values) >= 2:
                return _checked(child.values[1])
    return None


def _checked(text: str | float) -> float | None:
    try:
        size = float(text)
    except ValueError:
        return None
    return size if 1e-6 <= size <= 1e6 else None


def _parse(text: str) -> _Node:
    """A node that holds all others; brackets that do not fit close what is open."""
    root = _Node("")
    open_nodes = [root]
    for number, match in enumerate(_TOKEN.finditer(text)):
        if number > _MAX_NODES:
            return _Node("")
        quoted, keyword, closing, word = match.groups()
        if keyword is not None:
            node = _Node(keyword.upper())
            open_nodes[-1].children.append(node)
            open_nodes.append(node)
        elif closing is not None:
            if len(open_nodes) > 1:
                open_nodes.pop()
        else:
            open_nodes[-1].values.append(quoted if word is None else word)
    return root


def _walk(node: _Node) -> Iterator[_Node]:
    waiting = [node]
    while waiting:
        node = waiting.pop(0)
        yield node
        waiting.extend(node.children)
