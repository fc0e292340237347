"""Single leaves out of the points of a cloud: the one page of this method.

Points that lie in one smooth surface are joined to a tree of regions; every region is rated by its form; those that
together are the best leaves are kept, and the points at their rims are found for the fit. Our own.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import FitError
from usdfoliage.leaf.points import LeafPoints, no_points
from usdfoliage.leaf.segmentation.cloud.forms import measure_regions
from usdfoliage.leaf.segmentation.cloud.leafness import choose_regions, measure_median_size, rate_regions
from usdfoliage.leaf.segmentation.cloud.merge_tree import link_points, merge_points
from usdfoliage.leaf.segmentation.cloud.rims import find_rims
from usdfoliage.leaf.segmentation.cloud.settings import CloudSegmentationSettings
from usdfoliage.leaf.segmentation.cloud.working_cloud import MIN_POINTS, prepare_cloud
from usdfoliage.leaf.segmentation.model import nonzero
from usdfoliage.progress import Progress


@dataclass(frozen=True, kw_only=True, eq=False)
class CloudSegmentation:
    """The leaves of a cloud."""

    leaf: NDArray[np.int32]  # (N,), which leaf each point is of, -1 for none
    leaves: LeafPoints  # M of them; their confidence is the probability that each is one leaf
    regions: int  # that were rated
    loose: float  # share of the points that lie in no surface
    spacing_m: float  # typical distance between points
    thinned_m: float  # side of the cells whose points counted as one; 0 where all counted
    dropped: Mapping[str, int]  # regions that were not kept, by reason


def segment_cloud(
    points_m: NDArray[np.float64],
    settings: CloudSegmentationSettings = CloudSegmentationSettings(),
    progress: Progress | None = None,
    *,
    threads: int = 0,
) -> CloudSegmentation:
    """Find the leaves of a cloud by the form of its surfaces.

    Args:
        points_m: (N, 3), metres, finite, in any order and axes.
        settings: How.
        progress: Called with the parts that are done.
        threads: At most so many, 0 for one per core; the result is the same.

    Raises:
        ValueError: points_m is not (N, 3).
    """
    if points_m.ndim != 2 or points_m.shape[1] != 3:
        raise ValueError(f"points_m must be (N, 3), not {points_m.shape}")
    report = progress or (lambda done, total: None)
    if len(points_m) < MIN_POINTS:
        return _find_none(len(points_m))
    try:
        cloud = prepare_cloud(points_m, settings, threads=threads)
    except FitError:  # hardly any points are in different places, which are no leaf
        return _find_none(len(points_m))
    report(1, 4)
    links = link_points(cloud, settings)
    tree = merge_points(len(cloud), links, settings.size_power)
    report(2, 4)
    forms = measure_regions(cloud, links, tree, settings.min_points)
    report(3, 4)
    probability = rate_regions(forms, None)
    chosen = choose_regions(forms, tree, probability, settings.min_probability)
    size = measure_median_size(forms, chosen, probability)
    if size is not None:
        probability = rate_regions(forms, size)
        chosen = choose_regions(forms, tree, probability, settings.min_probability)
    of_working = np.full(len(cloud), -1, np.int32)
    for number, node in enumerate(forms.node[chosen].tolist()):
        of_working[tree.order[tree.start[node] : tree.start[node] + tree.count[node]]] = number
    leaf = of_working[cloud.of_point]
    rim = find_rims(cloud, of_working)
    linked = np.bincount(np.concatenate([links.first, links.second]), minlength=len(cloud)) > 0
    in_surface = linked & (_root_sizes(tree.parent, tree.count, len(cloud)) >= settings.min_points)
    return CloudSegmentation(
        leaf=leaf,
        leaves=_gather(points_m, cloud.normals[cloud.of_point], rim[cloud.of_point], leaf, probability[chosen]),
        regions=len(forms),
        loose=1 - float(in_surface[cloud.of_point].mean()),
        spacing_m=cloud.spacing_m,
        thinned_m=cloud.cell_m,
        dropped=nonzero({"parts of leaves, several leaves, or none": len(forms) - len(chosen)}),
    )


def _root_sizes(parent: NDArray[np.int64], count: NDArray[np.int64], points: int) -> NDArray[np.int64]:
    """(W,), points of the largest region that each point is in."""
    root = np.arange(len(parent))
    for node in range(len(parent) - 1, -1, -1):
        if parent[node] >= 0:
            root[node] = root[parent[node]]
    return count[root[:points]]


def _gather(
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    rim: NDArray[np.uint8],
    leaf: NDArray[np.int32],
    probability: NDArray[np.float64],
) -> LeafPoints:
    """The points of the leaves, leaf after leaf; no view saw them."""
    order = np.argsort(leaf, kind="stable")
    order = order[np.searchsorted(leaf[order], 0) :]
    return LeafPoints(
        points_m=points_m[order],
        normals=normals[order],
        kind=rim[order],
        point_view=np.full(len(order), -1, np.int32),
        offsets=np.searchsorted(leaf[order], np.arange(len(probability) + 1)).astype(np.int64),
        confidence=probability,
        view=np.full(len(probability), -1, np.int32),
    )


def _find_none(count: int) -> CloudSegmentation:
    return CloudSegmentation(
        leaf=np.full(count, -1, np.int32),
        leaves=no_points(),
        regions=0,
        loose=1.0 if count else 0.0,
        spacing_m=0.0,
        thinned_m=0.0,
        dropped={},
    )
