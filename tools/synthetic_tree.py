#!/usr/bin/env python3
"""A scan of a tree that never stood: grown into a crown, its bark sampled with noise, on a piece of ground.

usage: tools/synthetic_tree.py OUT.xyz [--seed 1] [--height 6] [--points 60000] [--noise 0.002]

For a first try of usdfoliage branches. Metres, Z up.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from usdfoliage.branch.distances import sample_axes
from usdfoliage.branch.growth.grow import grow_branches, seed_plants
from usdfoliage.branch.growth.logistic import LogisticSettings
from usdfoliage.branch.growth.settings import GrowthSettings
from usdfoliage.geometry.directions import two_across

INTERNODE_OF_HEIGHT = 0.02
CROWN = (0.62, 0.36, 0.26)  # middle, half height and half width, of the height
MARKERS = 2500
ROOT_OF_HEIGHT = 0.015  # radius
GROUND_POINTS = 8000
STEP_M = 0.004


def grow_tree(height_m: float, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places along the axes of a tree (K, 3), radii (K,) and directions (K, 3); Y up."""
    rng = np.random.default_rng(seed)
    crown = rng.normal(size=(MARKERS, 3))
    crown *= (rng.random(MARKERS) ** (1 / 3) / np.linalg.norm(crown, axis=1))[:, None]
    middle, half, wide = (share * height_m for share in CROWN)
    crown_m = crown * [wide, half, wide] + [0, middle, 0]
    trunk_m = np.linspace([0, 0, 0], [0, middle, 0], 60)
    markers_m = np.concatenate([trunk_m, crown_m])
    internode_m = INTERNODE_OF_HEIGHT * height_m
    settings = GrowthSettings(internode_m=internode_m, logistic=LogisticSettings(longest=1 / INTERNODE_OF_HEIGHT))
    root = seed_plants(np.zeros((1, 3)), internode_m, ROOT_OF_HEIGHT * height_m)
    skeleton = grow_branches(root, markers_m, np.ones(len(markers_m)), settings, seed).skeleton
    return sample_axes(skeleton, STEP_M)


def scan_tree(height_m: float, points: int, noise_m: float, seed: int) -> NDArray[np.float64]:
    """(N, 3) points on bark, by its area, and on the ground; Z up."""
    rng = np.random.default_rng(seed)
    axis_m, radius_m, direction = grow_tree(height_m, seed)
    chosen = rng.choice(len(axis_m), points, p=(radius_m + noise_m) / (radius_m + noise_m).sum())
    side, other = two_across(direction[chosen])
    turn = rng.uniform(0, 2 * np.pi, points)[:, None]
    bark_m = axis_m[chosen] + radius_m[chosen, None] * (np.cos(turn) * side + np.sin(turn) * other)
    bark_m += rng.uniform(-0.5, 0.5, (points, 1)) * STEP_M * direction[chosen]
    reach_m = 0.5 * height_m
    ground_m = rng.uniform(-reach_m, reach_m, (GROUND_POINTS, 3)) * [1, 0, 1]
    cloud_m = np.concatenate([bark_m, ground_m])
    cloud_m += rng.normal(0, noise_m, cloud_m.shape)
    return np.column_stack([cloud_m[:, 0], -cloud_m[:, 2], cloud_m[:, 1]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--height", type=float, default=6.0, metavar="METRES")
    parser.add_argument("--points", type=int, default=60_000)
    parser.add_argument("--noise", type=float, default=0.002, metavar="METRES")
    options = parser.parse_args()
    cloud_m = scan_tree(options.height, options.points, options.noise, options.seed)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(options.output, cloud_m, fmt="%.4f")
    print(options.output)


if __name__ == "__main__":
    main()
