"""Closed uniform cubic B-splines, and fewer control points for them by reverse subdivision.

Source:
    F. F. Samavati and R. H. Bartels, Multiresolution curve and surface representation: reversing subdivision rules by
    least-squares data fitting, Computer Graphics Forum 18(2), 1999.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# A coarse control point of the fine ones around it: the local least squares of cubic B-splines.
_REVERSE = np.array([23, -92, 63, 208, 63, -92, 23]) / 196


def subdivide_closed(control: Floats) -> Floats:
    """(2 N, D) control points of the same closed spline as N of them (N, D), twice as many."""
    before, after = np.roll(control, 1, axis=0), np.roll(control, -1, axis=0)
    fine = np.empty((2 * len(control), control.shape[1]))
    fine[::2] = (before + 6 * control + after) / 8
    fine[1::2] = (control + after) / 2
    return fine


def reverse_closed(fine: Floats) -> Floats:
    """(N, D) control points of a closed spline near that of fine ones (2 N, D): the same one where there is such."""
    return np.asarray(sum(part * np.roll(fine, 3 - place, axis=0) for place, part in enumerate(_REVERSE))[::2])


def evaluate_closed(control: Floats, per_span: int) -> Floats:
    """(N per_span, D) points of a closed spline (N, D), at even parameters, the first where its first span begins."""
    t = np.arange(per_span)[:, None, None] / per_span
    weights = ((1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3)
    points = sum(weight * np.roll(control, 1 - place, axis=0)[None] for place, weight in enumerate(weights)) / 6
    return np.asarray(points).transpose(1, 0, 2).reshape(-1, control.shape[1])
