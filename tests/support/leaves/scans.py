"""Clouds of leaves that are known, as scans that hide nothing."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

LENGTH_M, WIDTH = 0.08, 0.5
APART = 1.5  # leaf lengths between the middles


def scanned_leaves(
    count: int, points: int, noise_m: float = 0.0005, seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Points (N, 3) of bent leaves on a grid, turned anyhow, and which leaf each is of, in no order."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(count ** (1 / 3)))
    clouds = []
    for leaf in range(count):
        y = rng.uniform(-0.5, 0.5, 4 * points)
        x = rng.uniform(-0.5, 0.5, 4 * points) * WIDTH
        inside = np.flatnonzero(np.square(x / (WIDTH / 2)) + np.square(y / 0.5) < 1)[:points]
        x, y = x[inside], y[inside]
        blade = np.column_stack([x, y, 0.3 * np.square(y) + 0.2 * np.abs(x)]) * LENGTH_M
        blade = Rotation.random(random_state=rng.integers(1 << 30)).apply(blade)
        place = np.array(np.unravel_index(leaf, (side, side, side))) * APART * LENGTH_M
        clouds.append(blade + place + rng.normal(0, noise_m, blade.shape))
    order = rng.permutation(sum(map(len, clouds)))
    leaf_of = np.repeat(np.arange(count, dtype=np.int32), [len(cloud) for cloud in clouds])
    return np.concatenate(clouds)[order], leaf_of[order]


def stem_points(length_m: float, radius_m: float, points: int, seed: int = 1) -> NDArray[np.float64]:
    """Points (N, 3) of an upright cylinder with its middle at the origin."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0, 2 * np.pi, points)
    height_m = rng.uniform(-length_m / 2, length_m / 2, points)
    return np.column_stack([radius_m * np.cos(turn), height_m, radius_m * np.sin(turn)])


def overlaps(found: NDArray[np.int32], true: NDArray[np.int32]) -> NDArray[np.float64]:
    """(L,), the intersection over union of each true leaf with the found one that it shares most with."""
    best = []
    for leaf in range(int(true.max()) + 1):
        own = true == leaf
        near = found[own & (found >= 0)]
        nearest = np.bincount(near).argmax() if len(near) else -1
        both = np.count_nonzero(own & (found == nearest)) if nearest >= 0 else 0
        best.append(both / np.count_nonzero(own | ((found == nearest) & (found >= 0))))
    return np.array(best)
