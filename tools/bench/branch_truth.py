#!/usr/bin/env python3
"""A true tree, what a traced skeleton is worth against it, and the skeleton that any tool should beat.

usage: tools/bench/branch_truth.py ASSET CAPTURE     prints every measure of an asset's branches

CAPTURE/truth/skeleton.json is the true skeleton. A place of one skeleton is found where the other comes as near as
3 cm, or twice the true radius where that is more.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree
from usdfoliage.branch.allometry import grow_radii
from usdfoliage.branch.distances import sample_axes
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.axes import find_axes
from usdfoliage.branch.tracing.cloud_graph import CloudGraphSettings, link_points

STEP_M = 0.01  # between the places of axes that are compared
BOUND_M = 0.03  # a place is found within this, or within twice its radius
SEEN_RADIUS_M = 0.005  # from which on a branch is one that a scan may be asked for
MEASURED_RADIUS_M = 0.01  # from which on its radius is compared
ORDERS = 5
PATHS = 400  # true nodes whose path to the root is followed
ON_PATH = 0.8  # of a true path, that must be found


@dataclass(frozen=True, kw_only=True)
class BranchScores:
    """Shares, but for the two ratios."""

    recall: float
    recall_seen: float  # of what is thicker than 5 mm in radius
    recall_by_order: tuple[float, ...]  # NaN where the tree has none
    precision: float
    radius_error: float  # mean of |found - true| / true, where true is above 1 cm
    length_ratio: float  # found to true
    ancestry: float  # true places whose path to the root was found


def read_true_skeleton(path: Path) -> Skeleton:
    """The skeleton that a simulated tree was grown with, Y up; the capture is Z up."""
    content = json.loads(path.read_text(encoding="utf-8"))
    nodes = _turn_up(np.asarray(content["nodes"], float))
    parent, order, radius_m = content["parent"], content["order"], np.asarray(content["radius"], float)
    goes_on: dict[int, int] = {}
    for node, above in enumerate(parent):
        if above >= 0 and order[node] == order[above]:
            goes_on.setdefault(above, node)
    heads = [node for node, above in enumerate(parent) if goes_on.get(above) != node]
    chains = []
    for head in sorted(heads, key=lambda node: (order[node], node)):
        chain = [head] if parent[head] < 0 else [parent[head], head]
        while chain[-1] in goes_on:
            chain.append(goes_on[chain[-1]])
        chains.append(chain)
    return skeleton_of_chains(nodes, radius_m, chains)


def read_asset_skeleton(asset: Path) -> Skeleton:
    """The skeleton of an asset, in the frame of read_true_skeleton.

    Raises:
        FoliageError: It is no asset.
        ValueError: It has no skeleton.
    """
    from pxr import Usd
    from usdfoliage.asset.locate import find_interface
    from usdfoliage.asset.parts.branches import read_skeleton

    stage = Usd.Stage.Open(str(find_interface(asset)))
    prim = next((prim for prim in stage.Traverse() if prim.HasAPI("FoliageSkeletonAPI")), None)
    if prim is None:
        raise ValueError(f"{asset} has no skeleton of branches")
    skeleton = read_skeleton(prim)
    attribute = stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset")
    asset_from_capture = np.array(attribute.Get()).T if attribute and attribute.HasValue() else np.eye(4)
    back = np.linalg.inv(asset_from_capture)
    return replace(
        skeleton,
        points_m=_turn_up(skeleton.points_m @ back[:3, :3].T + back[:3, 3]),
        radius_m=skeleton.radius_m * float(np.cbrt(np.linalg.det(back[:3, :3]))),
    )


def _turn_up(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """From the capture's frame, Z up, to Y up."""
    return points_m[:, [0, 2, 1]] * [1, 1, -1]


def skeleton_of_chains(
    nodes_m: NDArray[np.float64], radius_m: NDArray[np.float64], chains: Sequence[Sequence[int]]
) -> Skeleton:
    """A skeleton of chains of nodes, parents first; one that has a parent begins with that one's node."""
    place = np.full(len(nodes_m), -1)
    curve = np.full(len(nodes_m), -1)
    points, radii, parent, vertex, order = [], [], [], [], []
    count = 0
    for number, chain in enumerate(chains):
        own = np.asarray(chain)
        above = int(curve[own[0]])
        parent.append(above)
        vertex.append(int(place[own[0]]) if above >= 0 else -1)
        order.append(order[above] + 1 if above >= 0 else 0)
        radius = radius_m[own].copy()
        if above >= 0:
            radius[0] = radius[1]  # as thick as it goes on
        new = own[1:] if above >= 0 else own
        place[new] = count + len(own) - len(new) + np.arange(len(new))
        curve[new] = number
        points.append(nodes_m[own])
        radii.append(radius)
        count += len(own)
    return Skeleton(
        points_m=np.concatenate(points),
        radius_m=np.concatenate(radii),
        counts=np.array([len(chain) for chain in chains], np.int32),
        parent_curve=np.array(parent, np.int32),
        parent_vertex=np.array(vertex, np.int32),
        order=np.array(order, np.int32),
    )


def spanning_skeleton(points_m: NDArray[np.float64], root_m: NDArray[np.float64], root_radius_m: float) -> Skeleton:
    """The minimum spanning tree of a cloud (N, 3), Y up, thinned to what it can be: a floor, and no more.

    One point stands for each cell of half a percent of the height, the nearest are linked, the shortest links that hold
    all together are kept, and twigs of up to two cells are cut off. Radii follow from the root's by allometry.
    """
    cell_m = max(0.005 * float(np.ptp(points_m[:, 1])), 1e-9)
    _, of = np.unique(np.floor(points_m / cell_m).astype(np.int64), axis=0, return_inverse=True)
    of = of.reshape(-1)
    nodes_m = np.stack([np.bincount(of, column) for column in points_m.T], axis=1) / np.bincount(of)[:, None]
    if len(nodes_m) < 2:
        raise ValueError("all points are in one cell")
    links = link_points(nodes_m, CloudGraphSettings(neighbors=8)).lengths_m
    root = int(np.argmin(np.linalg.norm(nodes_m - root_m, axis=1)))
    spanning = minimum_spanning_tree(links)
    _, parent = breadth_first_order(spanning, root, directed=False)
    parent = np.where(parent < 0, -1, parent).astype(np.int32)
    axes = find_axes(nodes_m, parent, 2 * cell_m)
    radius_m = grow_radii(RootedTree(parent), step_lengths(nodes_m, parent), root_radius_m)
    return skeleton_of_chains(nodes_m, np.maximum(radius_m, 1e-4), [axes.axis(number) for number in range(len(axes))])


def score_skeleton(found: Skeleton, true: Skeleton) -> BranchScores:
    """Compare two skeletons in one frame."""
    true_m, true_radius_m, _ = sample_axes(true, STEP_M)
    true_order = _sampled_order(true)
    found_m, found_radius_m, _ = sample_axes(found, STEP_M)
    away_m, nearest = (np.asarray(each) for each in cKDTree(found_m).query(true_m, workers=-1))
    back_m, true_place = (np.asarray(each) for each in cKDTree(true_m).query(found_m, workers=-1))
    bound_m = np.maximum(2 * true_radius_m, BOUND_M)
    hit = away_m <= bound_m
    thick = hit & (true_radius_m >= MEASURED_RADIUS_M)
    error = np.abs(found_radius_m[nearest] - true_radius_m) / true_radius_m
    return BranchScores(
        recall=_mean(hit),
        recall_seen=_mean(hit[true_radius_m >= SEEN_RADIUS_M]),
        recall_by_order=tuple(_mean(hit[true_order == order]) for order in range(ORDERS)),
        precision=_mean(back_m <= bound_m[true_place]),
        radius_error=_mean(error[thick]),
        length_ratio=float(found.lengths_m.sum() / true.lengths_m.sum()),
        ancestry=_find_paths(found, true),
    )


def vertex_parents(skeleton: Skeleton) -> NDArray[np.int64]:
    """(V,) the vertex before each one on its path to the root, -1 for a root's first."""
    before = np.arange(len(skeleton.points_m)) - 1
    before[skeleton.first] = skeleton.parent_vertex
    return before


def _sampled_order(skeleton: Skeleton) -> NDArray[np.int64]:
    """Order of each place of sample_axes."""
    by_order = [
        np.maximum(
            1, np.ceil(np.linalg.norm(np.diff(skeleton.points_m[skeleton.branch(number)], axis=0), axis=1) / STEP_M)
        )
        .astype(np.int64)
        .sum()
        for number in range(len(skeleton))
    ]
    return np.repeat(skeleton.order.astype(np.int64), by_order)


def _mean(values: NDArray[np.generic]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def _find_paths(found: Skeleton, true: Skeleton) -> float:
    """Share of true places that have a found one near them whose path to the root is near the true path."""
    rng = np.random.default_rng(0)
    above_found, above_true = vertex_parents(found), vertex_parents(true)
    chosen = rng.choice(len(true.points_m), min(PATHS, len(true.points_m)), replace=False)
    away_m, nearest = cKDTree(found.points_m).query(true.points_m[chosen])
    right = 0
    for vertex, gap_m, start in zip(chosen.tolist(), away_m.tolist(), nearest.tolist(), strict=True):
        if gap_m > max(2 * true.radius_m[vertex], BOUND_M):
            continue
        path, other = _path_to_root(vertex, above_true), _path_to_root(start, above_found)
        corners_m = found.points_m[other]
        steps = np.maximum(1, np.ceil(np.linalg.norm(np.diff(corners_m, axis=0), axis=1) / STEP_M)).astype(int)
        places = [np.linspace(a, b, n + 1) for a, b, n in zip(corners_m[:-1], corners_m[1:], steps, strict=True)]
        near_m, _ = cKDTree(np.concatenate([corners_m, *places])).query(true.points_m[path])
        right += bool(np.mean(near_m <= np.maximum(2 * true.radius_m[path], BOUND_M)) >= ON_PATH)
    return right / len(chosen)


def _path_to_root(vertex: int, above: NDArray[np.int64]) -> list[int]:
    path = []
    while vertex >= 0:
        path.append(vertex)
        vertex = int(above[vertex])
    return path


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", type=Path)
    parser.add_argument("capture", type=Path, help="with truth/skeleton.json")
    options = parser.parse_args()
    scores = score_skeleton(
        read_asset_skeleton(options.asset), read_true_skeleton(options.capture / "truth" / "skeleton.json")
    )
    for entry in fields(scores):
        values = np.atleast_1d(getattr(scores, entry.name))
        print(f"{entry.name:<28}{' '.join(f'{value:.6g}' for value in values)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
