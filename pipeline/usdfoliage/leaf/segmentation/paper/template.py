"""The template of all leaves of a scene: an ellipse as long in proportion to its width as the surest candidates are.

Source: G. Chaurasia, P. Beardsley, Editable Parametric Dense Foliage from 3D Capture, 2017, section 4.2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import FitError

_MAX_RINGS = 1000  # finer than any photograph shows a leaf


@dataclass(frozen=True, kw_only=True)
class TemplateSettings:
    """Which candidates teach the template, and how finely it is drawn."""

    surest: int = 50  # The template is learned from this many candidates of the highest confidence. Range: 1 or more.
    rings: int = 6  # The template has this many rings of points from the middle to the rim. Range: 2 to 1000.

    def __post_init__(self) -> None:
        if self.surest < 1 or not 2 <= self.rings <= _MAX_RINGS:
            raise ValueError(f"surest must be at least 1 and rings 2 to {_MAX_RINGS}, not {self}")


def measure_ratio(
    half_axes_m: NDArray[np.float64],
    confidence: NDArray[np.float64],
    settings: TemplateSettings = TemplateSettings(),
) -> float:
    """The median ratio of length to width of the surest candidates.

    Args:
        half_axes_m: (C, 2), of the enclosing ellipses, the longer one first.
        confidence: (C,), equal ones count in the order given.

    Raises:
        ValueError: The shapes differ.
        FitError: No candidate has a length and a width.
    """
    if half_axes_m.shape != (len(confidence), 2):
        raise ValueError(f"half_axes_m must be {(len(confidence), 2)}, not {half_axes_m.shape}")
    wide = np.flatnonzero((half_axes_m[:, 1] > 0) & np.isfinite(half_axes_m).all(axis=1))
    if not len(wide):
        raise FitError("no candidate leaf has a length and a width")
    surest = wide[np.argsort(-confidence[wide], kind="stable")][: settings.surest]
    return float(np.median(half_axes_m[surest, 0] / half_axes_m[surest, 1]))


def draw_template(ratio: float, settings: TemplateSettings = TemplateSettings()) -> NDArray[np.float64]:
    """(N, 3): points of an ellipse of length 1 along x and width 1 / ratio along y, evenly over its area, z 0."""
    if not (np.isfinite(ratio) and ratio >= 1):
        raise ValueError(f"ratio must be at least 1, not {ratio}")
    points = [np.zeros((1, 2))]
    for ring in range(1, settings.rings + 1):
        angles = np.arange(6 * ring) * (2 * np.pi / (6 * ring))
        points.append(ring / settings.rings * np.column_stack([np.cos(angles), np.sin(angles)]))
    disc = np.concatenate(points) * np.array([0.5, 0.5 / ratio])
    return np.column_stack([disc, np.zeros(len(disc))])
