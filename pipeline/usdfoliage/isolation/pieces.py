"""Which pieces of a cloud without its floor are of the plant that the photographs are aimed at. Our own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.geometry.point_cells import number_cells, touching_parts
from usdfoliage.isolation.focus import Focus


@dataclass(frozen=True, kw_only=True)
class PieceSettings:
    """What belongs together."""

    gap: float = 0.03  # of the cameras' distance, without points, around what is a piece of its own
    finer: tuple[float, ...] = (1.0, 0.67, 0.45, 0.3)  # of that gap: outliers may bridge it to a wall
    inside: float = 0.8  # share of the main piece that must be about as near to the focus, for a gap to part it
    link_gap: float = 0.1  # likewise, that is bridged to other pieces of the plant: thin stems are seen in parts
    aim: float = 0.25  # likewise, around the focus, where the plant is
    wide: float = 1.4  # of the plant's reach to its sides, within which other pieces may be of it
    low: float = 0.06  # of the cameras' distance over the floor: what does not rise above is remains of the floor
    wide_wall: float = 0.04  # of the cameras' distance, spread of a wall across its longest direction; wood is thin
    leafy: float = 0.3  # share of green cells, from which on a place is one of leaves and not of noise
    stand: float = 0.3  # of the green cells of the largest piece: so many are a plant of its own where it stands

    def __post_init__(self) -> None:
        if not (0 < self.gap <= self.link_gap and self.aim > 0 and self.wide >= 1 and self.low >= 0):
            raise ValueError(f"gap, link_gap and aim must be above 0, the gaps in order, wide at least 1, not {self}")


@dataclass(frozen=True, kw_only=True)
class LyingSettings:
    """What lies on the floor; lengths in layers of the floor, which are as thick as its noise."""

    low: float = 2.5  # up to which a place lies low
    above: float = 8.0  # up to which what stands above it is looked for,
    beside: float = 6.0  # and how far beside it

    def __post_init__(self) -> None:
        if not (0 < self.low < self.above and self.beside > 0):
            raise ValueError(f"low must be above 0 and below above, beside above 0, not {self}")


def find_lying(
    cells_m: NDArray[np.float64],
    heights_m: NDArray[np.float64],
    layer_m: float,
    settings: LyingSettings = LyingSettings(),
) -> NDArray[np.bool_]:
    """(N,) what lies flat on the floor beside a plant, as the floor in its shadow does where depth has more noise.

    What droops to the floor has more of the plant above it nearby; a plant that is as flat all over has no such part.

    Args:
        cells_m: (N, 3), Y up, places of the plant and of what is linked with it.
        heights_m: (N,) over the floor.
        layer_m: Thickness of the floor.
        settings: What lies.
    """
    low = heights_m < settings.low * layer_m
    above = ~low & (heights_m < settings.above * layer_m)
    if not low.any() or not above.any():
        return np.zeros(len(cells_m), bool)
    away_m = np.asarray(cKDTree(cells_m[above][:, [0, 2]]).query(cells_m[low][:, [0, 2]])[0])
    lying = np.zeros(len(cells_m), bool)
    lying[low] = away_m > settings.beside * layer_m
    return lying


def find_plant_pieces(
    cells_m: NDArray[np.float64],
    heights_m: NDArray[np.float64] | None,
    focus: Focus,
    settings: PieceSettings = PieceSettings(),
) -> NDArray[np.bool_]:
    """(N,) what is of the plant: its main piece, large and near the focus, and others that are near these.

    Args:
        cells_m: (N, 3), Y up, a point for each cell of a grid, without the floor.
        heights_m: (N,) over the floor; None where there is none.
        focus: What the photographs are aimed at.
        settings: What belongs together.
    """
    if not len(cells_m):
        return np.zeros(0, bool)
    scale_m = focus.distance_m
    aside_m = np.linalg.norm(cells_m - focus.place_m, axis=1)
    weight = np.exp(-np.square(aside_m / (settings.aim * scale_m)))
    best = (-1.0, np.zeros(len(cells_m), np.int64), 0)
    for finer in settings.finer:
        piece = touching_parts(cells_m, finer * settings.gap * scale_m)
        main = int(np.bincount(piece, weight).argmax())
        share = float((aside_m[piece == main] < settings.inside * scale_m).mean())
        if share > best[0]:
            best = share, piece, main
        if share >= settings.inside:
            break
    _, piece, main = best
    count = int(piece.max()) + 1
    of_plant = np.zeros(count, bool)
    of_plant[main] = True
    main_m = cells_m[of_plant[piece]]
    middle_m = (np.quantile(main_m[:, [0, 2]], 0.02, axis=0) + np.quantile(main_m[:, [0, 2]], 0.98, axis=0)) / 2
    beside_m = np.hypot(*(main_m[:, [0, 2]] - middle_m).T)
    reach_m = settings.wide * float(beside_m.max()) + settings.link_gap * scale_m
    # Walls and the like begin within reach, but do not end there.
    away_m = np.hypot(*(cells_m[:, [0, 2]] - middle_m).T)
    counts = np.bincount(piece)
    may_be = np.bincount(piece, away_m <= reach_m) >= 0.9 * counts
    if heights_m is not None:
        top_m = np.full(count, -np.inf)
        np.maximum.at(top_m, piece, heights_m)
        may_be &= top_m > settings.low * scale_m
    while True:
        tree = cKDTree(cells_m[of_plant[piece]])
        rest = np.flatnonzero((may_be & ~of_plant)[piece])
        if not len(rest):
            break
        gap_m, _ = tree.query(cells_m[rest], distance_upper_bound=settings.link_gap * scale_m)
        linked = np.unique(piece[rest[np.isfinite(gap_m)]])
        if not len(linked):
            break
        of_plant[linked] = True
    return np.asarray(of_plant[piece])


def find_bare_beside(
    cells_m: NDArray[np.float64],
    green: NDArray[np.bool_],
    focus: Focus,
    settings: PieceSettings = PieceSettings(),
) -> NDArray[np.bool_]:
    """(N,) what has no leaves and stands beside all that has leaves, as a wall near a plant does.

    Wood stands below and between its leaves, or begins near the place that the photographs are aimed at, as that of a
    plant in winter does, or is thin. Wrong depth may bridge a wall and a stem, so that what is not green is taken by
    itself.

    Args:
        cells_m: (N, 3), Y up, a point for each cell of a grid, of the plant and of what is linked with it.
        green: (N,) whether a cell is green.
        focus: What the photographs are aimed at.
        settings: What belongs together.
    """
    beside = np.zeros(len(cells_m), bool)
    if not green.any() or green.all():
        return beside
    gap_m = settings.gap * focus.distance_m
    # Single cells of a wall may be green, by noise.
    block = number_cells(cells_m, gap_m)
    is_leafy = green & ((np.bincount(block, green) > settings.leafy * np.bincount(block))[block])
    leafy, bare = np.flatnonzero(is_leafy), np.flatnonzero(~green)
    if not len(leafy):
        return beside
    aside_m = np.hypot(*(cells_m[:, [0, 2]] - focus.place_m[[0, 2]]).T)
    away_m = np.asarray(cKDTree(cells_m[leafy][:, [0, 2]]).query(cells_m[bare][:, [0, 2]])[0])
    piece = touching_parts(cells_m[bare], gap_m)
    nearest_m = np.full(int(piece.max()) + 1, np.inf)
    np.minimum.at(nearest_m, piece, aside_m[bare])
    is_away = 2 * np.bincount(piece, away_m > gap_m) > np.bincount(piece)
    found = is_away & (nearest_m > settings.link_gap * focus.distance_m)
    for number in np.flatnonzero(found):
        found[number] = _second_spread(cells_m[bare[piece == number]]) > settings.wide_wall * focus.distance_m
    beside[bare] = found[piece]
    if beside.any():
        rest = np.flatnonzero(green & ~is_leafy)
        beside[rest] = cKDTree(cells_m[beside]).query(cells_m[rest])[0] <= gap_m
    return beside


def _second_spread(points_m: NDArray[np.float64]) -> float:
    """The standard deviation of points (N, 3) along the second of their principal axes."""
    if len(points_m) < 3:
        return 0.0
    return float(np.sqrt(max(np.linalg.eigvalsh(np.cov(points_m.T))[1], 0.0)))


def count_stands(
    cells_m: NDArray[np.float64],
    heights_m: NDArray[np.float64],
    green: NDArray[np.bool_],
    scale_m: float,
    settings: PieceSettings = PieceSettings(),
) -> int:
    """How many pieces of about equal size stand on the floor, each by itself.

    Args:
        cells_m: (N, 3), Y up, a point for each cell of a grid, of the plant.
        heights_m: (N,) over the floor.
        green: (N,) whether a cell is green.
        scale_m: Distance of the cameras.
        settings: What belongs together.
    """
    if not len(cells_m):
        return 0
    piece = touching_parts(cells_m, settings.gap * scale_m)
    leaves = np.bincount(piece, green)
    foot_m = np.full(len(leaves), np.inf)
    np.minimum.at(foot_m, piece, heights_m)
    stands = (foot_m <= settings.low * scale_m) & (leaves > 0) & (leaves >= settings.stand * leaves.max())
    return int(np.count_nonzero(stands))
