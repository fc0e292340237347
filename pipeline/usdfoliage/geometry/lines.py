"""Lines of points, open and closed: how long they are, and places along them."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def arc_lengths(line: Floats) -> Floats:
    """(K,) way to each point of a line (K, 2 or 3) from its first one."""
    return np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def points_at(line: Floats, arc: Floats) -> Floats:
    """(N, D) the points of a line (K, D) after so much of its way (N,)."""
    own = arc_lengths(line)
    return np.stack([np.interp(arc, own, line[:, k]) for k in range(line.shape[1])], axis=-1)


def spread_evenly(line: Floats, count: int) -> Floats:
    """(count, D) points of a line (K, D) that are the same way apart, with its ends."""
    return points_at(line, np.linspace(0, arc_lengths(line)[-1], count))


def polygon_area(corners: Floats) -> float:
    """Area of a closed polygon (K, 2), positive where it goes counter-clockwise with y up."""
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def are_inside(corners: Floats, points: Floats) -> NDArray[np.bool_]:
    """(N,) which points (N, 2) lie in a closed polygon (K, 2), by the parity of its crossings."""
    begin, end = corners, np.roll(corners, -1, axis=0)
    rise = end[:, 1] - begin[:, 1]
    slope = np.divide(end[:, 0] - begin[:, 0], rise, out=np.zeros(len(rise)), where=rise != 0)
    inside = np.zeros(len(points), bool)
    for some in np.array_split(np.arange(len(points)), max(1, len(points) * len(corners) // (1 << 21))):
        x, y = points[some, 0, None], points[some, 1, None]
        crossed = (begin[:, 1] > y) != (end[:, 1] > y)
        inside[some] = (crossed & (x < begin[:, 0] + (y - begin[:, 1]) * slope)).sum(axis=1) % 2 == 1
    return inside


def meet_outline(corners: Floats, origin: Floats, direction: Floats) -> float | None:
    """Where a ray first meets a closed polygon (K, 2): the number of a side and the part of it; None where it does not.

    Args:
        corners: Of the polygon.
        origin: (2,), where the ray begins.
        direction: (2,), where it goes.
    """
    side = np.roll(corners, -1, axis=0) - corners
    to = corners - origin
    across = direction[0] * side[:, 1] - direction[1] * side[:, 0]
    safe = np.where(across == 0, 1.0, across)
    away = np.where(across == 0, np.inf, (to[:, 0] * side[:, 1] - to[:, 1] * side[:, 0]) / safe)
    part = (to[:, 0] * direction[1] - to[:, 1] * direction[0]) / safe
    met = np.flatnonzero(np.isfinite(away) & (away > 1e-9) & (part >= 0) & (part < 1))
    if not len(met):
        return None
    first = int(met[np.argmin(away[met])])
    return first + float(part[first])
