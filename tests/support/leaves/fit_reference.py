"""The alternating fit written plainly: numpy, and scipy's least squares with a numeric Jacobian.

Without weights against outliers, and without the bounds that keep bad leaves from folding.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from usdfoliage.geometry.enclosing_ellipse import enclosing_ellipses
from usdfoliage.leaf.shape.surface import evaluate_points

from tests.support.leaves.reference import axis_normals, axis_points, leaf_nets, quartic

PACE_PULL, SWAY_PULL = 0.1, 0.03


@dataclass
class ReferenceFit:
    parameters: np.ndarray  # (7, 3)
    base: np.ndarray
    axes: np.ndarray  # (3, 3), rows x, y, z
    length: float
    iterations: int


def ellipse_leaf(half_width):
    """A flat leaf (7, 3) whose silhouette is the quartic nearest to the ellipse."""
    v = (np.arange(20_000) + 0.5) / 20_000
    ends, middle = 4 * v * (1 - v) ** 3 + 4 * v**3 * (1 - v), 6 * v**2 * (1 - v) ** 2
    near, far = np.linalg.lstsq(np.column_stack([ends, middle]), 2 * np.sqrt(v * (1 - v)), rcond=None)[0]
    leaf = np.zeros((7, 3))
    leaf[:2, 1] = 1 / 3, 2 / 3
    leaf[2:5, 0] = 0.25, 0.5, 0.75
    leaf[2:5, 1] = np.array([near, max(far, 0), near]) * half_width
    return leaf


def quadric(x, y):
    return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def leaf_frame(points, normals):
    """Base, axes (rows), length, and the ellipse's half width in leaf lengths."""
    mean = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - mean, full_matrices=False)
    size = spread[0] / np.sqrt(len(points))
    along, normal = axes[0], axes[2]
    normal = normal * (1 if normal @ normals.sum(axis=0) >= 0 else -1)
    along = along * (1 if np.sum(((points - mean) @ along) ** 3) >= 0 else -1)
    plane = np.array([np.cross(along, normal), along, normal])
    x, y, z = ((points - mean) @ plane.T / size).T
    found = enclosing_ellipses(np.column_stack([x, y]), np.array([0, len(x)]), tolerance=1e-6)
    (half, half_width), angle = found.half_axes[0], found.angles[0]
    major = np.array([np.cos(angle), np.sin(angle)])
    major *= 1 if major[1] >= 0 else -1
    height, *_ = np.linalg.lstsq(quadric(x, y), z, rcond=None)
    ends = []
    for sign in (-1, 1):
        place = found.centers[0] + sign * half * major
        nearest = np.argsort((x - place[0]) ** 2 + (y - place[1]) ** 2)[: max(5, len(x) // 50)]
        off = np.sort((z - quadric(x, y) @ height)[nearest])[len(nearest) // 2]
        at_end = np.clip((quadric(place[:1], place[1:]) @ height)[0], z.min(), z.max())
        ends.append(np.array([*place, at_end + off]))
    length = np.linalg.norm(ends[1] - ends[0])
    y_axis = (ends[1] - ends[0]) / length
    x_axis = np.array([y_axis[1], -y_axis[0], 0]) / np.hypot(y_axis[0], y_axis[1])
    leaf_axes = np.array([x_axis, y_axis, np.cross(x_axis, y_axis)]) @ plane
    return mean + size * ends[0] @ plane, leaf_axes, length * size, half_width / length


def axis_slope(leaf, v):
    w = 1 - v[:, None]
    t = v[:, None]
    first, second, apex = leaf[0], leaf[1], np.array([0.0, 1.0, 0.0])
    slope = 3 * w * w * first + 6 * w * t * (second - first) + 3 * t * t * (apex - second)
    bend = 6 * w * (second - 2 * first) + 6 * t * (apex - 2 * second + first)
    return slope[:, :2], bend[:, :2]


def axis_feet(leaf, points):
    """v of the perpendicular from each point to the axis, seen from above."""
    v = np.clip(points[:, 1], 0, 1)
    for _ in range(30):
        off = points[:, :2] - axis_points(leaf[None], v)[0, :, :2]
        slope, bend = axis_slope(leaf, v)
        speed = np.sum(slope**2, axis=1)
        bent = speed - np.sum(off * bend, axis=1)
        v = np.clip(v + np.sum(off * slope, axis=1) / np.where(bent > speed / 4, bent, speed), -0.5, 1.5)
    return v


def half_widths(leaf, v):
    """Distance of the right silhouette from the curve of the feet, along the axis' normal."""
    net = leaf_nets(leaf[None])[0]
    step = quartic(v) @ (net[:, 6] - net[:, 0])[:, :2] / 2
    return np.sum(step * axis_normals(leaf[None], v)[0, :, :2], axis=1)


def map_points(leaf, half_width, points, lines):
    """(u, v) of the points (P, 2), the number of each one's scanline, weights of the scanlines (lines, 2)."""
    v = axis_feet(leaf, points)
    distance = np.sum((points - axis_points(leaf[None], v)[0])[:, :2] * axis_normals(leaf[None], v)[0, :, :2], axis=1)
    line = np.where((v >= 0) & (v <= 1), np.minimum((v * lines).astype(int), lines - 1), -1)
    at = (np.arange(lines) + 0.5) / lines
    here, there = half_widths(leaf, v), half_widths(leaf, at)[line]
    usable = (here > 0) & (there > 0)
    distance = distance * np.where(usable, np.clip(there / np.where(usable, here, 1), 0.5, 2), 1)
    side = (distance < 0).astype(int)
    reach, room, count = np.zeros((lines, 2)), np.zeros((lines, 2)), np.zeros((lines, 2))
    on = line >= 0
    np.maximum.at(reach, (line[on], side[on]), np.abs(distance[on]))
    np.add.at(count, (line[on], side[on]), 1)
    reach *= np.where(count > 0, 1 + 1 / np.maximum(count, 4), 1)
    radii = np.array([half_width, 0.5])
    feet, across = axis_points(leaf[None], at)[0], axis_normals(leaf[None], at)[0]
    for j, (point, normal) in enumerate(zip(feet, across, strict=True)):
        start = (point[:2] - (0, 0.5)) / radii
        for k, sign in enumerate((1, -1)):
            direction = sign * normal[:2] / radii
            roots = np.roots([direction @ direction, 2 * start @ direction, start @ start - 1])
            room[j, k] = max(reach[j, k], roots.real.max() if start @ start < 1 else 0)
    weight = np.divide(reach, room, out=np.zeros_like(reach), where=room > 0)
    best = weight.max(axis=1, keepdims=True)
    share = np.divide(weight, best, out=np.ones_like(weight), where=best > 0)
    full = share * reach + (1 - share) * np.maximum(reach, best * room)
    of_point = np.where(on, full[line, side], 0)
    u = np.clip(np.divide(distance, of_point, out=np.zeros_like(distance), where=of_point > 0), -1, 1)
    return np.column_stack([u, v]), line, weight


def fit_leaf(points, normals, scanlines=32, max_iterations=15, tolerance=1e-3, prior=1e-4):
    base, axes, length, half_width = leaf_frame(points, normals)
    local = (points - base) @ axes.T / length
    lines = min(max(int(0.8 * np.sqrt(len(points))), 8), scanlines)
    start = ellipse_leaf(half_width)
    leaf, iterations = start, 0
    pulls = np.full((7, 3), prior)
    pulls[:2, 1] += PACE_PULL
    while iterations < max_iterations:
        iterations += 1
        uv, line, weights = map_points(leaf, half_width, local, lines)
        on = line >= 0
        on_line = np.column_stack([uv[on, 0], (line[on] + 0.5) / lines])
        target = local[on] + evaluate_points(leaf[None], on_line)[0] - evaluate_points(leaf[None], uv[on])[0]
        weight = weights[line[on], (uv[on, 0] < 0).astype(int)]
        roots = np.sqrt(weight / weight.sum())[:, None]

        def off(numbers, on_line=on_line, target=target, roots=roots):
            trial = numbers.reshape(7, 3)
            away = roots * (evaluate_points(trial[None], on_line, threads=1)[0] - target)
            pulled = np.sqrt(pulls) * (trial - start)
            return np.concatenate([away.ravel(), pulled.ravel(), [np.sqrt(SWAY_PULL) * (trial[0, 0] - trial[1, 0])]])

        previous, leaf = leaf, least_squares(off, leaf.ravel(), method="lm").x.reshape(7, 3)
        change = evaluate_points(leaf[None], on_line)[0] - evaluate_points(previous[None], on_line)[0]
        if np.sqrt(np.sum((roots * change) ** 2)) <= tolerance:
            break
    return ReferenceFit(leaf, base, axes, length, iterations)
