"""Leaves as proposals, and evidence of them, made up for tests of what judges them."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.segmentation.dense.evidence import Evidence, weigh_evidence
from usdfoliage.leaf.segmentation.dense.proposals import Proposals
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

from tests.support.leaves.shapes import flat_leaf

SURFACE = grid_places(np.linspace(-1, 1, 17), np.linspace(0, 1, 25))


def flat_leaves(bases_m, length_m=0.1, width=0.4, orientation=(0.0, 0, 0, 1)):
    """Flat leaves from these bases (N, 3) along y, normals along z; or turned by a quaternion (x, y, z, w)."""
    bases = np.asarray(bases_m, float).reshape(-1, 3)
    count = len(bases)
    widths = np.broadcast_to(width, count)
    return Leaves(
        parameters=np.concatenate([flat_leaf(one) for one in widths] or [np.zeros((0, 7, 3))]),
        base_m=bases,
        orientation=np.broadcast_to(np.asarray(orientation, float), (count, 4)).copy(),
        length_m=np.broadcast_to(np.asarray(length_m, float), count).copy(),
        phase=np.zeros(count),
    )


def proposed(leaves, explained=1.0):
    return Proposals(leaves=leaves, explained=np.broadcast_to(np.asarray(explained, float), len(leaves)).copy())


def evidence_of(leaves, on=1.0, violated=0.0, unseen=0.0, free=1.0, continued=0.0) -> Evidence:
    """Probes of the leaves, all of them seen, and these shares for each."""
    probes = weigh_evidence(leaves, [], [], 0.0)
    shares = {"on": on, "violated": violated, "unseen": unseen, "free": free, "continued": continued}
    count = len(leaves)
    return replace(
        probes,
        seen=np.ones_like(probes.seen),
        **{name: np.broadcast_to(np.asarray(share, float), count).copy() for name, share in shares.items()},
    )


def surface_distances(leaves: Leaves, others: Leaves):
    """(N,), mean distance from points of either surface to the other's, in lengths of the others."""
    ours, theirs = (
        evaluate_points(one.parameters, SURFACE, placements=one.asset_from_leaf()) for one in (leaves, others)
    )
    distances = [
        (cKDTree(a).query(b)[0].mean() + cKDTree(b).query(a)[0].mean()) / 2 for a, b in zip(ours, theirs, strict=True)
    ]
    return np.asarray(distances) / others.length_m
