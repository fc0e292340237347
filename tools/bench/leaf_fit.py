#!/usr/bin/env python3
"""Time the fits of leaves: alternating, the same with scipy's Levenberg-Marquardt, and by closest places, in one run.

usage: tools/bench/leaf_fit.py [--leaves 300] [--points 1000] [--edge-points 200] [--peer-leaves 12] [--repeats 5]

Leaves of one plant are sampled evenly, with 0.3 % of their length of noise, some of them with an end or a side hidden.
The fit by closest places, that of the dense method, is also given points of the silhouette that is not hidden, as its
segmentation finds them; its time is that of the whole fit, with samples, first poses and what is learned of the set.
Times are cpu milliseconds a leaf, on one thread, best of the repeats, so that other work on the machine counts little;
those of the peer are of fewer leaves, once. Distances are mean symmetric ones between fitted and true surface, in per
cent of the leaf's length. Exit 1 if a target is missed.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.fit.alternating import AlternatingFitSettings, fit_leaves_alternating
from usdfoliage.leaf.fit.model import FittedLeaves
from usdfoliage.leaf.fit.surface import fit_leaves_to_surface
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.points import FREE_EDGE, INTERIOR, LeafPoints
from usdfoliage.leaf.shape.surface import evaluate_normals
from usdfoliage.leaf.shape.variation import vary_leaves

from tests.support.leaves import clouds, fit_reference

MAX_MS = 5.0  # a leaf and core
MIN_RATIO = 20.0  # the peer's time over ours
MAX_WORSE = 1.02  # our distance over the peer's
NOISE = 0.003

Keep = Callable[[np.ndarray, np.ndarray], np.ndarray]

HIDDEN: dict[str, Keep | None] = {
    "whole": None,
    "a third of the length hidden": lambda u, v: v < 0.67,
    "a corner hidden": lambda u, v: (u < 0.1) | (v < 0.4),
}


def cpu_ms(run: Callable[[], object], leaves: int, repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return 1e3 * min(times) / leaves


def fit_with_peer(points: LeafPoints) -> tuple[Leaves, float]:
    """The leaves by the reference, and its iterations each."""
    fits = []
    for begin, end in zip(points.offsets[:-1], points.offsets[1:], strict=True):
        fits.append(fit_reference.fit_leaf(points.points_m[begin:end], points.normals[begin:end]))
    leaves = Leaves(
        parameters=np.array([fit.parameters for fit in fits]),
        base_m=np.array([fit.base for fit in fits]),
        orientation=Rotation.from_matrix([fit.axes.T for fit in fits]).as_quat(),
        length_m=np.array([fit.length for fit in fits]),
        phase=np.zeros(len(fits)),
    )
    return leaves, float(np.mean([fit.iterations for fit in fits]))


def with_silhouettes(
    truth: np.ndarray,
    sampled: list[tuple[np.ndarray, np.ndarray]],
    count: int,
    rng: np.random.Generator,
    keep: Keep | None,
) -> LeafPoints:
    """What is sampled of the leaves, and points of their silhouettes, evenly along v, that are of the edge."""
    joined, kinds = [], []
    for leaf, (points, normals) in zip(truth, sampled, strict=True):
        uv = np.column_stack([np.resize((-1.0, 1.0), count), rng.uniform(size=count)])
        if keep is not None:
            uv = uv[keep(*uv.T)]
        edge, edge_normals = (each[0] for each in evaluate_normals(leaf[None], uv))
        edge = edge + NOISE * rng.normal(size=edge.shape)
        joined.append((np.concatenate([points, edge]), np.concatenate([normals, edge_normals])))
        kinds.append(np.repeat([INTERIOR, FREE_EDGE], [len(points), len(edge)]))
    points = clouds.leaf_points(*zip(*joined, strict=True))
    return replace(points, kind=np.concatenate(kinds).astype(np.uint8))


def in_order(fitted: FittedLeaves, count: int) -> Leaves:
    if fitted.source.tolist() != list(range(count)):
        raise SystemExit(f"{len(fitted.source)} of {count} leaves were fitted: {fitted.dropped}")
    return fitted.leaves


def report(name: str, ms: float, truth: np.ndarray, leaves: Leaves) -> float:
    distances = 100 * clouds.surface_distances(truth, leaves)
    mean, worst, length = distances.mean(), distances.max(), leaves.length_m.mean()
    print(f"{name:<44}{ms:10.2f}{mean:10.3f}{worst:10.3f}{length:10.3f}", flush=True)
    return float(mean)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--leaves", type=int, default=300)
    parser.add_argument("--points", type=int, default=1000)
    parser.add_argument("--edge-points", type=int, default=200)
    parser.add_argument("--peer-leaves", type=int, default=12)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()

    rng = np.random.default_rng(0)
    truth = vary_leaves(options.leaves, rng)
    few = truth[: options.peer_leaves]
    plain = AlternatingFitSettings(robustness="none")  # what the peer does
    missed = []
    print(f"{options.leaves} leaves of {options.points} points, one thread; the peer {len(few)} of them")
    print(f"{'':<44}{'cpu ms':>10}{'mean %':>10}{'worst %':>10}{'length':>10}")
    for name, keep in HIDDEN.items():
        sampled = [clouds.surface_points(leaf, options.points, rng, keep, NOISE) for leaf in truth]
        points = clouds.leaf_points(*zip(*sampled, strict=True))
        outlined = with_silhouettes(truth, sampled, options.edge_points, rng, keep)
        some = clouds.leaf_points(*zip(*sampled[: len(few)], strict=True))
        ms = cpu_ms(lambda points=points: fit_leaves_alternating(points, threads=1), len(truth), options.repeats)
        report(f"{name}: ours", ms, truth, fit_leaves_alternating(points).leaves)
        plain_ms = cpu_ms(lambda points=points: fit_leaves_alternating(points, plain, threads=1), len(truth), 2)
        ours = report(f"{name}: ours without weights", plain_ms, few, fit_leaves_alternating(some, plain).leaves)
        start = time.process_time()
        peer, iterations = fit_with_peer(some)
        peer_ms = 1e3 * (time.process_time() - start) / len(few)
        theirs = report(f"{name}: scipy, {iterations:.1f} turns", peer_ms, few, peer)
        print(f"{'':<44}{peer_ms / ms:10.1f} × (without weights {peer_ms / plain_ms:.1f} ×)")
        closest_ms = cpu_ms(
            lambda points=outlined: fit_leaves_to_surface(points, threads=1), len(truth), options.repeats
        )
        closest = in_order(fit_leaves_to_surface(outlined), len(truth))
        report(f"{name}: by closest places", closest_ms, truth, closest)
        for fit, cost in (("alternating", ms), ("by closest places", closest_ms)):
            if cost > MAX_MS:
                missed.append(f"{name}: {fit} {cost:.2f} ms a leaf, {MAX_MS:g} allowed")
        if peer_ms < MIN_RATIO * ms:
            missed.append(f"{name}: {peer_ms / ms:.1f} × the peer's speed, {MIN_RATIO:g} needed")
        if ours > MAX_WORSE * theirs:
            missed.append(f"{name}: {ours:.3f} % from the truth, the peer {theirs:.3f} %")
    for miss in missed:
        print(f"target missed: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
