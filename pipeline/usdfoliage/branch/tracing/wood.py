"""Wood and leaves: which sections of a cloud are of branches, where the plant was captured with its leaves on.

A slice of a leaf is a section like one of a twig. But the path through a leaf wanders from point to point, where a twig
goes straight on; a leaf holds many points for its length; and more of the space around is filled. These are weighed
together, and what is kept is the tree that has most for it as a whole: a section that looks like a leaf stays where
enough wood is beyond it. The features and the tree are our own; the idea of a path that is followed is that of
M. Vicari et al., Leaf and wood classification framework for terrestrial LiDAR point clouds, 2019.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.sections import SectionTree
from usdfoliage.geometry.point_cells import cell_means, number_cells

# Lengths in distances to the sixth neighbour.
_WINDOWS = (10.0, 20.0)  # of a path, to both sides, over which its straightness is measured
_CELL = 1.0  # of which filled ones are counted
_AROUND = 1.5  # of a section, where they are counted
_BLUR = 0.1  # that a path wanders in any case
_MAX_SECTIONS = 250  # of a path within a window
# Logarithm of the odds for wood: constant; straightness in both windows, fewness of points, emptiness around. Logistic
# regression, rounded, on a simulated tree with leaves of several sizes, scanned and sampled at several spacings and
# noises, the same without leaves, and two real clouds without leaves and with simulated ones.
_WEIGHTS = (-1.3, 1.8, 1.2, 2.5, 0.8)
MAX_SURE = 6.0  # logarithm of the odds
_STEM_SURE = 3.0  # of what is on a thick stem


@dataclass(frozen=True, kw_only=True)
class WoodSettings:
    """What is wood, and when a plant has leaves."""

    leaf_m: float = 0.1  # length of a typical leaf
    leaf_spacings: float = 3.0  # distances to the sixth neighbour in it, fewer of which do not show what it is
    leafless: float = 0.75  # share of the sections' length that is wood, from which on a plant has no leaves
    learned: float = 0.5  # weight of the odds learned of generated trees (wood_facts.py); the others are of paths alone
    caution: float = 0.5  # added to the logarithm of the odds for wood: among leaves it looks less like it
    color_caution: float = 1.2  # likewise, where colours distinguish wood from leaves well
    color_weight: float = 2.0  # of the odds by colours: a section has more than one independent point
    max_points: int = 500_000  # of a cloud, of which more are thinned for this:
    few_points: int = 200_000  # leaves that are seen from near are no more like leaves, and ways cost much
    settled: float = 0.87  # share that is wood of what was left, from which on no leaves are looked for any more
    max_turns: int = 5  # of leaving leaves out

    def __post_init__(self) -> None:
        if not (self.leaf_m > 0 and self.leaf_spacings > 0 and 0 <= self.leafless <= 1 and 0 <= self.settled <= 1):
            raise ValueError(f"leaf_m, leaf_spacings must be above 0, leafless and settled in [0, 1], not {self}")
        if not 2 <= self.few_points <= self.max_points:
            raise ValueError(f"2 <= few_points <= max_points, not {self.few_points} and {self.max_points}")
        if not np.isfinite([self.caution, self.color_caution, self.color_weight]).all() or self.color_weight < 0:
            raise ValueError(
                f"caution, color_caution and color_weight must be numbers, color_weight not below 0: {self}"
            )
        if not 0 <= self.learned <= 1:
            raise ValueError(f"learned must be in [0, 1], not {self.learned}")
        if self.max_turns < 1:
            raise ValueError(f"max_turns must be at least 1, not {self.max_turns}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Wood:
    """What of a cloud's sections is wood."""

    sections: NDArray[np.bool_]  # (S,), from the root on without gaps
    share: float  # of the length of all sections


def shows_leaves(spacing_m: float, settings: WoodSettings = WoodSettings()) -> bool:
    """Whether points that are spacing_m from their sixth neighbour are close enough together to recognise leaves."""
    return settings.leaf_spacings * spacing_m <= settings.leaf_m


def wood_odds(features: NDArray[np.float64]) -> NDArray[np.float64]:
    """(S,) logarithm of the odds that a section is of wood, by its features (S, 4) as wood_features measures them."""
    return np.asarray(_WEIGHTS[0] + features @ _WEIGHTS[1:])


def caution_with_colors(color_odds: NDArray[np.float64], settings: WoodSettings) -> float:
    """What is added to the logarithm of the odds for wood where colours count: the more, the more they distinguish.

    Args:
        color_odds: (N,) logarithms of the odds by the colour of each point.
        settings: caution where colours distinguish nothing, color_caution where they distinguish all.
    """
    known = 1 - np.exp(-float(np.abs(color_odds).mean())) if len(color_odds) else 0.0
    return settings.caution + known * (settings.color_caution - settings.caution)


def choose_wood(sections: SectionTree, odds: NDArray[np.float64], stem: NDArray[np.bool_], spacing_m: float) -> Wood:
    """The part of a tree of sections, with all its roots, for which the odds of being wood are best.

    Args:
        sections: Of a cloud.
        odds: (S,), their logarithms, however they came about.
        stem: (S,), those on thick stems, which are wood whatever they look like.
        spacing_m: To the sixth neighbour.
    """
    step_m = step_lengths(sections.center_m, sections.parent)
    sure = np.where(stem, _STEM_SURE, np.clip(odds, -MAX_SURE, MAX_SURE))
    kept = best_rooted_part(RootedTree(sections.parent), sure * np.maximum(step_m, 0.05 * spacing_m))
    whole_m = float(step_m.sum())
    return Wood(sections=kept, share=float(step_m[kept].sum()) / whole_m if whole_m > 0 else 1.0)


def best_rooted_part(tree: RootedTree, gain: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(S,) nodes of the part, with all roots and without gaps, whose gains (S,) are most together."""
    best = np.array(gain, np.float64)
    for level in reversed(tree.levels[1:]):
        np.add.at(best, tree.parent[level], np.maximum(best[level], 0))
    kept = tree.parent < 0
    for level in tree.levels[1:]:
        kept[level] = kept[tree.parent[level]] & (best[level] > 0)
    return kept


def wood_features(points_m: NDArray[np.float64], sections: SectionTree, spacing_m: float) -> NDArray[np.float64]:
    """(S, 4) what speaks for wood, the more the likelier: straightness in two windows, fewness of points, emptiness
    around.

    All four are logarithms of ratios, so that they do not depend on the size of the plant.

    Args:
        points_m: (N, 3), that fill the space around.
        sections: Of the points, or of some of them.
        spacing_m: To the sixth neighbour.
    """
    tree = RootedTree(sections.parent)
    step_m = step_lengths(sections.center_m, sections.parent)
    carried_m = tree.sum_above(step_m)
    following = tree.first_child(carried_m)
    straight = [
        _straightness(sections, step_m, following, window * spacing_m, _BLUR * spacing_m) for window in _WINDOWS
    ]
    points = tree.sum_above(sections.points.astype(np.float64))
    few = np.log((carried_m - step_m + spacing_m) / ((points + 1) * spacing_m))
    # One point a cell: how close points are together there no longer counts.
    cells = cKDTree(cell_means(points_m, number_cells(points_m, _CELL * spacing_m)))
    near = cells.query_ball_point(sections.center_m, _AROUND * spacing_m, workers=-1, return_length=True)
    return np.column_stack([*straight, few, -np.log(np.asarray(near) + 0.5)])


def walk_paths(
    parent: NDArray[np.signedinteger],
    following: NDArray[np.signedinteger],
    step_m: NDArray[np.float64],
    window_m: float,
    max_sections: int,
) -> Iterator[tuple[NDArray[np.signedinteger], NDArray[np.signedinteger]]]:
    """Sections (K,), and for each the next one (K,) of its path within window_m: towards the root, then away from it.

    Args:
        parent: (S,), -1 for roots.
        following: (S,), the section in which a path goes on; -1 at its end.
        step_m: (S,), length from each section's parent to it.
        window_m: Along the path, to either side.
        max_sections: To either side.
    """
    for upwards in (False, True):
        own: NDArray[np.signedinteger] = np.arange(len(parent))
        at: NDArray[np.signedinteger] = own
        path_m = np.zeros(len(parent))
        for _ in range(max_sections):
            beside = following[at] if upwards else parent[at]
            path_m = path_m + np.where(beside < 0, np.inf, step_m[beside] if upwards else step_m[at])
            on = path_m <= window_m
            if not on.any():
                break
            own, at, path_m = own[on], beside[on], path_m[on]
            yield own, at


def _straightness(
    sections: SectionTree,
    step_m: NDArray[np.float64],
    following: NDArray[np.int64],
    window_m: float,
    blur_m: float,
) -> NDArray[np.float64]:
    """(S,) logarithm of how much longer than wide the path is, on both sides of each section, within window_m."""
    center_m, count = sections.center_m, len(sections)
    count_near = np.ones(count)
    total = np.zeros((count, 3))  # of the path's sections, from the own one, so that no digits are lost
    square = np.zeros((count, 3, 3))
    for own, at in walk_paths(sections.parent, following, step_m, window_m, _MAX_SECTIONS):
        offset_m = center_m[at] - center_m[own]
        count_near[own] += 1
        total[own] += offset_m
        square[own] += offset_m[:, :, None] * offset_m[:, None, :]
    mean_m = total / count_near[:, None]
    spread = np.linalg.eigvalsh(square / count_near[:, None, None] - mean_m[:, :, None] * mean_m[:, None, :])
    long_m, wide_m = np.sqrt(np.maximum(spread[:, 2], 0)), np.sqrt(np.maximum(spread[:, 1], 0))
    return np.asarray(np.log((long_m + blur_m) / (wide_m + blur_m)))
