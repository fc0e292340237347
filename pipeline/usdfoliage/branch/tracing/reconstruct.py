"""From the cloud of a plant to the skeleton of its branches."""

import logging
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree
from usdfoliage.branch.tracing.attachments import settle_attachments
from usdfoliage.branch.tracing.cloud_graph import CloudGraph, CloudGraphSettings, link_points
from usdfoliage.branch.tracing.cut_ends import straighten_cut_ends
from usdfoliage.branch.tracing.gaps import find_beyond_gaps
from usdfoliage.branch.tracing.meeting_fronts import FrontSettings, join_fronts
from usdfoliage.branch.tracing.radii import Radii, RadiusSettings
from usdfoliage.branch.tracing.refinement import RefinementSettings, refine_branches
from usdfoliage.branch.tracing.sections import SectionTree, cut_sections, find_paths
from usdfoliage.branch.tracing.spurs import absorb_spurs, find_spurs
from usdfoliage.branch.tracing.traced_axes import as_skeleton, trace_axes
from usdfoliage.branch.tracing.wood import WoodSettings, caution_with_colors, choose_wood, shows_leaves, wood_odds
from usdfoliage.branch.tracing.wood_colors import blur_colors, color_odds
from usdfoliage.geometry.point_cells import cell_means, one_in_each_cell
from usdfoliage.progress import StepProgress

logger = logging.getLogger(__name__)

_SIXTH = 6  # neighbour whose distance is taken for the spacing of points
_SAMPLE = 20_000  # points of which it is taken
_HANGS_TOGETHER = 1.6  # distances to the sixth neighbour, that a slice of a thick stem must be thick
_FOOT = 1.6  # distances to the sixth neighbour, height of the foot of a stem
_FOOT_POINTS = 20  # that its width is measured from
_FOOT_GAP = 4.0  # distances to the sixth neighbour, beyond which points beside a foot are of something else
_WITHIN = 1.2  # radii of a thick branch from its axis, where all points are of it
_FLARE = 0.7  # of its radius, that a stem may be thicker at its foot on one side,
_FLARES = 4.0  # radii of it, up to which that fades
_NEAR_BELIEVED = 3  # nodes from a believed circle, that are as thick as is thought

CloudLeaves = Literal["auto", "on", "off"]  # whether a cloud has leaves: found from the cloud, yes, no


@dataclass(frozen=True, kw_only=True)
class BranchSettings:
    """How a cloud becomes a skeleton. Lengths without a unit are internodes, or what their comment states."""

    internode_m: float | None = None  # without it from the height
    internode_of_height: float = 0.005  # table 2: 5 cm in a box of 10 m
    graph: CloudGraphSettings = field(default_factory=CloudGraphSettings)
    path_power: float = 2.0  # of a link's length, that it costs
    coarse: float = 2.0  # internodes, thickness of a slice in which thick stems are found
    fine: float = 0.21  # internodes, thickness of a slice
    fine_spacings: float = 1.6  # distances to the sixth neighbour, thickness of a slice at most
    fine_noises: float = 2.5  # mean distances of points from a stem's surface, thickness of a slice at least
    sparse: float = 0.6  # internodes, that points are apart from where on each of them may be a twig's only one
    sparse_spacings: float = 0.14  # distances to the sixth neighbour, thickness of a slice there,
    wood_spacings: float = 0.03  # and where all points are taken for wood, known to be or not
    wood_stiffness: float = 0.3  # of axes there: slices have few points, which are all that is known of a twig
    stem_share: float = 0.3  # of the radius of a thick stem, thickness of its slices
    min_length: float = 1.0  # slices, that a branch must reach beyond its parent's surface
    max_gap: float = 1.0  # of the path beyond it, that a gap between a branch and the rest may be long
    stiffness: float = 4.0
    radii: RadiusSettings = field(default_factory=RadiusSettings)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    fronts: FrontSettings = field(default_factory=FrontSettings)
    leaves: CloudLeaves = "auto"
    wood: WoodSettings = field(default_factory=WoodSettings)

    def __post_init__(self) -> None:
        if self.internode_m is not None and not (np.isfinite(self.internode_m) and self.internode_m > 0):
            raise ValueError(f"internode_m must be above 0, not {self.internode_m:g}")
        if not (self.path_power >= 1 and self.coarse > 0 and self.fine > 0 and self.min_length >= 0):
            raise ValueError("path_power must be at least 1, coarse and fine above 0, min_length not below 0")
        if not self.max_gap > 0:
            raise ValueError(f"max_gap must be above 0, not {self.max_gap:g}")
        if self.leaves not in get_args(CloudLeaves):
            raise ValueError(f"leaves must be one of {', '.join(get_args(CloudLeaves))}, not {self.leaves!r}")


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedBranches:
    """A skeleton, and what it was made from."""

    skeleton: Skeleton
    radii: Radii
    internode_m: float
    spacing_m: float  # of all points that were given
    thickness_m: float  # of a slice of a thin branch
    pieces: int  # that the cloud's graph was in
    wood: NDArray[np.bool_]  # (N,), points that are of branches; the others are of leaves, and nothing was made of them
    knows_leaves: bool  # whether points are close enough together to distinguish wood from leaves
    # Whether the skeleton was found otherwise: internode_m is then no length of its internodes.
    found_otherwise: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cut:
    points_m: NDArray[np.float64]
    sections: SectionTree
    stem_m: NDArray[np.float64]  # (N,), radius of the thick stem that a point is on
    spacing_m: float
    fine_m: float
    pieces: int
    stiffness: float  # of axes


def reconstruct_branches(
    points_m: NDArray[np.float64],
    roots_m: NDArray[np.float64],
    settings: BranchSettings = BranchSettings(),
    progress: StepProgress | None = None,
    colors: NDArray[np.number] | None = None,
) -> TracedBranches:
    """Trace the branches of a plant through its cloud, and measure them.

    Args:
        points_m: (N, 3), of wood, or of wood and leaves, Y up, without ground.
        roots_m: (R, 3), where its stems come out of the ground; the nearest points are taken.
        settings: How.
        progress: Called with what is done, and how far it is.
        colors: (N, 3), red, green and blue of the points, 0 to 255, where they have any: they help to recognise wood.

    Raises:
        ValueError: Fewer than two points, all of them at one place, or no root.
    """
    if len(points_m) < 2:
        raise ValueError(f"a plant takes two points, not {len(points_m)}")
    if not len(roots_m):
        raise ValueError("a plant has a root")
    report = progress or (lambda name, share: None)
    report("graph", 0.0)
    spacing_m = point_spacing(points_m)
    given = np.arange(len(points_m))
    if spacing_m == 0:  # points come several times
        points_m, given = np.unique(points_m, axis=0, return_inverse=True)
        if len(points_m) < 2:
            raise ValueError("all points are at one place")
        colors = None if colors is None else cell_means(colors, given.reshape(-1))
        spacing_m = point_spacing(points_m)
    internode_m = settings.internode_m or settings.internode_of_height * float(np.ptp(points_m[:, 1]))
    knows_leaves = shows_leaves(spacing_m, settings.wood)
    search = settings.leaves == "on" or (settings.leaves == "auto" and knows_leaves)
    some, some_spacing_m = np.arange(len(points_m)), spacing_m
    if search and len(points_m) > settings.wood.max_points:
        few = one_in_each_cell(points_m, settings.wood.few_points)[0]
        few_spacing_m = point_spacing(points_m[few])
        if shows_leaves(few_spacing_m, settings.wood):  # of a very large crown all are needed
            some, some_spacing_m = few, few_spacing_m
    if len(some) < len(points_m):
        some_colors = None if colors is None else colors[some]
        of_some, _ = _find_wood(points_m[some], roots_m, internode_m, some_spacing_m, settings, some_colors, report)
        nearest = np.asarray(cKDTree(points_m[some]).query(points_m, workers=-1)[1])
        wood = np.flatnonzero(np.isin(np.arange(len(some)), of_some)[nearest])
        cut = _cut(points_m[wood], roots_m, internode_m, point_spacing(points_m[wood]) or spacing_m, settings)
    elif search:
        wood, cut = _find_wood(points_m, roots_m, internode_m, spacing_m, settings, colors, report)
    else:
        wood, cut = np.arange(len(points_m)), _cut(points_m, roots_m, internode_m, spacing_m, settings, all_wood=True)
    if search and len(wood) == len(points_m) and _is_sparse(internode_m, spacing_m, settings):
        cut = _cut(points_m, roots_m, internode_m, spacing_m, settings, all_wood=True)
    report("branches", 0.7)
    cut = _without_gaps(cut, settings.max_gap)
    fine_m = cut.fine_m
    window_m = max(2 * fine_m, 1.5 * cut.spacing_m)
    shortest_m = settings.min_length * fine_m
    traced = trace_axes(cut.points_m, cut.sections, shortest_m, window_m, cut.stiffness, settings.radii)
    if _shows_twigs(internode_m, cut.spacing_m, settings):
        parent, radius_m = cut.sections.parent, traced.radii.radius_m
        joined = join_fronts(traced.center_m, parent, radius_m, shortest_m, window_m, settings.fronts)
        if not np.array_equal(joined, parent):
            cut = replace(cut, sections=replace(cut.sections, parent=joined))
            traced = trace_axes(cut.points_m, cut.sections, shortest_m, window_m, cut.stiffness, settings.radii)
    # Again, without what ends inside the stem that it springs from, or runs along its bark: its points are the stem's.
    min_m = np.full(len(cut.sections), shortest_m)
    min_m[traced.axes.nodes] += traced.radii.radius_m[traced.axes.nodes]
    spurs = np.zeros(len(traced.axes), bool)
    spurs[np.diff(traced.axes.first) >= 2] = _spurs(as_skeleton(traced), settings)
    sections, kept = absorb_spurs(cut.points_m, cut.sections, traced.axes, spurs)
    traced = trace_axes(cut.points_m, sections, min_m[kept], window_m, cut.stiffness, settings.radii)
    branches = as_skeleton(traced)
    branches = branches.only(~_spurs(branches, settings))
    branches = straighten_cut_ends(branches, _HANGS_TOGETHER * cut.spacing_m)
    branches = settle_attachments(branches)
    skeleton = refine_branches(branches, internode_m, traced.radii.noise_m, settings.refinement)
    report("branches", 1.0)
    is_wood = np.zeros(len(points_m), bool)
    is_wood[wood] = True
    return TracedBranches(
        skeleton=skeleton,
        radii=traced.radii,
        internode_m=internode_m,
        spacing_m=spacing_m,
        thickness_m=fine_m,
        pieces=cut.pieces,
        wood=is_wood[given.reshape(-1)],
        knows_leaves=knows_leaves,
    )


def _find_wood(
    points_m: NDArray[np.float64],
    roots_m: NDArray[np.float64],
    internode_m: float,
    spacing_m: float,
    settings: BranchSettings,
    colors: NDArray[np.number] | None,
    report: StepProgress,
) -> tuple[NDArray[np.intp], _Cut]:
    """(W,) points that are of wood, and their sections."""
    cut = _cut(points_m, roots_m, internode_m, spacing_m, settings)
    blurred = None
    wood = np.arange(len(points_m))
    sure = np.zeros(len(points_m), bool)
    for turn in range(settings.wood.max_turns):
        report("wood", 0.5 + 0.2 * turn / settings.wood.max_turns)
        odds = wood_odds(points_m, cut.sections, cut.spacing_m)
        found = choose_wood(cut.sections, odds + settings.wood.caution, _on_stems(cut), cut.spacing_m)
        logger.info("%.0f %% of the sections' length is wood", 100 * found.share)
        if settings.leaves == "auto" and turn == 0 and found.share >= settings.wood.leafless:
            break
        if turn == 0:
            sure = _in_thick_branches(cut, settings)
            blurred = None if colors is None else blur_colors(points_m, colors, spacing_m)
        if blurred is not None:
            taken = np.zeros(len(points_m), bool)
            taken[wood] = found.sections[cut.sections.section] | sure[wood]
            colored = color_odds(blurred, taken)[wood]
            by_color = cell_means(colored[:, None], cut.sections.section)[:, 0]
            odds = odds + caution_with_colors(colored, settings.wood) + settings.wood.color_weight * by_color
            found = choose_wood(cut.sections, odds, _on_stems(cut), cut.spacing_m)
            logger.info("with colours %.0f %%", 100 * found.share)
            # What geometry alone would drop of a noisy cloud's wood is thin: long paths of few points, that colours
            # spared.
            if turn and found.sections[cut.sections.section].mean() >= settings.wood.settled:
                break
        kept = found.sections[cut.sections.section] | sure[wood]
        if kept.sum() < 2:
            break
        wood = wood[kept]
        # Without the leaves slices are other ones, and wood is easier to distinguish from the leaves that are still
        # there.
        cut = _cut(points_m[wood], roots_m, internode_m, point_spacing(points_m[wood]) or spacing_m, settings)
        if found.share >= settings.wood.settled:
            break
    return wood, cut


def _spurs(skeleton: Skeleton, settings: BranchSettings) -> NDArray[np.bool_]:
    """(B,) branches that reach less beyond their parent's surface than slices of a stem as thick as that are thick.

    At its foot a stem flares, more on one side than on the other.
    """
    share = np.full(len(skeleton.points_m), settings.min_length * settings.stem_share)
    of_root = skeleton.order[skeleton.curve] == 0
    foot_m = skeleton.radius_m[skeleton.first][skeleton.curve]
    share[of_root] += _FLARE * np.clip(1 - skeleton.arcs_m / (_FLARES * foot_m), 0, 1)[of_root]
    return find_spurs(skeleton, share * skeleton.radius_m)


def _cut(
    points_m: NDArray[np.float64],
    roots_m: NDArray[np.float64],
    internode_m: float,
    spacing_m: float,
    settings: BranchSettings,
    all_wood: bool = False,
) -> _Cut:
    """Sections of a cloud, as thick as the stem or the twig that they are of asks for.

    Thin slices of leaves look like twigs: where leaves are looked for, slices are thicker.
    """
    graph = link_points(points_m, settings.graph)
    feet, of_root = _find_feet(points_m, roots_m, spacing_m)
    stem_m, noise_m = _find_stems(points_m, graph, (feet, of_root), internode_m, spacing_m, settings)
    fine_m = _slice_thickness(internode_m, spacing_m, noise_m, settings, all_wood)
    # A slice of a branch whose surface is seen hangs together where it is thicker than its points are apart; one that
    # is thinner than that is a line of points.
    together_m = np.minimum(_HANGS_TOGETHER * spacing_m, 2 * stem_m)
    thickness_m = np.maximum(np.maximum(together_m, settings.stem_share * stem_m), fine_m)
    thick = stem_m > _HANGS_TOGETHER * spacing_m
    few_points = all_wood and _is_sparse(internode_m, spacing_m, settings)
    paths = find_paths(graph.bridged_m, feet, of_root, settings.path_power, thick)
    return _Cut(
        points_m=points_m,
        sections=cut_sections(points_m, graph.lengths_m, paths, thickness_m),
        stem_m=stem_m,
        spacing_m=spacing_m,
        fine_m=fine_m,
        pieces=graph.pieces,
        stiffness=settings.wood_stiffness if few_points else settings.stiffness,
    )


def _without_gaps(cut: _Cut, max_gap: float) -> _Cut:
    """Without what lies apart from the plant."""
    thick_m = np.zeros(len(cut.sections))  # slices of a thick stem are thick
    np.maximum.at(thick_m, cut.sections.section, cut.stem_m)
    typical_m = np.maximum(thick_m, max(_HANGS_TOGETHER * cut.spacing_m, cut.fine_m))
    stays = ~find_beyond_gaps(cut.sections, typical_m, max_gap)
    points = stays[cut.sections.section]
    return replace(cut, points_m=cut.points_m[points], sections=cut.sections.take(stays), stem_m=cut.stem_m[points])


def _on_stems(cut: _Cut) -> NDArray[np.bool_]:
    """(S,) sections most of whose points are on a thick stem."""
    counts = np.bincount(cut.sections.section, cut.stem_m > 0, len(cut.sections))
    return np.asarray(counts > 0.5 * cut.sections.points)


def _in_thick_branches(cut: _Cut, settings: BranchSettings) -> NDArray[np.bool_]:
    """(N,) points of slices that fell apart on the surface of a thick branch, and look like leaves of it."""
    window_m = max(2 * cut.fine_m, 1.5 * cut.spacing_m)
    min_m = settings.min_length * cut.fine_m
    traced = trace_axes(cut.points_m, cut.sections, min_m, window_m, cut.stiffness, settings.radii)
    thick = np.zeros(len(cut.sections), bool)
    thick[traced.axes.nodes] = True
    thick &= traced.radii.radius_m > _HANGS_TOGETHER * cut.spacing_m
    if not thick.any():
        return np.zeros(len(cut.points_m), bool)
    away_m, nearest = cKDTree(traced.center_m[thick]).query(cut.points_m, workers=-1)
    return np.asarray(away_m < _WITHIN * traced.radii.radius_m[thick][nearest])


def point_spacing(points_m: NDArray[np.float64]) -> float:
    """Median distance to the sixth neighbour, of a sample."""
    tree = cKDTree(points_m)
    sample = points_m[:: max(1, len(points_m) // _SAMPLE)]
    return float(np.median(tree.query(sample, k=[min(_SIXTH, len(points_m) - 1) + 1], workers=-1)[0]))


def _find_feet(
    points_m: NDArray[np.float64], roots_m: NDArray[np.float64], spacing_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Points all around the feet of stems, and the root of each: from one point alone, slices would lie aslant."""
    feet: list[NDArray[np.int64]] = []
    taken = np.zeros(len(points_m), bool)
    for root_m in roots_m:
        level = points_m[:, 1] < root_m[1] + _FOOT * spacing_m
        slab = np.flatnonzero(level & (points_m[:, 1] > root_m[1] - _FOOT * spacing_m) & ~taken)
        if not len(slab):
            slab = np.flatnonzero(~taken)
            if not len(slab):
                break
            slab = slab[[int(np.argmin(np.linalg.norm(points_m[slab] - root_m, axis=1)))]]
        away_m = np.linalg.norm(points_m[slab][:, [0, 2]] - root_m[[0, 2]], axis=1)
        near = np.sort(away_m)[:_FOOT_POINTS]
        apart = np.flatnonzero(np.diff(near) > _FOOT_GAP * spacing_m)
        near = near[: apart[0] + 1] if len(apart) else near  # where a foot has fewer points than that
        foot = slab[away_m <= 2 * float(np.median(near)) + 1e-9]
        taken[foot] = True
        feet.append(foot)
    return np.concatenate(feet), np.repeat(np.arange(len(feet)), [len(foot) for foot in feet])


def _is_sparse(internode_m: float, spacing_m: float, settings: BranchSettings) -> bool:
    return spacing_m > settings.sparse * internode_m


def _shows_twigs(internode_m: float, spacing_m: float, settings: BranchSettings) -> bool:
    """Whether the points around one are of one twig; where they are far apart they are of several."""
    return shows_leaves(spacing_m, settings.wood) and not _is_sparse(internode_m, spacing_m, settings)


def _slice_thickness(
    internode_m: float, spacing_m: float, noise_m: float, settings: BranchSettings, all_wood: bool
) -> float:
    """As fine as twigs ask for where points are close together; where they are not, points are twigs.

    A slice that is thinner than its points are off their surface falls apart, and each of its parts looks like a twig.
    """
    if _is_sparse(internode_m, spacing_m, settings):
        return (settings.wood_spacings if all_wood else settings.sparse_spacings) * spacing_m
    fine_m = max(settings.fine * internode_m, settings.fine_noises * noise_m)
    return min(fine_m, settings.fine_spacings * spacing_m)


def _find_stems(
    points_m: NDArray[np.float64],
    graph: CloudGraph,
    roots: tuple[NDArray[np.int64], NDArray[np.int64]],
    internode_m: float,
    spacing_m: float,
    settings: BranchSettings,
) -> tuple[NDArray[np.float64], float]:
    """(N,) radius of the thick stem that a point is on, 0 elsewhere, and how far points are off their surface.

    Thin slices of a thick stem fall apart.
    """
    coarse_m = max(settings.coarse * internode_m, _HANGS_TOGETHER * spacing_m)
    sections = cut_sections(points_m, graph.lengths_m, find_paths(graph.bridged_m, *roots), coarse_m)
    traced = trace_axes(points_m, sections, 1.5 * coarse_m, coarse_m, settings.stiffness, settings.radii)
    known = traced.radii.believed
    for _ in range(_NEAR_BELIEVED):
        above = np.flatnonzero(traced.parent >= 0)
        spread = known.copy()
        spread[above] |= known[traced.parent[above]]
        np.logical_or.at(spread, traced.parent[above], known[above])
        known = spread
    # A stem is one from the root on; what looks round farther out may be a cluster of leaves.
    tree = RootedTree(traced.parent)
    known[tree.levels[0]] = True
    for level in tree.levels[1:]:
        known[level] &= known[traced.parent[level]]
    stem_m = np.where(known, np.minimum(traced.radii.radius_m, 4 * coarse_m / settings.stem_share), 0)
    return np.asarray(stem_m[sections.section]), traced.radii.noise_m
