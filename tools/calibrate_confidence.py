#!/usr/bin/env python3
"""How far the confidence of leaves can be trusted, and the weights that make it so.

usage: tools/calibrate_confidence.py [CAPTURE ...] [--depths estimated depth depth_noisy] [--fit]

Of every capture with truth/leaves.npz, leaves are found by the method dense with each kind of depth that it has;
`estimated` is depth of the photographs alone, without isolation. Printed are the expected calibration error (how far
the share of right leaves is off the confidence, in ten bins), and the probability that a right leaf has more confidence
than a wrong one. With --fit the weights of leaf/confidence.py are learned of all these leaves, and printed with what
they reach. Without captures some are made: other seeds, species and light than those of the tests.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from usdfoliage.capture.folder.read import read_capture, read_views, without_depth
from usdfoliage.capture.mvs.rounds import estimate_depths
from usdfoliage.capture.mvs.upsampling import enlarge_depth
from usdfoliage.capture.view import View
from usdfoliage.leaf.confidence import WEIGHTS, ConfidenceFacts, rate_leaves
from usdfoliage.leaf.reconstruct import ReconstructionSettings, reconstruct_leaves

from tools.bench.leaf_truth import match_leaves, read_true_leaves
from tools.synthetic.scene import SceneSettings
from tools.synthetic_foliage import CaptureSettings, make_capture, write_capture

DEPTHS = ("estimated", "depth", "depth_noisy")
BINS = 10
RIDGE = 1e-3  # of weights, in deviations of what they weigh
MADE = (
    SceneSettings(leaves=150, views=8, width_px=800, height_px=600, seed=11),
    SceneSettings(leaves=120, views=10, width_px=800, height_px=600, seed=12, width=0.6, length_m=0.05, wall=False),
    SceneSettings(leaves=150, views=6, width_px=900, height_px=600, seed=13, width=1.4, variation=1.5),
)

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
    yes, no = confidence[right][:, None], confidence[~right]
    return float(np.mean((yes > no) + 0.5 * (yes == no)))


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


def rated_leaves(captures: list[Path], depths: list[str]) -> Iterator[tuple[str, ConfidenceFacts, NDArray[np.bool_]]]:
    """What the leaves of each capture are rated by, and which of them are right."""
    for capture in captures:
        truth = read_true_leaves(capture)
        for depth in depths:
            views = views_with(capture, depth)
            made = reconstruct_leaves(views, ReconstructionSettings(min_confidence=0.0)) if views else None
            if made is not None and made.facts is not None:
                right = np.zeros(len(made.leaves), bool)
                right[match_leaves(truth, made.leaves).found] = True
                yield f"{capture.name} {depth}", made.facts, right


def learn_weights(facts: list[ConfidenceFacts], right: NDArray[np.bool_]) -> tuple[float, dict[str, float]]:
    """Offset and weights under which the leaves (N,) are the most probable."""
    columns = np.column_stack([np.concatenate([getattr(one, name) for one in facts]) for name in WEIGHTS])
    spread = columns.std(axis=0) + 1e-9

    def cost(weights: Array) -> float:
        odds = weights[0] + columns @ weights[1:]
        return float(np.mean(np.logaddexp(0, odds) - right * odds) + RIDGE * np.square(weights[1:] * spread).sum())

    found = minimize(cost, np.zeros(1 + len(WEIGHTS)), method="BFGS").x
    return float(found[0]), {name: float(weight) for name, weight in zip(WEIGHTS, found[1:], strict=True)}


def make_captures(folder: Path) -> list[Path]:
    captures = []
    for number, scene in enumerate(MADE):
        captures.append(folder / f"made_{number}")
        write_capture(captures[-1], make_capture(CaptureSettings(scene=scene)))
    return captures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", metavar="CAPTURE", type=Path, nargs="*")
    parser.add_argument("--depths", nargs="+", choices=DEPTHS, default=list(DEPTHS))
    parser.add_argument("--fit", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        captures = options.captures or make_captures(Path(folder))
        found = list(rated_leaves(captures, options.depths))
    if not found:
        parser.error("no leaf was found in any capture")
    weights: list[tuple[float, dict[str, float]] | None] = [None]
    if options.fit:
        offset, learned = learn_weights(
            [facts for _, facts, _ in found], np.concatenate([right for *_, right in found])
        )
        print(f"offset {offset:.2f}, " + ", ".join(f"{name} {weight:.2f}" for name, weight in learned.items()))
        weights.append((offset, learned))
    for chosen in weights:
        print("as it is" if chosen is None else "as learned", "| leaves | right | confidence | error | ranking")
        for name, facts, right in found:
            confidence = rate_leaves(facts) if chosen is None else rate_leaves(facts, *chosen)
            error, rank = calibration_error(confidence, right), ranking(confidence, right)
            print(f"{name} | {len(right)} | {right.mean():.3f} | {confidence.mean():.3f} | {error:.3f} | {rank:.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
