#!/usr/bin/env python3
"""Time leaves: their evaluation natively and in plain numpy, in one run.

usage: tools/bench/leaf.py [--leaves 100000] [--threads 2] [--repeats 5]

Wall is the best of the repeats, with the median beside it; cpu is that of all threads, best of the repeats: the
better measure on a machine that is busy with other things. Ratios are numpy's over the native one's.
Exit 1 if 100,000 leaves miss a target.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np
from usdfoliage.leaf.shape.bounds import common_bounds, leaf_bounds
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.jitter import Jitter, spread_phases
from usdfoliage.leaf.shape.measures import leaf_area
from usdfoliage.leaf.shape.surface import (
    evaluate_grid,
    evaluate_jacobian,
    evaluate_normals,
    evaluate_points,
    grid_places,
)
from usdfoliage.leaf.shape.variation import vary_leaves

from tests.support.leaves import reference

MAX_SECONDS = 0.3  # for the points of 100,000 leaves
MIN_RATIO = 10.0  # numpy's time over ours
TARGET_LEAVES = 100_000

U, V = np.linspace(-1, 1, 9), np.linspace(0, 1, 9)


@dataclass(frozen=True)
class Timing:
    wall: float
    wall_median: float
    cpu: float


def measure(run: Callable[[], object], repeats: int) -> Timing:
    walls, cpus = [], []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        run()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return Timing(min(walls), median(walls), min(cpus))


def report(name: str, timing: Timing, reference: Timing | None = None) -> None:
    row = f"{name:<44}{timing.wall:9.3f}{timing.wall_median:9.3f}{timing.cpu:9.3f}"
    if reference is not None:
        row += f"{reference.wall / timing.wall:9.1f}{reference.cpu / timing.cpu:9.1f}"
    print(row, flush=True)


def bench_points(leaves: np.ndarray, threads: int, repeats: int) -> list[str]:
    """Points of all leaves on a 9 x 9 grid; returns the targets that were missed."""
    missed = []
    plain = measure(lambda: reference.evaluate_grid_points(leaves, U, V), 2)
    report("points, numpy", plain)
    uv = grid_places(U, V)
    for dtype in (np.float64, np.float32):
        run = measure(lambda dtype=dtype: evaluate_points(leaves, uv, dtype=dtype, threads=threads), repeats)
        report(f"points, {dtype.__name__}", run, plain)
        if len(leaves) == TARGET_LEAVES and (run.wall > MAX_SECONDS or plain.wall < MIN_RATIO * run.wall):
            ratio = plain.wall / run.wall
            missed.append(f"{dtype.__name__}: {run.wall:.3f} s ({MAX_SECONDS:g}), {ratio:.1f} × numpy ({MIN_RATIO:g})")
    jitter, phase = Jitter(amplitude=0.02), spread_phases(len(leaves))
    report(
        "points with jitter, float64",
        measure(lambda: evaluate_points(leaves, uv, jitter, phase, threads=threads), repeats),
    )
    matrices = np.tile(np.eye(3, 4), (len(leaves), 1, 1))
    placed = measure(
        lambda: evaluate_points(leaves, uv, placements=matrices, dtype=np.float32, threads=threads), repeats
    )
    report("points in the asset's frame, float32", placed)
    return missed


def bench_normals(leaves: np.ndarray, threads: int, repeats: int) -> None:
    """Points and normals, then tangents too."""
    plain = measure(lambda: reference.evaluate_grid(leaves, U, V), 1)
    report("points, tangents and normals, numpy", plain)
    report(
        "points, tangents and normals, float64",
        measure(lambda: evaluate_grid(leaves, U, V, threads=threads), repeats),
        plain,
    )
    uv = grid_places(U, V)
    for dtype in (np.float64, np.float32):
        run = measure(lambda dtype=dtype: evaluate_normals(leaves, uv, dtype=dtype, threads=threads), repeats)
        report(f"points and normals, {dtype.__name__}", run)


def bench_jacobian(leaves: np.ndarray, threads: int, repeats: int) -> None:
    """Derivatives by the 21 parameters of a hundredth of the leaves, at 500 places each."""
    some = leaves[: max(1, len(leaves) // 100)]
    uv = np.random.default_rng(1).uniform((-1, 0), (1, 1), (len(some), 500, 2))
    plain = measure(lambda: reference.evaluate_jacobian(some, uv), 1)
    report(f"derivatives, {len(some)} × 500, numpy", plain)
    run = measure(lambda: evaluate_jacobian(some, uv, threads=threads), repeats)
    report(f"derivatives, {len(some)} × 500, float64", run, plain)
    print(f"{'':<44}{len(some) * 500 / run.wall / 1e6:9.1f} million places a second")


def bench_boxes_and_measures(leaves: np.ndarray, threads: int, repeats: int) -> None:
    """What a writer and a validator ask of every leaf."""
    report("box of each leaf", measure(lambda: leaf_bounds(leaves, threads=threads), repeats))
    report("box of all leaves", measure(lambda: common_bounds(leaves, threads=threads), repeats))
    report("area of each leaf", measure(lambda: leaf_area(leaves), 2))
    report("folds of each leaf", measure(lambda: find_folds(leaves), 2))


OTHERS = (bench_normals, bench_jacobian, bench_boxes_and_measures)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--leaves", type=int, default=100_000)
    parser.add_argument("--threads", type=int, default=2, help="of the native functions")
    parser.add_argument("--repeats", type=int, default=5, help="of the native functions")
    options = parser.parse_args()

    leaves = vary_leaves(options.leaves, np.random.default_rng(0))
    print(f"{options.leaves} leaves at {len(U)} × {len(V)}, {options.threads} threads")
    print(f"{'':<44}{'wall s':>9}{'median':>9}{'cpu s':>9}{'ratio':>9}{'cpu':>9}")
    missed = bench_points(leaves, options.threads, options.repeats)
    for bench in OTHERS:
        bench(leaves, options.threads, options.repeats)
    for miss in missed:
        print(f"target missed: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
