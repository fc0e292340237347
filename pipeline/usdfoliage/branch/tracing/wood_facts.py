"""What sections of wood and of leaves look like, near and along their paths, and how probably each is of wood.

The four facts of wood.py are of a path and its surroundings as a whole. Here come the forms that the points around a
section make at three sizes, the path that it is on, and the means of these along the path; a quadratic form weighs them
all. Its weights were learned from scans of generated trees with known leaves: tools/learn_wood.py, which writes
wood_weights.toml. The facts are our own; forms of neighbourhoods at several sizes are those of N. Brodu and D. Lague,
3D terrestrial lidar data classification of complex natural scenes using a multi-scale dimensionality criterion, 2012.
"""

import functools
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.sections import SectionTree
from usdfoliage.branch.tracing.wood import MAX_SURE, walk_paths
from usdfoliage.geometry.point_cells import one_in_each_cell
from usdfoliage.geometry.quadratic_form import QuadraticForm, parse_form

_WEIGHTS = "wood_weights.toml"
# Lengths in distances to the sixth neighbour.
_SIZES = ((2.0, 32), (4.0, 64), (8.0, 96))  # radius of what is around, and points of it that count at most
_THIN_FROM = 8.0  # of which one point in three is looked at
_THINNED = 3
_BLUR = 0.05  # of that radius, by which forms are wide in any case
_AXIS = 2  # sections to both sides, through which a path's direction is measured
_ALONG = 8.0  # of a path to both sides, over which facts are averaged
_MAX_ALONG = 40  # sections of it
_BLOCK = 16_384  # sections at a time, so that temporaries stay small
_EXTREME = 5.0  # standard deviations of a fact, beyond which nothing changes

Array = NDArray[np.float64]


def learned_wood_odds(points_m: Array, sections: SectionTree, spacing_m: float, features: Array) -> Array:
    """(S,) logarithm of the odds that a section is of wood, where a plant is known to have leaves.

    Args:
        points_m: (N, 3), of the cloud with all its leaves, those that were left out of the sections among them.
        sections: Of the points, or of some of them.
        spacing_m: To the sixth neighbour.
        features: (S, 4), as wood_features measures them.
    """
    form = _read_weights()
    facts = wood_facts(points_m, sections, spacing_m, features)
    low, high = form.middle - _EXTREME * form.spread, form.middle + _EXTREME * form.spread
    return np.asarray(np.clip(form.odds(np.clip(facts, low, high)), -MAX_SURE, MAX_SURE))


def wood_facts(points_m: Array, sections: SectionTree, spacing_m: float, features: Array) -> Array:
    """(S, 31), what the odds are weighed by: ratios and logarithms of such, which do not depend on the plant's size.

    Arguments are those of learned_wood_odds.
    """
    tree = RootedTree(sections.parent)
    step_m = step_lengths(sections.center_m, sections.parent)
    carried_m = tree.sum_above(step_m)
    following = tree.first_child(carried_m)
    axis = _path_directions(sections.center_m, sections.parent, following)
    forms = []
    for size, cap in _SIZES:
        some = points_m
        if size >= _THIN_FROM:
            some = points_m[one_in_each_cell(points_m, max(1, len(points_m) // _THINNED))[0]]
        forms.append(_forms_around(some, sections.center_m, axis, size * spacing_m, cap))
    depth_m = np.zeros(len(sections))  # the longest path beyond
    for level in reversed(tree.levels[1:]):
        np.maximum.at(depth_m, sections.parent[level], depth_m[level] + step_m[level])
    paths = np.column_stack(
        [
            np.log1p(carried_m / spacing_m),
            np.log1p(depth_m / spacing_m),
            np.log((carried_m - step_m + spacing_m) / (depth_m + spacing_m)),
            np.log(sections.points),
        ]
    )
    near = np.concatenate([forms[0][:, :4], forms[1][:, :4]], axis=1)
    along = _means_along(near, sections.parent, following, step_m, _ALONG * spacing_m)
    return np.concatenate([features, *forms, paths, along], axis=1)


@functools.cache
def _read_weights() -> QuadraticForm:
    return parse_form(files(__package__).joinpath(_WEIGHTS).read_text("utf-8"), "wood")


def _path_directions(center_m: Array, parent: NDArray[np.signedinteger], following: NDArray[np.signedinteger]) -> Array:
    """(S, 3) unit vectors from a section before to one after each; 0 where all are at one place."""
    before = after = np.arange(len(center_m))
    for _ in range(_AXIS):
        before = np.where(parent[before] >= 0, parent[before], before)
        after = np.where(following[after] >= 0, following[after], after)
    along_m = center_m[after] - center_m[before]
    length_m = np.linalg.norm(along_m, axis=1, keepdims=True)
    return np.divide(along_m, length_m, out=np.zeros_like(along_m), where=length_m > 0)


def _forms_around(points_m: Array, center_m: Array, axis: Array, radius_m: float, cap: int) -> Array:
    """(S, 5) of the points within a radius of each section: how many, how much longer than wide, and wider than thick
    they lie, how far along the path, and how far aside of the section."""
    tree = cKDTree(points_m)
    cap = min(cap, len(points_m))
    blocks = []
    for start in range(0, len(center_m), _BLOCK):
        middle_m = center_m[start : start + _BLOCK]
        away_m, nearest = tree.query(middle_m, k=[*range(1, cap + 1)], distance_upper_bound=radius_m, workers=-1)
        near = np.isfinite(away_m)
        count = near.sum(axis=1)
        offset_m = points_m[np.where(near, nearest, 0)] - middle_m[:, None]
        offset_m[~near] = 0
        mean_m = offset_m.sum(axis=1) / np.maximum(count, 1)[:, None]
        square = np.matmul(offset_m.transpose(0, 2, 1), offset_m) / np.maximum(count, 1)[:, None, None]
        values, vectors = np.linalg.eigh(square - mean_m[:, :, None] * mean_m[:, None, :])
        thick_m, wide_m, long_m = np.sqrt(np.maximum(values, 0)).T + _BLUR * radius_m
        blocks.append(
            np.column_stack(
                [
                    np.log1p(count),
                    np.log(long_m / wide_m),
                    np.log(wide_m / thick_m),
                    np.abs(np.einsum("si,si->s", vectors[:, :, 2], axis[start : start + _BLOCK])),
                    np.linalg.norm(mean_m, axis=1) / radius_m,
                ]
            )
        )
    return np.concatenate(blocks) if blocks else np.zeros((0, 5))


def _means_along(
    facts: Array,
    parent: NDArray[np.signedinteger],
    following: NDArray[np.signedinteger],
    step_m: Array,
    window_m: float,
) -> Array:
    """(S, K) means of facts (S, K) over the path within window_m to both sides of each section."""
    total, count = facts.copy(), np.ones(len(facts))
    for own, at in walk_paths(parent, following, step_m, window_m, _MAX_ALONG):
        total[own] += facts[at]
        count[own] += 1
    return total / count[:, None]
