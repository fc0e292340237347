"""From places on stems to one skeleton: each stem from the soil up, each petiole to its leaf.

The cheapest paths from the soil lead along stems that photographs show, and straight on across what they do not. Of
the tree of these paths that part is kept for which most speaks: places on stems and the bases of leaves speak for it,
gaps and places that are rather of leaves against it. Our own; that a plant's skeleton is a tree of cheapest paths from
its root is that of A. Verroust and F. Lazarus, Extracting skeletal curves from 3D scattered data, 2000.
"""

import logging
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree
from scipy.special import logit

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.photographs.stem_points import StemPoints
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.attachments import settle_attachments
from usdfoliage.branch.tracing.axes import find_axes
from usdfoliage.branch.tracing.fairing import fair_axes
from usdfoliage.branch.tracing.radii import Radii
from usdfoliage.branch.tracing.refinement import RefinementSettings, collapse_nodes, round_bends
from usdfoliage.branch.tracing.sections import SectionTree
from usdfoliage.branch.tracing.traced_axes import TracedAxes, as_skeleton
from usdfoliage.branch.tracing.wood import best_rooted_part
from usdfoliage.geometry.point_cells import touching_parts

logger = logging.getLogger(__name__)

_NEAR = 0.05  # of the longest gap: of nearer places directions are not certain
_TOUCHING = 4.0  # footprints between places of one piece of a stem
_TURNS = 5  # of leaving out roots that carry no stem
_CLEAREST = 0.4  # logarithm of two costs, beyond which their difference does not count
_UNREACHED = 1e9  # metres, the cost of what no path leads to
_SUREST = 0.999  # certainty of a leaf's base, beyond which more does not count
_BASE_SINE = 0.3  # square of the sine of the angle between a link and a leaf's base, whose direction is not known


@dataclass(frozen=True, kw_only=True)
class JoinSettings:
    """How places on stems are joined. Lengths are shares of the plant's height."""

    longest_gap: float = 0.15  # Places up to this far apart are linked. Range: above 0.
    gap: float = 0.025  # Across a gap of this length a link costs twice as much. Range: above 0.
    bend: float = 3.0  # A link straight across the course of both its stems costs so much more. Range: 0 or more.
    fork: float = 1.0  # A link straight across the course of one of them, likewise. Range: 0 or more.
    fall: float = 3.0  # A link that leads straight down costs so much more. Range: 0 or more.
    # A stem that is hidden down to the soil costs, for each gap that it is long, so much more. Range: 0 or more.
    hidden: float = 0.5
    sure: float = 0.3  # Each unit of the logarithm of the odds makes a link cheaper by e to this. Range: 0 or more.
    low: float = 0.15  # A place on a stem up to this height goes on to the soil. Range: 0 to 1.
    highest_root: float = 0.5  # A stem that is seen from up to this height on goes on to the soil. Range: 0 to 1.
    stem: float = 0.4  # A stem that springs from the soil reaches at least this height. Range: 0 to 1.
    root: float = 0.04  # What speaks against a root: a stem of this length of even odds. Range: 0 or more.
    base: float = 0.2  # What speaks for the base of a leaf, likewise. Range: 0 or more.
    missing: float = 0.3  # What speaks against a gap, for its length. Range: 0 or more.
    twig: float = 0.02  # A branch is at least this long. Range: 0 or more.
    # A stem is seen where photographs show at least this length of it unbroken. Range: 0 or more.
    unbroken: float = 0.05
    # Photographs must show stems of at least this length together, or there are none. Range: 0 or more.
    min_visible: float = 0.3
    stiffness: float = 4.0  # Of axes, against the distance that places are moved. Range: 0 or more.
    # The logarithm of the odds that a leaf's base is the end to which the way from the soil costs less is this multiple
    # of the logarithm of how much less. Range: 0 or more.
    end: float = 5.0

    def __post_init__(self) -> None:
        if not (self.longest_gap > 0 and self.gap > 0):
            raise ValueError(f"longest_gap and gap must be above 0, not {self.longest_gap:g} and {self.gap:g}")
        for name in ("low", "highest_root", "stem"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be from 0 to 1, not {getattr(self, name):g}")
        for name in (
            "bend",
            "fork",
            "fall",
            "hidden",
            "sure",
            "root",
            "base",
            "missing",
            "twig",
            "unbroken",
            "min_visible",
            "stiffness",
            "end",
        ):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be 0 or more, not {getattr(self, name):g}")


@dataclass(frozen=True, kw_only=True, eq=False)
class StemPiece:
    """Places on a stem that hang together."""

    length_m: float  # from end to end
    middle_m: NDArray[np.float64]  # (3,)


@dataclass(frozen=True, kw_only=True, eq=False)
class JoinedStems:
    """A skeleton, and what it was made of."""

    skeleton: Skeleton
    joined: NDArray[np.bool_]  # (S,), places on stems that are on it
    leaf: NDArray[np.int64]  # (L,), vertex of the skeleton at which each leaf begins, -1 where none leads to it
    turned: NDArray[np.bool_]  # (L,), leaves of which what was taken for the apex is the base
    apart: tuple["StemPiece", ...]  # that look like stems and are not joined to the rest, the longest first


def join_stems(
    stems: StemPoints,
    bases_m: NDArray[np.float64],
    soil_m: float,
    settings: JoinSettings = JoinSettings(),
    *,
    apices_m: NDArray[np.float64] | None = None,
    certainty: NDArray[np.float64] | None = None,
) -> JoinedStems | None:
    """One skeleton of a plant's stems; None where nothing speaks for any.

    Args:
        stems: Places on them, Y up.
        bases_m: (L, 3), where leaves begin.
        soil_m: Height of the soil.
        settings: How they are joined.
        apices_m: (L, 3), the other ends of leaves, where it is not certain which end is the base.
        certainty: (L,), 0.5 to 1, the probability that the base is the base; 0.5 by default.
    """
    count, leaves = len(stems), len(bases_m)
    if not count:
        return None
    ends_m = bases_m if apices_m is None else np.concatenate([bases_m, apices_m])
    height_m = _height_m(stems.points_m, ends_m, soil_m)
    if not height_m > 0:
        return None
    links = _link_places(stems, ends_m, settings.longest_gap * height_m)
    turned = np.zeros(leaves, bool)
    if apices_m is not None and leaves:
        sure = np.full(leaves, 0.5) if certainty is None else certainty
        turned = _find_turned(links, stems, ends_m, sure, soil_m, settings)
        bases_m = np.where(turned[:, None], apices_m, bases_m)
        chosen = count + np.arange(leaves) + leaves * turned
        links = links.among(np.concatenate([np.arange(count), chosen]), count + 2 * leaves)
        height_m = _height_m(stems.points_m, bases_m, soil_m)
        if not height_m > 0:
            return None
    places_m = np.concatenate([stems.points_m, bases_m])
    odds = np.concatenate([np.clip(stems.odds, -3, 2), np.zeros(leaves)])
    costs = _weigh_links(links, odds, height_m, settings)
    apart_m = 3 * stems.footprint_m
    may_root = np.zeros(len(places_m), bool)
    above_m = stems.points_m[:, 1] - soil_m
    may_root[:count] = _on_clear_stems(stems, settings.unbroken * height_m) | (above_m < settings.low * height_m)
    for _ in range(_TURNS):
        parent, cost = _cheapest_paths(costs, stems, odds, soil_m, height_m, may_root, settings)
        step_m = step_lengths(places_m, parent)
        root = parent < 0
        step_m[root] = np.maximum(places_m[root, 1] - soil_m, 0)
        gain = odds * np.minimum(step_m, apart_m) - settings.missing * np.maximum(step_m - 2 * apart_m, 0)
        gain[count:] += settings.base * height_m
        gain[root] -= settings.root * height_m
        gain[~np.isfinite(cost)] = -_UNREACHED
        tree = RootedTree(parent)
        kept = _best_part(tree, gain)
        low = (
            kept & root & (_highest(tree, np.where(kept, places_m[:, 1], -np.inf)) < soil_m + settings.stem * height_m)
        )
        if not low.any() or low.sum() == (kept & root).sum():
            break
        may_root &= ~_of_roots(tree, low)  # what it carries is of another stem
    if not kept.any():
        return None
    # Bases of leaves, and scraps of their edges, make no stems: what joins them would be guessed. But where stems are
    # seen from the soil up, what leads from there to the leaves may be hidden for the most part.
    visible = kept & (parent >= 0) & (step_m <= 2 * apart_m) & (odds > 0)
    runs_m = _run_lengths(parent, visible, step_m)
    visible_m = float(runs_m[runs_m >= settings.unbroken * height_m].sum())
    logger.info("photographs show %.0f %% of the length of stems unbroken", 100 * visible_m / step_m[kept].sum())
    if visible_m < settings.min_visible * height_m:
        return None
    return _as_joined(places_m, parent, kept, stems, count, turned, soil_m, height_m, settings)


def find_turned(
    stems: StemPoints,
    bases_m: NDArray[np.float64],
    apices_m: NDArray[np.float64],
    certainty: NDArray[np.float64],
    soil_m: float,
    settings: JoinSettings = JoinSettings(),
) -> NDArray[np.bool_]:
    """(L,) leaves to which a stem leads by what was taken for their apex; arguments as join_stems takes them.

    The cheapest paths from the soil to either end are compared: the base is the end at a stem. That is a sign like
    those that leaves were turned by before, and counts together with how certain these were.
    """
    ends_m = np.concatenate([bases_m, apices_m])
    height_m = _height_m(stems.points_m, ends_m, soil_m)
    if not height_m > 0:
        return np.zeros(len(bases_m), bool)
    links = _link_places(stems, ends_m, settings.longest_gap * height_m)
    return _find_turned(links, stems, ends_m, certainty, soil_m, settings)


def _find_turned(
    links: "_Links",
    stems: StemPoints,
    ends_m: NDArray[np.float64],
    certainty: NDArray[np.float64],
    soil_m: float,
    settings: JoinSettings,
) -> NDArray[np.bool_]:
    """The same for the links of stems and of both ends (2L, 3) of leaves, bases first."""
    count = len(stems)
    height_m = _height_m(stems.points_m, ends_m, soil_m)
    odds = np.concatenate([np.clip(stems.odds, -3, 2), np.zeros(len(ends_m))])
    costs = _weigh_links(links, odds, height_m, settings)
    # No path goes on from the end of a leaf.
    costs = replace(
        costs,
        outwards=np.where(costs.one < count, costs.outwards, np.inf),
        back=np.where(costs.other < count, costs.back, np.inf),
    ).take((costs.one < count) | (costs.other < count))
    may_root = np.ones(count + len(ends_m), bool)
    _, cost = _cheapest_paths(costs, stems, odds, soil_m, height_m, may_root, settings)
    base, apex = np.split(np.minimum(cost[count:], _UNREACHED), 2)
    less = np.log(base / apex)  # above 0 where the apex is nearer
    return np.asarray(settings.end * np.clip(less, -_CLEAREST, _CLEAREST) > logit(np.clip(certainty, 0.5, _SUREST)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Links:
    """P pairs of near places on stems and at ends of leaves, which are numbered after the stems."""

    one: NDArray[np.int64]  # (P,)
    other: NDArray[np.int64]  # (P,)
    length_m: NDArray[np.float64]  # (P,)
    rise: NDArray[np.float64]  # (P,), sine of the angle at which the second lies above the first
    smaller: NDArray[np.float64]  # (P,), square of the sine of the angle between the link and one place's course
    larger: NDArray[np.float64]  # (P,), and of the other, where it is larger

    def take(self, chosen: NDArray[np.bool_]) -> "_Links":
        """These pairs alone."""
        return replace(self, **{each.name: getattr(self, each.name)[chosen] for each in fields(self)})

    def among(self, places: NDArray[np.int64], count: int) -> "_Links":
        """The pairs of these places, of so many, by their numbers in this order."""
        number = np.full(count, -1, np.int64)
        number[places] = np.arange(len(places))
        left = self.take((number[self.one] >= 0) & (number[self.other] >= 0))
        return replace(left, one=number[left.one], other=number[left.other])


@dataclass(frozen=True, kw_only=True, eq=False)
class _LinkCosts:
    """What paths along P links cost, in metres: from the first place to the second, and back."""

    one: NDArray[np.int64]  # (P,)
    other: NDArray[np.int64]  # (P,)
    outwards: NDArray[np.float64]  # (P,)
    back: NDArray[np.float64]  # (P,)

    def take(self, chosen: NDArray[np.bool_]) -> "_LinkCosts":
        """Those of these links alone."""
        return replace(self, **{each.name: getattr(self, each.name)[chosen] for each in fields(self)})


def _height_m(points_m: NDArray[np.float64], ends_m: NDArray[np.float64], soil_m: float) -> float:
    """Of the highest of places on stems (S, 3) and ends of leaves (E, 3) above the soil."""
    return float(np.concatenate([points_m, ends_m])[:, 1].max()) - soil_m


def _link_places(stems: StemPoints, ends_m: NDArray[np.float64], longest_m: float) -> _Links:
    """The links up to this length between places on stems and ends (E, 3) of leaves, whose course is not known."""
    places_m = np.concatenate([stems.points_m, ends_m])
    along = np.concatenate([stems.along, np.zeros((len(ends_m), 3))])
    one, other = cKDTree(places_m).query_pairs(longest_m, output_type="ndarray").T
    offset_m = places_m[other] - places_m[one]
    length_m = np.maximum(np.linalg.norm(offset_m, axis=1), 1e-9)
    sines = []
    for each in (one, other):
        cosine = np.einsum("ij,ij->i", offset_m, along[each]) / length_m
        sines.append(np.where(each < len(stems), 1 - np.square(cosine), _BASE_SINE))
    return _Links(
        one=one,
        other=other,
        length_m=length_m,
        rise=offset_m[:, 1] / length_m,
        smaller=np.minimum(*sines),
        larger=np.maximum(*sines),
    )


def _weigh_links(links: _Links, odds: NDArray[np.float64], height_m: float, settings: JoinSettings) -> _LinkCosts:
    """What links cost between places of these odds (N,), of a plant of this height: those that are not too long."""
    longest_m, gap_m = settings.longest_gap * height_m, settings.gap * height_m
    if links.length_m.max(initial=0) > longest_m:
        links = links.take(links.length_m <= longest_m)
    length_m = links.length_m
    turned = np.minimum(length_m / (_NEAR * longest_m), 1) * (
        settings.bend * links.smaller + settings.fork * links.larger
    )
    dear = np.exp(-settings.sure * odds)
    cost = length_m * (1 + turned) * (1 + length_m / gap_m) * 0.5 * (dear[links.one] + dear[links.other])
    # Stems rise from the soil: who comes to one by its tip, and leads down along it, has come by a leaf.
    outwards, back = (cost * (1 + settings.fall * np.square(np.maximum(-sign * links.rise, 0))) for sign in (1, -1))
    return _LinkCosts(one=links.one, other=links.other, outwards=outwards, back=back)


def _cheapest_paths(
    costs: _LinkCosts,
    stems: StemPoints,
    odds: NDArray[np.float64],
    soil_m: float,
    height_m: float,
    may_root: NDArray[np.bool_],
    settings: JoinSettings,
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """(N,) place before each one on the cheapest path from the soil, -1 where the soil is; (N,) what the paths cost.

    What no path leads to costs infinitely much, and has nothing before it.
    """
    whole, count, gap_m = len(odds), len(stems), settings.gap * height_m
    above_m = stems.points_m[:, 1] - soil_m
    low = np.flatnonzero((above_m < settings.highest_root * height_m) & may_root[:count])
    down_m = np.maximum(above_m[low], 1e-3 * height_m)
    lying = 1 - np.square(stems.along[low, 1])
    dear = np.exp(-settings.sure * odds[low])
    to_soil = down_m * (1 + settings.bend * lying) * (1 + settings.hidden * down_m / gap_m) * dear
    if not len(low):
        low, to_soil = np.array([np.argmin(above_m)]), np.array([1.0])
    soil = np.full(len(low), whole)
    graph = coo_array(
        (
            np.concatenate([costs.outwards, costs.back, to_soil]),
            (np.concatenate([costs.one, costs.other, soil]), np.concatenate([costs.other, costs.one, low])),
        ),
        shape=(whole + 1, whole + 1),
    ).tocsr()
    total, before, _ = dijkstra(
        csr_array(graph), directed=True, indices=np.array([whole]), min_only=True, return_predecessors=True
    )
    before = before[:whole]
    return np.where((before < 0) | (before == whole), -1, before).astype(np.int32), total[:whole]


def _best_part(tree: RootedTree, gain: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) nodes of the part whose gains (N,) are most together, with those roots alone that are worth it."""
    kept = best_rooted_part(tree, gain)
    worth = np.array(gain)
    for level in reversed(tree.levels[1:]):
        np.add.at(worth, tree.parent[level], np.maximum(worth[level], 0))
    return np.asarray(kept & _of_roots(tree, worth > 0))


def _on_clear_stems(stems: StemPoints, min_m: float) -> NDArray[np.bool_]:
    """(S,) places on stems that photographs show unbroken for so many metres; all, where there are none.

    Of what is high above the soil, these alone go on to it: a leaf whose petiole is hidden would hang on a stem
    of its own otherwise, straight down.
    """
    clear = np.flatnonzero(stems.odds > 0)
    if not len(clear):
        return np.ones(len(stems), bool)
    points_m = stems.points_m[clear]
    piece = touching_parts(points_m, _TOUCHING * stems.footprint_m)
    count = int(piece.max()) + 1
    low_m, high_m = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low_m, piece, points_m)
    np.maximum.at(high_m, piece, points_m)
    long = np.linalg.norm(high_m - low_m, axis=1) >= min_m
    on = np.zeros(len(stems), bool)
    on[clear] = long[piece]
    return on if on.any() else np.ones(len(stems), bool)


def _run_lengths(
    parent: NDArray[np.int32], visible: NDArray[np.bool_], step_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(R,) metres of each part of the tree that hangs together by visible steps from places (N,) to their parents."""
    child = np.flatnonzero(visible)
    links = coo_array((np.ones(len(child)), (child, parent[child])), shape=(len(parent), len(parent)))
    _, run = connected_components(csr_array(links), directed=False)
    return np.asarray(np.bincount(run[child], step_m[child]), np.float64)


def _highest(tree: RootedTree, height_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) greatest height (N,) of each node and of all that it carries."""
    highest_m = height_m.copy()
    for level in reversed(tree.levels[1:]):
        np.maximum.at(highest_m, tree.parent[level], highest_m[level])
    return highest_m


def _of_roots(tree: RootedTree, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) nodes whose root is good (N,)."""
    of_root = good.copy()
    for level in tree.levels[1:]:
        of_root[level] = of_root[tree.parent[level]]
    return of_root


def _as_joined(
    places_m: NDArray[np.float64],
    parent: NDArray[np.int32],
    kept: NDArray[np.bool_],
    stems: StemPoints,
    count: int,
    turned: NDArray[np.bool_],
    soil_m: float,
    height_m: float,
    settings: JoinSettings,
) -> JoinedStems:
    """The skeleton of the places that are kept, with its feet on the soil."""
    chosen = np.flatnonzero(kept)
    number = np.cumsum(kept) - 1
    own = parent[chosen]
    feet = np.flatnonzero(own < 0)
    feet_m = places_m[chosen[feet]].copy()
    feet_m[:, 1] = soil_m
    needs_foot = places_m[chosen[feet], 1] - soil_m > 1e-3 * height_m
    feet, feet_m = feet[needs_foot], feet_m[needs_foot]
    center_m = np.concatenate([places_m[chosen], feet_m])
    parents = np.concatenate([np.where(own < 0, -1, number[np.maximum(own, 0)]), np.full(len(feet), -1)]).astype(
        np.int32
    )
    parents[feet] = len(chosen) + np.arange(len(feet))
    is_base = np.concatenate([chosen >= count, np.zeros(len(feet), bool)])
    axes = find_axes(center_m, parents, settings.twig * height_m)
    weight = np.ones(len(center_m))
    fixed = is_base.copy()
    fixed[len(chosen) :] = True
    weight[fixed] = 1e6
    fair_m = fair_axes(center_m, axes, weight, settings.stiffness, 3 * stems.footprint_m)
    radius_m = _fair_radii(parents, chosen, stems, count)
    sections = SectionTree(
        center_m=center_m,
        points=np.ones(len(center_m), np.int32),
        parent=parents,
        section=np.arange(len(center_m), dtype=np.int32),
    )
    radii = Radii(radius_m=radius_m, believed=~is_base, exponent=0.5, noise_m=stems.footprint_m)
    traced = TracedAxes(
        sections=sections, axes=axes, center_m=fair_m, parent=axes.parent_node(len(center_m)), radii=radii
    )
    skeleton = as_skeleton(traced)
    refinement = RefinementSettings()
    skeleton = round_bends(
        collapse_nodes(settle_attachments(skeleton), settings.twig * height_m, refinement), refinement
    )
    joined = np.zeros(count, bool)
    joined[chosen[chosen < count]] = True
    leaf = np.full(len(places_m) - count, -1, np.int64)
    at = chosen[chosen >= count]
    if len(at) and len(skeleton):
        away_m, nearest = (np.asarray(each) for each in cKDTree(skeleton.points_m).query(places_m[at]))
        near = away_m < 0.02 * height_m
        leaf[at[near] - count] = nearest[near]
    apart = _find_apart(stems, joined, settings.twig * height_m, skeleton)
    return JoinedStems(skeleton=skeleton, joined=joined, leaf=leaf, turned=turned, apart=apart)


def _find_apart(
    stems: StemPoints, joined: NDArray[np.bool_], min_m: float, skeleton: Skeleton
) -> tuple[StemPiece, ...]:
    """Pieces that are rather stems than not, as long as a twig, and beside the skeleton."""
    left = stems.take(~joined & (stems.odds > 0))
    if not len(left):
        return ()
    reach_m = _TOUCHING * stems.footprint_m
    piece = touching_parts(left.points_m, reach_m)
    away_m = np.asarray(cKDTree(skeleton.points_m).query(left.points_m)[0])
    found = []
    for number in range(int(piece.max()) + 1):
        own_m = left.points_m[piece == number]
        length_m = float(np.linalg.norm(np.ptp(own_m, axis=0)))
        if length_m >= min_m and np.median(away_m[piece == number]) > min_m:
            found.append(StemPiece(length_m=length_m, middle_m=own_m.mean(axis=0)))
    return tuple(sorted(found, key=lambda each: -each.length_m))


def _fair_radii(
    parents: NDArray[np.int32], chosen: NDArray[np.int64], stems: StemPoints, count: int
) -> NDArray[np.float64]:
    """(N,) radii that change slowly along stems and never grow outwards; what was not measured is as its neighbours."""
    nodes = len(parents)
    known = np.flatnonzero(chosen < count)
    log_radius, weight = np.zeros(nodes), np.zeros(nodes)
    log_radius[known] = np.log(stems.radius_m[chosen[known]])
    weight[known] = np.exp(np.clip(stems.odds[chosen[known]], -3, 2))
    tree = RootedTree(parents)
    middle = float(np.average(log_radius[known], weights=weight[known])) if len(known) else np.log(stems.footprint_m)
    for _ in range(40):  # of spreading along links: as far as 40 places
        total, mass = log_radius * weight, weight.copy()
        up = np.flatnonzero(parents >= 0)
        for to, source in ((up, parents[up]), (parents[up], up)):
            np.add.at(total, to, 0.5 * log_radius[source] * np.minimum(weight[source], 1))
            np.add.at(mass, to, 0.5 * np.minimum(weight[source], 1))
        spread = np.where(mass > 0, total / np.where(mass > 0, mass, 1), middle)
        weight = np.where(weight > 0, weight, np.minimum(mass, 0.5))
        log_radius = spread
    lower, upper = log_radius.copy(), log_radius.copy()
    for level in tree.levels[1:]:
        lower[level] = np.minimum(lower[level], lower[tree.parent[level]])
    for level in reversed(tree.levels[1:]):
        np.maximum.at(upper, tree.parent[level], upper[level])
    return np.exp(0.5 * (lower + upper))
