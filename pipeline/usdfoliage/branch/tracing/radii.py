"""Radii of branches: those of circles where they can be believed, and allometry in between and for thin twigs."""

import logging
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu

from usdfoliage.branch.allometry import AllometrySettings, carried_lengths
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.stem_sections import StemSections

logger = logging.getLogger(__name__)

_TRUNK = (0.03, 0.2)  # of the longest path: where trunks are measured, above the flare of their base
_FEW_SECTIONS = 3  # circles that a trunk must have to be measured
_TRUNK_OF_HEIGHT = 0.01  # radius of a trunk that cannot be measured
_EXPONENT_PRIOR = 0.05  # standard deviation of exponents, of plants of all kinds
_EXPONENT_STEP = 0.005
_BEST_AWAY = 0.1  # of the radius, mean distance of points of a circle that shows the exponent
_LEVEL = 0.5  # of the logarithm of the length that is carried, in which circles count
_LEVEL_CIRCLES = 20  # as so many at most
_ANY = 3.0  # logarithms of radii, over which what is no branch may be
_CHANGED = 1e-9  # of a logarithm
_SMOOTHED = 6  # times, each over the nodes before and after


@dataclass(frozen=True, kw_only=True)
class RadiusSettings:
    """Which circles are believed, and how far radii follow them."""

    allometry: AllometrySettings = field(default_factory=AllometrySettings)
    all_round: float = 0.7  # share of a circle with points, from which on it is believed by itself
    min_seen: float = 0.4  # and where it is as thick as allometry lets expect
    max_away: float = 0.2  # of the radius, mean distance of its points
    certain_seen: float = 0.9  # share of a circle with points, and
    certain_away: float = 0.08  # of the radius, mean distance of them: it is what it is, whatever is expected
    factor: float = 1.6  # by which a circle seen in part may differ from what is expected
    max_apart: float = 0.8  # of the radius, distance between its points
    min_radius_m: float = 0.0005  # of the finest twig
    tolerance: float = 0.1  # of the logarithm of a circle's radius
    exponents: tuple[float, float] = (0.3, 0.7)  # that are possible
    exponent_tolerance: float = 0.2  # of the logarithm of a circle's radius, from what the exponent gives

    def __post_init__(self) -> None:
        if not 0 <= self.min_seen <= self.all_round <= 1:
            raise ValueError(f"0 <= min_seen <= all_round <= 1, not {self.min_seen:g} and {self.all_round:g}")
        if not (self.max_away > 0 and self.min_radius_m > 0 and self.tolerance > 0 and self.factor >= 1):
            raise ValueError("max_away, min_radius_m and tolerance must be above 0, factor at least 1")
        if not (0 < self.exponents[0] < self.exponents[1] and self.exponent_tolerance > 0):
            raise ValueError("exponents must rise from above 0, exponent_tolerance must be above 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class Radii:
    """How thick the nodes are, and by what."""

    radius_m: NDArray[np.float64]  # (S,), never above the parent's
    believed: NDArray[np.bool_]  # (S,), nodes whose circle counted
    exponent: float  # gamma that the circles show
    noise_m: float  # mean distance of points from the believed circles


def estimate_radii(
    center_m: NDArray[np.float64],
    parent: NDArray[np.int32],
    circles: StemSections,
    settings: RadiusSettings = RadiusSettings(),
) -> Radii:
    """Radii that are near the believed circles, change slowly along branches, and follow allometry elsewhere.

    Args:
        center_m: (S, 3), of the nodes.
        parent: (S,), -1 for a root.
        circles: Of the nodes.
        settings: What is believed.
    """
    tree = RootedTree(parent)
    step_m = step_lengths(center_m, parent)
    carried = np.log(carried_lengths(tree, step_m))
    found = _find_round(circles, settings)
    anchor = _measure_trunks(tree, step_m, carried, circles, found, center_m, settings)
    exponent = _fit_exponent(carried, circles, found, anchor, settings)
    expected = anchor[1] + exponent * (carried - anchor[0])
    with np.errstate(invalid="ignore"):
        certain = found & (circles.seen >= settings.certain_seen)
        certain &= circles.away_m < settings.certain_away * circles.radius_m
    believed = certain | (found & _as_expected(circles, expected, settings))
    noise_m = float(np.median(circles.away_m[believed])) if believed.any() else 0.0

    # What circles differ from it by, spread along the tree: a Gauss-Markov field, solved exactly.
    measured = np.zeros(len(parent))
    weight = np.zeros(len(parent))
    measured[believed] = np.log(circles.radius_m[believed]) - expected[believed]
    weight[believed] = 1 / (
        np.square(circles.away_m[believed] / circles.radius_m[believed]) / 4 + settings.tolerance**2
    )
    # A circle through two branches is neither's.
    uncertain = believed & ~certain
    weight[uncertain] /= 1 + (measured[uncertain] / (1.25 * np.log(settings.factor))) ** 4
    own = np.flatnonzero(parent >= 0)
    median_m = float(np.median(step_m[own])) if len(own) else 1.0
    change = 0.06 * np.maximum(step_m[own] / median_m, 0.2) if median_m > 0 else np.full(len(own), 0.06)
    tie = 1 / np.square(change)
    rows, columns = np.concatenate([own, parent[own]]), np.concatenate([parent[own], own])
    ties = coo_array((np.concatenate([tie, tie]), (rows, columns)), shape=(len(parent),) * 2).tocsc()
    matrix = diags_array(ties.sum(axis=1) + weight + 0.2) - ties
    solver = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0, options={"SymmetricMode": True})
    log_radius = _falling(tree, step_m, expected + solver.solve(weight * measured))
    radius_m = np.maximum(np.exp(log_radius), settings.min_radius_m)
    radius_m = _never_growing(tree, radius_m)
    logger.info(
        "%d of %d circles believed, exponent %.2f, noise %.4f m", believed.sum(), len(parent), exponent, noise_m
    )
    return Radii(radius_m=radius_m, believed=believed, exponent=exponent, noise_m=noise_m)


def _falling(tree: RootedTree, step_m: NDArray[np.float64], log_radius: NDArray[np.float64]) -> NDArray[np.float64]:
    """(S,) logarithms that rise nowhere along an axis, least squares, and fall without steps.

    A thin circle does not thin all above it, and where circles contradict each other there is no ring.
    """
    main = tree.first_child(tree.sum_above(step_m))
    head = np.arange(len(tree.parent))
    for level in tree.levels[1:]:
        goes_on = level[main[tree.parent[level]] == level]
        head[goes_on] = head[tree.parent[goes_on]]
    order = np.lexsort((tree.depth, head))
    fallen = log_radius.copy()
    for chain in np.split(order, np.flatnonzero(np.diff(head[order])) + 1):
        if (np.diff(log_radius[chain]) > 0).any():
            fair = isotonic_regression(log_radius[chain], increasing=False).x
            changed = np.abs(fair - log_radius[chain]) > _CHANGED
            for _ in range(
                _SMOOTHED if len(chain) > 2 else 0
            ):  # steps are smoothed between levels, not at forks, where branches do thin
                near = changed[1:-1] | changed[:-2] | changed[2:]
                fair[1:-1] = np.where(near, np.convolve(fair, [0.25, 0.5, 0.25], "valid"), fair[1:-1])
            fallen[chain] = fair
    return fallen


def _never_growing(tree: RootedTree, radius_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(S,) radii that never grow outwards: the mean of the largest below them that do not, and of the smallest above.

    One radius that is too small would drag all that it carries with it, one that is too large all that carry it.
    """
    lower, upper = radius_m.copy(), radius_m.copy()
    for level in tree.levels[1:]:
        lower[level] = np.minimum(lower[level], lower[tree.parent[level]])
    for level in reversed(tree.levels[1:]):
        np.maximum.at(upper, tree.parent[level], upper[level])
    return np.asarray(np.sqrt(lower * upper))


def _find_round(circles: StemSections, settings: RadiusSettings) -> NDArray[np.bool_]:
    """Circles with points near them, close together, on more than one side; noise makes such ones as well."""
    radius_m, away_m = circles.radius_m, circles.away_m
    with np.errstate(invalid="ignore"):
        good = np.isfinite(radius_m) & (away_m < settings.max_away * radius_m) & (radius_m < 4 * circles.spread_m)
        good &= circles.apart_m < settings.max_apart * radius_m
        part = (circles.seen >= settings.min_seen) & (away_m < 0.6 * settings.max_away * radius_m)
    return good & (part | (circles.seen >= settings.all_round))


def _as_expected(circles: StemSections, expected: NDArray[np.float64], settings: RadiusSettings) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.abs(np.log(circles.radius_m) - expected) < np.log(settings.factor))


def _measure_trunks(
    tree: RootedTree,
    step_m: NDArray[np.float64],
    carried: NDArray[np.float64],
    circles: StemSections,
    found: NDArray[np.bool_],
    center_m: NDArray[np.float64],
    settings: RadiusSettings,
) -> tuple[float, float]:
    """What the trunks carry a little above the ground, and their radius there, both as logarithms."""
    main = tree.first_child(tree.sum_above(step_m))
    on_trunk = np.zeros(len(tree.parent), bool)
    at = tree.levels[0]
    while len(at):
        on_trunk[at] = True
        at = main[at][main[at] >= 0]
    path_m = tree.sum_below(step_m)
    reach_m = float(tree.farthest_above(step_m)[tree.levels[0]].max())
    low = on_trunk & (path_m > _TRUNK[0] * reach_m) & (path_m < _TRUNK[1] * reach_m)
    measured = low & found
    if measured.sum() >= _FEW_SECTIONS:
        return float(np.median(carried[measured])), float(np.median(np.log(circles.radius_m[measured])))
    height_m = float(np.ptp(center_m[:, 1]))
    spread_m = circles.spread_m[low & np.isfinite(circles.spread_m)]
    guess_m = _TRUNK_OF_HEIGHT * height_m
    if len(spread_m):  # of points all around a trunk the spread is its radius
        guess_m = float(np.clip(np.median(spread_m), 0.5 * guess_m, 3 * guess_m))
    return float(carried[low].mean() if low.any() else carried.max()), float(
        np.log(max(guess_m, settings.min_radius_m))
    )


def _fit_exponent(
    carried: NDArray[np.float64],
    circles: StemSections,
    found: NDArray[np.bool_],
    anchor: tuple[float, float],
    settings: RadiusSettings,
) -> float:
    """Exponent of the allometry that goes through the trunk: the likeliest one, from the best circles and the settings.

    A circle is that of a branch, or of anything else that looks round. Those of branches that carry about the same
    together count as a few, for most are of few branches, and a trunk has many.
    """
    with np.errstate(invalid="ignore"):
        best = found & (circles.seen >= settings.all_round) & (circles.away_m < _BEST_AWAY * circles.radius_m)
    if best.sum() < _LEVEL_CIRCLES:  # of a sparse cloud they are all that there is
        best = found
    if not best.any():
        return settings.allometry.exponent
    thinner, smaller = carried[best] - anchor[0], np.log(circles.radius_m[best]) - anchor[1]
    low, high = settings.exponents
    exponents = np.linspace(low, high, 1 + max(1, round((high - low) / _EXPONENT_STEP)))
    plausible = -0.5 * np.square((exponents - settings.allometry.exponent) / _EXPONENT_PRIOR)
    level = np.floor((thinner - thinner.min()) / _LEVEL).astype(np.int64)
    share = np.minimum(1, _LEVEL_CIRCLES / np.bincount(level)[level])
    off = (smaller - exponents[:, None] * thinner) / settings.exponent_tolerance
    of_branch = np.exp(-0.5 * np.square(off)) / (np.sqrt(2 * np.pi) * settings.exponent_tolerance)
    plausible += np.log(0.5 * of_branch + 0.5 / _ANY) @ share
    return float(exponents[np.argmax(plausible)])
