"""Scans of ground whose height is known by a formula, with houses and trees of points on it."""

from collections.abc import Callable

import numpy as np

SIDE_M = 160.0
GROUNDS: dict[str, Callable] = {
    "flat": lambda x, y: 100 + 0 * x,
    "slope": lambda x, y: 100 + 0.7 * x + 0.4 * y,
    "hill": lambda x, y: 100 + 30 * np.exp(-((x - 80) ** 2 + (y - 70) ** 2) / (2 * 30**2)) + 0.1 * x,
    "ridge": lambda x, y: 100 - np.hypot(x - 80 + 0.2 * y, 10),
}
HOUSES = ((40.0, 40.0, 14.0, 9.0, 6.0), (115.0, 60.0, 24.0, 16.0, 9.0), (60.0, 120.0, 12.0, 30.0, 4.0))


def trees(seed: int = 0) -> np.ndarray:
    """(T, 4) easting, northing, radius and height of trees beside the houses."""
    rng = np.random.default_rng(seed)
    rows = np.column_stack([rng.uniform(8, SIDE_M - 8, (90, 2)), rng.uniform(1.5, 4.5, 90), rng.uniform(5, 18, 90)])
    free = np.ones(len(rows), bool)
    for x, y, width, depth, _ in HOUSES:
        free &= (np.abs(rows[:, :2] - [x, y]) > np.array([width, depth]) / 2 + rows[:, 2:3] + 1).any(axis=1)
    return rows[free]


def scan_of(ground: str, seed: int = 0, noise_m: float = 0.03, outliers: int = 12) -> np.ndarray:
    """(N, 3) points of the ground about 1 m apart, 15 % of them under crowns, of crowns, of roofs, and low outliers."""
    rng = np.random.default_rng(seed)
    height = GROUNDS[ground]
    plan = rng.uniform(0, SIDE_M, (int(SIDE_M**2), 2))
    z = height(*plan.T)
    kept = np.ones(len(plan), bool)
    crowns = []
    for x, y, radius, tall in trees(seed):
        kept &= (np.hypot(*(plan - [x, y]).T) > radius) | (rng.random(len(plan)) < 0.15)
        angle, off = rng.uniform(0, 2 * np.pi, 300), np.sqrt(rng.random(300))
        top, bottom = tall * (1 - 0.5 * off**2), 0.3 * tall
        up = bottom + (top - bottom) * rng.random(300) ** 0.3
        east, north = x + radius * off * np.cos(angle), y + radius * off * np.sin(angle)
        crowns.append(np.column_stack([east, north, height(x, y) + up]))
    for x, y, width, depth, tall in HOUSES:
        inside = (np.abs(plan - [x, y]) < np.array([width, depth]) / 2).all(axis=1)
        z[inside] = z[inside].max() + tall
    ground_m = np.column_stack([plan, z + rng.normal(0, noise_m, len(z))])[kept]
    low = rng.uniform(0, SIDE_M, (outliers, 2))
    low_m = np.column_stack([low, height(*low.T) - rng.uniform(3, 30, outliers)])
    return np.concatenate([ground_m, *crowns, low_m])
