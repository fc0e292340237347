"""How sure a leaf is: the share of leaves like it that are right.

What the segmentation thinks of a leaf ranks the leaves of one capture, but means another thing where depth is exact
than where it is estimated. Here what depth and photographs show of the fitted leaf is weighed, by weights that were
learned where the truth is known, so that of leaves of confidence 0.8 eight in ten are right. Our own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from usdfoliage.capture.view import View
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.outline_edges import OutlineSettings, find_edges, measure_outlines
from usdfoliage.leaf.segmentation.dense.coherence import measure_noise
from usdfoliage.leaf.segmentation.dense.evidence import weigh_evidence

# Of each fact in the logarithm of the odds. Learned of generated beds and plants, with exact, noisy and estimated
# depth; tools/calibrate_confidence.py measures what they reach, and learns others.
OFFSET = 0.47
WEIGHTS: Mapping[str, float] = {
    "score": 0.86,
    "edges": 0.87,
    "on": 0.74,
    "violated": -5.18,
    "free": 2.36,
    "residual": -22.0,
}
_EXTREME = 1e-3  # scores nearer to 0 or 1 count as these


@dataclass(frozen=True, kw_only=True, eq=False)
class ConfidenceFacts:
    """What N leaves are rated by."""

    score: NDArray[np.float64]  # (N,), the logarithm of the odds that the segmentation gives
    edges: NDArray[np.float64]  # (N,), by how much edges of photographs under the outline exceed the typical change
    on: NDArray[np.float64]  # (N,), share of the area that depth confirms
    violated: NDArray[np.float64]  # (N,), share that depth looks through
    free: NDArray[np.float64]  # (N,), share of the silhouette where depth ends with the leaf
    residual: NDArray[np.float64]  # (N,), distance of its points from the leaf, in leaf lengths

    def take(self, chosen: NDArray[np.generic]) -> "ConfidenceFacts":
        """The facts of these leaves, in this order."""
        return ConfidenceFacts(**{name: getattr(self, name)[chosen] for name in self.__dataclass_fields__})


def find_facts(
    leaves: Leaves,
    score: NDArray[np.float64],
    views: Sequence[View],
    settings: OutlineSettings = OutlineSettings(),
    *,
    threads: int = 0,
) -> ConfidenceFacts:
    """What depth and photographs show of leaves.

    Args:
        leaves: N, in the world of the views, with residual_m.
        score: (N,), 0 to 1, what the segmentation thinks of them.
        views: At least one with depth.
        settings: How outlines are compared with edges.
        threads: At most so many, 0 for one per core; the result is the same.

    Raises:
        ValueError: The leaves have no residuals.
    """
    if leaves.residual_m is None:
        raise ValueError("leaves without residuals cannot be rated")
    known = [view for view in views if view.has_depth]
    noises_m = [measure_noise(view, threads=threads) for view in known]
    evidence = weigh_evidence(leaves, known, [view.depth_m for view in known], noises_m, threads=threads)
    edges = find_edges(views, settings, threads=threads)
    return ConfidenceFacts(
        score=np.asarray(logit(np.clip(score, _EXTREME, 1 - _EXTREME))),
        edges=measure_outlines(leaves, [view.camera for view in views], edges, settings, threads=threads),
        on=evidence.on,
        violated=evidence.violated,
        free=evidence.free,
        residual=np.asarray(leaves.residual_m / leaves.length_m),
    )


def rate_leaves(
    facts: ConfidenceFacts, offset: float = OFFSET, weights: Mapping[str, float] = WEIGHTS
) -> NDArray[np.float64]:
    """(N,), 0 to 1: the probability that each leaf is right."""
    odds = np.full(len(facts.score), offset)
    for name, weight in weights.items():
        odds += weight * getattr(facts, name)
    return np.asarray(expit(odds))
