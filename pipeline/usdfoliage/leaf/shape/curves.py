"""The curves that a leaf is made of, with their control points, to be looked at."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places, leaf_nets

# Columns of a leaf's control net: the left half mirrors the right one.
_COLUMNS = (("silhouette", 0), ("outer", 1), ("inner", 2), ("inner", 4), ("outer", 5), ("silhouette", 6))


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafCurve:
    """One of the longitudinal curves, in leaf space."""

    name: str  # axis, inner, outer or silhouette; the three twice, left and right
    points: NDArray[np.float64]  # (P, 3), from base to apex; a silhouette's with its jitter
    controls: NDArray[np.float64]  # (4, 3) of the axis, (5, 3) of the others


def leaf_curves(
    parameters: NDArray[np.floating], jitter: Jitter = NO_JITTER, phase: float = 0.0, points: int = 65
) -> list[LeafCurve]:
    """The axis, and from left to right the other curves, of one leaf (7, 3).

    Args:
        phase: Where on the jitter's wave the leaf begins, in cycles.
        points: Of each curve.
    """
    leaf = np.asarray(parameters, np.float64)[None]
    v = np.linspace(0.0, 1.0, points)
    net = leaf_nets(leaf)[0]
    axis = np.concatenate([net[:1, 3], leaf[0, :2], net[-1:, 3]])
    curves = [LeafCurve(name="axis", points=_bezier(axis, v), controls=axis)]
    edges = evaluate_points(leaf, grid_places((-1.0, 1.0), v), jitter, np.array([phase]))[0].reshape(points, 2, 3)
    for name, column in _COLUMNS:
        controls = net[:, column]
        on_curve = edges[:, column // 6] if name == "silhouette" else _bezier(controls, v)
        curves.append(LeafCurve(name=name, points=on_curve, controls=controls))
    return curves


def _bezier(controls: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(BPoly(controls[:, None], [0.0, 1.0])(v))
