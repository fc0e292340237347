"""Colours of a cloud that stand for a quantity, as height or intensity, and are not those of what was scanned. Our own.

A ramp is one curve through the colours, so its points lie on it; light and pigments of a real thing spread in all
directions about any curve.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]

_LOOKED_AT, _PLACES = 20_000, 500  # colours that are looked at, and places among them where a curve is looked for
_MIN_COLORS = 24  # different ones, below which they are classes or a few materials
_AROUND, _MIN_AROUND = 24.0, 8  # of 255, how far about a colour, and how many others, its curve is looked for
_THIN = 0.12  # spread across the curve over that along it; scans that a camera coloured have 0.3 and more
_DARK = 0.01  # of white, added to what colours are divided by: the chromaticity of what is black is nothing
# Extents in chromaticity; that of one leaf in light and shade is below 0.05, from green leaves to brown wood 0.25.
_WIDE, _WIDE_OF_BLUE, _WIDE_BY_PLACE = 0.4, 0.2, 0.1
_BLUE, _BLUE_SHARE = 0.1, 0.1  # of all light, blue over red, and share of the colours that have it: leaves have none
_SLICES, _STEPS, _STEPPED = 48, 6, 0.8  # of the cloud, the largest changes between them, and their share of all
_BY_PLACE = 0.05  # variance between neighbours along an axis over that of all


def check_colors(points: NDArray[np.floating], colors: NDArray[np.number]) -> str:
    """What ramp the colours of a cloud are, in words; empty where they may be a plant's.

    Colours (almost) on one curve through many hues are a ramp. So are those that follow one axis of the cloud,
    whatever shading lies over them.

    Args:
        points: (N, 3), in any unit.
        colors: (N, 3), red, green and blue, 0 to 255; black ones are no colours.
    """
    colored = np.flatnonzero(np.asarray(colors).any(axis=1))
    some = colored[np.linspace(0, len(colored) - 1, min(len(colored), _LOOKED_AT)).astype(np.int64)]
    if len(some) < _SLICES:
        return ""
    shade = np.asarray(colors, np.float64)[some]
    light = shade / 255 + _DARK
    chroma = light / light.sum(axis=1, keepdims=True)
    extent = float(np.linalg.norm(np.subtract(*np.quantile(chroma, [0.95, 0.05], axis=0))))
    if extent < _WIDE_BY_PLACE:
        return ""
    place = np.asarray(points, np.float64)[some]
    axis = next((name for name, along in zip("XYZ", place.T, strict=True) if _follow(chroma, along)), None)
    is_curve = _lie_on_curve(shade)
    if axis is not None and (is_curve or extent >= _WIDE):
        return f"a ramp along its axis {axis}"
    blue = float((chroma[:, 2] - chroma[:, 0] > _BLUE).mean())
    if is_curve and extent >= (_WIDE if blue < _BLUE_SHARE else _WIDE_OF_BLUE):
        return "a ramp, as of intensity or height"
    return ""


class SampledColors:
    """Some points of a cloud with their colours, as they come part after part: the mean of several is on no curve."""

    def __init__(self) -> None:
        self._points: list[Array] = []
        self._colors: list[NDArray[np.float32]] = []
        self._step = 1  # one in so many points is kept
        self._skip = 0  # points that come before the next one to hold

    def add(self, points: NDArray[np.float64], colors: NDArray[np.float32]) -> None:
        """Take more points (N, 3) and their colours (N, 3)."""
        self._points.append(points[self._skip :: self._step].copy())
        self._colors.append(colors[self._skip :: self._step].copy())
        self._skip = (self._skip - len(points)) % self._step
        while sum(map(len, self._points)) > 4 * _LOOKED_AT:
            points, colors = self.finish()
            self._points, self._colors = [points[::2]], [colors[::2]]
            self._step *= 2

    def finish(self) -> tuple[Array, NDArray[np.float32]]:
        """Points (M, 3) and colours (M, 3), as they were given."""
        if not self._points:
            return np.zeros((0, 3)), np.zeros((0, 3), np.float32)
        return np.concatenate(self._points), np.concatenate(self._colors)


def _follow(chroma: Array, along: Array) -> bool:
    """Whether chromaticities (N, 3) are a function of a coordinate (N,), and not one of a few steps."""
    order = np.argsort(along, kind="stable")
    between = float((np.diff(chroma[order], axis=0) ** 2).sum(axis=1).mean()) / 2
    if between >= _BY_PLACE * float(chroma.var(axis=0).sum()):
        return False
    means = np.array([part.mean(axis=0) for part in np.array_split(chroma[order], _SLICES)])
    steps = np.sort(np.linalg.norm(np.diff(means, axis=0), axis=1))
    return bool(steps[-_STEPS:].sum() < _STEPPED * steps.sum())  # brown wood below green leaves is one step


def _lie_on_curve(shade: Array) -> bool:
    """Whether colours (N, 3), 0 to 255, lie on a thin curve, as lines through the colours about some of them show."""
    different = np.unique(np.rint(shade), axis=0)
    if len(different) < _MIN_COLORS:
        return False
    tree = cKDTree(different)
    thin = []
    for place in shade[:: max(1, len(shade) // _PLACES)]:
        around = tree.query_ball_point(place, _AROUND)
        if len(around) < _MIN_AROUND:
            around = tree.query(place, k=_MIN_AROUND)[1]
        near = different[around]
        spread = np.linalg.svd(near - near.mean(axis=0), compute_uv=False)
        thin.append(float(np.hypot(spread[1], spread[2]) / spread[0]))
    return float(np.median(thin)) < _THIN
