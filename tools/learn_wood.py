#!/usr/bin/env python3
"""Learn by what sections of a leafy cloud are recognised as wood, from scans of generated trees, and write the weights.

usage: tools/learn_wood.py [--seed 500] [--trees 60] [-o WEIGHTS.toml]

Of each scan up to 6,000 sections, drawn at random from those that are on no stem, are compared with the true wood; a
section counts by its length along its path. Leaves are left out turn after turn by the odds of paths alone, so that
the weights do not depend on weights that were learned before. The trees are those of tools/synthetic/leafy_trees.py;
those whose points are too far apart to recognise leaves are left out.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from usdfoliage.branch.rooted_tree import step_lengths
from usdfoliage.branch.tracing.cloud_cut import cut_cloud, point_spacing, points_in_thick_branches, sections_on_stems
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.branch.tracing.wood import choose_wood, shows_leaves, wood_features, wood_odds
from usdfoliage.branch.tracing.wood_facts import wood_facts
from usdfoliage.geometry.point_cells import cell_means

from tools.learned_forms import format_form, learn_form
from tools.synthetic.leafy_trees import list_leafy_trees, scan_leafy_tree

OUTPUT = Path(__file__).parents[1] / "pipeline/usdfoliage/branch/tracing/wood_weights.toml"
TURNS = 4  # of leaving leaves out
SECTIONS = 6000  # of a scan, that are learned from
MAX_STEP = 8.0  # spacings of the points, that a section counts for at most

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Example:
    """Sections of one scan."""

    facts: Array  # (R, K)
    wood: Array  # (R,), share of their points that is of wood
    length: Array  # (R,), spacings


def make_example(points_m: Array, is_wood: NDArray[np.bool_], rng: np.random.Generator) -> Example | None:
    """Sections of all turns of the search for wood; None where points are too far apart for it."""
    settings = BranchSettings(leaves="on")
    spacing_m = point_spacing(points_m)
    if not shows_leaves(spacing_m, settings.wood):
        return None
    internode_m = settings.internode_of_height * float(np.ptp(points_m[:, 1]))
    root_m = np.zeros((1, 3))
    left = np.arange(len(points_m))
    cut = cut_cloud(points_m, root_m, internode_m, spacing_m, settings)
    sure = points_in_thick_branches(cut, settings)
    facts, wood, length = [], [], []
    for _ in range(TURNS):
        stems = sections_on_stems(cut)
        step = step_lengths(cut.sections.center_m, cut.sections.parent) / spacing_m
        share = cell_means(is_wood[left].astype(np.float64)[:, None], cut.sections.section)[:, 0]
        features = wood_features(points_m, cut.sections, cut.spacing_m)
        facts.append(wood_facts(points_m, cut.sections, cut.spacing_m, features)[~stems])
        wood.append(share[~stems])
        length.append(np.clip(step[~stems], 0.05, MAX_STEP))
        odds = wood_odds(features) + settings.wood.caution
        found = choose_wood(cut.sections, odds, stems, cut.spacing_m)
        kept = found.sections[cut.sections.section] | sure[left]
        if found.share >= settings.wood.settled or kept.sum() < 2:
            break
        left = left[kept]
        cut = cut_cloud(points_m[left], root_m, internode_m, point_spacing(points_m[left]) or spacing_m, settings)
    total = sum(map(len, wood))
    chosen = np.sort(rng.permutation(total)[:SECTIONS])
    return Example(
        facts=np.concatenate(facts)[chosen], wood=np.concatenate(wood)[chosen], length=np.concatenate(length)[chosen]
    )


def learn(seed: int, trees: int) -> str:
    """The text of wood_weights.toml."""
    examples = []
    for tree in list_leafy_trees(seed, trees):
        scan, _ = scan_leafy_tree(tree)
        example = make_example(scan.points_m, scan.leaf < 0, np.random.default_rng(tree.seed))
        count = f"{len(example.wood):,} sections" if example else "too few points"
        print(f"{tree.name}: {count}", file=sys.stderr, flush=True)
        if example:
            examples.append(example)
    facts, wood, length = ([getattr(each, name) for each in examples] for name in ("facts", "wood", "length"))
    return "# Written by tools/learn_wood.py.\n" + format_form("wood", learn_form(facts, wood, length))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=500)
    parser.add_argument("--trees", type=int, default=60)
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    if options.trees < 1:
        parser.error("--trees must be 1 or more")
    options.output.write_text(learn(options.seed, options.trees), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
