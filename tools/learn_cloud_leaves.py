#!/usr/bin/env python3
"""Learn by what regions of a cloud are recognised as leaves, of scans of generated plants, and write the weights.

usage: tools/learn_cloud_leaves.py [--seed 100] [--rounds 4] [-o WEIGHTS.toml]

Every region that the merging of points gives is compared with the true leaves; what it is worth rises with the share of
its points, and of the leaf's, that both have. The plants are those of tools/synthetic/scanned_plants.py.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from usdfoliage.leaf.segmentation.cloud.forms import RegionForms, measure_regions
from usdfoliage.leaf.segmentation.cloud.leafness import (
    MedianSize,
    choose_regions,
    list_facts,
    measure_median_size,
)
from usdfoliage.leaf.segmentation.cloud.merge_tree import MergeTree, link_points, merge_points
from usdfoliage.leaf.segmentation.cloud.settings import CloudSegmentationSettings
from usdfoliage.leaf.segmentation.cloud.working_cloud import WorkingCloud, prepare_cloud

from tools.learned_forms import format_form, learn_form
from tools.synthetic.scan import Scan
from tools.synthetic.scanned_plants import ScannedPlant, list_training, scan_plant

OUTPUT = Path(__file__).parents[1] / "pipeline/usdfoliage/leaf/segmentation/cloud/weights.toml"
WORTHLESS, WORTH_ALL = 0.35, 0.75  # intersection over union
MIN_LEAF = 8  # points of a true leaf that can be found

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Example:
    """The regions of one scan, and how far each is a true leaf."""

    forms: RegionForms
    tree: MergeTree
    overlap: Array  # (R,), intersection over union with the leaf that it is most of


def make_example(scan: Scan, settings: CloudSegmentationSettings) -> Example:
    """Segment a scan as far as regions, and compare them with the truth."""
    cloud = prepare_cloud(scan.points_m, settings)
    links = link_points(cloud, settings)
    tree = merge_points(len(cloud), links, settings.size_power)
    forms = measure_regions(cloud, links, tree, settings.min_points)
    return Example(forms=forms, tree=tree, overlap=_overlaps(cloud, tree, forms.node, scan.leaf))


def _overlaps(cloud: WorkingCloud, tree: MergeTree, node: NDArray[np.int64], leaf: NDArray[np.int32]) -> Array:
    size = np.bincount(leaf[leaf >= 0], minlength=max(int(leaf.max()) + 1, 1))
    place = np.empty(tree.points, np.int64)
    place[tree.order] = np.arange(tree.points)
    order = np.argsort(place[cloud.of_point], kind="stable")
    ends = np.searchsorted(place[cloud.of_point][order], np.arange(tree.points + 1))
    sequence = leaf[order]
    overlap = np.zeros(len(node))
    for number, each in enumerate(node.tolist()):
        own = sequence[ends[tree.start[each]] : ends[tree.start[each] + tree.count[each]]]
        counts = np.bincount(own[own >= 0], minlength=1)
        own_leaf = int(counts.argmax())
        if counts[own_leaf] and size[own_leaf] >= MIN_LEAF:
            overlap[number] = counts[own_leaf] / (size[own_leaf] + len(own) - counts[own_leaf])
    return overlap


def learn(plants: Sequence[ScannedPlant], settings: CloudSegmentationSettings) -> str:
    """The text of weights.toml."""
    examples = []
    for plant in plants:
        example = make_example(scan_plant(plant), settings)
        print(f"{plant.name}: {len(example.forms):,} regions", file=sys.stderr, flush=True)
        examples.append(example)
    worth = [np.clip((each.overlap - WORTHLESS) / (WORTH_ALL - WORTHLESS), 0, 1) for each in examples]
    by_form = [list_facts(example.forms, None) for example in examples]
    form = learn_form(by_form, worth)
    by_size = []
    for example, facts in zip(examples, by_form, strict=True):
        probability = form.probability(facts)
        chosen = choose_regions(example.forms, example.tree, probability, settings.min_probability)
        size = measure_median_size(example.forms, chosen, probability) or MedianSize(length_m=1.0, width_m=1.0)
        by_size.append(list_facts(example.forms, size))
    with_size = learn_form(by_size, worth)
    return "# Written by tools/learn_cloud_leaves.py.\n" + "\n".join(
        [format_form("form", form), format_form("form_and_size", with_size)]
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=4, help="scans of each species")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    text = learn(list_training(options.seed, options.rounds), CloudSegmentationSettings())
    options.output.write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
