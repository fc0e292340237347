#!/usr/bin/env python3
"""How far the confidence of leaves can be trusted, and the weights that make it so.

usage: tools/calibrate_confidence.py [CAPTURE ...] [--depths estimated depth depth_noisy] [--fit]

Of every capture with truth/leaves.npz, leaves are found by the method dense with each kind of depth that it has;
`estimated` is depth of the photographs alone, without isolation. Printed are the expected calibration error (how far
the share of right leaves is off the confidence, in ten bins), and the probability that a right leaf has more confidence
than a wrong one. With --fit the weights of leaf/segmentation/dense/pool.py are learned of all proposals and printed,
with what they reach on these. Without captures some are made: other seeds, species and light than those of the tests.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from usdfoliage.capture.folder.read import read_capture, read_views, without_depth
from usdfoliage.capture.mvs.rounds import estimate_depths
from usdfoliage.capture.mvs.upsampling import enlarge_depth
from usdfoliage.capture.view import View
from usdfoliage.leaf.reconstruct import reconstruct_leaves
from usdfoliage.leaf.segmentation.dense.choice import measure_pool
from usdfoliage.leaf.segmentation.dense.pool import WEIGHTS, ProposalFacts, rate_proposals
from usdfoliage.leaf.segmentation.dense.segment import propose_in_passes
from usdfoliage.leaf.segmentation.dense.settings import DenseSegmentationSettings

from tools.bench.leaf_truth import match_leaves, nearest_distances, read_true_leaves
from tools.synthetic.scene import SceneSettings
from tools.synthetic_foliage import CaptureSettings, make_capture, write_capture

DEPTHS = ("estimated", "depth", "depth_noisy")
BINS = 10
RIDGE = 1e-3  # of weights, in deviations of what they weigh
MADE = (
    SceneSettings(leaves=150, views=8, width_px=800, height_px=600, seed=11, relief=1.0, sizes=0.4),
    SceneSettings(
        leaves=120, views=10, width_px=800, height_px=600, seed=12, width=0.6, length_m=0.05, wall=False, relief=1.5,
        sizes=0.2,
    ),
    SceneSettings(
        leaves=150, views=6, width_px=900, height_px=600, seed=13, width=1.4, variation=1.5, relief=1.0, sizes=0.5
    ),
    SceneSettings(
        leaves=180, views=8, width_px=700, height_px=525, seed=14, width=0.8, variation=1.3, relief=2.0, sizes=0.3
    ),
)  # fmt: skip
# Of a match the limit is 0.08; a stricter one puts the nearest of the proposals of one leaf first.
RIGHT_PROPOSAL = 0.06
PROPOSAL_FACTS = tuple(WEIGHTS)

Array = NDArray[np.float64]


def calibration_error(confidence: Array, right: NDArray[np.bool_]) -> float:
    """The mean over leaves (N,) of how far confidence and share of right leaves differ in the leaf's bin."""
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    parts = [(bins == one) for one in np.unique(bins)]
    return float(sum(abs(confidence[part].mean() - right[part].mean()) * part.mean() for part in parts))


def ranking(confidence: Array, right: NDArray[np.bool_]) -> float:
    """The probability that a right leaf has more confidence than a wrong one; NaN where there is only one kind."""
    if right.all() or not right.any():
        return np.nan
    order = np.argsort(confidence, kind="stable")
    _, first, counts = np.unique(confidence[order], return_index=True, return_counts=True)
    ranks = np.empty(len(confidence))
    ranks[order] = np.repeat(first + (counts + 1) / 2, counts)  # equal confidence shares its rank
    yes = np.count_nonzero(right)
    return float((ranks[right].sum() - yes * (yes + 1) / 2) / (yes * (len(right) - yes)))


def views_with(capture: Path, depth: str) -> list[View]:
    """The views of a capture with this kind of depth; none where it has none."""
    if depth != "estimated":
        return list(read_views(read_capture(capture, depth=depth)).views) if (capture / depth).is_dir() else []
    bare = list(read_views(without_depth(read_capture(capture))).views)
    found = estimate_depths(bare)
    return [
        view if one is None else replace(view, depth_m=enlarge_depth(one, view.camera).depth_m)
        for view, one in zip(bare, found, strict=True)
    ]


def rated_leaves(captures: list[Path], depths: list[str]) -> Iterator[tuple[str, Array, NDArray[np.bool_]]]:
    """The confidence of the leaves that are found in each capture, and which of them are right."""
    for capture in captures:
        truth = read_true_leaves(capture)
        for depth in depths:
            views = views_with(capture, depth)
            leaves = reconstruct_leaves(views).leaves if views else None
            if leaves is not None and leaves.confidence is not None and len(leaves):
                right = np.zeros(len(leaves), bool)
                right[match_leaves(truth, leaves).found] = True
                yield f"{capture.name} {depth}", leaves.confidence, right


def rated_proposals(captures: list[Path], depths: list[str]) -> Iterator[tuple[str, ProposalFacts, NDArray[np.bool_]]]:
    """What the proposals of each capture are rated by, and which of them are right."""
    settings = DenseSegmentationSettings()
    for capture in captures:
        truth = read_true_leaves(capture)
        for depth in depths:
            views = views_with(capture, depth)
            used = [index for index, view in enumerate(views) if view.has_depth]
            pool = propose_in_passes(views, used, settings, lambda: None, 0).pool if used else None
            if pool is not None:
                facts, _ = measure_pool(pool, settings, 0)
                right = nearest_distances(truth, pool.proposals.leaves) <= RIGHT_PROPOSAL
                yield f"{capture.name} {depth}", facts, right


def learn_weights(
    facts: Sequence[ProposalFacts],
    right: NDArray[np.bool_],
    names: Sequence[str],
    share: Array | None = None,
) -> tuple[float, dict[str, float]]:
    """Offset and weights of these facts under which the leaves (N,) are the most probable.

    Args:
        share: (N,), how much each leaf counts; all count as much by default.
    """
    columns = np.column_stack([np.concatenate([getattr(one, name) for one in facts]) for name in names])
    counted = np.ones(len(right)) if share is None else share / share.mean()
    middle, spread = columns.mean(axis=0), columns.std(axis=0) + 1e-9
    columns = (columns - middle) / spread

    def cost(weights: Array) -> float:
        odds = weights[0] + columns @ weights[1:]
        return float(np.mean(counted * (np.logaddexp(0, odds) - right * odds)) + RIDGE * np.square(weights[1:]).sum())

    found = minimize(cost, np.zeros(1 + len(names)), method="BFGS").x
    weights = found[1:] / spread
    return float(found[0] - weights @ middle), {
        name: float(weight) for name, weight in zip(names, weights, strict=True)
    }


def make_captures(folder: Path) -> list[Path]:
    captures = []
    for number, scene in enumerate(MADE):
        captures.append(folder / f"made_{number}")
        write_capture(captures[-1], make_capture(CaptureSettings(scene=scene)))
    return captures


def fit_pool(captures: list[Path], depths: list[str]) -> None:
    """Learn the weights of proposals, every capture and depth counting as much as any other, and print them."""
    found = list(rated_proposals(captures, depths))
    right = np.concatenate([each for *_, each in found])
    share = np.concatenate([np.full(len(each), 1 / len(each)) for *_, each in found])
    offset, weights = learn_weights([facts for _, facts, _ in found], right, PROPOSAL_FACTS, share)
    print(f"OFFSET = {offset:.3f}\nWEIGHTS = " + repr({name: round(value, 3) for name, value in weights.items()}))
    print("capture | proposals | right | probability | error | ranking")
    for name, facts, yes in found:
        rated = rate_proposals(facts, offset, weights)
        error, rank = calibration_error(rated, yes), ranking(rated, yes)
        print(f"{name} | {len(yes)} | {yes.mean():.3f} | {rated.mean():.3f} | {error:.3f} | {rank:.3f}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", metavar="CAPTURE", type=Path, nargs="*")
    parser.add_argument("--depths", nargs="+", choices=DEPTHS, default=list(DEPTHS))
    parser.add_argument("--fit", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        captures = options.captures or make_captures(Path(folder))
        if options.fit:
            fit_pool(captures, options.depths)
            return 0
        found = list(rated_leaves(captures, options.depths))
    if not found:
        parser.error("no leaf was found in any capture")
    print("capture | leaves | right | confidence | error | ranking")
    for name, confidence, yes in found:
        error, rank = calibration_error(confidence, yes), ranking(confidence, yes)
        print(f"{name} | {len(yes)} | {yes.mean():.3f} | {confidence.mean():.3f} | {error:.3f} | {rank:.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
