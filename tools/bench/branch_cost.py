"""What tracing branches and building their surface costs, at any number of points of one tree."""

import resource
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.distances import sample_axes
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.reconstruct import reconstruct_branches

from tools.bench.branch_truth import read_true_skeleton

NOISE_M = 0.002  # of the points


def tree_points(count: int, truth_file: Path) -> NDArray[np.float64]:
    """(count, 3) points on the surface of a tree, Y up: the true one, or a plain one where there is no file."""
    rng = np.random.default_rng(0)
    skeleton = read_true_skeleton(truth_file) if truth_file.is_file() else _plain_tree(rng)
    places_m, radius_m, direction = sample_axes(skeleton, 0.01)
    chosen = rng.choice(len(places_m), count, p=radius_m / radius_m.sum())
    side = np.cross(direction, rng.normal(size=3))
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    other = np.cross(direction, side)
    turn = rng.uniform(0, 2 * np.pi, count)[:, None]
    around = np.cos(turn) * side[chosen] + np.sin(turn) * other[chosen]
    along = rng.uniform(-0.005, 0.005, count)[:, None] * direction[chosen]
    return places_m[chosen] + along + radius_m[chosen, None] * around + rng.normal(0, NOISE_M, (count, 3))


def _plain_tree(rng: np.random.Generator) -> Skeleton:
    """A trunk of 6 m with 60 branches of 10 twigs each."""
    points, radii, parent, vertex, order = (
        [np.linspace([0, 0, 0], [0, 6, 0], 61)],
        [np.linspace(0.15, 0.02, 61)],
        [-1],
        [-1],
        [0],
    )
    for above, count, length, share in ((0, 60, 2.0, 0.4), (1, 600, 0.5, 0.4)):
        carriers = [number for number, each in enumerate(order) if each == above]
        firsts = np.cumsum([0, *(len(each) for each in points)])
        for k in range(count):
            carrier = carriers[k % len(carriers)]
            at = int(rng.integers(len(points[carrier]) // 4, len(points[carrier])))
            direction = rng.normal([0, 0.5, 0])
            start = points[carrier][at]
            points.append(np.linspace(start, start + length * direction / np.linalg.norm(direction), 21))
            radii.append(np.linspace(1, 0.3, 21) * share * radii[carrier][at])
            parent.append(carrier)
            vertex.append(int(firsts[carrier]) + at)
            order.append(above + 1)
    return Skeleton(
        points_m=np.concatenate(points),
        radius_m=np.concatenate(radii),
        counts=np.array([len(each) for each in points], np.int32),
        parent_curve=np.array(parent, np.int32),
        parent_vertex=np.array(vertex, np.int32),
        order=np.array(order, np.int32),
    )


def measure_cost(count: int, truth_file: Path, settings: BranchCageSettings) -> dict[str, float]:
    """Seconds and memory of this process at so many points."""
    points_m = tree_points(count, truth_file)
    before = _cpu_seconds()
    start = time.perf_counter()
    skeleton = reconstruct_branches(points_m, np.zeros((1, 3))).skeleton
    traced, middle = _cpu_seconds(), time.perf_counter()
    cage = build_branch_cage(skeleton, settings)
    return {
        "branches": len(skeleton),
        "faces": len(cage.faces),
        "skeleton s": middle - start,
        "surface s": time.perf_counter() - middle,
        "skeleton cpu s": traced - before,
        "surface cpu s": _cpu_seconds() - traced,
        "peak GiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2,
    }


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime
