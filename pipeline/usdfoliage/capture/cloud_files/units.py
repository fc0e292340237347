"""The unit of a cloud's coordinates: as words name it, or guessed from how large the cloud is."""

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.remarks import Remark, Setting, remark

UNITS: Mapping[str, float] = {"mm": 0.001, "cm": 0.01, "m": 1.0, "ft": 0.3048}  # metres, by the names users give

_WORDS: Mapping[str, float] = {
    **UNITS,
    **{f"{prefix}{base}{plural}": size for prefix, size in (("milli", 0.001), ("centi", 0.01), ("", 1.0))
       for base in ("metre", "meter") for plural in ("", "s")},
    **{"foot": 0.3048, "feet": 0.3048, "inch": 0.0254, "inches": 0.0254},
}  # fmt: skip
# "units metres", "unit: mm", "UNIT=cm", "coordinates in metres"; or the words that a line begins with: "metres, Z up".
_UNIT = re.compile(
    r"\b(?:units?|coordinates)\b(?:\s*[:=]|\s+(?:is|are|in))*\s*([a-z]+)\b|^\s*([a-z]{4,})\b(?=\s*(?:,|$))"
)
_UP = re.compile(
    r"\bup[ _-]?axis\b(?:\s*[:=]|\s+is)*\s*([+-]?)([xyz])\b|(?<![\w+-])([+-]?)([xyz])[ _-](?:axis )?(?:is )?up\b"
)

# Of the largest side of a cloud without a unit; what is smaller or larger is never taken for millimetres.
_MIN_MM, _MAX_MM = 200.0, 60_000.0
_PLANT_SIZED = 2000.0  # below it, both a plant in millimetres and land in metres are common
_LAND_FLATNESS = 0.25  # smallest side over the largest: land of that width, with its trees, is flatter
_TILE_FLATNESS = 0.05  # the same beyond _PLANT_SIZED: land is kilometres wide then
_FAR = 20.0  # of its size: a cloud that far from the origin has coordinates of a map, which are in metres
_FINEST_MM, _COARSEST = 0.05, 0.2  # spacing of points in a scan of a plant: no finer, and no coarser for its size
_LARGEST_PLANT_M = 60.0
_TAILS = 0.002  # share of the points on each side that may be outliers
_SAMPLE = 5000


class GuessedUnit(NamedTuple):
    """A unit that no file states."""

    metres_per_unit: float
    remark: Remark  # on what is assumed


def find_stated_unit(lines: Iterable[str]) -> float | None:
    """Metres per unit as the comments of a file state it, the first that does; None where none does."""
    for line in lines:
        for match in _UNIT.finditer(line.lower()):
            word = match[1] or match[2]
            if word in _WORDS:
                return _WORDS[word]
    return None


def find_stated_up(lines: Iterable[str]) -> str | None:
    """The axis that points up as the comments of a file state it: X, Y or Z with + or -; None where none does."""
    for line in lines:
        match = _UP.search(line.lower())
        if match is not None:
            return (match[1] or match[3] or "+") + (match[2] or match[4]).upper()
    return None


def guess_unit(points: NDArray[np.float64]) -> GuessedUnit:
    """Metres or millimetres, for a cloud of a plant in a file that states no unit.

    Our own rule. Without a reason for millimetres a cloud is in metres. It is in millimetres where its largest side is
    200 to 60,000 units (0.2 to 60 m), and

    - it lies no farther from the origin than 20 times its size: those beyond have coordinates of a map, in metres;
    - it is not as flat as land: below 2,000 units, where a forest plot in metres is as likely as a small plant in
      millimetres, the smallest side is at least a quarter of the largest; above it, where land would be kilometres
      wide, a twentieth;
    - its points are at least 0.05 units apart, finer than which no scan of a plant of that size is, and no more than a
      fifth of its size.

    Sides are measured without the outermost 0.2 % of the points on each side. Centimetres, feet and inches look like
    metres and are never guessed: the remark on a cloud wider than any plant has its width.

    Args:
        points: (N, 3) float, finite, in the file's unit and with the file's origin, in any order; N at least 2.
    """
    low, high = np.quantile(points, [_TAILS, 1 - _TAILS], axis=0)
    sides = np.sort(high - low)
    largest, flatness = float(sides[2]), float(sides[0] / sides[2]) if sides[2] > 0 else 0.0
    away = float(np.linalg.norm((low + high) / 2))
    if _MIN_MM < largest <= _MAX_MM:
        reason = None
        if away > _FAR * largest:
            reason = f"lie {away:,.0f} units from the origin, as on a map"
        elif flatness < (_LAND_FLATNESS if largest < _PLANT_SIZED else _TILE_FLATNESS):
            reason = "are as flat as land"
        else:
            spacing = _median_spacing(points)
            if not _FINEST_MM <= spacing <= _COARSEST * largest:
                reason = f"are {spacing:.3g} units apart"
        if reason is None:
            return _assume(0.001, f"millimetres are assumed, as it is {largest:,.0f} units wide")
        return _assume(1.0, f"metres are assumed, though it is {largest:,.0f} units wide, as its points {reason}")
    if largest > _LARGEST_PLANT_M:
        return _assume(1.0, f"metres are assumed, though it is {largest:,.0f} units wide")
    return _assume(1.0, f"metres are assumed, as it is {largest:.3g} units wide")


def _assume(metres_per_unit: float, why: str) -> GuessedUnit:
    return GuessedUnit(metres_per_unit, remark_unit_assumed(why))


def remark_unit_assumed(why: str) -> Remark:
    """On the unit that is assumed for a cloud whose file states none."""
    remedy = "where that is wrong, set ", Setting(name="capture.toml:metres_per_unit")
    return remark("cloud-unit-assumed", f"the file states no unit, and {why}", remedy=remedy)


def _median_spacing(points: NDArray[np.float64]) -> float:
    """Median distance between neighbouring points, some of them."""
    some = points[:: max(1, len(points) // _SAMPLE)]
    return float(np.median(np.asarray(cKDTree(points).query(some, k=2)[0])[:, 1]))
