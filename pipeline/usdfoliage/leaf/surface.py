"""The leaf as a surface: points, tangents and normals from the 21 parameters.

The algebra is written down once here for Python and once in usdFoliageLeaf.glslfx for Storm.

Source:
    Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, section 3, equations 3 to 6.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usdfoliage.leaf.jitter import NO_JITTER, WAVES, Jitter

APEX = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafGrid:
    """N leaves at every (u, v) of a grid, in leaf space; V rows from base to apex, U columns from left to right."""

    points: NDArray[np.float64]  # (N, V, U, 3)
    tangents_u: NDArray[np.float64]  # (N, V, U, 3), derivatives by u; those of the right half at u = 0
    tangents_v: NDArray[np.float64]  # (N, V, U, 3), derivatives by v
    normals: NDArray[np.float64]  # (N, V, U, 3), unit, towards +z for a flat leaf; at base and apex the limit


def axis_points(parameters: NDArray[np.floating], v: ArrayLike) -> NDArray[np.float64]:
    """A(v): (N, P, 3) from parameters (N, 7, 3) and v (P,) or (N, P)."""
    p = np.asarray(parameters, np.float64)
    t = np.broadcast_to(np.asarray(v, np.float64), (len(p), np.shape(v)[-1]))[..., None]
    w = 1 - t
    return 3 * w * w * t * p[:, None, 0] + 3 * w * t * t * p[:, None, 1] + t**3 * APEX


def axis_normals(parameters: NDArray[np.floating], v: ArrayLike) -> NDArray[np.float64]:
    """n(v): unit normals of the axis in the leaf's plane, +x for a straight axis; (0, 0, 0) where it stands upright."""
    p = np.asarray(parameters, np.float64)
    t = np.broadcast_to(np.asarray(v, np.float64), (len(p), np.shape(v)[-1]))[..., None]
    w = 1 - t
    d = 3 * w * w * p[:, None, 0] + 6 * w * t * (p[:, None, 1] - p[:, None, 0]) + 3 * t * t * (APEX - p[:, None, 1])
    flat = d[..., :2] / np.maximum(np.linalg.norm(d[..., :2], axis=-1, keepdims=True), 1e-12)
    return np.stack([flat[..., 1], -flat[..., 0], np.zeros(flat.shape[:-1])], axis=-1)


def leaf_nets(parameters: NDArray[np.floating]) -> NDArray[np.float64]:
    """Control nets of the leaves: (N, 5, 7, 3) from parameters (N, 7, 3), in leaf space.

    Rows are the quartic along v from base to apex, columns from left to right: the silhouette, outer and inner curve of
    the left half, the axis raised to degree four, and those of the right half. The surface is a cubic in |u| over the
    columns of either half.
    """
    p = np.asarray(parameters, np.float64)
    net = np.zeros((len(p), 5, 7, 3))
    net[:, 4] = APEX
    net[:, 1, 3] = 0.75 * p[:, 0]  # the base is the origin
    net[:, 2, 3] = 0.5 * (p[:, 0] + p[:, 1])
    net[:, 3, 3] = 0.25 * APEX + 0.75 * p[:, 1]
    on_axis = axis_points(p, p[:, 2:5, 0])
    normal = axis_normals(p, p[:, 2:5, 0])
    for column, share, heights in ((1, 1 / 3, p[:, 5]), (2, 2 / 3, p[:, 6]), (3, 1.0, p[:, 2:5, 2])):  # eq. 3, 4
        for side in (-1, 1):
            point = on_axis + side * share * p[:, 2:5, 1, None] * normal
            point[..., 2] += heights
            net[:, 1:4, 3 + side * column] = point
    return net


def evaluate_grid(
    parameters: NDArray[np.floating],
    u: ArrayLike,
    v: ArrayLike,
    jitter: Jitter = NO_JITTER,
    phase: ArrayLike | None = None,
) -> LeafGrid:
    """Evaluate leaves (N, 7, 3) at u (U,) in [-1, 1] and v (V,) in [0, 1].

    Args:
        phase: (N,), where on the jitter's wave each leaf begins; 0 by default.
    """
    p = np.asarray(parameters, np.float64)
    u, v = np.asarray(u, np.float64), np.asarray(v, np.float64)
    net = leaf_nets(p)
    rows = np.einsum("vk,nkcd->nvcd", quartic(v), net)
    rows_v = np.einsum("vk,nkcd->nvcd", quartic_derivative(v), net)
    if jitter.amplitude:
        by = np.zeros(len(p)) if phase is None else np.asarray(phase, np.float64)
        offset, offset_v = _jitter_offsets(p, v, jitter, by)
        for column, side in ((0, -1.0), (6, 1.0)):
            rows[:, :, column] += side * offset
            rows_v[:, :, column] += side * offset_v
    across, across_u = cross_section(u), cross_section_derivative(u)
    points = np.einsum("uc,nvcd->nvud", across, rows)
    tangents_u = np.einsum("uc,nvcd->nvud", across_u, rows)
    tangents_v = np.einsum("uc,nvcd->nvud", across, rows_v)
    # At base and apex all columns meet: there the derivative by u vanishes and its change along v takes its place.
    ends = np.where(v == 0.0, 1.0, np.where(v == 1.0, -1.0, 0.0))[None, :, None, None]
    mixed = np.einsum("uc,nvcd->nvud", across_u, rows_v)
    cross = np.cross(np.where(ends == 0, tangents_u, ends * mixed), tangents_v)
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    normals = np.where(length > 1e-12, cross / np.maximum(length, 1e-12), np.array([0.0, 0.0, 1.0]))
    return LeafGrid(points=points, tangents_u=tangents_u, tangents_v=tangents_v, normals=normals)


def quartic(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bernstein polynomials of degree 4 at v (V,): (V, 5)."""
    w = 1 - v
    return np.stack([w**4, 4 * w**3 * v, 6 * w**2 * v**2, 4 * w * v**3, v**4], axis=-1)


def quartic_derivative(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Their derivatives: (V, 5)."""
    w = 1 - v
    cubic = 4 * np.stack([w**3, 3 * w**2 * v, 3 * w * v**2, v**3], axis=-1)
    zero = np.zeros((len(v), 1))
    return np.concatenate([zero, cubic], axis=-1) - np.concatenate([cubic, zero], axis=-1)


def cross_section(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of the seven columns of the net at u (U,): (U, 7); either half is a cubic in |u|."""
    a = np.abs(u)
    b = 1 - a
    half = np.stack([b**3, 3 * b**2 * a, 3 * b * a**2, a**3], axis=-1)
    return _halves(half, u)


def cross_section_derivative(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Their derivatives by u: (U, 7); the right half's at u = 0."""
    a = np.abs(u)
    b = 1 - a
    half = 3 * np.stack([-(b**2), b**2 - 2 * a * b, 2 * a * b - a**2, a**2], axis=-1)
    return _halves(half * np.where(u < 0, -1.0, 1.0)[:, None], u)


def _halves(half: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    columns = np.zeros((len(u), 7))
    columns[:, 3] = half[:, 0]
    left = u < 0
    columns[left, 2::-1] = half[left, 1:]
    columns[~left, 4:] = half[~left, 1:]
    return columns


def _jitter_offsets(
    p: NDArray[np.float64], v: NDArray[np.float64], jitter: Jitter, phase: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far the right silhouette is moved, and the derivative by v: (N, V, 3) each."""
    at = jitter.frequency * v + phase[:, None]
    if jitter.map is None:
        turns = 2 * np.pi * at
        wave = sum(weight * np.sin(rate * turns) for rate, weight in WAVES)
        slope = sum(2 * np.pi * rate * weight * np.cos(rate * turns) for rate, weight in WAVES)
    else:
        place = (at - np.floor(at)) * len(jitter.map) - 0.5
        low = np.floor(place).astype(int)
        first, second = jitter.map[low % len(jitter.map)], jitter.map[(low + 1) % len(jitter.map)]
        wave = first + (place - low) * (second - first)
        slope = (second - first) * len(jitter.map)
    fade, fade_v = 1 - (2 * v - 1) ** 8, -16 * (2 * v - 1) ** 7
    height = jitter.amplitude * wave * fade
    height_v = jitter.amplitude * (jitter.frequency * slope * fade + wave * fade_v)
    normal = axis_normals(p, v)
    w = 1 - v[None, :, None]
    t = v[None, :, None]
    a1, a2 = p[:, None, 0], p[:, None, 1]
    d = (3 * w * w * a1 + 6 * w * t * (a2 - a1) + 3 * t * t * (APEX - a2))[..., :2]
    dd = (6 * w * (a2 - 2 * a1) + 6 * t * (APEX - 2 * a2 + a1))[..., :2]
    speed = np.maximum(np.linalg.norm(d, axis=-1, keepdims=True), 1e-12)
    unit = d / speed
    turn = (dd - unit * np.sum(unit * dd, axis=-1, keepdims=True)) / speed
    normal_v = np.stack([turn[..., 1], -turn[..., 0], np.zeros(turn.shape[:-1])], axis=-1)
    return (
        height[..., None] * normal,
        height_v[..., None] * normal + height[..., None] * normal_v,
    )
