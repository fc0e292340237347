#!/usr/bin/env python3
"""Branches out of clouds: against true skeletons, against other tools on real trees, against what was measured there.

usage: tools/bench/branches.py [--only synthetic|real|measured|scaling …]

synthetic  Recall, by order too, precision, radii, length and ancestry against the true skeletons of
           ../shared/data/synthetic/tree_leaf_off and tree_leaf_on (branch_truth.py), beside them a minimum spanning
           tree's, and the similarity S_T (branch_similarity.py).
real       Every cloud of ../shared/data/cloud-*: branches, distances between scan and surface both ways, AdTree's
           beside them, seconds, and whether the cage is sound.
measured   Trunk diameters, heights, lengths and volumes that come with those clouds, against ours.
scaling    Seconds and memory at 50,000 to 2,000,000 points, each in a process of its own.

What is read is what `usdfoliage branches` would read. Tables are Markdown.
"""

import argparse
import csv
import json
import logging
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from usdfoliage.branch.cage.build import BranchCage, build_branch_cage, check_cage
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.reconstruct import TracedBranches, reconstruct_branches
from usdfoliage.branch.tracing.roots import RootSettings
from usdfoliage.jobs.branches.surfaces import CAGE
from usdfoliage.jobs.plant_cloud import PlantCloud, PlantCloudRequest, read_plant_cloud

from tools.bench.branch_cost import measure_cost
from tools.bench.branch_similarity import compare_trees
from tools.bench.branch_surface import cone_volume, diameter_at, limit_surface, measure_surface, radius_deviations
from tools.bench.branch_truth import ORDERS, read_true_skeleton, score_skeleton, spanning_skeleton

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
PARTS = ("synthetic", "real", "measured", "scaling")
SYNTHETIC = ("tree_leaf_off", "tree_leaf_on")
WOOD = 1  # label of a simulated scan
COUNTS = (50_000, 100_000, 200_000, 400_000, 1_000_000, 2_000_000)

# AdTree (commit c140430, GPL, measured elsewhere with the same measure): scan to mesh and mesh to scan, mean metres.
ADTREE = {
    "cloud-adtree/Lille_2": (0.0387, 0.0765),
    "cloud-adtree/Paris_Luxembourg_1": (0.0240, 0.0396),
    "cloud-adtree/tree33": (0.0339, 0.0731),
    "cloud-adtree/tree7": (0.0174, 0.0449),
    "cloud-amsterdam-street-tree/airborne_tree_121913_487434": (0.0426, 0.1196),
    "cloud-amsterdam-street-tree/stem_121913_487434": (0.0117, 0.0390),
    "cloud-archi/tree_1": (0.0379, 0.0734),
    "cloud-itsme/buttressed_tree_1": (0.0333, 0.0437),
    "cloud-itsme/tree_1": (0.1048, 0.2320),
    "cloud-rtwig/tree": (0.0041, 0.0092),
    "cloud-treels/pine": (0.0824, 0.1962),
}


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What is known of a tree: in metres and cubic metres; what is not known is None."""

    source: str
    diameter: float | None = None  # 1.3 m over the ground
    height: float | None = None
    length: float | None = None
    volume: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A cloud, and the branches that were found in it."""

    plant: PlantCloud
    traced: TracedBranches
    cage: BranchCage
    trace_s: float
    surface_s: float

    @property
    def skeleton(self) -> Skeleton:
        return self.traced.skeleton


def read_plant(cloud: Path, up: str | None = "Z") -> PlantCloud:
    return read_plant_cloud(PlantCloudRequest(path=cloud, roots=RootSettings(), up=up))


def run(plant: PlantCloud) -> Run:
    start = time.perf_counter()
    traced = reconstruct_branches(plant.points_m, plant.roots_m, colors=plant.colors)
    middle = time.perf_counter()
    cage = build_branch_cage(traced.skeleton, CAGE)
    end = time.perf_counter()
    return Run(plant=plant, traced=traced, cage=cage, trace_s=middle - start, surface_s=end - middle)


def whole_cloud(plant: PlantCloud) -> NDArray[np.float64]:
    """(N, 3) all points of a cloud, its ground too, where the branches are."""
    turn, shift = plant.asset_from_cloud[:3, :3], plant.asset_from_cloud[:3, 3]
    scale = plant.source.metres_per_unit
    return (plant.source.points_m + plant.source.origin_m) / scale @ turn.T + shift


def print_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    for row in (head, ["---"] * len(head), *rows):
        print(f"| {' | '.join(row)} |", flush=True)


def bench_synthetic() -> None:
    """Against true skeletons."""
    head = ["tree", "points", "skeleton", "recall", "r > 5 mm", *(f"order {k}" for k in range(ORDERS)), "precision"]
    head += ["radius error", "length ratio", "ancestry", "S_T", "shape / geometry / structure"]
    rows = []
    for name in SYNTHETIC:
        folder = DATA / "synthetic" / name
        if not (folder / "truth" / "skeleton.json").is_file():
            print(f"{name}: not measured, {folder} is not there")
            continue
        true = read_true_skeleton(folder / "truth" / "skeleton.json")
        label = np.load(folder / "truth" / "scan_labels.npz")["label"]
        whole = read_plant(folder / "scan.ply")
        points_m = whole_cloud(whole)
        wood_m = points_m[label == WOOD] if len(label) == len(points_m) else None
        origin_m = whole.asset_from_cloud[:3, 3]  # the truth is in the scan's frame
        for what, cloud_m in (("scan", whole.points_m), ("its wood", wood_m)):
            if cloud_m is None:
                continue
            traced = reconstruct_branches(cloud_m, whole.roots_m).skeleton
            floor = spanning_skeleton(cloud_m, whole.roots_m[0], float(traced.radius_m[0]))
            for tool, found in (("ours", traced), ("spanning tree", floor)):
                moved = Skeleton(
                    points_m=found.points_m - origin_m,
                    radius_m=found.radius_m,
                    counts=found.counts,
                    parent_curve=found.parent_curve,
                    parent_vertex=found.parent_vertex,
                    order=found.order,
                )
                scores, similarity = score_skeleton(moved, true), compare_trees(moved, true)
                shares = [scores.recall, scores.recall_seen, *scores.recall_by_order, scores.precision]
                shares += [scores.radius_error, scores.length_ratio, scores.ancestry, similarity.total]
                three = f"{similarity.shape:.2f} / {similarity.geometry:.2f} / {similarity.structure:.2f}"
                rows.append([name, f"{what}, {len(cloud_m):,}", tool, *(f"{share:.3f}" for share in shares), three])
    if rows:
        print("\n### Simulated trees against their true skeletons\n")
        print_table(head, rows)


def real_clouds() -> list[tuple[str, Path]]:
    return [(f"{path.parent.name}/{path.stem}", path) for path in sorted(DATA.glob("cloud-*/*.ply"))]


def bench_real() -> None:
    """Real clouds, beside AdTree."""
    clouds = real_clouds()
    if not clouds:
        print(f"real trees: not measured, {DATA} has no cloud-*")
        return
    print("\n### Real trees; distances in metres, mean (standard deviation); AdTree's measured elsewhere\n")
    head = [
        "cloud",
        "points",
        "height m",
        "branches",
        "mean length m",
        "scan to mesh",
        "AdTree",
        "mesh to scan",
        "AdTree",
    ]
    head += ["skeleton + surface s", "cage", "left out", "off the skeleton's tube, of its radius: median, 95 %, most"]
    print_table(head, [])
    better = known = 0
    for name, path in clouds:
        plant = read_plant(path)
        found = run(plant)
        surface_m, quads = limit_surface(found.cage)
        away = measure_surface(surface_m, quads, whole_cloud(plant))
        off = radius_deviations(found.skeleton, found.cage, surface_m)
        peer = ADTREE.get(name)
        if peer:
            known += 1
            better += away.scan_to_mesh[0] < peer[0] and away.mesh_to_scan[0] < peer[1]
        row = [
            name.removeprefix("cloud-"),
            f"{len(plant.points_m):,}",
            f"{np.ptp(plant.points_m[:, 1]):.2f}",
            f"{len(found.skeleton):,}",
            f"{found.skeleton.lengths_m.mean():.3f}",
            f"{away.scan_to_mesh[0]:.4f} ({away.scan_to_mesh[1]:.4f})",
            f"{peer[0]:.4f}" if peer else "-",
            f"{away.mesh_to_scan[0]:.4f} ({away.mesh_to_scan[1]:.4f})",
            f"{peer[1]:.4f}" if peer else "-",
            f"{found.trace_s:.1f} + {found.surface_s:.1f}",
            "sound" if check_cage(found.cage).clean else "NOT SOUND",
            f"{len(found.cage.dropped)}",
            f"{np.median(off):.1%}, {np.quantile(off, 0.95):.1%}, {off.max():.0%}" if len(off) else "-",
        ]
        print(f"| {' | '.join(row)} |", flush=True)
    print(f"\nBoth distances below AdTree's on {better} of {known} clouds.")


def read_model(path: Path) -> Measured:
    """Totals of a published cylinder model; Z up."""
    with path.open(encoding="utf-8") as file:
        head = file.readline()
        rows = list(csv.reader(file))
    names = rows[0] if "start_x" in rows[0] else head.lstrip("# ").rsplit(". ", 1)[-1].strip().split(",")
    values = np.array(rows[1:] if "start_x" in rows[0] else rows, float)
    if "start_x" in names:
        radius, length = values[:, names.index("radius")], values[:, names.index("length")]
        start = values[:, names.index("start_x") : names.index("start_x") + 3]
        if "end_x" in names:
            end = values[:, names.index("end_x") : names.index("end_x") + 3]
        else:
            axis = values[:, names.index("axis_x") : names.index("axis_x") + 3]
            end = start + length[:, None] * axis
    else:  # radius, length, start, axis
        radius, length, start = values[:, 0], values[:, 1], values[:, 2:5]
        end = start + length[:, None] * values[:, 5:8]
    low = float(start[:, 2].min())
    level = (np.minimum(start[:, 2], end[:, 2]) <= low + 1.3) & (np.maximum(start[:, 2], end[:, 2]) >= low + 1.3)
    return Measured(
        source=path.stem,
        diameter=float(2 * radius[level].max()) if level.any() else None,
        height=float(max(start[:, 2].max(), end[:, 2].max()) - low),
        length=float(length.sum()),
        volume=float(np.pi * np.sum(radius**2 * length)),
    )


def known_measures(path: Path) -> list[Measured]:
    """What comes with a cloud: published cylinder models, and the values of its README."""
    models = [read_model(model) for model in sorted(path.parent.glob(f"{path.stem}_qsm*.csv"))]
    if path.stem.startswith("stem_121913"):
        models.append(Measured(source="published table", diameter=0.571))
    if path.stem.startswith("airborne_tree_121913"):
        models.append(Measured(source="published table", height=15.2))
    return models


def bench_measured() -> None:
    """Figures that come with the clouds."""
    rows = []
    for name, path in real_clouds():
        known = known_measures(path)
        if not known:
            continue
        plant = read_plant(path)
        skeleton = reconstruct_branches(plant.points_m, plant.roots_m, colors=plant.colors).skeleton
        ours = {
            "diameter": diameter_at(skeleton, 1.3),
            "height": float(np.ptp(skeleton.points_m[:, 1])),
            "length": float(skeleton.lengths_m.sum()),
            "volume": cone_volume(skeleton),
        }
        for model in known:
            cells = []
            for what, value in ours.items():
                theirs = getattr(model, what)
                cells.append("-" if theirs is None else f"{value:.3f} / {theirs:.3f} ({value / theirs - 1:+.0%})")
            rows.append([name.removeprefix("cloud-"), model.source, *cells])
    if not rows:
        print(f"measured trees: not measured, {DATA} has no cloud-*")
        return
    print("\n### Ours / what was measured there\n")
    print_table(["cloud", "by", "diameter at 1.3 m, m", "height m", "length of all branches m", "volume m³"], rows)


def bench_scaling(counts: Sequence[int]) -> None:
    """One tree in more and more points."""
    print("\n### Cost by points of one tree; wall seconds (processor seconds)\n")
    print_table(["points", "branches", "faces of the cage", "skeleton s", "surface s", "peak GiB"], [])
    for count in counts:
        command = [sys.executable, __file__, "--cost", str(count)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        cost = json.loads(done.stdout.splitlines()[-1])
        cells = [f"{count:,}", f"{cost['branches']:,}", f"{cost['faces']:,}"]
        cells += [f"{cost[f'{part} s']:.1f} ({cost[f'{part} cpu s']:.1f})" for part in ("skeleton", "surface")]
        cells.append(f"{cost['peak GiB']:.2f}")
        print(f"| {' | '.join(cells)} |", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts to run (all)")
    parser.add_argument("--counts", nargs="+", type=int, default=COUNTS, metavar="N", help="points of the scaling")
    parser.add_argument("--cost", type=int, metavar="N", help=argparse.SUPPRESS)
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    if options.cost:
        print(
            json.dumps(measure_cost(options.cost, DATA / "synthetic" / SYNTHETIC[0] / "truth" / "skeleton.json", CAGE))
        )
        return 0
    if "synthetic" in options.only:
        bench_synthetic()
    if "real" in options.only:
        bench_real()
    if "measured" in options.only:
        bench_measured()
    if "scaling" in options.only:
        bench_scaling(options.counts)
    return 0


if __name__ == "__main__":
    sys.exit(main())
