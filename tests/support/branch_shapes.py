"""Skeletons and a cube whose every number is known."""

import numpy as np
from usdfoliage.branch.model import Skeleton
from usdfoliage.geometry.smooth_mesh import refine_smooth

# A cube of one metre, as quads from outside.
BOX = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
QUADS = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])


def fork(angle_deg: float = 90.0, radius_m: float = 0.05, child_m: float = 0.03) -> Skeleton:
    """A trunk of 2 m, a branch of 1 m from its middle at an angle, a twig from the branch's tip at 45 degrees."""
    turn = np.radians(angle_deg)
    tip = np.array([np.sin(turn), 1 + np.cos(turn), 0])
    return Skeleton(
        points_m=np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0], [0, 1, 0], tip, tip, np.add(tip, [0.5, 0, 0.5])], float),
        radius_m=np.array([radius_m] * 3 + [child_m] * 2 + [child_m / 2] * 2),
        counts=np.array([3, 2, 2], np.int32),
        parent_curve=np.array([-1, 0, 1], np.int32),
        parent_vertex=np.array([-1, 1, 4], np.int32),
        order=np.array([0, 1, 2], np.int32),
    )


def plant_of(*branches: tuple) -> Skeleton:
    """A skeleton of branches (points, radii, parent, vertex of the parent), parent None for a root."""
    firsts, orders, parents, leaves = [], [], [], []
    for points, _, parent, vertex in branches:
        firsts.append(firsts[-1] + len(branches[len(firsts) - 1][0]) if firsts else 0)
        parents.append(-1 if parent is None else parent)
        leaves.append(-1 if parent is None else firsts[parent] + vertex)
        orders.append(0 if parent is None else orders[parent] + 1)
        assert len(points) >= 2
    return Skeleton(
        points_m=np.concatenate([np.asarray(points, float) for points, _, _, _ in branches]),
        radius_m=np.concatenate([np.broadcast_to(np.asarray(r, float), len(points)) for points, r, _, _ in branches]),
        counts=np.array([len(points) for points, _, _, _ in branches], np.int32),
        parent_curve=np.array(parents, np.int32),
        parent_vertex=np.array(leaves, np.int32),
        order=np.array(orders, np.int32),
    )


def arc(radius_m: float, angle_rad: float, count: int) -> np.ndarray:
    """Points (count, 3) of an arc that starts upwards at the origin."""
    turn = np.linspace(0, angle_rad, count)
    return radius_m * np.stack([1 - np.cos(turn), np.sin(turn), 0 * turn], axis=1)


def random_tree(seed: int, max_branches: int = 20, wild: bool = False) -> Skeleton:
    """A tree of up to so many branches in up to four orders; a wild one zigzags, repeats points and thickens."""
    rng = np.random.default_rng(seed)
    branches: list[tuple] = []
    orders: list[int] = []

    def grow(start, direction, length_m, radius_m, parent, vertex):
        count = int(rng.integers(2, 12))
        bend = rng.choice([0.05, 0.2, 1.5 if wild else 0.6])
        points = [np.array(start, float)]
        for _ in range(count - 1):
            direction = direction + bend * 0.5 * rng.normal(size=3)
            direction = direction / np.linalg.norm(direction)
            stays = wild and rng.random() < 0.1
            points.append(points[-1] + (0 if stays else length_m / (count - 1)) * direction)
        radii = radius_m * np.linspace(1, rng.uniform(0.3, 1), count) * (rng.uniform(0.5, 1.5, count) if wild else 1)
        branches.append((np.array(points), radii, parent, vertex))
        orders.append(0 if parent is None else orders[parent] + 1)

    grow([0, 0, 0], np.array([0, 1, 0]), rng.uniform(0.5, 3), rng.uniform(0.02, 0.15), None, -1)
    for _ in range(int(rng.integers(0, max_branches))):
        parent = int(rng.integers(0, len(branches)))
        points, radii, _, _ = branches[parent]
        if orders[parent] >= 3:
            continue
        vertex = len(points) - 1 if rng.random() < 0.1 else int(rng.integers(0, len(points)))
        along = points[min(vertex + 1, len(points) - 1)] - points[max(vertex - 1, 0)]
        along = along / max(np.linalg.norm(along), 1e-9)
        side = np.cross(along, rng.normal(size=3))
        side = side / max(np.linalg.norm(side), 1e-9)
        turn = np.radians(rng.uniform(5, 175) if wild else rng.uniform(25, 120))
        length_m = np.linalg.norm(np.diff(points, axis=0), axis=1).sum() * rng.uniform(0.05 if wild else 0.3, 0.9)
        thickness = radii[vertex] * rng.uniform(0.1, 1.3 if wild else 0.9)
        grow(points[vertex], np.cos(turn) * along + np.sin(turn) * side, length_m + 1e-3, thickness, parent, vertex)
    return plant_of(*branches)


def limit(cage, levels: int = 3):
    """Limit points (V, 3) and quads (F, 4) of a cage; 4 ** levels quads a face, face after face."""
    return refine_smooth(cage.points_m, cage.faces, levels)


def volume(points, quads):
    """Volume inside a closed mesh of quads."""
    a, b, c, d = (points[quads[:, k]] for k in range(4))
    return float((np.sum(np.cross(a, b) * c, axis=1) + np.sum(np.cross(a, c) * d, axis=1)).sum() / 6)


def off_axis(points, axis_m, radius_m):
    """Distance of points (N, 3) from a polyline over its radius there (N,), and the arc of the nearest place (N,)."""
    step = np.diff(axis_m, axis=0)
    square = np.maximum(np.sum(step**2, axis=1), 1e-300)
    share = np.clip(np.sum((points[:, None] - axis_m[:-1]) * step, axis=2) / square, 0, 1)
    distance = np.linalg.norm(points[:, None] - axis_m[:-1] - share[..., None] * step, axis=2)
    at = distance.argmin(axis=1)
    row = np.arange(len(points))
    length = np.sqrt(square)
    arc = np.concatenate([[0], np.cumsum(length)])[at] + share[row, at] * length[at]
    radius = radius_m[at] + share[row, at] * (radius_m[at + 1] - radius_m[at])
    return distance[row, at] / radius, arc
