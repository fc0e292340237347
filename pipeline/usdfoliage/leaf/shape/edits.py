"""Collective edits: what an artist does to all leaves at once.

Edits are affine in the parameters and clamp nothing: a silhouette point may be moved past the base, the apex or its
neighbour. Only so do edits undo each other and agree with the shader; a leaf that folds by it is drawn as it is.

Source:
    Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, section 6.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.shape.fold import find_folds

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class LeafEdits:
    """Edits of all leaves at once, in leaf lengths, neutral by default: the attributes primvars:leaf:edit:*.

    Attributes:
        width: A factor on the distances of the silhouettes from the axis, 0 or more.
        axis1: Added to the first control point of the axis, (x, y, z).
        axis2: Added to the second one.
        silhouette1: Added to the first control point of both silhouettes, (v, x, z), x after the factor.
        silhouette2: Added to the second one.
        silhouette3: Added to the third one.
        curl: Added to the heights of the inner curve, of the outer curve, of the silhouette.
        jitter_amplitude: How far silhouettes are jittered, 0 or more.
        jitter_frequency: Cycles of the jitter from base to apex, above 0.

    Raises:
        ValueError: A number is out of its range or not finite.
    """

    width: float = 1.0
    axis1: Vector = ZERO
    axis2: Vector = ZERO
    silhouette1: Vector = ZERO
    silhouette2: Vector = ZERO
    silhouette3: Vector = ZERO
    curl: Vector = ZERO
    jitter_amplitude: float = 0.0
    jitter_frequency: float = 8.0

    def __post_init__(self) -> None:
        for name in ("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "curl"):
            vector = getattr(self, name)
            if len(vector) != 3 or not np.isfinite(vector).all():
                raise ValueError(f"{name} must be three finite numbers, not {vector}")
        for name, minimum in (("width", 0.0), ("jitter_amplitude", 0.0)):
            number = getattr(self, name)
            if not (np.isfinite(number) and number >= minimum):
                raise ValueError(f"{name} must be {minimum:g} or more, not {number}")
        if not (np.isfinite(self.jitter_frequency) and self.jitter_frequency > 0):
            raise ValueError(f"jitter_frequency must be above 0, not {self.jitter_frequency}")


NEUTRAL = LeafEdits()

SilhouettePoint = Literal[1, 2, 3]  # from the base to the apex
AxisPoint = Literal[1, 2]  # likewise
BOTH_AXIS_POINTS: tuple[AxisPoint, ...] = (1, 2)


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


def slim_leaves(parameters: NDArray[np.floating], factors: NDArray[np.floating]) -> NDArray[np.float64]:
    """Each leaf (N, 7, 3) slimmer as a whole by its factor (N,) in [0, 1]: beside and above the line from base to apex.

    No edit: with another width alone a leaf stays as bent and as curled as it was, and one that is very slim would
    fold. One that would fold here is left as it is.
    """
    wide = np.array(parameters, np.float64)
    factor = np.asarray(factors, np.float64)[:, None, None]
    straight = np.array([[0, 1 / 3, 0], [0, 2 / 3, 0]])
    slim = wide.copy()
    slim[:, :2] = straight + factor * (wide[:, :2] - straight)
    slim[:, 2:5, 1:] *= factor
    slim[:, 5:] *= factor
    folded = find_folds(slim) & ~find_folds(wide)
    return np.where(folded[:, None, None], wide, slim)


def compose_edits(first: LeafEdits, second: LeafEdits) -> LeafEdits:
    """One edit that does what first and then second do.

    Parameters come out as by one after the other. The jitter is that of the second edit, or of the first where the
    second has none: a silhouette has one wave.

    Args:
        first: Acts on the leaves as they are, in leaf lengths.
        second: Acts on the result.

    Raises:
        ValueError: A number overflows.
    """
    jitter = second if second.jitter_amplitude or not first.jitter_amplitude else first
    return LeafEdits(
        width=first.width * second.width,
        axis1=_add(first.axis1, second.axis1),
        axis2=_add(first.axis2, second.axis2),
        silhouette1=_add(_widen(first.silhouette1, second.width), second.silhouette1),
        silhouette2=_add(_widen(first.silhouette2, second.width), second.silhouette2),
        silhouette3=_add(_widen(first.silhouette3, second.width), second.silhouette3),
        curl=_add(first.curl, second.curl),
        jitter_amplitude=jitter.jitter_amplitude,
        jitter_frequency=jitter.jitter_frequency,
    )


def invert_edits(edits: LeafEdits) -> LeafEdits:
    """The edit that takes this one back: apply_edits with both, in either order, leaves the parameters as they were.

    Jitter changes no parameter, so there is nothing of it to take back; the inverse has none. To remove the jitter of
    leaves, set its amplitude to 0.

    Args:
        edits: What to take back, in leaf lengths.

    Raises:
        ValueError: The width is 0, which makes all leaves lines, or so near to it that its inverse overflows.
    """
    if not edits.width >= np.finfo(np.float64).tiny:
        raise ValueError(f"width {edits.width:g} makes every leaf a line: its width is lost, there is no inverse")
    width = 1 / edits.width
    return LeafEdits(
        width=width,
        axis1=_negate(edits.axis1),
        axis2=_negate(edits.axis2),
        silhouette1=_negate(_widen(edits.silhouette1, width)),
        silhouette2=_negate(_widen(edits.silhouette2, width)),
        silhouette3=_negate(_widen(edits.silhouette3, width)),
        curl=_negate(edits.curl),
    )


def scale_width(edits: LeafEdits, factor: float) -> LeafEdits:
    """Leaves wider by a factor, 0 or more: the lateral displacements of all longitudinal curves (fig. 7a)."""
    return compose_edits(edits, LeafEdits(width=factor))


def skew_axis(edits: LeafEdits, x: float, y: float, points: Sequence[AxisPoint] = BOTH_AXIS_POINTS) -> LeafEdits:
    """Asymmetric leaves: control points of the axis moved in the leaf's plane (fig. 7b)."""
    return compose_edits(edits, _move_axis((x, y, 0.0), points))


def shift_silhouette(edits: LeafEdits, point: SilhouettePoint, v: float, x: float, z: float = 0.0) -> LeafEdits:
    """Another outline: one control point moved by v along the axis, x away from it, z up, in both halves (fig. 7c, d).

    The inner and the outer curve follow along the axis and sideways.
    """
    if point not in (1, 2, 3):
        raise ValueError(f"the silhouette points are 1, 2 and 3 from the base to the apex, not {point}")
    by = (v, x, z)
    moved = LeafEdits(
        silhouette1=by if point == 1 else ZERO,
        silhouette2=by if point == 2 else ZERO,
        silhouette3=by if point == 3 else ZERO,
    )
    return compose_edits(edits, moved)


def bend_axis(edits: LeafEdits, z: float, points: Sequence[AxisPoint] = BOTH_AXIS_POINTS) -> LeafEdits:
    """Leaves bent along their length: control points of the axis raised by z out of the leaf's plane (fig. 7e)."""
    return compose_edits(edits, _move_axis((0.0, 0.0, z), points))


def curl(edits: LeafEdits, inner: float = 0.0, outer: float = 0.0, silhouette: float = 0.0) -> LeafEdits:
    """Halves rolled across the leaf: each of the longitudinal curves raised in both of them (fig. 7f)."""
    return compose_edits(edits, LeafEdits(curl=(inner, outer, silhouette)))


def jitter_silhouette(edits: LeafEdits, amplitude: float, frequency: float = NEUTRAL.jitter_frequency) -> LeafEdits:
    """Serrated or uneven silhouettes: a wave of this amplitude with frequency cycles from base to apex (fig. 7g).

    Unlike the other operations this one sets and does not add: it takes the place of an earlier jitter, and an
    amplitude of 0 removes it.
    """
    return replace(edits, jitter_amplitude=amplitude, jitter_frequency=frequency)


def _move_axis(by: Vector, points: Sequence[AxisPoint]) -> LeafEdits:
    if not points or not set(points) <= set(BOTH_AXIS_POINTS):
        raise ValueError(f"the axis points are 1 and 2 from the base to the apex, not {tuple(points)}")
    return LeafEdits(axis1=by if 1 in points else ZERO, axis2=by if 2 in points else ZERO)


def _add(first: Vector, second: Vector) -> Vector:
    return first[0] + second[0], first[1] + second[1], first[2] + second[2]


def _widen(silhouette: Vector, factor: float) -> Vector:
    return silhouette[0], factor * silhouette[1], silhouette[2]


def _negate(vector: Vector) -> Vector:
    return 0.0 - vector[0], 0.0 - vector[1], 0.0 - vector[2]  # never -0, which would be written out
