"""The branching skeleton of a lobed leaf: smooth lines between forks, from the base to a tip in each lobe.

Source:
    L. Mündermann et al., Modeling lobed leaves, section 3.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from usdfoliage.geometry.lines import arc_lengths, meet_outline, points_at, polygon_area, spread_evenly
from usdfoliage.leaf.lobed.medial_axis import MedialAxis

Floats = NDArray[np.float64]

_DIRECTION = 6.0  # of a limb where it leaves a fork: towards what is so many pixels along it


@dataclass(frozen=True, kw_only=True)
class SkeletonSettings:
    """How smooth limbs are, and how far they go into the tips of lobes."""

    smooth: float = 0.02  # deviation of the mean along limbs, as a part of the root of the leaf's area
    straight: float = 0.08  # at a tip, over which its direction is measured, likewise
    keep_off_px: float = 3.0  # of a tip from the outline, or half of what was between them

    def __post_init__(self) -> None:
        if not (self.smooth >= 0 and self.straight > 0 and self.keep_off_px > 0):
            raise ValueError("smooth must not be below 0; straight and keep_off_px must be above 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class Limb:
    """A line between two nodes that are forks or tips."""

    begin: int
    end: int
    points: Floats  # (K, 2), from the one to the other

    def towards(self, node: int) -> Floats:
        """Its points so that they end in one of its nodes."""
        return self.points if node == self.end else self.points[::-1]


@dataclass(frozen=True, kw_only=True, eq=False)
class LimbTree:
    """Limbs that are joined in a tree, and where it begins."""

    nodes: Floats  # (N, 2), forks and tips
    limbs: Sequence[Limb]
    base: int  # a tip

    def limbs_of(self, node: int) -> list[int]:
        """Numbers of the limbs that end in a node."""
        return [number for number, limb in enumerate(self.limbs) if node in (limb.begin, limb.end)]


def build_limbs(
    axis: MedialAxis, outline: Floats, base: Floats, settings: SkeletonSettings = SkeletonSettings()
) -> LimbTree:
    """The limbs of a medial axis, smooth, and longer by what is left to the outline at tips.

    Args:
        axis: A tree of places.
        outline: (K, 2), closed.
        base: (2,), the tip nearest to it is where the tree begins.
        settings: How.

    Raises:
        ValueError: The axis is a single place.
    """
    size = np.sqrt(abs(polygon_area(outline)))
    ends = [place for place, near in enumerate(axis.neighbors) if len(near) != 2]
    if len(ends) < 2:
        raise ValueError("the outline is a disc: it has no axis")
    number = {place: node for node, place in enumerate(ends)}
    nodes = axis.places[ends].copy()
    limbs = []
    for place in ends:
        for near in axis.neighbors[place]:
            chain = _follow(axis, place, near)
            if chain[0] < chain[-1]:
                points = _smooth(axis.places[chain], settings.smooth * size)
                limbs.append(Limb(begin=number[chain[0]], end=number[chain[-1]], points=points))
    tips = [node for node, place in enumerate(ends) if len(axis.neighbors[place]) == 1]
    for node in tips:
        which = next(number for number, limb in enumerate(limbs) if node in (limb.begin, limb.end))
        limb = limbs[which]
        longer = _lengthen(limb.towards(node), outline, settings.straight * size, settings.keep_off_px)
        nodes[node] = longer[-1]
        points = longer if node == limb.end else longer[::-1]
        limbs[which] = Limb(begin=limb.begin, end=limb.end, points=points)
    first = min(tips, key=lambda node: float(np.linalg.norm(nodes[node] - base)))
    return LimbTree(nodes=nodes, limbs=limbs, base=first)


def walk_around(tree: LimbTree) -> list[tuple[int, bool]]:
    """The limbs in the order in which the outline passes them, counter-clockwise from the base: each twice.

    Returns:
        Number of a limb, and whether it is walked from its begin to its end.
    """
    at: list[list[tuple[int, bool]]] = [[] for _ in tree.nodes]
    for number, limb in enumerate(tree.limbs):
        at[limb.begin].append((number, True))
        at[limb.end].append((number, False))
    leg = at[tree.base][0]
    legs = []
    while True:
        legs.append(leg)
        number, forward = leg
        limb = tree.limbs[number]
        node = limb.end if forward else limb.begin
        if node == tree.base:
            return legs
        back = (number, not forward)
        others = [each for each in at[node] if each[0] != number]
        if others:
            facing = _angle(tree, back)
            back = min(others, key=lambda each: (_angle(tree, each) - facing) % (2 * np.pi))
        leg = back


def end_direction(points: Floats) -> Floats:
    """(2,) the unit direction in which a line (K, 2) ends."""
    step = points[-1] - points[max(0, len(points) - 6)]
    return np.asarray(step / max(float(np.linalg.norm(step)), 1e-12))


def _follow(axis: MedialAxis, place: int, near: int) -> list[int]:
    """The places from one end through a neighbour of it to the next end."""
    chain = [place, near]
    while len(axis.neighbors[chain[-1]]) == 2:
        one, other = axis.neighbors[chain[-1]]
        chain.append(other if one == chain[-2] else one)
    return chain


def _smooth(line: Floats, deviation: float) -> Floats:
    """A line with points a unit apart, without its unevenness; its ends stay."""
    length = float(arc_lengths(line)[-1])
    even = spread_evenly(line, max(8, int(length)))
    spread = deviation * (len(even) - 1) / max(length, 1e-12)
    # Point reflection at the ends keeps these where they are.
    reach = min(len(even) - 1, int(4 * spread) + 1)
    before, after = 2 * even[0] - even[reach:0:-1], 2 * even[-1] - even[-2 : -reach - 2 : -1]
    smooth = gaussian_filter1d(np.concatenate([before, even, after]), spread, axis=0)[reach:-reach]
    smooth[0], smooth[-1] = even[0], even[-1]
    return np.asarray(smooth)


def _lengthen(line: Floats, outline: Floats, straight: float, keep_off: float) -> Floats:
    """A line that goes straight on at its end, nearly to the outline."""
    length = float(arc_lengths(line)[-1])
    behind = points_at(line, np.array([length - min(length / 2, max(3.0, straight))]))[0]
    direction = (line[-1] - behind) / max(float(np.linalg.norm(line[-1] - behind)), 1e-12)
    met = meet_outline(outline, line[-1], direction)
    if met is None:
        return line
    side = int(met)
    hit = outline[side] + (met - side) * (outline[(side + 1) % len(outline)] - outline[side])
    gap = float(np.linalg.norm(hit - line[-1]))
    if gap <= keep_off:
        return line
    longer = np.concatenate([line, [line[-1] + direction * (gap - min(gap / 2, keep_off))]])
    return spread_evenly(longer, max(8, int(arc_lengths(longer)[-1])))


def _angle(tree: LimbTree, leg: tuple[int, bool]) -> float:
    """In which direction a limb leaves its node, radians."""
    number, forward = leg
    points = tree.limbs[number].points if forward else tree.limbs[number].points[::-1]
    ahead = points_at(points, np.array([min(_DIRECTION, float(arc_lengths(points)[-1]))]))[0] - points[0]
    return float(np.arctan2(ahead[1], ahead[0]))
