"""The pot that a plant stands in: wide, closed all around, not green, and below what is green. Our own.

A trunk is not green either, but narrower; so are the stems of a shrub, and they do not close to a wall.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.isolation.vegetation import MIN_EXCESS
from usdfoliage.remarks import Remark, remark

BESIDE = 1.5  # radii from the axis, within which what is not green and below the rim is the pot
_FEW = 30  # cells of a slab, about which nothing is known


@dataclass(frozen=True, kw_only=True)
class ContainerSettings:
    """What is taken for a container."""

    slabs: int = 48  # of the plant's height
    max_green: float = 0.35  # share of a slab's cells that are green, in a container
    min_green: float = 0.15  # likewise of the whole cloud, without which colours decide nothing
    excess_of_leaves: float = 0.35  # excess of green, for that of the plant's own leaves, from which on a cell is green
    green_above: float = 0.5  # likewise of what is above the container
    min_width: float = 0.15  # of the height
    min_height: float = 0.06  # likewise
    max_height: float = 0.65  # likewise
    slenderness: float = 2.0  # height of a container for its width, at most: trunks are more slender
    sectors: int = 24  # around its axis
    min_closed: float = 0.6  # share of the sectors in which its wall is seen
    max_uneven: float = 0.35  # deviation of the wall's distance from the axis, for its mean
    wall: float = 0.2  # of that distance, in which a wall lies
    min_wall: float = 0.6  # share of the container's cells that lie in its wall: stems stand all over
    soil: float = 0.04  # of the height, above the rim, where what is not green is soil

    def __post_init__(self) -> None:
        if self.slabs < 8 or self.sectors < 6:
            raise ValueError(f"slabs must be at least 8, sectors at least 6, not {self.slabs} and {self.sectors}")
        if not (0 < self.min_height < self.max_height < 1 and self.min_width > 0 and self.slenderness > 0):
            raise ValueError(f"heights must be in (0, 1) and in order, min_width above 0, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Container:
    """A pot."""

    rim_m: float  # its height, on the level that heights were given on
    soil_m: float  # height up to which what is not green is soil, if it is near the axis
    middle_m: NDArray[np.float64]  # (2,), x and z of its axis
    radius_m: float  # up to which soil is looked for
    min_excess: float  # of green, from which on a point is of the plant

    def holds(
        self, points_m: NDArray[np.float64], heights_m: NDArray[np.float64], excess: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """(N,) which points (N, 3) are of it: green ones are leaves that hang over it, or stems."""
        aside_m = np.hypot(*(points_m[:, [0, 2]] - self.middle_m).T)
        # What hangs far beside the pot, and is not green, may be a flower or a leaf of the plant.
        body = (heights_m < self.rim_m) & (aside_m < BESIDE * self.radius_m)
        below = body | ((heights_m < self.soil_m) & (aside_m < self.radius_m))
        return np.asarray(below & (excess <= self.min_excess))


@dataclass(frozen=True, kw_only=True, eq=False)
class ContainerSearch:
    """What was found, or a remark on why not."""

    container: Container | None = None
    remark: Remark | None = None  # None where nothing looks like one


def find_container(
    cells_m: NDArray[np.float64],
    heights_m: NDArray[np.float64],
    excess: NDArray[np.float64],
    settings: ContainerSettings = ContainerSettings(),
) -> ContainerSearch:
    """The container of a plant, if it stands in one.

    Args:
        cells_m: (N, 3), Y up, a point for each cell of a grid, of the plant and what it stands in, without floor.
        heights_m: (N,) over the floor, or over any level.
        excess: (N,) of green, as green_excess gives it.
        settings: What is a container.
    """
    if len(cells_m) < settings.slabs * _FEW // 4:
        return ContainerSearch()
    low_m, high_m = (float(bound) for bound in np.quantile(heights_m, [0.001, 0.999]))
    tall_m = high_m - low_m
    if not tall_m > 0:
        return ContainerSearch()
    green = excess > MIN_EXCESS
    if green.mean() < settings.min_green:
        text = "hardly anything is green, and a pot cannot be separated from the plant"
        return ContainerSearch(remark=remark("isolation-hardly-green", text))
    # Soil in the shade is a little green as well.
    leaves = green & (heights_m > low_m + 0.5 * tall_m)
    median = float(np.median(excess[leaves])) if leaves.any() else 0.0
    min_excess = max(MIN_EXCESS, settings.excess_of_leaves * median)
    green = excess > min_excess
    slab = np.clip(((heights_m - low_m) / tall_m * settings.slabs).astype(np.int64), 0, settings.slabs - 1)
    counts = np.bincount(slab, minlength=settings.slabs)
    greens = np.bincount(slab, green, minlength=settings.slabs)
    bare = counts - greens
    run = 0
    while run < settings.slabs and greens[run] <= settings.max_green * counts[run]:
        run += 1
    # Slabs without enough points decide nothing, and are no container's.
    full = counts[:run] >= max(_FEW, 0.1 * float(np.median(counts[counts > 0])))
    if run < settings.min_height * settings.slabs or full.mean() < 0.7:
        return ContainerSearch()
    above = float(greens[run:].sum()) / max(float(counts[run:].sum()), 1.0)
    if above < settings.green_above or run > settings.max_height * settings.slabs or not bare[:run].any():
        return ContainerSearch()
    inside = (slab < run) & ~green
    flat_m = cells_m[inside][:, [0, 2]]
    middle_m = _find_axis(flat_m)
    beside_m = flat_m - middle_m
    away_m = np.hypot(beside_m[:, 0], beside_m[:, 1])
    sector = ((np.arctan2(beside_m[:, 1], beside_m[:, 0]) / (2 * np.pi) + 0.5) * settings.sectors).astype(np.int64)
    sector = np.minimum(sector, settings.sectors - 1)
    counts = np.bincount(sector, minlength=settings.sectors)
    wall_m = np.zeros(settings.sectors)
    for number in np.flatnonzero(counts):
        wall_m[number] = np.quantile(away_m[sector == number], 0.8)
    seen = counts >= 0.2 * float(counts.mean())
    radius_m = float(np.median(wall_m[seen]))
    # Pots taper: a slab's wall is where the slab is widest.
    of_slab = slab[inside]
    typical_m = np.full(run, radius_m)
    for number in np.unique(of_slab):
        typical_m[number] = np.quantile(away_m[of_slab == number], 0.8)
    width_m, rim_m = 2 * radius_m, run / settings.slabs * tall_m
    if width_m < settings.min_width * tall_m or rim_m > settings.slenderness * width_m:
        return ContainerSearch()
    in_wall = away_m / typical_m[of_slab] >= (1 - settings.wall) * wall_m[sector] / radius_m
    closed, uneven = float(seen.mean()), float(wall_m[seen].std()) / radius_m
    # A lid of soil lies inside the wall, at the top.
    under = of_slab < max(run - 0.15 * settings.slabs, 0.6 * run)
    share = float(in_wall[under].mean()) if under.any() else 0.0
    if closed < settings.min_closed or uneven > settings.max_uneven or share < settings.min_wall:
        text = (
            f"what is below {rim_m / tall_m:.0%} of the height is not green and wide as a pot, but not surely one "
            f"({closed:.0%} closed, {share:.0%} in its wall): it stays"
        )
        return ContainerSearch(remark=remark("isolation-container-unclear", text))
    container = Container(
        rim_m=low_m + rim_m,
        soil_m=low_m + rim_m + settings.soil * tall_m,
        middle_m=middle_m,
        radius_m=1.3 * radius_m,
        min_excess=min_excess,
    )
    return ContainerSearch(container=container)


def _find_axis(flat_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2,) middle of points (N, 2), of which there may be more on the side that was seen better."""
    turns = np.linspace(0, np.pi, 12, endpoint=False)
    axes = np.column_stack([np.cos(turns), np.sin(turns)])
    spans = np.quantile(flat_m @ axes.T, [0.03, 0.97], axis=0).mean(axis=0)
    return np.asarray(np.linalg.lstsq(axes, spans, rcond=None)[0])
