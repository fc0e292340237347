"""Which way is up in the cloud of one plant: by its trunk and the ground it stands on, else as in most files.

Our own rules. The cloud is looked at as cells of a grid, so that neither the order of the points counts, nor how
densely a scanner saw the plant's parts.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from usdfoliage.geometry.up_turn import AXES, axis_vector, parse_axis

Grid = NDArray[np.bool_]  # (A, B, H), cells with points; the last axis goes up

_CELLS = 64  # along the mean side
_MAX_CELLS = 256  # along the largest
_TAIL = 0.0005  # share of the points on each side that may be outliers
# Evidence that is believed, of a direction by how common it is.
_CLEAR_EXPECTED, _CLEAR_Y, _CLEAR_OTHER, _CLEAR_AGAINST_FORMAT = 0.3, 0.4, 0.45, 0.6
_LEAD = 0.15  # of it over the next best
_SURE = 0.5

_GROUND_BAND = 2  # cells that the ground may be off its plane, to each side
_GROUND_SHARE = 0.5  # of the columns, that the ground fills at least: a plant does not reach far beyond it
_BARE_SHARE = 0.3  # of the columns with nothing above the ground, from which on more of them are no better evidence
_STEEPEST = 0.5  # ground, height over width
_EVEN = 0.7  # share of the ground's columns that are off by half of that at most: bark seen from the side is round
_MAX_BELOW = 0.03  # share of the columns whose lowest cell may be below the ground
_STRIP = 0.3  # of its length, up to which ground is none: bark of a trunk that was cut out, seen from the side
_TRUNK_WIDTH = 0.25  # of the plant's width, that a trunk has at most
_TRUNK_SHARE = 0.2  # of the cells of the fullest slabs, that a trunk's slab has at most
_TRUNK_LENGTH = 0.25  # of the height, from which on a trunk is no better evidence
_TIP_LENGTH = 0.05  # of the height, up to which it is none: tips of crowns and branches are as thin for so long
_GROWTH = 1.6  # of a trunk's width above that at its end, at most: a treetop's grows without end
_UNBROKEN = 0.6  # share of the slabs of a trunk that were seen at all
_POLE = 0.2  # of its length, that a trunk seen from the side is thick at most
_FOOT = 0.2  # of the height, up to which what is wide at one end may be the foot of a trunk that was cut out,
_TAPER = 1.1  # if the trunk is so much wider towards it
_MIN_WIDTH = 2.5  # cells, of anything seen through a grid


@dataclass(frozen=True, kw_only=True, eq=False)
class CloudUp:
    """The axis that points up."""

    axis: NDArray[np.float64]  # (3,), unit, one of ±X, ±Y, ±Z of the cloud
    how: str  # a phrase for the user: by what it was found, and what speaks against it
    sure: bool  # False: worth a look
    rare: bool = False  # it was found, and is another one than nearly all files have, +Z or +Y


class _Trunk(NamedTuple):
    """What may be a trunk."""

    clear: float  # 0 to 1
    width: float  # in cells


class _Evidence(NamedTuple):
    """What speaks for one direction."""

    trunk: float  # 0 to 1
    ground: float  # 0 to 1

    @property
    def total(self) -> float:
        return self.trunk + self.ground

    @property
    def text(self) -> str:
        named = [name for name, value in (("a trunk", self.trunk), ("the ground", self.ground)) if value >= _LEAD]
        return " and ".join(named) or "its shape"


def find_cloud_up(points_m: NDArray[np.float64], stated: str | None = None, format_up: str | None = None) -> CloudUp:
    """Find which axis of a cloud is up.

    For each of the six directions two things are looked for at its lower end. A trunk: slabs that hold few cells, close
    together, of a width that does not shrink towards the end as that of a treetop does; the longer, the better. Where
    the fullest slabs are themselves a trunk, seen from the side, there is none; nor where hardly more than a trunk was
    cut out, and what is wide at one end may be its foot. The ground: a thin plane of cells below half the plant or
    more, no narrow strip, sloped by no more than 27°, with nothing below it and parts of it bare. A plant without
    either, such as a hedge that was cut out, gives no evidence: then Z is up.

    Args:
        points_m: (N, 3) float, finite, of a single plant, in any order; N at least 1.
        stated: The axis that the user or the file states is up, X, Y or Z with or without + or -. It is followed; where
            the evidence is clearly against it, there is a warning.
        format_up: The axis that is up in files of this kind; evidence must be clearer to be believed against it.

    Raises:
        ValueError: points_m is not (N, 3), or an axis is none.
    """
    if points_m.ndim != 2 or points_m.shape[1] != 3 or not len(points_m):
        raise ValueError(f"points_m must be (N, 3), not {points_m.shape}")
    prior = parse_axis(format_up) if format_up is not None else "+Z"
    grid = _fill_grid(points_m)
    evidence = _find_evidence(grid)
    ranked = sorted(AXES, key=lambda axis: (-evidence[axis].total, axis != prior, axis))
    best, second = ranked[0], ranked[1]
    lead = evidence[best].total - evidence[second].total
    if best == prior:
        needed = _CLEAR_EXPECTED
    elif format_up is not None:
        needed = _CLEAR_AGAINST_FORMAT
    else:
        needed = _CLEAR_Y if best == "+Y" else _CLEAR_OTHER
    is_clear = evidence[best].total >= needed and lead >= _LEAD
    is_sure = is_clear and evidence[best].total >= _SURE
    if stated is not None:
        axis = parse_axis(stated)
        if is_clear and best != axis:
            return CloudUp(
                axis=axis_vector(axis),
                how=f"{axis} as stated, but {evidence[best].text} indicates {best}: it may lie or stand upside down",
                sure=False,
            )
        return CloudUp(axis=axis_vector(axis), how=f"{axis} as stated", sure=True)
    if is_clear:
        how = f"{best} by {evidence[best].text}"
        return CloudUp(axis=axis_vector(best), how=how, sure=is_sure, rare=best not in ("+Z", "+Y"))
    reason = "as in most such files" if format_up is not None else "assumed"
    return CloudUp(
        axis=axis_vector(prior),
        how=f"{prior} {reason}; neither a trunk nor the ground shows it clearly",
        sure=format_up is not None,
    )


def _fill_grid(points_m: NDArray[np.float64]) -> Grid:
    """Cells that hold points, cubes as large as a 64th of the cloud's mean side, the geometric one."""
    low, high = np.quantile(points_m, [_TAIL, 1 - _TAIL], axis=0)
    sides = high - low
    if not sides.max() > 0:
        return np.ones((1, 1, 1), bool)
    cell_m = max(float(np.cbrt(np.prod(sides))) / _CELLS, float(sides.max()) / _MAX_CELLS)
    # About the middle, so that a cloud turned upside down has the same cells.
    reach = np.ceil(sides / cell_m / 2).astype(np.int64) + 1
    cells = np.floor((points_m - (low + high) / 2) / cell_m).astype(np.int64) + reach
    cells = cells[((cells >= 0) & (cells < 2 * reach)).all(axis=1)]
    grid = np.zeros(2 * reach, bool)
    grid[tuple(cells.T)] = True
    filled = np.argwhere(grid)
    return grid[tuple(slice(a, b) for a, b in zip(filled.min(axis=0), filled.max(axis=0) + 1, strict=True))]


def _seen_along(grid: Grid, axis: str) -> Grid:
    """The grid with this axis as its last, from below to above."""
    turned = np.moveaxis(grid, "XYZ".index(axis[1]), 2)
    return turned if axis[0] == "+" else turned[:, :, ::-1]


def _find_evidence(grid: Grid) -> dict[str, _Evidence]:
    """What speaks for each of the six axes."""
    grounds, trunks = {}, {}
    for axis in AXES:
        seen = _seen_along(grid, axis)
        is_ground, grounds[axis] = _find_ground(seen)
        trunks[axis] = _find_trunk(seen & ~is_ground)
    evidence = {}
    for axis, trunk in trunks.items():
        # Of two that may be the trunk, at either end, the thinner is the tip.
        end = trunks[("-" if axis[0] == "+" else "+") + axis[1]]
        thickest = max(trunk.width, end.width if 4 * end.clear >= trunk.clear else 0.0)
        thin = min(1.0, trunk.width / thickest) if thickest > 0 else 1.0
        evidence[axis] = _Evidence(trunk.clear * thin, grounds[axis])
    return evidence


def _find_ground(grid: Grid) -> tuple[Grid, float]:
    """Cells of the ground at the lower end, and how clear it is, 0 to 1."""
    none = np.zeros_like(grid), 0.0
    filled = np.asarray(grid.any(axis=2))
    if np.count_nonzero(filled) < _CELLS or grid.shape[2] < 6 * _GROUND_BAND:
        return none
    if _is_pole(filled, grid.shape[2], _STRIP):
        return none
    columns = np.argwhere(filled)
    lowest = grid.argmax(axis=2)[filled].astype(np.float64)
    design = np.column_stack([columns, np.ones(len(columns))])
    plane = np.array([0.0, 0.0, np.quantile(lowest, 0.1)])
    band = 3.0 * _GROUND_BAND  # wide first, for a slope
    for _ in range(6):
        near = np.abs(lowest - design @ plane) <= band
        if np.count_nonzero(near) < _CELLS:
            return none
        plane = np.linalg.lstsq(design[near], lowest[near], rcond=None)[0]
        band = max(band * 0.7, float(_GROUND_BAND))
    if np.hypot(plane[0], plane[1]) > _STEEPEST:
        return none
    away = lowest - design @ plane
    if np.mean(away < -_GROUND_BAND - 1) > _MAX_BELOW:
        return none
    heights = np.arange(grid.shape[2])
    above = heights - (design @ plane)[:, None]
    cells = grid[filled]
    on_plane = np.abs(away) <= _GROUND_BAND
    bare = on_plane & ~(cells & (above > _GROUND_BAND)).any(axis=1)
    is_even = np.count_nonzero(np.abs(away) <= _GROUND_BAND / 2) >= _EVEN * np.count_nonzero(on_plane)
    if np.mean(on_plane) < _GROUND_SHARE or not is_even or bare.all():
        return none
    is_ground = np.zeros_like(grid)
    is_ground[filled] = cells & (np.abs(above) <= _GROUND_BAND)
    return is_ground, min(1.0, float(np.mean(bare)) / _BARE_SHARE)


def _find_trunk(grid: Grid) -> _Trunk:
    """A trunk at the lower end."""
    filled = np.flatnonzero(grid.any(axis=(0, 1)))
    if not len(filled):
        return _Trunk(0.0, 0.0)
    grid = grid[:, :, filled[0] : filled[-1] + 1]
    height = grid.shape[2]
    counts = median_filter(grid.sum(axis=(0, 1)), 3, mode="nearest")
    widths = median_filter([_width(grid[:, :, level]) for level in range(height)], 3, mode="nearest")
    full, wide = (float(np.sort(values)[-max(1, height // 20) :].mean()) for values in (counts, widths))
    fullest = np.argsort(counts, kind="stable")[-max(1, height // 20) :]
    if _is_pole(np.asarray(grid[:, :, fullest].any(axis=2)), height):
        return _Trunk(0.0, 0.0)
    thin = (counts <= max(_TRUNK_SHARE * full, 1)) & (widths <= max(_TRUNK_WIDTH * wide, _MIN_WIDTH))
    # The foot may be wider: roots, grass, what is left of the ground. The trunk begins where it is longest.
    run, width, begin = 0, 0.0, 0
    for start in np.flatnonzero(thin[: max(2, height // 16) + 1]):
        first = max(float(np.median(widths[start : start + max(3, height // 20)])), _MIN_WIDTH)
        rest = thin[start:] & (widths[start:] <= _GROWTH * first)
        length = len(rest) if rest.all() else int(np.argmin(rest))
        if length > run and np.mean(counts[start : start + length] > 0) >= _UNBROKEN:
            run, width, begin = length, first, int(start)
    reach = height if thin[begin:].all() else begin + int(np.argmin(thin[begin:]))
    if reach >= (1 - _FOOT) * height and _widens(counts[begin:reach]):
        return _Trunk(0.0, 0.0)
    share = 2 * run / (height + max(grid.shape))  # a branch that reaches out is short for the whole plant
    return _Trunk(float(np.clip((share - _TIP_LENGTH) / (_TRUNK_LENGTH - _TIP_LENGTH), 0, 1)), width)


def _widens(counts: NDArray[np.int64]) -> bool:
    """Whether slabs of so many cells (L,) are wider in the last third than in the first: the first is not the foot."""
    third = len(counts) // 3
    return third > 0 and bool(np.median(counts[-third:]) > _TAPER * np.median(counts[:third]))


def _is_pole(slab: Grid, height: int, pole: float = _POLE) -> bool:
    """Whether the cells of a slab (A, B) are a trunk seen from the side, longer than the plant is high this way up.

    What looks like a trunk below it is a branch then.
    """
    cells = np.argwhere(slab).astype(np.float64)
    if len(cells) < 2:
        return False
    spread = np.linalg.eigvalsh(np.cov(cells.T))
    thickness, length = np.sqrt(12 * np.maximum(spread, 0)) + 1  # of a bar, evenly filled
    return bool(length > height and thickness < pole * length)


def _width(slab: Grid) -> float:
    """Of the cells of a slab (A, B), across: of a full disk its diameter; 1 for one cell, 0 for none."""
    cells = np.argwhere(slab).astype(np.float64)
    if not len(cells):
        return 0.0
    spread = np.square(cells - cells.mean(axis=0)).sum(axis=1).mean()
    return float(np.sqrt(8 * spread)) + 1
