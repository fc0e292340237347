"""Which of many proposals to keep, so that no leaf is kept twice."""

import heapq

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.segmentation.dense.evidence import Evidence
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

PARALLEL = 0.6  # cosine between normals of surfaces that may be the same
REACH = 1.2  # of the distance between probes, along the surface, within which a probe is covered
APART = 0.5  # leaf lengths between the middles of two leaves, beyond which they are not the same


def select_leaves(
    evidence: Evidence, score: NDArray[np.float64], tolerance_m: float, max_overlap: float
) -> NDArray[np.int64]:
    """Proposals to keep, the best first: each that is not yet covered by better ones for more than max_overlap.

    What a proposal is worth falls with the share of its seen area that kept ones cover.

    Args:
        evidence: Of N proposals, with their probes.
        score: (N,), what each is worth; those at 0 are not kept.
        tolerance_m: Between surfaces that are the same.
        max_overlap: Share of a proposal's seen area.
    """
    points, normals, areas, seen = evidence.points_m, evidence.normals, evidence.areas_m2, evidence.seen
    count, probes = seen.shape
    flat_points, flat_normals = points.reshape(-1, 3), normals.reshape(-1, 3)
    tree = cKDTree(flat_points) if count else None
    covered = np.zeros(count * probes, bool)
    own = np.maximum((areas * seen).sum(axis=1), 1e-30)
    overlap = np.zeros(count)
    heap = [(-float(score[i]), i) for i in range(count) if score[i] > 0]
    heapq.heapify(heap)
    kept: list[int] = []
    while heap and tree is not None:
        worth, i = heapq.heappop(heap)
        if overlap[i] > max_overlap:
            continue
        now = float(score[i] * (1 - overlap[i]))
        if -worth > now + 1e-12:
            heapq.heappush(heap, (-now, i))
            continue
        kept.append(i)
        middle = points[i].mean(axis=0)
        reach_m = REACH * float(np.sqrt(areas[i].sum() / probes))
        radius_m = float(np.linalg.norm(points[i] - middle, axis=1).max()) + max(tolerance_m, reach_m)
        near = np.asarray(tree.query_ball_point(middle, radius_m, return_sorted=True), np.int64)
        near = near[~covered[near]]
        if not len(near):
            continue
        distance_m, nearest = cKDTree(points[i]).query(flat_points[near])
        across_m = np.abs(np.sum((flat_points[near] - points[i][nearest]) * normals[i][nearest], axis=1))
        along_m = np.sqrt(np.maximum(distance_m**2 - across_m**2, 0))
        parallel = np.abs(np.sum(flat_normals[near] * normals[i][nearest], axis=1)) > PARALLEL
        hit = near[(across_m < tolerance_m) & (along_m < reach_m) & parallel]
        covered[hit] = True
        for row in np.unique(hit // probes):
            mine = covered[row * probes : (row + 1) * probes]
            overlap[row] = float((areas[row] * seen[row] * mine).sum()) / own[row]
    return np.asarray(kept, np.int64)


def drop_twins(leaves: Leaves, score: NDArray[np.float64], distance: float) -> NDArray[np.bool_]:
    """True (N,) for leaves to keep: of two whose surfaces are on average nearer than this, in lengths, the better."""
    keep = np.ones(len(leaves), bool)
    if len(leaves) < 2:
        return keep
    places = grid_places(np.linspace(-1, 1, 13), np.linspace(0, 1, 13))
    surfaces = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf())
    trees = [cKDTree(surface) for surface in surfaces]
    middles = cKDTree(surfaces.mean(axis=1))
    pairs = middles.query_pairs(APART * float(np.median(leaves.length_m)), output_type="ndarray")
    order = np.lexsort((pairs[:, 1], pairs[:, 0], -score[pairs].max(axis=1)))
    for first, second in pairs[order]:
        if keep[first] and keep[second]:
            there = trees[first].query(surfaces[second])[0].mean()
            back = trees[second].query(surfaces[first])[0].mean()
            if (there + back) / 2 < distance * max(leaves.length_m[first], leaves.length_m[second]):
                keep[first if score[first] < score[second] else second] = False
    return keep
