"""The paper's fit: UV mapping and Levenberg-Marquardt in turns, from the points of each leaf alone."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from usdfoliage import _native
from usdfoliage.leaf.fit.model import FittedLeaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.points import LeafPoints
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.native_settings import native_settings

logger = logging.getLogger(__name__)

Robustness = Literal["none", "huber", "tukey"]
ROBUSTNESS: Mapping[Robustness, _native.Robustness] = {
    "none": _native.Robustness.NONE,
    "huber": _native.Robustness.HUBER,
    "tukey": _native.Robustness.TUKEY,
}
FITTED, *_ = OUTCOMES = (
    "fitted",
    "too few points",
    "points that are not finite",
    "points on a line",
)  # as leaf/frame.h numbers them

STEPS_BACK = 6  # of leaves that fold, each half of the way to the ellipse, the last one all of it
DENSE = grid_places(np.linspace(-1, 1, 65), np.linspace(0, 1, 65))  # a leaf as points, for the few that folded


@dataclass(frozen=True, kw_only=True)
class AlternatingFitSettings:
    """How leaves are fitted, and which are not."""

    # A leaf with fewer points is not fitted. A leaf has 21 parameters, and a point three numbers. Range: 3 or more.
    min_points: int = 20
    # A leaf is divided into this many scanlines at most; a leaf of few points has fewer, so that each line meets
    # some. Range: 4 or more.
    scanlines: int = 32
    # The two steps alternate at most this often: where points lie on the surface, and the surface through them.
    # Range: 1 or more.
    max_iterations: int = 15
    # Iterations end where the surface moves by no more than this, root mean square. Unit: leaf lengths. Range: above
    # 0.
    tolerance: float = 1e-3
    # Points off the surface are weighted by this function: none is the paper's; huber and tukey reduce their weight.
    robustness: Robustness = "tukey"
    # Points are left out where their neighbours are this many times the typical distance away, unless robustness is
    # none. Unit: typical distances. Range: above 0.
    isolation: float = 4.0
    # The enclosing ellipse pulls unseen parts with this share of the pull of the points. Range: above 0.
    prior: float = 1e-4
    # A surface this far from its points has half the confidence. Unit: leaf lengths. Range: above 0.
    half_believed_residual: float = 0.05

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
        the surface and isolated ones are left out is our own, as are the pull towards the ellipse and u as a share of
        the width at v, not of the greatest one.
    """
    count = len(points)
    fits = _native.fit_leaves(
        np.ascontiguousarray(points.points_m, np.float64),
        np.ascontiguousarray(points.normals, np.float64),
        np.ascontiguousarray(points.offsets, np.int64),
        settings=native_settings(_native.LeafFitSettings, settings, robustness=ROBUSTNESS[settings.robustness]),
        threads=threads,
    )
    source = np.flatnonzero(fits.outcomes == 0)
    dropped = {reason: int(np.sum(fits.outcomes == code)) for code, reason in enumerate(OUTCOMES) if reason != FITTED}
    logger.info("fitted %d of %d leaves in %d iterations", len(source), count, fits.iterations[source].sum())
    leaves = Leaves(
        parameters=fits.parameters[source],
        base_m=fits.base_m[source],
        orientation=_quaternions(fits.axes[source]),
        length_m=fits.length_m[source],
        phase=spread_phases(len(source)),
        view=points.view[source],
    )
    residual_m = fits.residual_m[source]
    folded = np.flatnonzero(find_folds(leaves.parameters))
    if len(folded):
        leaves = _without_folds(leaves, folded, fits.ellipses[source])
        residual_m[folded] = _residuals(leaves, folded, points, source)
    close = 1 / (1 + (residual_m / leaves.length_m / settings.half_believed_residual) ** 2)
    confidence = np.clip(points.confidence[source] * fits.coverages[source] * close, 0, 1)
    return FittedLeaves(
        leaves=replace(leaves, confidence=confidence, residual_m=residual_m),
        source=source,
        dropped={reason: number for reason, number in dropped.items() if number},
    )


def _without_folds(leaves: Leaves, folded: NDArray[np.int64], ellipses: NDArray[np.float64]) -> Leaves:
    """Bring these leaves, which fold over themselves, nearer to their ellipses (N, 7, 3), which do not."""
    parameters = leaves.parameters.copy()
    for step in range(STEPS_BACK):
        share = 1.0 if step == STEPS_BACK - 1 else 0.5
        parameters[folded] += share * (ellipses[folded] - parameters[folded])
        folded = folded[find_folds(parameters[folded])]
    return replace(leaves, parameters=parameters)


def _residuals(
    leaves: Leaves, chosen: NDArray[np.int64], points: LeafPoints, source: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Root mean square distance of the points from the surface of these few leaves, in metres."""
    placements, squares = leaves.asset_from_leaf(), []
    for leaf in chosen:
        surface_m = evaluate_points(leaves.parameters[leaf, None], DENSE, placements=placements[leaf, None])[0]
        captured = slice(*points.offsets[source[leaf] : source[leaf] + 2])
        distances_m, _ = KDTree(surface_m).query(points.points_m[captured])
        squares.append(np.mean(distances_m**2))
    return np.sqrt(squares)


def _quaternions(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternions (N, 4), x y z w, that turn leaf space's axes into the rows of axes (N, 3, 3)."""
    if len(axes) == 0:
        return np.zeros((0, 4))
    return np.asarray(Rotation.from_matrix(np.swapaxes(axes, 1, 2)).as_quat())
