"""Which end of leaves in a cloud is the base: the one at which stem and petiole are. Our own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import expit

from usdfoliage.leaf.model import Leaves

REACH = 0.2  # of a leaf's length, within which points beside an end count
STRONGEST = 3.0  # logarithm of the odds that the points at one leaf, or at all, give at most


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafEnds:
    """Which ends of N leaves are their bases."""

    flip: NDArray[np.bool_]  # (N,), True where base and apex must be exchanged
    certainty: NDArray[np.float64]  # (N,), that the base then is the base: 0.5 nothing is known to 1


def find_wood_ends(leaves: Leaves, others_m: NDArray[np.float64], *, threads: int = 0) -> LeafEnds:
    """Compare the points beside both ends of each leaf; what all leaves show together counts for each.

    Args:
        leaves: N, in the frame of the points, whose bases are all bases or all apices.
        others_m: (K, 3), points that are of no leaf.
        threads: At most so many, 0 for one per core; the result is the same.
    """
    if not len(leaves) or not len(others_m):
        return LeafEnds(flip=np.zeros(len(leaves), np.bool_), certainty=np.full(len(leaves), 0.5))
    tree = cKDTree(others_m)
    apex_m = leaves.base_m + leaves.asset_from_leaf()[:, :, 1]
    at_base, at_apex = (
        tree.query_ball_point(end_m, REACH * leaves.length_m, return_length=True, workers=threads or -1)
        for end_m in (leaves.base_m, apex_m)
    )
    own = np.clip(np.log((at_base + 1) / (at_apex + 1)), -STRONGEST, STRONGEST)
    odds = own + np.clip(own.sum(), -STRONGEST, STRONGEST)
    return LeafEnds(flip=odds < 0, certainty=np.asarray(expit(np.abs(odds))))
