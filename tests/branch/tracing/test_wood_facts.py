"""What is around sections of wood and of leaves: on lines and planes that are known, and on a scan of a grown tree."""

from functools import cache

import numpy as np
import pytest
from usdfoliage.branch.tracing.cloud_cut import Cut, cut_cloud, point_spacing, sections_on_stems
from usdfoliage.branch.tracing.sections import SectionTree
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.branch.tracing.wood import wood_features, wood_odds
from usdfoliage.branch.tracing.wood_facts import learned_wood_odds, wood_facts
from usdfoliage.geometry.point_cells import cell_means

from tests.support.branch_clouds import chain, line
from tools.synthetic.leafy_trees import LeafyTree, scan_leafy_tree
from tools.synthetic.scan import ScanSettings

SPACING_M = 0.01
LONGER, FLATTER, ALONG_PATH = 5, 6, 7  # facts of what is within two spacings


def facts_of(points_m: np.ndarray, sections: SectionTree, spacing_m: float = SPACING_M) -> np.ndarray:
    return wood_facts(points_m, sections, spacing_m, wood_features(points_m, sections, spacing_m))


@cache
def leafy_cut() -> tuple[np.ndarray, np.ndarray, Cut]:
    """A scan that nothing was learned from, which of its points are wood, and its sections."""
    scan = ScanSettings(points=30_000, stations=4, noise_m=0.002)
    tree = LeafyTree(name="tree", height_m=4.0, markers=1000, leaves=2500, scan=scan, seed=77)
    cloud, _ = scan_leafy_tree(tree)
    points_m = cloud.points_m
    cut = cut_cloud(points_m, np.zeros((1, 3)), 0.02, point_spacing(points_m), BranchSettings(leaves="on"))
    return points_m, cloud.leaf < 0, cut


def rank(odds: np.ndarray, wood: np.ndarray) -> float:
    """Share of the pairs of wood and leaf of which the wood has the higher odds."""
    sequence = wood[np.argsort(odds, kind="stable")]
    return float((np.cumsum(~sequence) * sequence).sum() / (sequence.sum() * (~sequence).sum()))


def test_around_a_line_points_lie_along_it_and_around_a_plane_they_do_not():
    on_line_m = line([0, 0, 0], [0, 2, 0], 401)
    side = np.arange(-20, 21) * 0.005
    on_plane_m = np.stack(np.meshgrid(side, side, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    middle_m = line([0, -0.05, 0], [0, 0.05, 0], 21)
    of_line = facts_of(on_line_m, chain(on_line_m))[100:300]
    of_plane = facts_of(on_plane_m, chain(middle_m))[5:16]
    assert of_line[:, LONGER].min() > of_plane[:, LONGER].max() + 1
    assert of_plane[:, FLATTER].min() > of_line[:, FLATTER].max() + 1
    np.testing.assert_allclose(of_line[:, ALONG_PATH], 1, atol=1e-9)


@pytest.mark.parametrize("scale", [0.1, 7.0])
def test_facts_do_not_depend_on_the_size_of_the_plant(scale):
    points_m, _, cut = leafy_cut()
    some = SectionTree(
        center_m=scale * cut.sections.center_m,
        points=cut.sections.points,
        parent=cut.sections.parent,
        section=cut.sections.section,
    )
    facts = facts_of(points_m, cut.sections, cut.spacing_m)
    scaled = facts_of(scale * points_m, some, scale * cut.spacing_m)
    assert facts.shape == (len(cut.sections), 31)
    assert np.isfinite(facts).all()
    # Of thinned points others may be taken, and of many points at one distance.
    assert (np.abs(scaled - facts).max(axis=1) < 1e-6).mean() > 0.9


def test_the_learned_odds_know_wood_better_than_those_of_the_path_alone():
    points_m, is_wood, cut = leafy_cut()
    share = cell_means(is_wood.astype(np.float64)[:, None], cut.sections.section)[:, 0]
    known = ((share < 0.1) | (share > 0.9)) & ~sections_on_stems(cut)
    features = wood_features(points_m, cut.sections, cut.spacing_m)
    odds = learned_wood_odds(points_m, cut.sections, cut.spacing_m, features)
    learned = rank(odds[known], share[known] > 0.5)
    of_path = rank(wood_odds(features)[known], share[known] > 0.5)
    assert learned > 0.85
    assert learned > of_path + 0.03


def test_a_plant_of_few_points_has_odds():
    points_m = line([0, 0, 0], [0, 1, 0], 3)
    features = wood_features(points_m, chain(points_m), SPACING_M)
    assert np.isfinite(learned_wood_odds(points_m, chain(points_m), SPACING_M, features)).all()
