"""The sections of a cloud: slices as thick as the stem or the twig that they are of asks for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.rooted_tree import RootedTree
from usdfoliage.branch.tracing.cloud_graph import CloudGraph, link_points
from usdfoliage.branch.tracing.sections import SectionTree, cut_sections, find_paths
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.branch.tracing.traced_axes import trace_axes
from usdfoliage.branch.tracing.wood import shows_leaves

_SIXTH = 6  # neighbour whose distance is taken for the spacing of points
_SAMPLE = 20_000  # points of which it is taken
SPACINGS_TOGETHER = 1.6  # distances to the sixth neighbour, that a slice of a thick stem must be thick
_FOOT = 1.6  # distances to the sixth neighbour, height of the foot of a stem
_FOOT_POINTS = 20  # that its width is measured from
_FOOT_GAP = 4.0  # distances to the sixth neighbour, beyond which points beside a foot are of something else
_WITHIN = 1.2  # radii of a thick branch from its axis, where all points are of it
_NEAR_BELIEVED = 3  # nodes from a believed circle, that are as thick as is thought


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """A cloud in sections."""

    points_m: NDArray[np.float64]
    sections: SectionTree
    stem_m: NDArray[np.float64]  # (N,), radius of the thick stem that a point is on
    spacing_m: float  # to the sixth neighbour
    fine_m: float  # thickness of a slice of a thin branch
    pieces: int  # that the cloud's graph was in
    stiffness: float  # of axes


def cut_cloud(
    points_m: NDArray[np.float64],
    roots_m: NDArray[np.float64],
    internode_m: float,
    spacing_m: float,
    settings: BranchSettings,
    all_wood: bool = False,
    search: bool = False,
) -> Cut:
    """Sections of a cloud, as thick as the stem or the twig that they are of asks for.

    Thin slices of leaves look like twigs: where leaves are looked for, slices are thicker.

    Args:
        points_m: (N, 3), Y up.
        roots_m: (R, 3), where its stems come out of the ground.
        internode_m: Of the plant.
        spacing_m: To the sixth neighbour.
        settings: How.
        all_wood: Whether all points are taken for wood.
        search: Whether the sections are to show which points are leaves.
    """
    graph = link_points(points_m, settings.graph)
    feet, of_root = _find_feet(points_m, roots_m, spacing_m)
    stem_m, noise_m = _find_stems(points_m, graph, (feet, of_root), internode_m, spacing_m, settings)
    fine_m = _slice_thickness(internode_m, spacing_m, noise_m, settings, all_wood)
    # A slice of a branch whose surface is seen hangs together where it is thicker than its points are apart; one that
    # is thinner than that is a line of points.
    together_m = np.minimum(SPACINGS_TOGETHER * spacing_m, 2 * stem_m)
    thickness_m = np.maximum(np.maximum(together_m, settings.stem_share * stem_m), fine_m)
    thick = stem_m > SPACINGS_TOGETHER * spacing_m
    sparse = is_sparse(internode_m, spacing_m, settings)
    far_apart = sparse and not shows_leaves(spacing_m, settings.wood)
    power = settings.sparse_power if far_apart else settings.path_power
    paths = find_paths(graph.bridged_m, feet, of_root, settings.search_power if search else power, thick)
    return Cut(
        points_m=points_m,
        sections=cut_sections(points_m, graph.lengths_m, paths, thickness_m),
        stem_m=stem_m,
        spacing_m=spacing_m,
        fine_m=fine_m,
        pieces=graph.pieces,
        stiffness=settings.wood_stiffness if all_wood and sparse else settings.stiffness,
    )


def sections_on_stems(cut: Cut) -> NDArray[np.bool_]:
    """(S,) sections most of whose points are on a thick stem."""
    counts = np.bincount(cut.sections.section, cut.stem_m > 0, len(cut.sections))
    return np.asarray(counts > 0.5 * cut.sections.points)


def points_in_thick_branches(cut: Cut, settings: BranchSettings) -> NDArray[np.bool_]:
    """(N,) points of slices that fell apart on the surface of a thick branch, and look like leaves of it."""
    window_m = max(2 * cut.fine_m, 1.5 * cut.spacing_m)
    min_m = settings.min_length * cut.fine_m
    traced = trace_axes(cut.points_m, cut.sections, min_m, window_m, cut.stiffness, settings.radii)
    thick = np.zeros(len(cut.sections), bool)
    thick[traced.axes.nodes] = True
    thick &= traced.radii.radius_m > SPACINGS_TOGETHER * cut.spacing_m
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


def is_sparse(internode_m: float, spacing_m: float, settings: BranchSettings) -> bool:
    return spacing_m > settings.sparse * internode_m


def shows_twigs(internode_m: float, spacing_m: float, settings: BranchSettings) -> bool:
    """Whether the points around one are of one twig; where they are far apart they are of several."""
    return shows_leaves(spacing_m, settings.wood) and not is_sparse(internode_m, spacing_m, settings)


def _slice_thickness(
    internode_m: float, spacing_m: float, noise_m: float, settings: BranchSettings, all_wood: bool
) -> float:
    """As fine as twigs ask for where points are close together; where they are not, points are twigs.

    A slice that is thinner than its points are off their surface falls apart, and each of its parts looks like a twig.
    """
    if is_sparse(internode_m, spacing_m, settings):
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
    coarse_m = max(settings.coarse * internode_m, SPACINGS_TOGETHER * spacing_m)
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
