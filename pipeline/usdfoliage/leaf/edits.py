"""Collective edits: what an artist does to all leaves alike.

Source:
    Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, section 6.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class LeafEdits:
    """Edits of all leaves alike, in leaf lengths, neutral by default: the attributes primvars:leaf:edit:*."""

    width: float = 1.0  # factor
    axis1: Vector = ZERO
    axis2: Vector = ZERO
    silhouette1: Vector = ZERO  # added to (v, x, z), x after the factor
    silhouette2: Vector = ZERO
    silhouette3: Vector = ZERO
    curl: Vector = ZERO  # added to the heights of the inner curve, of the outer curve, of the silhouette
    jitter_amplitude: float = 0.0
    jitter_frequency: float = 8.0  # cycles from base to apex

    def __post_init__(self) -> None:
        for name in ("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "curl"):
            vector = getattr(self, name)
            if len(vector) != 3 or not np.isfinite(vector).all():
                raise ValueError(f"{name} must be three finite numbers, not {vector}")
        for name, least in (("width", 0.0), ("jitter_amplitude", 0.0)):
            number = getattr(self, name)
            if not (np.isfinite(number) and number >= least):
                raise ValueError(f"{name} must be {least:g} or more, not {number}")
        if not (np.isfinite(self.jitter_frequency) and self.jitter_frequency > 0):
            raise ValueError(f"jitter_frequency must be above 0, not {self.jitter_frequency}")


NEUTRAL = LeafEdits()


def apply_edits(parameters: NDArray[np.floating], edits: LeafEdits) -> NDArray[np.float64]:
    """The parameters (N, 7, 3) of the edited leaves; jitter is no parameter and stays an edit."""
    edited = np.array(parameters, np.float64)
    edited[:, 0] += edits.axis1
    edited[:, 1] += edits.axis2
    edited[:, 2:5, 1] *= edits.width
    edited[:, 2:5] += (edits.silhouette1, edits.silhouette2, edits.silhouette3)
    inner, outer, silhouette = edits.curl
    edited[:, 5] += inner
    edited[:, 6] += outer
    edited[:, 2:5, 2] += silhouette
    return edited
