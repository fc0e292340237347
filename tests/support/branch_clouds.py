"""Clouds of branches that are known: points on cylinders, cones, forks and a small tree, and on the ground below.

Also of what is no tree: rectangles, as of walls and roofs, and blocks of leaves; Y up.
"""

import numpy as np
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.sections import SectionTree

from tests.support.branch_shapes import plant_of

_ARM_M = 0.5  # of a fork, the thin one
_TWIG_M = 0.4  # of the small tree: less than its branches go on for


def rings(radius_m: float, heights_m: np.ndarray, around: int = 24) -> np.ndarray:
    """Points of an upright cylinder, ring after ring, as evenly as they can be."""
    turn = 2 * np.pi * np.arange(around) / around
    ring = radius_m * np.column_stack([np.cos(turn), 0 * turn, np.sin(turn)])
    return (ring + np.asarray(heights_m)[:, None, None] * [0, 1, 0]).reshape(-1, 3)


def cone(start_m, end_m, radii_m, count: int, seed: int = 0, noise_m: float = 0.0) -> np.ndarray:
    """Points spread evenly over the side of a cone, or of a cylinder where both radii are one."""
    rng = np.random.default_rng(seed)
    start_m, along_m = np.asarray(start_m, float), np.subtract(end_m, start_m, dtype=float)
    first_m, last_m = np.broadcast_to(radii_m, 2)
    share = rng.uniform(0, 1, count)  # uniform in area: of share t the ring is first + t (last - first) long
    if first_m != last_m:
        share = (np.sqrt(first_m**2 + share * (last_m**2 - first_m**2)) - first_m) / (last_m - first_m)
    direction = along_m / np.linalg.norm(along_m)
    side = np.cross(direction, [1.0, 0, 0] if abs(direction[0]) < 0.9 else [0, 1.0, 0])
    side /= np.linalg.norm(side)
    turn = rng.uniform(0, 2 * np.pi, count)[:, None]
    away_m = (first_m + share * (last_m - first_m))[:, None]
    surface_m = away_m * (np.cos(turn) * side + np.sin(turn) * np.cross(direction, side))
    return start_m + share[:, None] * along_m + surface_m + noise_m * rng.normal(size=(count, 3))


def line(start_m, end_m, count: int) -> np.ndarray:
    """Points in even steps, both ends among them."""
    return np.linspace(np.asarray(start_m, float), np.asarray(end_m, float), count)


def cloud_of(skeleton: Skeleton, per_m2: float = 10_000, seed: int = 0, noise_m: float = 0.0) -> np.ndarray:
    """Points spread evenly over the branches of a skeleton, none of them inside another branch."""
    ends = np.setdiff1d(np.arange(len(skeleton.points_m)), skeleton.first)
    parts = []
    for end in ends.tolist():
        edge_m, radii_m = skeleton.points_m[end - 1 : end + 1], skeleton.radius_m[end - 1 : end + 1]
        count = max(4, round(per_m2 * 2 * np.pi * radii_m.mean() * np.linalg.norm(np.diff(edge_m, axis=0))))
        points_m = cone(*edge_m, radii_m, count, seed + end, noise_m)
        outside = np.ones(count, bool)
        for other in ends[skeleton.curve[ends] != skeleton.curve[end]].tolist():
            outside &= ~_inside(points_m, skeleton.points_m[other - 1 : other + 1], skeleton.radius_m[other])
        parts.append(points_m[outside])
    return np.concatenate(parts)


def _inside(points_m: np.ndarray, edge_m: np.ndarray, radius_m: float) -> np.ndarray:
    along_m = edge_m[1] - edge_m[0]
    share = np.clip((points_m - edge_m[0]) @ along_m / (along_m @ along_m), 0, 1)
    return np.linalg.norm(points_m - edge_m[0] - share[:, None] * along_m, axis=1) < 0.95 * radius_m


def y_fork() -> Skeleton:
    """A stem that parts at 1 m: a thick arm of 1.2 m, in which it goes on, and a thin one of half a metre."""
    stem = [[0, 0, 0], [0, 0.5, 0], [0, 1, 0]]
    thick = [[0.3, 1.52, 0], [0.6, 2.04, 0]]
    thin_m = np.array([0, 1, 0]) + _ARM_M * np.array([[0, 0, 0], [-0.35, 0.35, 0], [-0.7, 0.7, 0]])
    return plant_of(
        (np.array(stem + thick), [0.06, 0.06, 0.06, 0.05, 0.04], None, 0),
        (thin_m, [0.025, 0.02, 0.015], 0, 2),
    )


def small_tree() -> Skeleton:
    """A trunk of 4 m, 12 cm thick at its foot and 4 at its tip, four branches of a metre, and twigs on two of them."""
    heights_m = np.linspace(0, 4, 17)
    trunk_m = heights_m[:, None] * [0, 1, 0]
    trunk = (trunk_m, 0.06 - 0.01 * heights_m, None, 0)
    branches, twigs = [], []
    for number, vertex in enumerate((6, 8, 10, 12)):
        turn = number * np.radians(137.5)
        out = np.array([np.cos(turn), 0.6, np.sin(turn)]) / np.hypot(1, 0.6)
        points_m = trunk_m[vertex] + np.linspace(0, 1, 6)[:, None] * out
        branches.append((points_m, np.linspace(0.022, 0.01, 6), 0, vertex))
        if number < 2:
            side = np.cross(out, [0, 1, 0])
            aside = (out + side / np.linalg.norm(side)) / np.sqrt(2)
            twig_m = points_m[2] + _TWIG_M * np.linspace(0, 1, 4)[:, None] * aside
            twigs.append((twig_m, np.linspace(0.009, 0.006, 4), number + 1, 2))
    return plant_of(trunk, *branches, *twigs)


def twiggy_tree() -> Skeleton:
    """A stem of 1.5 m with three branches of 60 cm, and on each of them five twigs of 30 cm, thin as twigs are."""
    rng = np.random.default_rng(4)
    stem_m = np.linspace(0, 1.5, 11)[:, None] * [0, 1, 0]
    branches, twigs = [(stem_m, np.linspace(0.03, 0.012, 11), None, 0)], []
    for number, vertex in enumerate((5, 7, 9), 1):
        turn = number * np.radians(137.5)
        points_m = stem_m[vertex] + np.linspace(0, 0.6, 7)[:, None] * [np.cos(turn) * 0.86, 0.5, np.sin(turn) * 0.86]
        branches.append((points_m, np.linspace(0.012, 0.005, 7), 0, vertex))
        for at in range(2, 7):
            out = rng.normal(size=3) + 2.5 * (points_m[-1] - points_m[0])
            twig_m = points_m[at] + 0.3 * np.linspace(0, 1, 4)[:, None] * out / np.linalg.norm(out)
            twigs.append((twig_m, [0.003, 0.0025, 0.002, 0.0015], number, at))
    return plant_of(*branches, *twigs)


def leaves_on(skeleton: Skeleton, per_twig: int, length_m: float = 0.1, per_m2: float = 10_000, seed: int = 0):
    """Points (N, 3) of flat oval leaves on stalks along the twigs, half as wide as they are long."""
    rng = np.random.default_rng(seed)
    parts = []
    for number in np.flatnonzero(skeleton.order == skeleton.order.max()).tolist():
        twig_m = skeleton.points_m[skeleton.branch(number)]
        for share in rng.uniform(0.2, 1, per_twig):
            base_m = twig_m[0] + share * (twig_m[-1] - twig_m[0])
            frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            count = rng.poisson(per_m2 * 0.8 * length_m * length_m / 2)
            along, across = rng.uniform(-0.5, 0.5, (2, 4 * count))
            oval = along**2 + across**2 < 0.25
            along, across = along[oval][:count], across[oval][:count]
            plane = (0.75 + along)[:, None] * frame[0] + 0.5 * across[:, None] * frame[1]
            parts.append(base_m + length_m * plane)
    return np.concatenate(parts)


def ground(side_m: float, count: int = 4000, slope=(0.0, 0.0), height_m: float = 0.0, noise_m: float = 0.003, seed=9):
    """Points of a square of ground around the origin, that rises along x and z."""
    rng = np.random.default_rng(seed)
    x, z = rng.uniform(-side_m / 2, side_m / 2, (2, count))
    return np.column_stack([x, height_m + slope[0] * x + slope[1] * z + rng.normal(0, noise_m, count), z])


def rectangle(corner_m, along_m, other_m, per_m2: float, noise_m: float, seed: int) -> np.ndarray:
    """Points spread evenly over a rectangle between two sides, off it by some noise."""
    rng = np.random.default_rng(seed)
    across = np.cross(along_m, other_m).astype(float)
    area_m2 = np.linalg.norm(across)
    share = rng.uniform(0, 1, (round(per_m2 * area_m2), 2))
    off_m = noise_m * rng.normal(size=(len(share), 1)) * across / area_m2
    return np.asarray(corner_m, float) + share @ np.array([along_m, other_m], float) + off_m


def gabled_house(per_m2: float = 40, noise_m: float = 0.02) -> np.ndarray:
    """Four walls of 5 m, 10 m times 8 m, and a roof that is 3 m higher."""
    sides = [
        ((0, 0, 0), (10, 0, 0), (0, 5, 0)),
        ((0, 0, 8), (10, 0, 0), (0, 5, 0)),
        ((0, 0, 0), (0, 0, 8), (0, 5, 0)),
        ((10, 0, 0), (0, 0, 8), (0, 5, 0)),
        ((0, 5, 0), (10, 0, 0), (0, 3, 4)),
        ((0, 5, 8), (10, 0, 0), (0, 3, -4)),
    ]
    return np.concatenate([rectangle(*side, per_m2, noise_m, seed) for seed, side in enumerate(sides)])


def block(size_m, count: int, seed: int = 0, middle_m: float | None = None) -> np.ndarray:
    """Points in a box from the origin; where middle_m is given most are that near its sides and top."""
    rng = np.random.default_rng(seed)
    size_m = np.asarray(size_m, float)
    points_m = size_m * rng.uniform(0, 1, ((8 if middle_m else 1) * count, 3))
    if middle_m:
        inside_m = np.minimum(points_m, size_m - points_m)
        inside_m[:, 1] = size_m[1] - points_m[:, 1]
        points_m = points_m[rng.uniform(0, 1, len(points_m)) < np.exp(-inside_m.min(axis=1) / middle_m)]
    return points_m[:count]


def chain(points_m: np.ndarray) -> SectionTree:
    """Each point a section, one after the other."""
    count = len(points_m)
    return SectionTree(
        center_m=points_m,
        points=np.ones(count, np.int32),
        parent=np.arange(-1, count - 1, dtype=np.int32),
        section=np.arange(count, dtype=np.int32),
    )
