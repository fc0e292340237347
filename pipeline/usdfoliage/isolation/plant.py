"""Which points of a captured cloud are the plant: without what it stands on and in, and what is behind it. Our own."""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.point_cells import cell_means, number_cells, touching_parts
from usdfoliage.isolation.container import Container, ContainerSettings, find_container
from usdfoliage.isolation.focus import Focus, FocusSettings, find_focus
from usdfoliage.isolation.hanging import HangingSettings, find_hanging
from usdfoliage.isolation.pieces import (
    LyingSettings,
    PieceSettings,
    count_stands,
    find_bare_beside,
    find_lying,
    find_plant_pieces,
)
from usdfoliage.isolation.support import Support, SupportSettings, find_support
from usdfoliage.isolation.vegetation import MIN_EXCESS, green_excess
from usdfoliage.remarks import Remark, remark

_COARSE, _FINE = 0.008, 0.004  # of the scale, widths of cells in which the floor, and pieces of the plant, are found
_MAX_POINTS = 3_000_000  # that the floor is looked for in, evenly chosen
_COLOR_CELLS = 1.5  # fine cells, width in which colours are taken together: single pixels of soil may be green
_DIM = 0.05  # of white: about as dark, soil in the shade is of any hue
_FEW = 200  # points, about which nothing is known
_GREEN = 0.3  # of the cells of a part of the plant; the rest is wood and what shows around it
_PART = 0.01  # of the plant's green cells: a green piece within masks that has fewer is wrong depth
_ANOTHER = 0.5  # of the plant's green cells: so many in one piece are another plant, fewer may be lost parts of it
_SPREAD = (0.02, 0.98)  # quantiles that a cloud without focus is measured between


class PointKind(IntEnum):
    """What a point is of."""

    PLANT = 0
    FLOOR = 1
    CONTAINER = 2
    OUTLIER = 3


@dataclass(frozen=True, kw_only=True)
class IsolationSettings:
    """What is left out of a cloud."""

    floor: bool = True
    container: bool = True
    outliers: bool = True
    focus: FocusSettings = field(default_factory=FocusSettings)
    support: SupportSettings = field(default_factory=SupportSettings)
    pieces: PieceSettings = field(default_factory=PieceSettings)
    lying: LyingSettings = field(default_factory=LyingSettings)
    pot: ContainerSettings = field(default_factory=ContainerSettings)
    hanging: HangingSettings = field(default_factory=HangingSettings)


@dataclass(frozen=True, kw_only=True, eq=False)
class IsolatedPlant:
    """What every point is of, and what that was decided by."""

    kind: NDArray[np.uint8]  # (N,), PointKind
    focus: Focus | None
    support: Support | None
    container: Container | None
    remarks: tuple[Remark, ...]  # on what was not found

    @property
    def plant(self) -> NDArray[np.bool_]:
        """(N,)"""
        return np.asarray(self.kind == PointKind.PLANT)

    @property
    def stands_at_m(self) -> float | None:
        """Height, along y, at which the plant comes out of what it stands on or in; None where nothing shows it."""
        if self.focus is None or (self.support is None and self.container is None):
            return None
        middle_m = self.focus.place_m if self.container is None else np.insert(self.container.middle_m, 1, 0.0)
        level_m = float(self.focus.place_m[1])  # that heights are given on
        if self.support is not None:
            level_m = -float(self.support.heights(np.array([[middle_m[0], 0.0, middle_m[2]]]))[0])
        return level_m if self.container is None else level_m + self.container.rim_m

    def share(self, kind: PointKind) -> float:
        return float((self.kind == kind).mean()) if len(self.kind) else 0.0


def isolate_plant(
    points_m: NDArray[np.float64],
    colors: NDArray[np.number],
    positions_m: NDArray[np.float64],
    axes: NDArray[np.float64],
    settings: IsolationSettings = IsolationSettings(),
    within_masks: bool = False,
) -> IsolatedPlant:
    """Separate the plant of a cloud from the floor, its pot, and all that is not linked with it.

    Args:
        points_m: (N, 3), Y up as well as is known.
        colors: (N, 3), red, green and blue, 0 to 255.
        positions_m: (V, 3), where the cameras stand.
        axes: (V, 3), where they look, of length 1.
        settings: What is left out.
        within_masks: Whether the points are those that somebody's masks show. What is green is then of the plant,
            linked or not: the floor between its stems is missing.

    Raises:
        ValueError: Arrays do not fit together.
    """
    if points_m.ndim != 2 or points_m.shape[1] != 3 or colors.shape != points_m.shape:
        raise ValueError(f"points and colours must be (N, 3), not {points_m.shape} and {colors.shape}")
    if positions_m.shape != axes.shape:
        raise ValueError(f"cameras' places and axes must have the same shape, not {positions_m.shape} and {axes.shape}")
    kind = np.full(len(points_m), PointKind.PLANT, np.uint8)
    focus = find_focus(positions_m, axes, settings.focus)
    remarks: list[Remark] = []
    if focus is None:
        text = "the photographs are not aimed at one plant, and all that stands on the ground is taken for it"
        remarks.append(remark("isolation-no-aim", text))
    if len(points_m) < _FEW:
        return IsolatedPlant(kind=kind, focus=focus, support=None, container=None, remarks=tuple(remarks))
    if focus is not None:
        middle_m, scale_m = focus.place_m, focus.distance_m
    else:
        low_m, high_m = np.quantile(points_m, _SPREAD, axis=0)
        middle_m, scale_m = (low_m + high_m) / 2, float(np.linalg.norm(high_m - low_m)) / 4
    support = None
    if settings.floor:
        some = np.linspace(0, len(points_m) - 1, min(len(points_m), _MAX_POINTS)).astype(np.int64)
        coarse = number_cells(points_m[some], _COARSE * scale_m)
        some = some[np.unique(coarse, return_index=True)[1]]
        support = find_support(points_m[some], middle_m, scale_m, settings.support)
        if support is None:
            text = "the plant stands on nothing that stands out as level, and nothing is taken for floor"
            remarks.append(remark("isolation-no-floor", text))
    heights_m = points_m[:, 1] - middle_m[1] if support is None else support.heights(points_m)
    if support is not None:
        kind[heights_m < support.layer_m] = PointKind.FLOOR
    container = None
    excess = np.zeros(0)
    left = np.flatnonzero(kind == PointKind.PLANT)
    if focus is not None and len(left) >= _FEW and (settings.outliers or settings.container):
        cell_m = _FINE * scale_m
        cell = number_cells(points_m[left], cell_m)
        first = np.unique(cell, return_index=True)[1]
        cells_m = points_m[left[first]]
        over_m = heights_m[left[first]]
        of_plant = find_plant_pieces(cells_m, None if support is None else over_m, focus, settings.pieces)
        if support is not None:
            of_plant[of_plant] = ~find_lying(cells_m[of_plant], over_m[of_plant], support.layer_m, settings.lying)
        excess = _smooth_excess(colors[left], number_cells(points_m[left], _COLOR_CELLS * cell_m))
        if within_masks:
            of_plant |= _green_pieces(cells_m, excess[first] > MIN_EXCESS, of_plant, settings.pieces.gap * scale_m)
        if settings.outliers:
            kind[left[~of_plant[cell]]] = PointKind.OUTLIER
            share = _share_of_another(cells_m, over_m, excess[first] > MIN_EXCESS, of_plant, focus, settings.pieces)
            if share > _ANOTHER:
                text = (
                    f"another plant, {share:.0%} as large in the cloud, stands in the photographs and is left out; "
                    "what the photographs are aimed at is taken for the plant"
                )
                remarks.append(remark("isolation-other-plant", text))
        if settings.container:
            search = find_container(cells_m[of_plant], over_m[of_plant], excess[first][of_plant], settings.pot)
            container = search.container
            if search.remark is not None:
                remarks.append(search.remark)
        if settings.outliers and not within_masks:
            at = np.flatnonzero(of_plant)
            if container is not None:
                at = at[~container.holds(cells_m[at], over_m[at], excess[first][at])]
            green = excess[first][at] > MIN_EXCESS
            beside = find_bare_beside(cells_m[at], green, focus, settings.pieces)
            of_plant[at[beside]] = False
            if beside.any():
                text = (
                    f"what has no leaves, is wide and stands beside the plant is left out, {beside.mean():.0%} of both"
                )
                remarks.append(remark("isolation-wall-left-out", text))
            kind[left[~of_plant[cell]]] = PointKind.OUTLIER
            at, green = at[~beside], green[~beside]
            if support is not None and container is None:
                stands = count_stands(cells_m[at], over_m[at], green, focus.distance_m, settings.pieces)
                if stands > 1:
                    text = f"{stands} parts of about equal size stand apart on the ground, and are taken for one plant"
                    remarks.append(remark("isolation-several-stands", text))
        if support is not None and of_plant.any():
            low = np.flatnonzero(kind == PointKind.FLOOR)
            hangs = _find_hanging(
                points_m[low], colors[low], heights_m[low], cells_m[of_plant], support, focus, settings
            )
            kind[low[hangs]] = PointKind.PLANT
            if hangs.any():
                text = (
                    "what is green and hangs over the edge of what the plant stands on, lower than that, is taken for "
                    "part of it"
                )
                remarks.append(remark("isolation-hanging-parts", text))
    if container is not None:
        of_container = container.holds(points_m[left], heights_m[left], excess) & (kind[left] == PointKind.PLANT)
        kind[left[of_container]] = PointKind.CONTAINER
        # What is left of the rim by itself is no leaf.
        left = left[kind[left] == PointKind.PLANT]
        if len(left):
            piece = touching_parts(points_m[left], 0.5 * settings.pieces.gap * scale_m)
            top_m = np.full(int(piece.max()) + 1, -np.inf)
            np.maximum.at(top_m, piece, heights_m[left])
            kind[left[top_m[piece] < container.soil_m]] = PointKind.CONTAINER
    return IsolatedPlant(kind=kind, focus=focus, support=support, container=container, remarks=tuple(remarks))


def _green_pieces(
    cells_m: NDArray[np.float64], green: NDArray[np.bool_], of_plant: NDArray[np.bool_], gap_m: float
) -> NDArray[np.bool_]:
    """(N,) which other cells (N, 3) are of pieces that are green enough, and large enough, to be parts of the plant."""
    found = np.zeros(len(green), bool)
    other = ~of_plant
    if other.any():
        piece = touching_parts(cells_m[other], gap_m)
        count, of_leaves = np.bincount(piece), np.bincount(piece, green[other])
        is_part = (of_leaves >= _GREEN * count) & (of_leaves >= _PART * np.count_nonzero(green & of_plant))
        found[other] = is_part[piece]
    return found


def _share_of_another(
    cells_m: NDArray[np.float64],
    heights_m: NDArray[np.float64],
    green: NDArray[np.bool_],
    of_plant: NDArray[np.bool_],
    focus: Focus,
    settings: PieceSettings,
) -> float:
    """How many cells (N, 3) the largest other plant has among the cameras, relative to those of the plant; 0 for none.

    Behind the cameras, hedges and other trees stand in most photographs.
    """
    scale_m = focus.distance_m
    aside_m = np.hypot(*(cells_m - focus.place_m)[:, [0, 2]].T)
    other = green & ~of_plant & (aside_m < scale_m) & (heights_m > settings.low * scale_m)
    own = int(np.count_nonzero(green & of_plant))
    if not own or not other.any():
        return 0.0
    return float(np.bincount(touching_parts(cells_m[other], settings.gap * scale_m)).max()) / own


def _find_hanging(
    low_m: NDArray[np.float64],
    colors: NDArray[np.number],
    heights_m: NDArray[np.float64],
    plant_m: NDArray[np.float64],
    support: Support,
    focus: Focus,
    settings: IsolationSettings,
) -> NDArray[np.bool_]:
    """(N,) which points (N, 3) that are no higher than the floor hang from the plant's (M, 3)."""
    if not len(low_m):
        return np.zeros(0, bool)
    scale_m = focus.distance_m
    cell = number_cells(low_m, _FINE * scale_m)
    first = np.unique(cell, return_index=True)[1]
    green = _smooth_excess(colors, number_cells(low_m, _COLOR_CELLS * _FINE * scale_m)) > MIN_EXCESS
    hangs = find_hanging(
        low_m[first],
        heights_m[first] > -support.layer_m,
        green[first],
        plant_m,
        focus.place_m,
        scale_m,
        (settings.pieces.gap, settings.pieces.link_gap),
        settings.hanging,
    )
    return np.asarray(hangs[cell] & green)


def _smooth_excess(colors: NDArray[np.number], cell: NDArray[np.int64]) -> NDArray[np.float64]:
    """(N,) excess of green of the mean colour in each point's cell (N,)."""
    return np.asarray(green_excess(cell_means(colors, cell), _DIM)[cell])
