"""From the cloud of a plant to the skeleton of its branches."""

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.attachments import settle_attachments
from usdfoliage.branch.tracing.cloud_cut import (
    SPACINGS_TOGETHER,
    Cut,
    cut_cloud,
    is_sparse,
    point_spacing,
    shows_twigs,
)
from usdfoliage.branch.tracing.cut_ends import straighten_cut_ends
from usdfoliage.branch.tracing.gaps import find_beyond_gaps
from usdfoliage.branch.tracing.meeting_fronts import join_fronts
from usdfoliage.branch.tracing.radii import Radii
from usdfoliage.branch.tracing.refinement import refine_branches
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.branch.tracing.spurs import absorb_spurs, find_spurs
from usdfoliage.branch.tracing.traced_axes import as_skeleton, trace_axes
from usdfoliage.branch.tracing.wood import shows_leaves
from usdfoliage.branch.tracing.wood_search import find_wood
from usdfoliage.geometry.point_cells import cell_means, one_in_each_cell
from usdfoliage.progress import StepProgress

logger = logging.getLogger(__name__)

_FLARE = 0.7  # of its radius, that a stem may be thicker at its foot on one side,
_FLARES = 4.0  # radii of it, up to which that fades


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
    wood = np.arange(len(points_m))
    if len(some) < len(points_m):
        some_colors = None if colors is None else colors[some]
        of_some = find_wood(points_m[some], roots_m, internode_m, some_spacing_m, settings, some_colors, report)
        nearest = np.asarray(cKDTree(points_m[some]).query(points_m, workers=-1)[1])
        wood = np.flatnonzero(np.isin(np.arange(len(some)), of_some)[nearest])
    elif search:
        wood = find_wood(points_m, roots_m, internode_m, spacing_m, settings, colors, report)
    wood_spacing_m = (point_spacing(points_m[wood]) if len(wood) < len(points_m) else spacing_m) or spacing_m
    all_wood = not search or (len(wood) == len(points_m) and is_sparse(internode_m, spacing_m, settings))
    cut = cut_cloud(points_m[wood], roots_m, internode_m, wood_spacing_m, settings, all_wood=all_wood)
    report("branches", 0.7)
    cut = _without_gaps(cut, settings.max_gap)
    fine_m = cut.fine_m
    window_m = max(2 * fine_m, 1.5 * cut.spacing_m)
    shortest_m = settings.min_length * fine_m
    traced = trace_axes(cut.points_m, cut.sections, shortest_m, window_m, cut.stiffness, settings.radii)
    if shows_twigs(internode_m, cut.spacing_m, settings):
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
    branches = straighten_cut_ends(branches, SPACINGS_TOGETHER * cut.spacing_m)
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


def _spurs(skeleton: Skeleton, settings: BranchSettings) -> NDArray[np.bool_]:
    """(B,) branches that reach less beyond their parent's surface than slices of a stem as thick as that are thick.

    At its foot a stem flares, more on one side than on the other.
    """
    share = np.full(len(skeleton.points_m), settings.min_length * settings.stem_share)
    of_root = skeleton.order[skeleton.curve] == 0
    foot_m = skeleton.radius_m[skeleton.first][skeleton.curve]
    share[of_root] += _FLARE * np.clip(1 - skeleton.arcs_m / (_FLARES * foot_m), 0, 1)[of_root]
    return find_spurs(skeleton, share * skeleton.radius_m)


def _without_gaps(cut: Cut, max_gap: float) -> Cut:
    """Without what lies apart from the plant."""
    thick_m = np.zeros(len(cut.sections))  # slices of a thick stem are thick
    np.maximum.at(thick_m, cut.sections.section, cut.stem_m)
    typical_m = np.maximum(thick_m, max(SPACINGS_TOGETHER * cut.spacing_m, cut.fine_m))
    stays = ~find_beyond_gaps(cut.sections, typical_m, max_gap)
    points = stays[cut.sections.section]
    return replace(cut, points_m=cut.points_m[points], sections=cut.sections.take(stays), stem_m=cut.stem_m[points])
