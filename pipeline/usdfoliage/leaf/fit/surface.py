"""Leaves fitted to their points by the closest places of the surface; what is hidden of a leaf as its siblings have it.

First every leaf is fitted under a prior that knows only the median length and width; from the leaves that show
most of their silhouette a prior of the set is learned; then every leaf is fitted under that, either way round and left-
or right-handed, and keeps what explains it best. So a leaf that is half hidden gets the half of its siblings. A leaf
that is about as wide as long is tried along its width too: its halves and its siblings show where the midrib is, which
its extents do not. Our own idea.
"""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.leaf.fit.model import FittedLeaves
from usdfoliage.leaf.fit.prior import LeafPrior, exchange_ends, generic_prior, learn_prior
from usdfoliage.leaf.fit.start import LeafSamples, sample_points, start_poses, thin_samples, turn_across
from usdfoliage.leaf.fit.under_prior import (
    DescentSettings,
    PosedLeaves,
    find_closest_places,
    fit_under_prior,
    version_costs,
)
from usdfoliage.leaf.model import LeafOrigin, Leaves
from usdfoliage.leaf.points import LeafPoints
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_area_elements, grid_places
from usdfoliage.progress import Progress

CELLS_U, CELLS_V = 6, 8  # of a leaf's surface, to measure how much of it has points
EDGE_CELLS = 12  # of either silhouette
STRONGER = 100.0  # how much more folds cost where leaves fold still
MIN_SINGLE = 0.1  # confidence that leaves keep whose edges are nowhere near one silhouette
COMPLETED_BELOW = 0.75  # of a leaf's area: the rest of a leaf with points on less of it is as its siblings have it
STEPS_BACK = 4  # towards the mean leaf, where that did not help

BLADE = 4.0  # widths, as a size; leaves are shorter

Lengths = TypeVar("Lengths", float, NDArray[np.float64])


@dataclass(frozen=True, kw_only=True)
class SurfaceFitSettings:
    """How leaves are fitted, and which fits are given up."""

    interior_points: int = 200  # At most this many points of a leaf's interior are fitted. Range: 1 or more.
    edge_points: int = 100  # At most this many points of a leaf's edge are fitted. Range: 1 or more.
    min_points: int = 20  # A leaf with fewer points is not fitted. Range: 4 or more.
    # All points of a leaf weigh, against the prior, as much as this many independent points at most. Range: above 0.
    evidence: float = 300.0
    # A real leaf lies off the model by this much; smaller noise does not count. Unit: leaf sizes, the root of length
    # by width. Range: above 0.
    misfit: float = 0.015
    # The noise of points of the edge is this multiple of the noise of the interior. Range: above 0.
    edge_noise: float = 1.0
    # Points farther off the surface than this count less. Unit: standard deviations of the noise. Range: above 0.
    cutoff: float = 2.5
    fold_weight: float = 2000.0  # The penalty on leaves that fold over themselves has this weight. Range: 0 or more.
    start_iterations: int = 12  # The first fit runs this many iterations with a third of the points. Range: 1 or more.
    # The fit of each version of the prior runs this many iterations with a quarter of the points. Range: 1 or more.
    choice_iterations: int = 4
    iterations: int = 8  # The fit of the chosen version runs this many iterations. Range: 1 or more.
    rounds: int = 1  # The prior is learned this many times. Range: 1 or more.
    # A leaf is dropped where its points lie farther off the surface on average. Unit: leaf lengths. Range: above 0.
    max_residual: float = 0.08
    # From this width on, the longest extent of the points may be a leaf's width. Unit: leaf lengths. Range: above 0.
    broad: float = 0.5
    # Confidence rises from the first to the second of these shares of the edge that lie on the silhouette. Range: 0
    # to 1, rising.
    lobed: tuple[float, float] = (0.5, 0.85)
    # Confidence falls below this width, because blades of grass look like parts of blades. Unit: leaf lengths. Range:
    # above 0.
    narrow: float = 0.1

    def __post_init__(self) -> None:
        for name in ("interior_points", "edge_points", "start_iterations", "choice_iterations", "iterations", "rounds"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, not {getattr(self, name)}")
        if self.min_points < 4:
            raise ValueError(f"min_points must be at least 4, not {self.min_points}")
        for name in ("evidence", "misfit", "edge_noise", "cutoff", "max_residual", "broad", "narrow"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")
        if not 0 <= self.lobed[0] < self.lobed[1] <= 1:
            raise ValueError(f"lobed must be two shares, the lower first, not {self.lobed}")
        if not (np.isfinite(self.fold_weight) and self.fold_weight >= 0):
            raise ValueError(f"fold_weight must be 0 or more, not {self.fold_weight}")


@dataclass(frozen=True, kw_only=True, eq=False)
class FitQuality:
    """How well N fits explain their points."""

    cost: NDArray[np.float64]  # (N,), robust cost a point, in units of the noise; about 0.5 for a good fit, 3 at most
    explained: NDArray[np.float64]  # (N,), share of the points that lie on the leaf
    covered: NDArray[np.float64]  # (N,), share of the leaf's area that has points
    supported: NDArray[np.float64]  # (N,), share of the silhouette that has points of the edge
    outlined: NDArray[np.float64]  # (N,), share of the points of the edge that lie on the silhouette; 1 without any
    unlikely: NDArray[np.float64]  # (N,), cost of the prior a number; about 0.5 for a leaf like its siblings
    ends_gap: NDArray[np.float64]  # (N,), how much more the leaf costs with base and apex exchanged; 0: not known
    residual_m: NDArray[np.float64]  # (N,), robust root mean square distance of the points


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceFits:
    """N fits, folded or not, good or bad."""

    source: NDArray[np.int64]  # (N,), the number of each in the LeafPoints
    parameters: NDArray[np.float64]  # (N, 7, 3)
    axes: NDArray[np.float64]  # (N, 3, 3), the leaf's x, y and z in the columns
    base_m: NDArray[np.float64]  # (N, 3)
    length_m: NDArray[np.float64]  # (N,)
    quality: FitQuality
    prior: LeafPrior | None  # what was learned of the set; none of no leaves


def fit_leaves_to_surface(
    points: LeafPoints,
    settings: SurfaceFitSettings = SurfaceFitSettings(),
    *,
    threads: int = 0,
    progress: Progress | None = None,
) -> FittedLeaves:
    """Fit a leaf to each of M sets of points.

    All thresholds follow the scale of the points. A leaf's base is the end that is like the bases of the others; the
    wider end of the mean leaf.

    Args:
        threads: At most so many, 0 for one per core; the result does not depend on it.
        progress: Called with how much of the work is done.
    """
    fits = fit_surfaces(points, settings, threads=threads, progress=progress)
    quality = fits.quality
    reasons = {
        "no surface close to the points": ~(quality.residual_m <= settings.max_residual * fits.length_m),
        "folded over itself": find_folds(fits.parameters),
    }
    dropped = {"too few points": len(points) - len(fits.source)}
    kept = np.ones(len(fits.source), bool)
    for reason, failed in reasons.items():
        dropped[reason] = int((failed & kept).sum())
        kept &= ~failed
    parameters = fits.parameters.copy()
    # Points behind the edge pull it past the axis here and there: a leaf has no width less than none.
    parameters[:, 2:5, 1] = np.maximum(parameters[:, 2:5, 1], 0.0)
    leaves = Leaves(
        parameters=parameters,
        base_m=fits.base_m,
        orientation=Rotation.from_matrix(fits.axes).as_quat() if len(fits.axes) else np.zeros((0, 4)),
        length_m=fits.length_m,
        phase=spread_phases(len(fits.source)),
        confidence=_confidence(points.confidence[fits.source], fits, settings),
        residual_m=quality.residual_m,
        view=points.view[fits.source],
        origin=np.where(quality.covered < COMPLETED_BELOW, LeafOrigin.COMPLETED, LeafOrigin.FOUND).astype(np.int32),
    ).take(kept)
    return FittedLeaves(
        leaves=replace(leaves, phase=spread_phases(len(leaves))),
        source=fits.source[kept],
        outlined=quality.outlined[kept],
        dropped={reason: count for reason, count in dropped.items() if count},
    )


def fit_surfaces(
    points: LeafPoints,
    settings: SurfaceFitSettings = SurfaceFitSettings(),
    *,
    threads: int = 0,
    progress: Progress | None = None,
) -> SurfaceFits:
    """The fits of all leaves with points enough, with how good they are; for a segmentation to judge its leaves by."""
    samples = sample_points(points, settings.interior_points, settings.edge_points, settings.evidence)
    counted = (
        np.add.reduceat(np.append(samples.weights > 0, False), samples.offsets[:-1]) if len(points) else np.zeros(0)
    )
    counted = np.where(np.diff(samples.offsets) > 0, counted, 0)
    source = np.flatnonzero(counted >= settings.min_points)
    samples = samples.take(source)
    total = len(source) * (1 + settings.rounds)
    report = progress or (lambda done, of: None)
    if not len(source):
        return _no_fits()

    leaf, state, prior, noise_m = _first_fits(points, samples, source, settings, threads)
    best = _choose(state, leaf, len(source))
    generic = prior
    report(len(source), total)
    ends_gap = np.zeros(len(leaf))
    for number in range(settings.rounds):
        chosen = state.take(best)
        quality = _quality(samples, chosen, noise_m, ends_gap[best], settings, threads)
        prior = learn_prior(chosen.numbers()[_well_seen(quality)], generic)
        noise_m = _noise(quality.residual_m, chosen, settings)
        state, ends_gap = _refit(samples, state, prior, leaf, noise_m, settings, threads)
        best = _choose(state, leaf, len(source))
        report(len(source) * (2 + number), total)
    state, ends_gap = state.take(best), ends_gap[best]
    if _tapers_to_base(prior):
        prior, state = prior.exchanged(), _exchanged(state, np.ones(len(source), bool))
    state = _unfold(samples, state, prior, noise_m, settings, threads)
    return SurfaceFits(
        source=source,
        parameters=state.parameters,
        axes=state.axes,
        base_m=state.base_m,
        length_m=state.length_m,
        quality=_quality(samples, state, noise_m, ends_gap, settings, threads),
        prior=prior,
    )


def _first_fits(
    points: LeafPoints, samples: LeafSamples, source: NDArray[np.int64], settings: SurfaceFitSettings, threads: int
) -> tuple[NDArray[np.int64], PosedLeaves, LeafPrior, NDArray[np.float64]]:
    """Fits under the generic prior, which leaf (S,) each is of, that prior, and the noise (N,) they were made with.

    First one fit of every leaf, then those along the width of the broad ones.
    """
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(np.nan_to_num(points.normals), axis=0)])
    found = start_poses(samples, sums[points.offsets[source + 1]] - sums[points.offsets[source]])
    broad = found.width_m > settings.broad * found.length_m
    leaf = np.concatenate([np.arange(len(source)), np.flatnonzero(broad)])
    poses = found.append(turn_across(found.take(np.flatnonzero(broad))))
    if broad.mean() > 0.5:  # neither of both extents is to be preferred
        typical_m, width = float(np.median(np.sqrt(found.length_m * found.width_m))), 1.0
    else:
        typical_m, width = float(np.median(found.length_m)), float(np.median(found.width_m / found.length_m))
    prior = generic_prior(typical_m, width)
    noise_m = np.full(len(source), 2 * settings.misfit * _size(typical_m, width * typical_m))
    start = PosedLeaves(
        parameters=np.repeat(prior.mean[:21].reshape(1, 7, 3), len(leaf), axis=0),
        axes=poses.axes,
        base_m=poses.base_m,
        length_m=poses.length_m,
        costs=np.zeros((len(leaf), 3)),
    )
    zeros = np.zeros(len(leaf), np.int64)
    descent = _descent(settings, settings.start_iterations)
    state = fit_under_prior(thin_samples(samples, 2), start, prior, leaf, zeros, noise_m, descent, threads=threads)
    return leaf, state, prior, noise_m


def _choose(state: PosedLeaves, leaf: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Which of the fits (S,) of each of count leaves costs least."""
    order = np.lexsort((np.arange(len(leaf)), state.costs.sum(axis=1), leaf))
    return order[np.searchsorted(leaf[order], np.arange(count))]


def _refit(
    samples: LeafSamples,
    state: PosedLeaves,
    prior: LeafPrior,
    leaf: NDArray[np.int64],
    noise_m: NDArray[np.float64],
    settings: SurfaceFitSettings,
    threads: int,
) -> tuple[PosedLeaves, NDArray[np.float64]]:
    """Fits under the prior in the version that suits each, ends as in the prior, and how sure they are."""
    count = len(leaf)
    every = np.arange(count)
    likely = _likely_versions(state, prior)
    tried = fit_under_prior(
        thin_samples(samples, 4),
        state.take(np.tile(every, 2)),
        prior,
        np.tile(leaf, 2),
        likely.ravel(),
        noise_m,
        _descent(settings, settings.choice_iterations),
        threads=threads,
    )
    cost = tried.costs.sum(axis=1).reshape(2, count)
    end = cost.argmin(axis=0)
    best, version = tried.take(end * count + every), likely[end, every]
    descent = _descent(settings, settings.iterations)
    fitted = fit_under_prior(samples, best, prior, leaf, version, noise_m, descent, threads=threads)
    return _exchanged(fitted, end == 1), np.abs(cost[1] - cost[0])


def _likely_versions(state: PosedLeaves, prior: LeafPrior) -> NDArray[np.int64]:
    """(2, N): the hand of either end that suits each leaf as it is; versions 0 and 2 lie as the prior does."""
    cost = version_costs(state.numbers(), prior)
    return np.stack([np.where(cost[2] < cost[0], 2, 0), np.where(cost[3] < cost[1], 3, 1)])


def _descent(settings: SurfaceFitSettings, iterations: int) -> DescentSettings:
    return DescentSettings(
        iterations=iterations,
        edge_noise=settings.edge_noise,
        fold_weight=settings.fold_weight,
        cutoff=settings.cutoff,
    )


def _exchanged(state: PosedLeaves, which: NDArray[np.bool_]) -> PosedLeaves:
    """The same surfaces, with base and apex exchanged where wanted."""
    parameters, axes, base_m = state.parameters.copy(), state.axes.copy(), state.base_m.copy()
    parameters[which] = exchange_ends(parameters[which])
    base_m[which] += state.length_m[which, None] * axes[which, :, 1]
    axes[which, :, :2] *= -1
    return replace(state, parameters=parameters, axes=axes, base_m=base_m)


def _tapers_to_base(prior: LeafPrior) -> bool:
    """Whether the mean leaf is wider towards its apex."""
    feet, widths = prior.mean[6:15:3], prior.mean[7:15:3]
    return bool(np.sum((feet - 0.5) * np.abs(widths)) > 0)


def _well_seen(quality: FitQuality) -> NDArray[np.bool_]:
    """Leaves to learn from: those that show most of their silhouette and fit well."""
    return np.asarray(
        (quality.supported >= np.median(quality.supported)) & (quality.cost <= np.quantile(quality.cost, 0.7))
    )


def _noise(residual_m: NDArray[np.float64], leaves: PosedLeaves, settings: SurfaceFitSettings) -> NDArray[np.float64]:
    """Noise (N,) of the points of each leaf, not far from the median, nor below what the model misses."""
    median_m = np.median(residual_m)
    size_m = _size(leaves.length_m, leaf_width(leaves.parameters) * leaves.length_m)
    return np.asarray(np.maximum(np.clip(residual_m, median_m / 2, median_m * 2), settings.misfit * size_m))


def _size(length_m: Lengths, width_m: Lengths) -> Lengths:
    """By what the model misses leaves: their length, or of blades so many widths."""
    return np.minimum(length_m, BLADE * width_m)


def _quality(
    samples: LeafSamples,
    state: PosedLeaves,
    noise_m: NDArray[np.float64],
    ends_gap: NDArray[np.float64],
    settings: SurfaceFitSettings,
    threads: int,
) -> FitQuality:
    count = len(state.length_m)
    uv, distance_m = find_closest_places(samples, samples.edge, state, threads=threads)
    sizes = np.diff(samples.offsets)
    leaf = np.repeat(np.arange(count), sizes)
    edge = samples.edge > 0
    near = distance_m <= settings.cutoff * noise_m[leaf] * np.where(edge, settings.edge_noise, 1.0)
    cell_u = np.minimum(((uv[:, 0] + 1) / 2 * CELLS_U).astype(int), CELLS_U - 1)
    cell_v = np.minimum((uv[:, 1] * CELLS_V).astype(int), CELLS_V - 1)
    filled = np.zeros((count, CELLS_V, CELLS_U), bool)
    filled[leaf[near], cell_v[near], cell_u[near]] = True
    middles = grid_places((np.arange(CELLS_U) + 0.5) / CELLS_U * 2 - 1, (np.arange(CELLS_V) + 0.5) / CELLS_V)
    areas = evaluate_area_elements(state.parameters, middles, threads=threads)
    supported = np.zeros((count, 2, EDGE_CELLS), bool)
    on_edge = edge & near
    along = np.minimum((uv[on_edge, 1] * EDGE_CELLS).astype(int), EDGE_CELLS - 1)
    supported[leaf[on_edge], (uv[on_edge, 0] > 0).astype(int), along] = True
    ends = np.bincount(leaf[edge], minlength=count)
    outlined = np.where(ends > 0, np.bincount(leaf[on_edge], minlength=count) / np.maximum(ends, 1), 1.0)
    median_m = np.array([np.median(part) for part in np.split(distance_m, samples.offsets[1:-1])])
    weight = np.add.reduceat(samples.weights, samples.offsets[:-1])
    return FitQuality(
        cost=state.costs[:, 0] / np.maximum(weight, 1e-12),
        explained=np.bincount(leaf[near], minlength=count) / sizes,
        covered=(areas * filled.reshape(count, -1)).sum(axis=1) / np.maximum(areas.sum(axis=1), 1e-300),
        supported=supported.mean(axis=(1, 2)),
        outlined=outlined,
        unlikely=state.costs[:, 1] / 22,
        ends_gap=ends_gap,
        residual_m=1.4826 * median_m,
    )


def _unfold(
    samples: LeafSamples,
    state: PosedLeaves,
    prior: LeafPrior,
    noise_m: NDArray[np.float64],
    settings: SurfaceFitSettings,
    threads: int,
) -> PosedLeaves:
    """Fits that fold are fitted again, with folds much dearer; what folds still is taken back towards the mean leaf."""
    folded = np.flatnonzero(find_folds(state.parameters))
    if not len(folded):
        return state
    parameters, axes, base_m, length_m, costs = (
        state.parameters.copy(),
        state.axes.copy(),
        state.base_m.copy(),
        state.length_m.copy(),
        state.costs.copy(),
    )
    dearer = _descent(replace(settings, fold_weight=settings.fold_weight * STRONGER), settings.start_iterations)
    zeros = np.zeros(len(folded), np.int64)
    again = fit_under_prior(samples, state.take(folded), prior, folded, zeros, noise_m, dearer, threads=threads)
    mean = prior.mean[:21].reshape(7, 3)
    repaired = again.parameters.copy()
    for _ in range(STEPS_BACK):
        still = find_folds(repaired)
        repaired[still] = (repaired[still] + mean) / 2
    parameters[folded], axes[folded], base_m[folded] = repaired, again.axes, again.base_m
    length_m[folded], costs[folded] = again.length_m, again.costs
    return PosedLeaves(parameters=parameters, axes=axes, base_m=base_m, length_m=length_m, costs=costs)


def _confidence(given: NDArray[np.float64], fits: SurfaceFits, settings: SurfaceFitSettings) -> NDArray[np.float64]:
    """From 0 to 1: what the segmentation thinks, times what speaks for the fit."""
    quality = fits.quality
    close = 1 / (1 + np.square(quality.residual_m / (2 * settings.misfit * fits.length_m)) / 4)
    seen = 0.4 + 0.3 * quality.covered + 0.3 * quality.supported
    likeness = np.minimum(1.0, 2.0 / np.maximum(quality.unlikely, 1e-9))
    form = rate_form(fits.parameters, quality.outlined, settings)
    return np.asarray(np.clip(given * quality.explained * close * seen * np.sqrt(likeness) * form, 0.0, 1.0))


def rate_form(
    parameters: NDArray[np.float64],
    outlined: NDArray[np.float64] | None,
    settings: SurfaceFitSettings = SurfaceFitSettings(),
) -> NDArray[np.float64]:
    """(N,), 0 to 1: whether leaves (N, 7, 3) are of one lobe and no blades of grass.

    Args:
        outlined: (N,), the share of each leaf's edge that lies on its silhouette; None where that is not known.
        settings: From where on they are.
    """
    wide = np.square(np.minimum(1.0, leaf_width(parameters) / settings.narrow))
    low, high = settings.lobed
    single = 1.0 if outlined is None else np.clip((outlined - low) / (high - low), MIN_SINGLE, 1.0)
    return np.asarray(wide * single)


def _no_fits() -> SurfaceFits:
    none = np.zeros(0)
    quality = FitQuality(**dict.fromkeys(FitQuality.__dataclass_fields__, none))
    return SurfaceFits(
        source=np.zeros(0, np.int64),
        parameters=np.zeros((0, 7, 3)),
        axes=np.zeros((0, 3, 3)),
        base_m=np.zeros((0, 3)),
        length_m=none,
        quality=quality,
        prior=None,
    )
