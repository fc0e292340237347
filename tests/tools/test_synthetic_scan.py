"""Scans of generated plants, to learn from and to measure by."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from usdfoliage.branch.distances import sample_axes

from tools.bench.cloud_leaves import compare_instances
from tools.synthetic.leafy_trees import LeafyTree, list_leafy_trees, scan_leafy_tree
from tools.synthetic.scan import CLUTTER, ScanSettings, scan_scene
from tools.synthetic.shoots import SPECIES, grow_shoots

PLATE = np.array([[-1.0, 0, 0], [1, 0, 0], [1, 2, 0], [-1, 2, 0]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_scan_lies_on_what_was_scanned_and_is_the_same_again():
    settings = ScanSettings(points=2000, stations=2, noise_m=0.001, clutter=0.25, seed=3)
    one, two = (scan_scene(PLATE, TWO, np.array([0, 1]), settings) for _ in range(2))
    np.testing.assert_array_equal(one.points_m, two.points_m)
    own = one.leaf >= 0
    assert np.abs(one.points_m[own, 2]).max() < 0.02
    assert abs(np.mean(one.leaf == CLUTTER) - 0.25) < 0.001


def test_what_stands_before_hides_what_stands_behind():
    behind = np.concatenate([PLATE, PLATE * 0.5 + [0, 0.5, -0.1]])
    triangles = np.concatenate([TWO, TWO + 4])
    settings = ScanSettings(points=2000, stations=1, one_sided=True, noise_m=0.0)
    scan = scan_scene(behind, triangles, np.array([0, 0, 1, 1]), settings)
    assert set(scan.leaf.tolist()) == {0}


def test_shoots_have_the_leaves_that_were_asked_for():
    shoots = grow_shoots(SPECIES["opposite"], 12, seed=1)
    assert shoots.count == 12
    assert set(shoots.leaf.tolist()) == set(range(-1, 12))
    assert shoots.triangles.max() < len(shoots.vertices_m)


def test_instances_are_right_where_they_share_half_of_all_points():
    true = np.repeat([0, 1, 2, -1], [40, 40, 10, 40]).astype(np.int32)
    found = np.full(130, -1, np.int32)
    found[:20] = 0  # half of the first: right
    found[40:59] = 1  # less than half of the second
    found[80:90] = 2  # of the third, which is too small to count
    found[100:120] = 3  # of none
    assert compare_instances(found, true) == (2, 3, 0.5, 1 / 3)


def test_the_same_leafy_tree_gives_the_same_scan_with_twigs_and_leaves():
    tree = LeafyTree(name="tree", height_m=3.0, markers=2500, leaves=500, scan=ScanSettings(points=5000), seed=5)
    (scan, skeleton), (again, _) = scan_leafy_tree(tree), scan_leafy_tree(tree)
    np.testing.assert_array_equal(scan.points_m, again.points_m)
    assert len(np.unique(scan.leaf)) > 200
    assert 0.1 < (scan.leaf < 0).mean() < 0.9
    assert skeleton.order.max() >= 2
    # Wood is where the skeleton is, within its noise and what its points are apart along it.
    axis_m, radius_m, _ = sample_axes(skeleton, 0.004)
    away_m, nearest = cKDTree(axis_m).query(scan.points_m[scan.leaf < 0])
    bound_m = radius_m[nearest] + tree.scan.noise_m * 4 + 0.004
    assert (away_m < bound_m).mean() > 0.7  # the others are stalks of leaves


def test_every_fifth_leafy_tree_is_bare():
    trees = list_leafy_trees(3, 10)
    assert [tree.leaves == 0 for tree in trees] == [False] * 4 + [True] + [False] * 4 + [True]
    assert {tree.crown for tree in trees} == {"ball", "column", "cone", "umbrella"}
    with pytest.raises(ValueError, match="crown"):
        LeafyTree(name="tree", crown="square")
