"""From places on stems to one skeleton: each stem from the soil up, each petiole to its leaf.

The cheapest paths from the soil lead along stems that photographs show, and straight on across what they do not. Of
the tree of these paths that part is kept for which most speaks: places on stems and the bases of leaves speak for it,
gaps and places that are rather of leaves against it. Our own; that a plant's skeleton is a tree of cheapest paths from
its root is that of A. Verroust and F. Lazarus, Extracting skeletal curves from 3D scattered data, 2000.
"""

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.special import logit

from usdfoliage.branch.photographs.join_settings import JoinSettings
from usdfoliage.branch.photographs.joined import TOUCHING, JoinedStems, make_skeleton
from usdfoliage.branch.photographs.paths import Links, find_cheapest_paths, link_places, weigh_links
from usdfoliage.branch.photographs.stem_points import StemPoints
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.wood import best_rooted_part
from usdfoliage.geometry.point_cells import touching_parts

logger = logging.getLogger(__name__)

_TURNS = 5  # of leaving out roots that carry no stem
_CLEAREST = 0.4  # logarithm of two costs, beyond which their difference does not count
_UNREACHED = 1e9  # metres, the cost of what no path leads to
_SUREST = 0.999  # certainty of a leaf's base, beyond which more does not count


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
    links = link_places(stems, ends_m, settings.longest_gap * height_m)
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
    costs = weigh_links(links, odds, height_m, settings)
    apart_m = 3 * stems.footprint_m
    may_root = np.zeros(len(places_m), bool)
    above_m = stems.points_m[:, 1] - soil_m
    may_root[:count] = _on_clear_stems(stems, settings.unbroken * height_m) | (above_m < settings.low * height_m)
    for _ in range(_TURNS):
        parent, cost = find_cheapest_paths(costs, stems, odds, soil_m, height_m, may_root, settings)
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
    return make_skeleton(places_m, parent, kept, stems, count, turned, soil_m, height_m, settings)


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
    links = link_places(stems, ends_m, settings.longest_gap * height_m)
    return _find_turned(links, stems, ends_m, certainty, soil_m, settings)


def _find_turned(
    links: Links,
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
    costs = weigh_links(links, odds, height_m, settings)
    # No path goes on from the end of a leaf.
    costs = replace(
        costs,
        outwards=np.where(costs.one < count, costs.outwards, np.inf),
        back=np.where(costs.other < count, costs.back, np.inf),
    ).take((costs.one < count) | (costs.other < count))
    may_root = np.ones(count + len(ends_m), bool)
    _, cost = find_cheapest_paths(costs, stems, odds, soil_m, height_m, may_root, settings)
    base, apex = np.split(np.minimum(cost[count:], _UNREACHED), 2)
    less = np.log(base / apex)  # above 0 where the apex is nearer
    return np.asarray(settings.end * np.clip(less, -_CLEAREST, _CLEAREST) > logit(np.clip(certainty, 0.5, _SUREST)))


def _height_m(points_m: NDArray[np.float64], ends_m: NDArray[np.float64], soil_m: float) -> float:
    """Of the highest of places on stems (S, 3) and ends of leaves (E, 3) above the soil."""
    return float(np.concatenate([points_m, ends_m])[:, 1].max()) - soil_m


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
    piece = touching_parts(points_m, TOUCHING * stems.footprint_m)
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
