#!/usr/bin/env python3
"""Leaves out of scans alone: how many instances are right, on generated plants whose leaves are known.

usage: tools/bench/cloud_leaves.py [--seed 7] [--quick]

A found leaf is right where it shares at least half of all points that it or a true leaf has with that leaf. True leaves
of fewer than 20 points are left out: they are neither missed, nor is who finds them wrong.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.cloud_files.up_axis import find_cloud_up
from usdfoliage.geometry.up_turn import turn_to_y_up
from usdfoliage.jobs.plant_cloud import find_plant_ground
from usdfoliage.leaf.reconstruct_cloud import reconstruct_cloud_leaves

from tools.synthetic.scan import Scan, ScanSettings
from tools.synthetic.scanned_plants import BED, PLANT, TREE, ScannedPlant, scan_plant

TARGET_F1 = 0.85
TARGET_S = 60.0  # for FULL_POINTS
FULL_POINTS = 200_000
RIGHT = 0.5  # intersection over union
MIN_POINTS = 20  # of a true leaf that counts

PLANTS: Sequence[ScannedPlant] = (
    ScannedPlant(name="ovate", kind="ovate", leaves=120, points_a_leaf=250),
    ScannedPlant(name="ovate, 40 points a leaf", kind="ovate", leaves=160, points_a_leaf=40),
    ScannedPlant(name="ovate, 2,000 points a leaf", kind="ovate", leaves=60, points_a_leaf=2000),
    ScannedPlant(
        name="ovate, 2 mm noise", kind="ovate", leaves=120, points_a_leaf=250, scan=ScanSettings(noise_m=0.002)
    ),
    ScannedPlant(
        name="ovate, one side", kind="ovate", leaves=120, points_a_leaf=250, scan=ScanSettings(one_sided=True)
    ),
    ScannedPlant(
        name="ovate, a third noise", kind="ovate", leaves=120, points_a_leaf=250, scan=ScanSettings(clutter=1 / 3)
    ),
    ScannedPlant(name="opposite", kind="opposite", leaves=140, points_a_leaf=150, scan=ScanSettings(noise_m=0.0007)),
    ScannedPlant(name="lanceolate", kind="lanceolate", leaves=120, points_a_leaf=200),
    ScannedPlant(name="round", kind="round", leaves=140, points_a_leaf=120),
    ScannedPlant(name="rosette", kind="rosette", leaves=120, points_a_leaf=250),
    ScannedPlant(name="small", kind="small", leaves=160, points_a_leaf=150, scan=ScanSettings(noise_m=0.0005)),
    ScannedPlant(name="large", kind="large", leaves=90, points_a_leaf=400, scan=ScanSettings(noise_m=0.002)),
    ScannedPlant(name="whorled", kind="whorled", leaves=120, points_a_leaf=200),
    ScannedPlant(name="bed", kind=BED, leaves=150, points_a_leaf=200),
    ScannedPlant(name="plant", kind=PLANT, leaves=240, points_a_leaf=150),
    ScannedPlant(name="plant, 30 points a leaf", kind=PLANT, leaves=240, points_a_leaf=45),
    ScannedPlant(name="plant, with ground", kind=PLANT, leaves=240, points_a_leaf=150, ground=1.0),
    ScannedPlant(name="rosette, with ground", kind="rosette", leaves=120, points_a_leaf=250, ground=2.0),
    ScannedPlant(name="amid bare branches", kind=TREE, leaves=120, points_a_leaf=200, height_m=3.0),
)


@dataclass(frozen=True, kw_only=True)
class Instances:
    """How many leaves of a scan were found."""

    true: int
    found: int
    recall: float
    precision: float
    seconds: float
    points: int

    @property
    def f1(self) -> float:
        both = self.recall + self.precision
        return 2 * self.recall * self.precision / both if both > 0 else 0.0


def compare_instances(found: NDArray[np.int32], true: NDArray[np.int32]) -> tuple[int, int, float, float]:
    """True leaves that count, found ones that do, recall and precision.

    Args:
        found: (N,), number of the leaf, below 0 for none.
        true: (N,), likewise.
    """
    sizes = np.bincount(true[true >= 0], minlength=int(true.max(initial=-1)) + 1)
    found_sizes = np.bincount(found[found >= 0], minlength=int(found.max(initial=-1)) + 1)
    both = (true >= 0) & (found >= 0)
    pairs, shared = np.unique(np.column_stack([true[both], found[both]]), axis=0, return_counts=True)
    overlap = shared / (sizes[pairs[:, 0]] + found_sizes[pairs[:, 1]] - shared)
    right = pairs[overlap >= RIGHT]
    counts = sizes >= MIN_POINTS
    is_found = np.zeros(len(sizes), bool)
    is_found[right[:, 0]] = True
    is_right, is_small = np.zeros(len(found_sizes), bool), np.zeros(len(found_sizes), bool)
    is_right[right[counts[right[:, 0]], 1]] = True
    is_small[right[~counts[right[:, 0]], 1]] = True
    judged = ~is_small
    return (
        int(counts.sum()),
        int(judged.sum()),
        float(is_found[counts].mean()) if counts.any() else 1.0,
        float(is_right[judged].mean()) if judged.any() else 1.0,
    )


def measure_scan(scan: Scan) -> Instances:
    """Find the leaves of a scan and compare them with the truth."""
    start = time.perf_counter()
    turn = turn_to_y_up(find_cloud_up(scan.points_m, None, None).axis)
    kept = np.flatnonzero(~find_plant_ground(scan.points_m @ turn.T).ground.points)
    leaf = np.full(len(scan.points_m), -1, np.int32)
    leaf[kept] = reconstruct_cloud_leaves(scan.points_m[kept]).leaf
    seconds = time.perf_counter() - start
    true, found, recall, precision = compare_instances(leaf, scan.leaf)
    return Instances(
        true=true, found=found, recall=recall, precision=precision, seconds=seconds, points=len(scan.points_m)
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--quick", action="store_true", help="leave out the one that measures the time")
    options = parser.parse_args()
    plants = list(PLANTS)
    if not options.quick:
        plants.append(ScannedPlant(name="200,000 points", kind="ovate", leaves=800, points_a_leaf=225))
    print(f"{'scan':28} {'points':>8} {'leaves':>7} {'found':>6} {'recall':>7} {'precision':>9} {'F1':>6} {'s':>6}")
    misses = 0
    for number, plant in enumerate(plants):
        measured = measure_scan(scan_plant(replace(plant, seed=options.seed + 1000 * number)))
        slow = measured.points > 0.9 * FULL_POINTS and measured.seconds > TARGET_S
        misses += measured.f1 < TARGET_F1 or slow
        print(
            f"{plant.name:28} {measured.points:8,} {measured.true:7} {measured.found:6} {measured.recall:7.3f} "
            f"{measured.precision:9.3f} {measured.f1:6.3f} {measured.seconds:6.1f}",
            flush=True,
        )
    print(f"target: F1 {TARGET_F1:g} of each, {FULL_POINTS:,} points in {TARGET_S:g} s; {misses} missed")
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())
