"""What a segmentation gives to the fit and to the report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.leaf.points import LeafPoints, no_points

# FREE_EDGE: the leaf ends here, since what is seen beside it lies behind it.
# HIDDEN_EDGE: something stands before the leaf here, or the picture ends; the leaf may go on.


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidates:
    """The candidate leaves of one view."""

    labels: NDArray[np.int32]  # (H, W), 0 for none, k for the candidate k - 1
    confidence: NDArray[np.float64]  # (C,), 0 to 1
    superpixels: NDArray[np.int32] | None = None  # (H, W), numbers from 0, -1 for none; for the report


@dataclass(frozen=True, kw_only=True)
class Step:
    """How many there are after a step, and how many went in it: what was tried is the sum of both."""

    name: str
    count: int
    dropped: Mapping[str, int] = field(default_factory=dict)  # by reason
    tried: int | None = None  # where it is not the count of the step before


@dataclass(frozen=True, kw_only=True, eq=False)
class Segmentation:
    """The leaves of a whole scene."""

    candidates: Sequence[Candidates]  # one a view
    leaves: LeafPoints
    dropped: Mapping[str, int] = field(default_factory=dict)  # how many went to get the leaves, by reason
    passes: Sequence[Step] = ()  # before that, from the candidates on


def nonzero(dropped: Mapping[str, int]) -> dict[str, int]:
    """The reasons for which any were dropped."""
    return {reason: count for reason, count in dropped.items() if count}


def find_nothing(views: Sequence[View]) -> Segmentation:
    """A segmentation without candidates and leaves."""
    candidates = [Candidates(labels=np.zeros(view.depth_m.shape, np.int32), confidence=np.zeros(0)) for view in views]
    return Segmentation(candidates=candidates, leaves=no_points())
