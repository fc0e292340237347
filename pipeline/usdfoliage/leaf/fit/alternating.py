"""The paper's fit: UV mapping and Levenberg-Marquardt in turns, from the points of each leaf alone."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage import _native
from usdfoliage.leaf.fit.model import FittedLeaves
from usdfoliage.leaf.jitter import spread_phases
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.segmentation.model import LeafPoints

logger = logging.getLogger(__name__)

Robustness = Literal["none", "huber", "tukey"]
ROBUSTNESS: Mapping[Robustness, int] = {"none": 0, "huber": 1, "tukey": 2}  # as leaf_fit.h numbers them
FITTED, *_ = OUTCOMES = ("fitted", "too few points", "points that are not finite", "points on a line")  # likewise


@dataclass(frozen=True, kw_only=True)
class AlternatingFitSettings:
    """How leaves are fitted, and which are not."""

    min_points: int = 20  # a leaf has 21 parameters, and three numbers a point
    scanlines: int = 32  # at most; a leaf of few points has fewer, so that each line meets some
    max_iterations: int = 15
    tolerance: float = 1e-3  # leaf lengths; iterations end when no parameter changes by more
    robustness: Robustness = "tukey"  # what points off the surface count; "none" is the paper's
    isolation: float = 4.0  # points whose neighbours are this many times farther than usual are left out, unless "none"
    prior: float = 1e-5  # pull of the enclosing ellipse where nothing is seen, as a share of what the points pull
    half_believed_residual: float = 0.05  # leaf lengths; a surface that far from its points has half the confidence

    def __post_init__(self) -> None:
        if self.min_points < 3:
            raise ValueError(f"min_points must be at least 3, not {self.min_points}")
        if self.scanlines < 4:
            raise ValueError(f"scanlines must be at least 4, not {self.scanlines}")
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations must be at least 1, not {self.max_iterations}")
        if self.robustness not in ROBUSTNESS:
            raise ValueError(f"robustness must be one of {', '.join(ROBUSTNESS)}, not {self.robustness}")
        for name in ("tolerance", "isolation", "prior", "half_believed_residual"):
            number = getattr(self, name)
            if not (np.isfinite(number) and number > 0):
                raise ValueError(f"{name} must be above 0, not {number}")


def fit_leaves_alternating(
    points: LeafPoints, settings: AlternatingFitSettings = AlternatingFitSettings(), *, threads: int = 0
) -> FittedLeaves:
    """Fit a leaf of 21 parameters to the points of each leaf.

    Leaf space is found by the principal axes of the points, +z towards the cameras, and by the ellipse around them,
    whose far ends are base and apex; which of them is the base is not known here. Then in turns every point is given
    its (u, v) by scanlines across the axis, and the parameters the least squares of the points, by eq. 11. A leaf that
    would fold over itself is taken back towards the ellipse. Confidence is what the segmentation gave, times the share
    of the leaf's width that points reach, times how closely the surface keeps to the points.

    The results do not depend on the number of threads.

    Source:
        Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, sections 5 and 5.1. That points off
        the surface and isolated ones are left out is our own, as is the pull towards the ellipse.
    """
    count = len(points)
    parameters, bases, axes = np.zeros((count, 7, 3)), np.zeros((count, 3)), np.zeros((count, 3, 3))
    lengths, residuals, coverages = (np.zeros(count) for _ in range(3))
    iterations, outcomes = (np.zeros(count, np.int32) for _ in range(2))
    _native.fit_leaves(
        np.ascontiguousarray(points.points_m, np.float64),
        np.ascontiguousarray(points.normals, np.float64),
        np.ascontiguousarray(points.offsets, np.int64),
        settings.min_points,
        settings.robustness != "none",
        settings.isolation,
        settings.scanlines,
        settings.max_iterations,
        settings.tolerance,
        ROBUSTNESS[settings.robustness],
        settings.prior,
        parameters,
        bases,
        axes,
        lengths,
        residuals,
        coverages,
        iterations,
        outcomes,
        threads,
    )
    source = np.flatnonzero(outcomes == 0)
    dropped = {reason: int(np.sum(outcomes == code)) for code, reason in enumerate(OUTCOMES) if reason != FITTED}
    share = residuals[source] / lengths[source] / settings.half_believed_residual
    confidence = points.confidence[source] * coverages[source] / (1 + share**2)
    logger.info("fitted %d of %d leaves in %d iterations", len(source), count, iterations[source].sum())
    leaves = Leaves(
        parameters=parameters[source],
        base_m=bases[source],
        orientation=_quaternions(axes[source]),
        length_m=lengths[source],
        phase=spread_phases(len(source)),
        confidence=np.clip(confidence, 0, 1),
        residual_m=residuals[source],
        view=points.view[source],
    )
    return FittedLeaves(leaves=leaves, source=source, dropped={name: n for name, n in dropped.items() if n})


def _quaternions(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternions (N, 4), x y z w, that turn leaf space's axes into the rows of axes (N, 3, 3)."""
    if len(axes) == 0:
        return np.zeros((0, 4))
    return np.asarray(Rotation.from_matrix(np.swapaxes(axes, 1, 2)).as_quat())
