"""How thick branches are: as the picture shows them, else by the allometry of the species."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import isotonic_regression

from usdfoliage.geometry.lines import arc_lengths
from usdfoliage.sketch.axes import Axis

Floats = NDArray[np.float64]

OF_PARENT = 0.75  # of its parent's radius, that a branch has where nothing else is known (section 2)
TAPER = 0.35  # of its radius at the base, that a branch has at its tip
TRUNK_TAPER = 0.12
_UPPER = 0.75  # expectile of the widths that are seen: leaves and twigs before a trunk hide parts of it
_WIDEST = 1.6  # times the radius near the root; what is wider is a shadow, or a plant behind
_NARROWEST = 0.7  # of a trunk that tapers evenly, or carries what it does; what is narrower is hidden by the crown
_PIPES = 0.5  # exponent of what a trunk carries where the species has none: its section is that of its branches
_ROUNDS = 12  # in which the weights of that expectile settle
_PLACES = 129  # along a trunk, where its radius is smoothed
_SMOOTH = 3.0  # of these places: standard deviation of the smoothing


def find_radii(axes: Sequence[Axis], exponent: float | None, tip_px: float, stem_px: float) -> list[Floats]:
    """(K,) radius along each axis, in pixels.

    The radius of a trunk is that of the picture at its root, and above it not much less than its branches ask for. A
    branch has its share of the length that its parent carries there, to the power of the species' exponent, and never
    more than the picture shows.

    Args:
        axes: Each after its parent.
        exponent: Of the species' allometry; None: OF_PARENT of the parent's radius.
        tip_px: Radius of a shoot at its tip.
        stem_px: Radius of a trunk at its root, where the picture does not show it.
    """
    lengths = np.array([axis.length for axis in axes])
    carried = lengths.copy()
    for number in range(len(axes) - 1, -1, -1):
        if axes[number].parent >= 0:
            carried[axes[number].parent] += carried[number]
    radii: list[Floats] = []
    for number, axis in enumerate(axes):
        arc = arc_lengths(axis.points)
        share = arc / max(arc[-1], 1e-9)
        if axis.parent < 0:
            above = arc[-1] - arc
            for child, each in enumerate(axes):
                if each.parent == number:
                    above[: each.parent_point + 1] += carried[child]
            asked = (above / max(above[0], 1e-9)) ** (_PIPES if exponent is None else exponent)
            radii.append(_trunk_radius(axis, share, asked, max(_seen_at_root(axis) or stem_px, 2 * tip_px), tip_px))
            continue
        parent = float(radii[axis.parent][axis.parent_point])
        factor = OF_PARENT if exponent is None else (carried[number] / max(carried[axis.parent], 1e-9)) ** exponent
        base = parent * min(factor, OF_PARENT)
        if not axis.inferred and np.isfinite(axis.half).any():
            seen = float(np.nanmedian(axis.half[: max(2, len(axis.half) // 2)]))
            base = min(max(base, 0.6 * seen), 0.95 * parent, max(1.3 * seen, tip_px))
        base = max(base, tip_px)
        radii.append(np.maximum(base * (1 - (1 - TAPER) * share), min(tip_px, base)))
    return radii


def _trunk_radius(axis: Axis, share: Floats, asked: Floats, base: float, tip_px: float) -> Floats:
    """(K,) radius of a trunk: as the picture shows it, and where it is hidden tapering from there to its tip.

    Args:
        axis: The trunk.
        share: (K,) of its length, from 0 to 1.
        asked: (K,) of its radius at the root, that what it carries asks for.
        base: Radius at the root.
        tip_px: Radius at the tip.
    """
    tapering = np.maximum(1 - (1 - TRUNK_TAPER) * share**0.9, asked)
    radius = base * tapering
    known = np.flatnonzero(np.isfinite(axis.half))
    if len(known):
        places = np.linspace(share[known[0]], share[known[-1]], _PLACES)
        seen = _falling(np.interp(places, share[known], np.minimum(axis.half[known], _WIDEST * base)))
        last = share[known[-1]]
        beyond = np.clip((share - last) / max(1 - last, 1e-9), 0, 1)
        radius = np.interp(share, places, seen) * (1 - (1 - TRUNK_TAPER) * beyond)
        radius = np.maximum(radius, _NARROWEST * max(base, float(seen[0])) * tapering)
    return np.maximum(np.minimum.accumulate(radius), tip_px)


def _falling(widths: Floats) -> Floats:
    """(K,) what never grows, near the upper ones of widths along a trunk, and smooth.

    An expectile: the sum of squares in which what is above counts more than what is below.
    """
    fitted = np.full(len(widths), widths.min())
    for _ in range(_ROUNDS):
        weight = np.where(widths > fitted, _UPPER, 1 - _UPPER)
        fitted = np.asarray(isotonic_regression(widths, weights=weight, increasing=False).x)
    return np.asarray(gaussian_filter1d(fitted, _SMOOTH, mode="nearest"))


def _seen_at_root(axis: Axis) -> float:
    """The radius that the picture shows over the lower part of a trunk; 0 where it shows none."""
    lower = axis.half[: max(2, len(axis.half) // 4)]
    lower = lower[np.isfinite(lower)]
    return float(np.median(lower)) if len(lower) else 0.0
