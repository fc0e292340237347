"""Railroad ties between the skeleton of a leaf and its silhouette.

The skeleton is walked around as the outline passes it: each limb twice, each fork once for each limb. Anchors part the
outline into segments, one for each limb and side; in a segment ties are equally spaced along both. Our own: from there
a tie may slide along the outline, so that the outline is met where it turns, no tie leaves the leaf, and no quad is
folded. The best of all choices is found by dynamic programming.

Source:
    L. Mündermann et al., Modeling lobed leaves, section 3.3.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.lines import arc_lengths, meet_outline, points_at, spread_evenly
from usdfoliage.leaf.lobed.skeleton import LimbTree, end_direction, walk_around

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FINER = 2  # pixels across one, of the picture in which it is measured whether ties leave the leaf
_ALONG = np.linspace(0.08, 0.92, 9)  # of a tie, where that is measured
_OUTSIDE_PX = 0.4  # by which a tie may leave the leaf
_CLOSEST_PX = 0.8  # apart, that nodes of the skeleton are at least


@dataclass(frozen=True, kw_only=True)
class TieSettings:
    """How dense ties are, and what they cost."""

    spacing_px: float = 3.0  # along the outline, at most, before ties slide
    limit: int = 700  # about so many in all: in larger leaves they are farther apart
    samples: int = 4  # places of the outline between neighbours, to which a tie may slide
    slides: tuple[int, ...] = (4, 8, 16)  # spacings by which it may slide; more where a quad is folded else
    leans: tuple[float, ...] = (0.5, 1.0)  # of ties towards tips, in their lengths, tried where quads are folded else
    off_outline: float = 2.0  # a square pixel of the outline's distance from the edge between ties
    off_place: float = 0.125  # a squared spacing by which a tie slid
    uneven: float = 0.3  # a squared part by which an edge is longer or shorter than it would be
    outside: float = 4.0  # a place of a tie that is outside
    folded: float = 60.0  # a quad with a negative area; a triangle of it costs a twentieth

    def __post_init__(self) -> None:
        if not (self.spacing_px > 0 and self.limit >= 20 and self.samples >= 1 and self.slides):
            raise ValueError("spacing_px must be above 0, limit at least 20, samples 1 or more, slides given")


@dataclass(frozen=True, kw_only=True, eq=False)
class Ties:
    """The ties of a leaf, in the order of the outline; the last one is the first again, and is not among them."""

    nodes: Floats  # (N, 2), of the skeleton
    limb_nodes: Sequence[Ints]  # nodes of each limb, from its begin to its end
    node: Ints  # (T,), where each begins
    foot: Floats  # (T, 2), where it ends on the outline, counter-clockwise
    base: int  # the node where the leaf begins

    def quads(self) -> Ints:
        """(T, 4) corners of the faces, counter-clockwise: nodes first, then feet, whose numbers begin after nodes."""
        ahead = np.roll(np.arange(len(self.node)), -1)
        feet = len(self.nodes) + np.arange(len(self.node))
        return np.stack([self.node, feet, feet[ahead], self.node[ahead]], axis=-1)

    def places(self) -> Floats:
        """(N + T, 2) the points of the faces."""
        return np.concatenate([self.nodes, self.foot])

    def areas(self) -> Floats:
        """(T,) of the faces, positive where they are not folded."""
        corners = self.places()[self.quads()]
        x, y = corners[..., 0], corners[..., 1]
        return np.asarray((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1) / 2)


def lay_ties(tree: LimbTree, outline: Floats, settings: TieSettings = TieSettings()) -> Ties:
    """Ties for a leaf.

    Args:
        tree: Its skeleton.
        outline: (K, 2), closed, counter-clockwise.
        settings: How.

    Raises:
        ValueError: No ties were found that go around the outline in order.
    """
    length = float(arc_lengths(np.concatenate([outline, outline[:1]]))[-1])
    spacing = max(settings.spacing_px, length / settings.limit)
    samples = _from_base(tree, outline, int(np.ceil(length / spacing)) * settings.samples)
    legs = walk_around(tree)
    anchor = _anchors(tree, legs, samples)
    nodes, limb_nodes = _spread_nodes(tree, legs, np.diff(anchor) / settings.samples)
    walk, place = [tree.base], [0.0]
    for number, (limb, forward) in enumerate(legs):
        passed = limb_nodes[limb] if forward else limb_nodes[limb][::-1]
        walk += passed[1:].tolist()
        place += (anchor[number] + (anchor[number + 1] - anchor[number]) * np.linspace(0, 1, len(passed))[1:]).tolist()
    best = _slide_best(tree, nodes, limb_nodes, np.array(walk), np.array(place), samples, settings)
    if best is None:
        raise ValueError("no railroad ties go around the outline")
    for lean in settings.leans if best[0] else ():
        leaning = _lean(nodes[walk], np.array(place), legs, limb_nodes, samples, lean)
        other = _slide_best(tree, nodes, limb_nodes, np.array(walk), leaning, samples, settings)
        if other is not None and other[0] < best[0]:
            best = other
    return best[1]


def _slide_best(
    tree: LimbTree,
    nodes: Floats,
    limb_nodes: tuple[Ints, ...],
    walk: Ints,
    place: Floats,
    samples: Floats,
    settings: TieSettings,
) -> tuple[int, Ties] | None:
    """How many quads are folded at the slide that folds the fewest, and the ties then; None where none go around."""
    best: tuple[int, Ties] | None = None
    for slide in settings.slides:
        foot = _slide(nodes[walk], place, samples, slide * settings.samples, settings)
        if foot is None:
            continue
        ties = Ties(
            nodes=nodes, limb_nodes=limb_nodes, node=walk[:-1], foot=samples[foot[:-1] % len(samples)], base=tree.base
        )
        folded = int((ties.areas() <= 0).sum())
        if best is None or folded < best[0]:
            best = folded, ties
        if not folded:
            break
    return best


def _lean(
    walk: Floats,
    place: Floats,
    legs: Sequence[tuple[int, bool]],
    limb_nodes: Sequence[Ints],
    samples: Floats,
    lean: float,
) -> Floats:
    """(M + 1,) places of the outline that lie nearer to tips than place (M + 1,) does, by a part of each tie's length.

    Beside teeth that point to the tip, ties that lean as veins do are less folded. At the ends of each leg they stay
    where they are.
    """
    step = float(np.linalg.norm(np.diff(samples, axis=0), axis=1).mean())
    leaning = place.copy()
    first = 0
    for limb, forward in legs:
        last = first + len(limb_nodes[limb]) - 1
        inner = slice(first, last + 1)
        long = np.linalg.norm(samples[np.round(place[inner]).astype(np.int64) % len(samples)] - walk[inner], axis=1)
        room = np.minimum(place[inner] - place[first], place[last] - place[inner])
        ahead = np.minimum(lean * long / step, 0.8 * room)
        leaning[inner] = place[inner] + (ahead if forward else -ahead)
        leaning[inner] = np.maximum.accumulate(leaning[inner])
        first = last
    return leaning


def _from_base(tree: LimbTree, outline: Floats, count: int) -> Floats:
    """(count, 2) even places of the outline, the first where the axis would leave it at the base."""
    begin = _hit(tree, tree.base, outline)
    side = int(begin)
    closed = np.concatenate([outline, outline[:1]])
    along = arc_lengths(closed)
    first = along[side] + (begin - side) * (along[side + 1] - along[side])
    return points_at(closed, (first + np.arange(count) / count * along[-1]) % along[-1])


def _hit(tree: LimbTree, tip: int, outline: Floats) -> float:
    """Where the tangent of a tip meets the outline, else what is nearest to it."""
    limb = tree.limbs[tree.limbs_of(tip)[0]]
    met = meet_outline(outline, tree.nodes[tip], end_direction(limb.towards(tip)))
    return float(np.argmin(((outline - tree.nodes[tip]) ** 2).sum(axis=1))) if met is None else met


def _anchors(tree: LimbTree, legs: Sequence[tuple[int, bool]], samples: Floats) -> Floats:
    """(L + 1,) places of the outline where legs begin, and where the last one ends: rising, from 0 to their number."""
    visited = [tree.base]
    for number, forward in legs:
        limb = tree.limbs[number]
        visited.append(limb.end if forward else limb.begin)
    anchor = np.full(len(visited), np.nan)
    anchor[0], anchor[-1] = 0, len(samples)
    tips = [place for place in range(1, len(visited) - 1) if len(tree.limbs_of(visited[place])) == 1]
    anchor[tips] = [_hit(tree, visited[place], samples) for place in tips]
    if (np.diff([0.0, *anchor[tips], float(len(samples))]) <= len(tips)).any():
        anchor[tips] = _closest_in_order(tree.nodes[[visited[place] for place in tips]], samples, 0, len(samples))
    marks = [0, *tips, len(visited) - 1]
    for first, last in itertools.pairwise(marks):
        inner = np.arange(first + 1, last)
        if len(inner):
            forks = tree.nodes[[visited[place] for place in inner.tolist()]]
            low, high = int(np.ceil(anchor[first])), int(np.floor(anchor[last]))
            anchor[inner] = _closest_in_order(forks, samples, low, high)
    return anchor


def _closest_in_order(points: Floats, samples: Floats, low: int, high: int) -> Floats:
    """(P,) rising places between two others, the nearest to points (P, 2) in all."""
    between = np.arange(low + 1, high)
    if len(between) < len(points):
        return np.linspace(low, high, len(points) + 2)[1:-1]
    away = ((samples[between % len(samples)] - points[:, None]) ** 2).sum(axis=2)
    cost, backs = away[0], []
    for row in away[1:]:
        lowest = np.minimum.accumulate(cost)
        which = np.maximum.accumulate(np.where(cost == lowest, np.arange(len(cost)), 0))
        backs.append(np.concatenate([[0], which[:-1]]))
        cost = np.concatenate([[np.inf], lowest[:-1]]) + row
    chosen = [int(np.argmin(cost))]
    for back in reversed(backs):
        chosen.append(int(back[chosen[-1]]))
    return np.asarray(between[chosen[::-1]], np.float64)


def _spread_nodes(
    tree: LimbTree, legs: Sequence[tuple[int, bool]], spacings: Floats
) -> tuple[Floats, tuple[Ints, ...]]:
    """Nodes of limbs: forks and tips, then as many in each as the longer of its two sides asks for.

    Args:
        tree: The limbs.
        legs: Of the walk.
        spacings: (L,) how many spacings of the outline lie beside each leg.
    """
    longer = np.zeros(len(tree.limbs))
    for (number, _), count in zip(legs, spacings.tolist(), strict=True):
        longer[number] = max(longer[number], count)
    nodes = [tree.nodes]
    total = len(tree.nodes)
    limb_nodes = []
    for limb, count in zip(tree.limbs, longer.tolist(), strict=True):
        room = max(2, int(arc_lengths(limb.points)[-1] / _CLOSEST_PX))
        steps = min(max(2, int(np.ceil(count))), room)
        nodes.append(spread_evenly(limb.points, steps + 1)[1:-1])
        limb_nodes.append(np.array([limb.begin, *range(total, total + steps - 1), limb.end]))
        total += steps - 1
    return np.concatenate(nodes), tuple(limb_nodes)


def _slide(walk: Floats, place: Floats, samples: Floats, reach: int, settings: TieSettings) -> Ints | None:
    """(M + 1,) the samples at which ties end, from the first to itself again; None where there is no order of them.

    Args:
        walk: (M + 1, 2), where ties begin, the first and the last the same.
        place: (M + 1,), where they would end if they were equally spaced, in samples.
        samples: (S, 2), of the outline.
        reach: How many samples a tie may slide.
        settings: Costs.
    """
    count = len(samples)
    nearest = np.round(place).astype(np.int64)
    widest = int(min(max(3 * reach, 2 * reach + np.diff(nearest).max() + 1), count - 1))
    bulge = _bulges(samples, widest)
    depth, low = _draw_depth(samples)
    offset = np.arange(-reach, reach + 1)
    expected = np.maximum(np.diff(place), 0.5)
    cost = np.where(offset == 0, 0.0, np.inf)
    backs = []
    for step in range(1, len(walk)):
        before, now = nearest[step - 1] + offset, nearest[step] + offset
        foot_before, foot = samples[before % count], samples[now % count]
        along = walk[step] + _ALONG[:, None, None] * (foot - walk[step])
        own = settings.outside * (_read_depth(depth, low, along) < -_OUTSIDE_PX).sum(axis=0)
        own = own + settings.off_place * ((now - place[step]) / settings.samples) ** 2
        allowed = now == count if step == len(walk) - 1 else (now > 0) & (now < count)
        own = np.where(allowed, own, np.inf)
        gap = now[None, :] - before[:, None]
        first = _twice_area(walk[step - 1], foot_before[:, None], foot[None])
        second = _twice_area(walk[step - 1], foot[None], walk[step])
        bent = (settings.folded / 20) * ((first <= 1e-3).astype(np.float64) + (second <= 1e-3))
        bent += settings.folded * (first + second <= 1e-3)
        edge = settings.off_outline * bulge[before[:, None] % count, np.clip(gap, 0, widest)] ** 2
        edge += settings.uneven * (gap / expected[step - 1] - 1) ** 2 + bent
        total = cost[:, None] + np.where((gap >= 1) & (gap <= widest), edge, np.inf)
        back = np.argmin(total, axis=0)
        cost = total[back, np.arange(len(offset))] + own
        backs.append(back)
    if not np.isfinite(cost).any():
        return None
    chosen = [int(np.argmin(cost))]
    for back in reversed(backs):
        chosen.append(int(back[chosen[-1]]))
    return nearest + offset[chosen[::-1]]


def _twice_area(one: Floats, other: Floats, third: Floats) -> Floats:
    """Of triangles (..., 2), positive counter-clockwise."""
    return np.asarray(
        (other[..., 0] - one[..., 0]) * (third[..., 1] - one[..., 1])
        - (other[..., 1] - one[..., 1]) * (third[..., 0] - one[..., 0])
    )


def _bulges(samples: Floats, widest: int) -> Floats:
    """(S, widest + 1) how far the outline from each sample to one so many after it is from the edge between them."""
    count = len(samples)
    bulge = np.zeros((count, widest + 1))
    ring = samples[np.arange(count + widest) % count]
    for gap in range(2, widest + 1):
        chord = ring[gap : gap + count] - samples
        squared = np.maximum((chord**2).sum(axis=1), 1e-12)
        for between in np.unique(np.linspace(1, gap - 1, min(gap - 1, 10)).astype(np.int64)).tolist():
            to = ring[between : between + count] - samples
            part = np.clip((to * chord).sum(axis=1) / squared, 0, 1)
            away = np.linalg.norm(to - part[:, None] * chord, axis=1)
            bulge[:, gap] = np.maximum(bulge[:, gap], away)
    return bulge


def _draw_depth(samples: Floats) -> tuple[Floats, Floats]:
    """How deep pixels (H, W) are in an outline, negative outside of it, and the place (2,) of the first corner."""
    low, high = samples.min(axis=0) - 3, samples.max(axis=0) + 4
    width, height = np.ceil((high - low) * _FINER).astype(int)
    filled = np.zeros((height, width), np.uint8)
    cv2.fillPoly(filled, [np.round(((samples - low) * _FINER - 0.5) * 16).astype(np.int32)], 1, shift=4)
    within, beyond = (cv2.distanceTransform(each, cv2.DIST_L2, 5) for each in (filled, 1 - filled))
    return (within.astype(np.float64) - beyond) / _FINER, low


def _read_depth(depth: Floats, low: Floats, places: Floats) -> Floats:
    """(...) the depth at places (..., 2)."""
    pixel = np.round((places - low) * _FINER - 0.5).astype(np.int64)
    height, width = depth.shape
    return np.asarray(depth[np.clip(pixel[..., 1], 0, height - 1), np.clip(pixel[..., 0], 0, width - 1)])
