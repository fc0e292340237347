"""The leaf written plainly in numpy: what the native one is compared with.

All of it takes complex numbers too, so that a step along the imaginary axis gives exact derivatives.
"""

from dataclasses import dataclass

import numpy as np
from usdfoliage.leaf.shape.jitter import NO_JITTER, WAVES

APEX = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class ReferenceGrid:
    points: np.ndarray  # (N, V, U, 3)
    tangents_u: np.ndarray
    tangents_v: np.ndarray
    normals: np.ndarray


def axis_points(p, v):
    t = np.broadcast_to(v, (len(p), np.shape(v)[-1]))[..., None]
    w = 1 - t
    return 3 * w * w * t * p[:, None, 0] + 3 * w * t * t * p[:, None, 1] + t**3 * APEX


def axis_normals(p, v):
    t = np.broadcast_to(v, (len(p), np.shape(v)[-1]))[..., None]
    w = 1 - t
    d = 3 * w * w * p[:, None, 0] + 6 * w * t * (p[:, None, 1] - p[:, None, 0]) + 3 * t * t * (APEX - p[:, None, 1])
    flat = d[..., :2] / _guarded(np.sqrt(np.sum(d[..., :2] ** 2, axis=-1, keepdims=True)))
    return np.stack([flat[..., 1], -flat[..., 0], np.zeros(flat.shape[:-1])], axis=-1)


def leaf_nets(p):
    net = np.zeros((len(p), 5, 7, 3), p.dtype)
    net[:, 4] = APEX
    net[:, 1, 3] = 0.75 * p[:, 0]
    net[:, 2, 3] = 0.5 * (p[:, 0] + p[:, 1])
    net[:, 3, 3] = 0.25 * APEX + 0.75 * p[:, 1]
    on_axis = axis_points(p, p[:, 2:5, 0])
    normal = axis_normals(p, p[:, 2:5, 0])
    for column, share, heights in ((1, 1 / 3, p[:, 5]), (2, 2 / 3, p[:, 6]), (3, 1.0, p[:, 2:5, 2])):
        for side in (-1, 1):
            point = on_axis + side * share * p[:, 2:5, 1, None] * normal
            point[..., 2] += heights
            net[:, 1:4, 3 + side * column] = point
    return net


def evaluate_points(p, uv):
    """(N, P, 3) at uv (P, 2) or (N, P, 2)."""
    uv = np.broadcast_to(uv, (len(p), *np.shape(uv)[-2:]))
    net = leaf_nets(p)
    rows = np.einsum("npk,nkcd->npcd", quartic(uv[..., 1]), net)
    return np.einsum("npc,npcd->npd", cross_section(uv[..., 0]), rows)


def evaluate_grid_points(p, u, v):
    """The points of evaluate_grid alone."""
    rows = np.einsum("vk,nkcd->nvcd", quartic(v), leaf_nets(p))
    return np.einsum("uc,nvcd->nvud", cross_section(u), rows)


def evaluate_grid(p, u, v, jitter=NO_JITTER, phase=None):
    net = leaf_nets(p)
    rows = np.einsum("vk,nkcd->nvcd", quartic(v), net)
    rows_v = np.einsum("vk,nkcd->nvcd", quartic_derivative(v), net)
    if jitter.amplitude:
        offset, offset_v = _jitter_offsets(p, v, jitter, np.zeros(len(p)) if phase is None else phase)
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
    return ReferenceGrid(points, tangents_u, tangents_v, normals)


def evaluate_jacobian(p, uv):
    """Points (N, P, 3) and derivatives (N, P, 3, 21) by a step of each parameter along the imaginary axis."""
    step = 1e-30
    jacobian = np.empty((len(p), np.shape(uv)[-2], 3, 21))
    for number in range(21):
        moved = p.astype(complex)
        moved.reshape(len(p), 21)[:, number] += 1j * step
        jacobian[..., number] = evaluate_points(moved, uv).imag / step
    return evaluate_points(p, uv), jacobian


def quartic(v):
    """Bernstein polynomials of degree 4 at v (...): (..., 5)."""
    w = 1 - v
    return np.stack([w**4, 4 * w**3 * v, 6 * w**2 * v**2, 4 * w * v**3, v**4], axis=-1)


def quartic_derivative(v):
    w = 1 - v
    cubic = 4 * np.stack([w**3, 3 * w**2 * v, 3 * w * v**2, v**3], axis=-1)
    zero = np.zeros((*np.shape(v), 1))
    return np.concatenate([zero, cubic], axis=-1) - np.concatenate([cubic, zero], axis=-1)


def cross_section(u):
    """Weights of the seven columns of the net at u (...): (..., 7); either half is a cubic in |u|."""
    a = np.where(u.real < 0, -u, u)
    b = 1 - a
    return _halves(np.stack([b**3, 3 * b**2 * a, 3 * b * a**2, a**3], axis=-1), u)


def cross_section_derivative(u):
    """Their derivatives by u; the right half's at u = 0."""
    a = np.abs(u)
    b = 1 - a
    half = 3 * np.stack([-(b**2), b**2 - 2 * a * b, 2 * a * b - a**2, a**2], axis=-1)
    return _halves(half * np.where(u < 0, -1.0, 1.0)[..., None], u)


def _halves(half, u):
    columns = np.zeros((*np.shape(u), 7), half.dtype)
    columns[..., 3] = half[..., 0]
    left = u.real < 0
    columns[left, 2::-1] = half[left, 1:]
    columns[~left, 4:] = half[~left, 1:]
    return columns


def _guarded(length):
    return np.where(length.real > 1e-12, length, 1e-12)


def jitter_wave(jitter, cycles):
    """J and its derivative by cycles."""
    if jitter.map is None:
        turns = 2 * np.pi * cycles
        wave = sum(weight * np.sin(rate * turns) for rate, weight in WAVES)
        return wave, sum(2 * np.pi * rate * weight * np.cos(rate * turns) for rate, weight in WAVES)
    place = (cycles - np.floor(cycles)) * len(jitter.map) - 0.5
    low = np.floor(place).astype(int)
    first, second = jitter.map[low % len(jitter.map)], jitter.map[(low + 1) % len(jitter.map)]
    return first + (place - low) * (second - first), (second - first) * len(jitter.map)


def _jitter_offsets(p, v, jitter, phase):
    """How far the right silhouette is moved, and the derivative by v: (N, V, 3) each."""
    wave, slope = jitter_wave(jitter, jitter.frequency * v + phase[:, None])
    fade, fade_v = 1 - (2 * v - 1) ** 8, -16 * (2 * v - 1) ** 7
    height = jitter.amplitude * wave * fade
    height_v = jitter.amplitude * (jitter.frequency * slope * fade + wave * fade_v)
    normal = axis_normals(p, v)
    w = 1 - v[None, :, None]
    t = v[None, :, None]
    a1, a2 = p[:, None, 0], p[:, None, 1]
    d = (3 * w * w * a1 + 6 * w * t * (a2 - a1) + 3 * t * t * (APEX - a2))[..., :2]
    dd = (6 * w * (a2 - 2 * a1) + 6 * t * (APEX - 2 * a2 + a1))[..., :2]
    speed = _guarded(np.sqrt(np.sum(d**2, axis=-1, keepdims=True)))
    unit = d / speed
    turn = (dd - unit * np.sum(unit * dd, axis=-1, keepdims=True)) / speed
    normal_v = np.stack([turn[..., 1], -turn[..., 0], np.zeros(turn.shape[:-1])], axis=-1)
    return height[..., None] * normal, height_v[..., None] * normal + height[..., None] * normal_v
