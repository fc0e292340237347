"""How probably a region of a cloud is one leaf, and which regions to keep.

A quadratic form in a few numbers of a region's form gives the logarithm of the odds. Its weights were learned of scans
of generated plants whose leaves are known: tools/learn_cloud_leaves.py, which writes weights.toml. The first form knows
no sizes; from what it finds follows the size of the median leaf, which the second form weighs too. Our own.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.quadratic_form import QuadraticForm, parse_form
from usdfoliage.leaf.segmentation.cloud.forms import RegionForms
from usdfoliage.leaf.segmentation.cloud.merge_tree import MergeTree

SURE = 0.6  # probability from which a region counts for the size of the median leaf
_FEW = 3  # regions that are so sure, below which all count
_WEIGHTS = "weights.toml"
_PART = 1.5  # times as many points as a region has, from which it is a part of another and not nearly the same
_WHOLE_WEIGHT = 0.2  # of the odds of a whole against its parts: it may be several leaves that look like one
_EXTREME = 1e-6  # probabilities nearer to 1 count as this
_SIZES = 2.0  # logarithm of a length to that of the median leaf, beyond which nothing changes
# Of each fact its lowest and highest value, and whether its logarithm counts.
_FACTS: Mapping[str, tuple[float, float, bool]] = {
    "count": (8, 1000, True),
    "open": (0, 3, False),
    "joint": (0.02, 5, True),
    "beyond": (0.005, 5, True),
    "roughness": (0.3, 20, True),
    "fill": (0, 2, False),
    "slimness": (0.03, 1, True),
    "depth": (0, 1, False),
    "turning": (0, 0.67, False),
    "straightness": (0, 1, False),
    "roundness": (0.03, 6, True),
}


@dataclass(frozen=True, kw_only=True)
class MedianSize:
    """Of the leaves of a cloud, as RegionForms measures them: half of the leaf area is of smaller ones."""

    length_m: float
    width_m: float


def list_facts(forms: RegionForms, size: MedianSize | None) -> NDArray[np.float64]:
    """(R, K), what regions are rated by: of their form alone, and with a size of their length and width too."""
    columns = []
    for name, (low, high, is_ratio) in _FACTS.items():
        values = np.clip(getattr(forms, name).astype(np.float64), low, high)
        columns.append(np.log(values) if is_ratio else values)
    if size is not None:
        for own_m, median_m in ((forms.length_m, size.length_m), (forms.width_m, size.width_m)):
            columns.append(np.clip(np.log(own_m / median_m), -_SIZES, _SIZES))
    return np.column_stack(columns)


def rate_regions(forms: RegionForms, size: MedianSize | None) -> NDArray[np.float64]:
    """(R,), the probability that each region is one leaf, rather than a part of one, several, or none."""
    return read_form("form" if size is None else "form_and_size").probability(list_facts(forms, size))


def choose_regions(
    forms: RegionForms, tree: MergeTree, probability: NDArray[np.float64], min_probability: float
) -> NDArray[np.int64]:
    """Which regions (numbers in forms, rising) are the leaves: those that together exceed the least probability most.

    No point is in two of them. Where a whole is a leaf none of its parts is: the more probable a whole, the less are
    its parts.
    """
    odds = np.zeros(len(tree))
    odds[forms.node] = probability / np.maximum(1 - probability, _EXTREME)
    worth = np.full(len(tree), -1.0)
    against = 1 + odds + _WHOLE_WEIGHT * _odds_of_wholes(forms, tree, odds)
    worth[forms.node] = (odds / against)[forms.node] - min_probability
    best, taken = np.zeros(len(tree)), np.zeros(len(tree), bool)
    for span in tree.spans():
        below = best[tree.children[span]].sum(axis=1)
        taken[span] = worth[span] > below
        best[span] = np.maximum(worth[span], below)
    inside = np.zeros(len(tree), bool)
    for span in tree.spans()[::-1]:
        inside[tree.children[span]] = (taken[span] | inside[span])[:, None]
    return np.asarray(np.searchsorted(forms.node, np.flatnonzero(taken & ~inside)), np.int64)


def _odds_of_wholes(forms: RegionForms, tree: MergeTree, odds: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M,), the highest odds of the regions that each node is a part of, and not nearly all."""
    rated = np.zeros(len(tree), bool)
    rated[forms.node] = True
    of_wholes, known = np.zeros(len(tree)), odds.copy()  # known: of nodes that were not rated, those of what they are
    for span in tree.spans()[::-1]:
        for child in tree.children[span].T:
            is_part = tree.count[span] > _PART * tree.count[child]
            of_wholes[child] = np.maximum(of_wholes[span], np.where(is_part, known[span], 0.0))
            known[child] = np.where(rated[child] | is_part, odds[child], known[span])
    return of_wholes


def measure_median_size(
    forms: RegionForms, chosen: NDArray[np.int64], probability: NDArray[np.float64]
) -> MedianSize | None:
    """The size of the median leaf of those that are sure, of all where hardly any is; None of none."""
    if not len(chosen):
        return None
    sure = chosen[probability[chosen] > SURE]
    sure = sure if len(sure) >= _FEW else chosen

    def middle(values: NDArray[np.float64]) -> float:
        order = np.argsort(values[sure], kind="stable")
        rising = np.cumsum(forms.area_m2[sure][order])
        return float(values[sure][order][np.searchsorted(rising, rising[-1] / 2)])

    return MedianSize(length_m=middle(forms.length_m), width_m=middle(forms.width_m))


@functools.cache
def read_form(name: str) -> QuadraticForm:
    """The form of this name in weights.toml."""
    return parse_form(files(__package__).joinpath(_WEIGHTS).read_text("utf-8"), name)
