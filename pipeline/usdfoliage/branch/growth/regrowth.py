"""What growth is for: plants that are grown through a whole cloud, and the inside of crowns that clouds do not show.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 6.1 (figure 8) and section
6.2 (figure 13: similar plants by slightly other parameters, within the same points).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.distances import near_surface, place_on_axes
from usdfoliage.branch.growth.envelope import EnvelopeSettings
from usdfoliage.branch.growth.grow import GrownBranches, grow_branches, seed_plants
from usdfoliage.branch.growth.hidden_interior import HiddenSettings, find_hidden
from usdfoliage.branch.growth.importance import ImportanceSettings, weigh_points
from usdfoliage.branch.growth.limbs import LimbSettings
from usdfoliage.branch.growth.logistic import LogisticSettings
from usdfoliage.branch.growth.seen_stems import SeenStems
from usdfoliage.branch.growth.settings import GrowthSettings
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.refinement import RefinementSettings, refine_branches, split_edges
from usdfoliage.geometry.disks import choose_disks

_BARK = 1.4  # radii of a stem, within which points are its own
_INNER_BARK = 0.6  # radii, from which on they are surely not of what is inside
_FLARE = 0.7  # radii, that it may be thicker at its foot,
_FLARES = 4.0  # radii, up to which that fades
_BEYOND = 0.5  # radii, that they may be beyond the end of a piece of its axis
_LONGEST = 4.0  # internodes, that a straight piece of a branch is long at most,
_LONGEST_RADII = 2.0  # or of its radii
_SAME = 1e-9  # of a length, within which two are the same
_MIN_REACH = 5.0  # internodes, that a plant is taken to be high at least


@dataclass(frozen=True, kw_only=True)
class RegrowthSettings:
    """How a cloud is thinned for growth, and what follows it."""

    marker_spacing: float = 0.5  # internodes, between points that buds compete for
    weighing: float = 0.2  # internodes, between points of which importance is counted
    importance: ImportanceSettings = field(default_factory=ImportanceSettings)
    hidden: HiddenSettings = field(default_factory=HiddenSettings)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    thick: float = 0.5  # internodes, radius from which on a stem's bark is not what grows
    stems: float = 0.5  # internodes, radius from which on plants that are varied have the stems of the plant
    fair: float = 10.0  # internodes, length of waves in these stems that are half as high afterwards
    variation: float = 0.15  # of each parameter, by which plants that are varied differ at most
    envelope: EnvelopeSettings = field(default_factory=EnvelopeSettings)  # of plants that are varied
    limbs: LimbSettings = field(default_factory=LimbSettings)

    def __post_init__(self) -> None:
        if not 0 < self.weighing <= self.marker_spacing:
            raise ValueError("weighing must be above 0 and at most marker_spacing")
        if not all(0 <= each < np.inf for each in (self.thick, self.stems, self.fair)):
            raise ValueError("thick, stems and fair must be finite and not below 0")
        if not 0 <= self.variation < 1:
            raise ValueError(f"variation must be in [0, 1), not {self.variation:g}")


def regrow(
    points_m: NDArray[np.float64],
    roots_m: NDArray[np.float64],
    root_radius_m: float,
    growth: GrowthSettings,
    settings: RegrowthSettings = RegrowthSettings(),
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    stems: Skeleton | None = None,
    near_m: float | None = None,
) -> GrownBranches:
    """Grow a whole plant, or several that compete, from its roots through a cloud.

    Args:
        points_m: (N, 3), Y up, without ground.
        roots_m: (R, 3), where seeds are put.
        root_radius_m: Of the plants there.
        growth: The plant's parameters; the longest way is taken from the cloud.
        settings: How the cloud is thinned.
        seed: Of phyllotaxy, and of which points stay.
        progress: Called with how far it is, 0 to 1.
        stems: Branches that were seen: of thick ones it is the axis that is grown along, and not the bark.
        near_m: From a branch's surface, within which it has come to a point; without it points are those that growth
            was drawn by, and it came to those that are used up.

    Returns:
        The plant; reached is (N,) of the points where near_m is given.
    """
    internode_m = growth.internode_m
    cloud_m, feet_m = points_m, roots_m
    if stems is not None:
        feet_m = find_feet(roots_m, stems)
        points_m = draw_to_axes(points_m, stems, settings.thick * internode_m)
    # A stem's points have many like them around; its axis has few.
    on_axis = (points_m != cloud_m).any(axis=1)
    markers_m, weights = choose_markers(points_m, internode_m, settings, seed, on_axis)
    grown = grow_branches(
        seed_plants(feet_m, internode_m, root_radius_m),
        markers_m,
        weights,
        _reaching(growth, points_m),
        seed,
        progress,
        None if stems is None else SeenStems(skeleton=stems, min_m=settings.thick * internode_m),
    )
    grown = replace(grown, skeleton=_refined(grown.skeleton, internode_m, settings))
    if near_m is None:
        return grown
    used_m = min(growth.max_kill * internode_m, growth.max_kill_m)
    return replace(grown, reached=near_surface(cloud_m, grown.skeleton, max(near_m, used_m)))


def fill_hidden(
    skeleton: Skeleton,
    points_m: NDArray[np.float64],
    spacing_m: float,
    growth: GrowthSettings,
    settings: RegrowthSettings = RegrowthSettings(),
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> GrownBranches:
    """Let the buds of a skeleton grow into the part of the crown that its cloud hides; where it hides none, nothing.

    Args:
        skeleton: The branches that were seen, which stay.
        points_m: (N, 3), the cloud.
        spacing_m: Between its points.
        growth: The plant's parameters; the longest way is taken from the cloud.
        settings: What is hidden.
        seed: Of phyllotaxy and of the points in the crown.
        progress: Called with how far it is, 0 to 1.
    """
    hidden_m = find_hidden(points_m, growth.internode_m, spacing_m, settings.hidden, seed)
    if not len(hidden_m) or not len(skeleton):
        return GrownBranches(skeleton=skeleton, cycles=0, grown=0, shed=0, reached=np.zeros(len(hidden_m), bool))
    grown = grow_branches(skeleton, hidden_m, np.ones(len(hidden_m)), _reaching(growth, points_m), seed, progress)
    return replace(grown, skeleton=_refined(grown.skeleton, growth.internode_m, settings, skeleton))


def fill_rest(
    skeleton: Skeleton,
    points_m: NDArray[np.float64],
    near_m: float,
    growth: GrowthSettings,
    settings: RegrowthSettings = RegrowthSettings(),
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    min_left: float = 0.0,
    *,
    keeps: bool = True,
) -> GrownBranches:
    """Let the limbs of a skeleton grow on into what it leaves of a cloud; where it leaves nothing, nothing grows.

    Args:
        skeleton: The branches that were traced, which stay as they are.
        points_m: (N, 3), the cloud, leaves included.
        near_m: From a branch's surface, within which a point is one that branches have come to.
        growth: The plant's parameters; the longest way is taken from the cloud.
        settings: How the cloud is thinned.
        seed: Of phyllotaxy, and of which points stay.
        progress: Called with how far it is, 0 to 1.
        min_left: Share of the points, up to which nothing grows into what is left.
        keeps: Whether the branches stay exactly as they are, and others are inferred; else all are made fair together.

    Returns:
        The branches; reached is (N,) of the points.
    """
    seen = near_surface(points_m, skeleton, near_m)
    rest_m = points_m[~seen]
    if not len(skeleton) or len(rest_m) <= min_left * len(points_m):
        return GrownBranches(skeleton=skeleton, cycles=0, grown=0, shed=0, reached=seen)
    markers_m, weights = choose_markers(rest_m, growth.internode_m, settings, seed)
    grown = grow_branches(skeleton, markers_m, weights, _reaching(growth, points_m), seed, progress, ages=not keeps)
    filled = _refined(grown.skeleton, growth.internode_m, settings, skeleton if keeps else None)
    return replace(grown, skeleton=filled, reached=near_surface(points_m, filled, near_m))


def choose_markers(
    points_m: NDArray[np.float64],
    internode_m: float,
    settings: RegrowthSettings = RegrowthSettings(),
    seed: int = 0,
    important: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(M, 3) of points (N, 3) those that buds compete for, and (M,) how much each is worth.

    Points that are important (N,) are worth as much as any.
    """
    dense = choose_disks(points_m, settings.weighing * internode_m, seed)
    dense_m = points_m[dense]
    weights = 1 + weigh_points(dense_m, internode_m, settings.importance)
    if important is not None:
        weights[important[dense]] = 1 + settings.importance.neighbors
    markers = choose_disks(dense_m, settings.marker_spacing * internode_m, seed)
    return dense_m[markers], weights[markers]


def draw_to_axes(points_m: NDArray[np.float64], stems: Skeleton, min_m: float) -> NDArray[np.float64]:
    """(N, 3) points, those on the bark of stems at least so thick moved to the axis.

    Args:
        points_m: (N, 3).
        stems: Branches.
        min_m: Radius from which on they count.
    """
    places_m, radii_m, direction, vertex = place_on_axes(stems, 0.5 * min_m)
    thick = radii_m >= min_m
    if not thick.any():
        return points_m
    places_m, radii_m, direction, vertex = places_m[thick], radii_m[thick], direction[thick], vertex[thick]
    # At its foot a stem flares.
    arc_m = stems.arcs_m[vertex] + np.linalg.norm(places_m - stems.points_m[vertex], axis=1)
    foot_m = stems.radius_m[stems.first][stems.curve[vertex]]
    flares = np.where(stems.order[stems.curve[vertex]] == 0, _FLARE, 0.0)
    bark = _BARK + flares * np.clip(1 - arc_m / (_FLARES * foot_m), 0, 1)
    # What is on the bark of a thick stem is not of a thin one that ends inside it.
    drawn_m, left = points_m.copy(), np.arange(len(points_m))
    size = np.ceil(np.log2(radii_m))
    for min_share, some in [*((_INNER_BARK, size == each) for each in np.unique(size)[::-1]), (0.0, size == size)]:
        near = np.asarray(cKDTree(places_m[some]).query(points_m[left], workers=-1)[1])
        offset_m = points_m[left] - places_m[some][near]
        axis = direction[some][near]
        along_m = np.einsum("nc,nc->n", offset_m, axis)
        share = np.linalg.norm(offset_m - along_m[:, None] * axis, axis=1) / radii_m[some][near]
        # On the outside of a bend points are beyond the ends of both pieces.
        beside = np.abs(along_m) <= np.maximum(min_m, _BEYOND * radii_m[some][near])
        on_bark = (share >= min_share) & (share <= bark[some][near]) & beside
        at_m = places_m[some][near] + np.clip(along_m, -min_m, min_m)[:, None] * axis
        drawn_m[left[on_bark]] = at_m[on_bark]
        left = left[~on_bark]
    return drawn_m


def find_feet(roots_m: NDArray[np.float64], stems: Skeleton) -> NDArray[np.float64]:
    """(R, 3) roots, those on the bark of a stem that was seen moved to its axis, as low as they are."""
    foot = stems.first[stems.parent_curve < 0]
    if not len(foot):
        return roots_m
    found = cKDTree(stems.points_m[foot][:, [0, 2]]).query(roots_m[:, [0, 2]])
    across_m, nearest = (np.asarray(each) for each in found)
    is_foot = across_m <= _BARK * stems.radius_m[foot[nearest]]
    feet_m = roots_m.copy()
    feet_m[is_foot] = stems.points_m[foot[nearest[is_foot]]]
    feet_m[:, 1] = np.minimum(feet_m[:, 1], roots_m[:, 1])
    return feet_m


def vary_growth(growth: GrowthSettings, variation: float, seed: int) -> GrowthSettings:
    """Parameters (table 1) of a plant like another: each evenly within a share of its value."""
    if variation == 0:
        return growth
    rng = np.random.default_rng(seed)
    internode, divergence, branching, exponent = 1 + rng.uniform(-variation, variation, 4)
    return replace(
        growth,
        internode_m=growth.internode_m * internode,
        divergence_deg=growth.divergence_deg * divergence,
        branching_deg=growth.branching_deg * branching,
        allometry=replace(growth.allometry, exponent=growth.allometry.exponent * exponent),
    )


def _reaching(growth: GrowthSettings, points_m: NDArray[np.float64]) -> GrowthSettings:
    """With the longest way that the plant's height lets expect (the paper: H_max is near the height)."""
    longest = max(float(np.ptp(points_m[:, 1])) / growth.internode_m, _MIN_REACH)
    logistic: LogisticSettings = replace(growth.logistic, longest=longest)
    return replace(growth, logistic=logistic)


def _refined(
    skeleton: Skeleton, internode_m: float, settings: RegrowthSettings, start: Skeleton | None = None
) -> Skeleton:
    """Fair branches; what was there already, the first branches as far as they went, stays as it is.

    The others are inferred, and so is one of the first of which the larger part is new.
    """
    stays = None
    if start is not None:
        of_start = skeleton.curve < len(start)
        before_m = np.zeros(len(skeleton))
        before_m[: len(start)] = start.lengths_m
        stays = of_start & (skeleton.arcs_m <= (1 + _SAME) * before_m[skeleton.curve])
        inferred = skeleton.lengths_m > 2 * before_m
        inferred[: len(start)] |= start.inferred
        skeleton = replace(skeleton, inferred=inferred)
    refined = refine_branches(skeleton, internode_m, settings=settings.refinement, stays=stays)
    longest_m = np.maximum(_LONGEST * internode_m, _LONGEST_RADII * refined.radius_m)
    return split_edges(refined, longest_m)[0]
