"""Points that are joined to regions, the surest first."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.segmentation.cloud.merge_tree import Links, link_points, merge_points
from usdfoliage.leaf.segmentation.cloud.working_cloud import prepare_cloud

from tests.support.leaves.scans import scanned_leaves


def links_of(*triples):
    first, second, weight = zip(*triples, strict=True)
    return Links(first=np.array(first), second=np.array(second), weight=np.array(weight, np.float64))


def test_the_strongest_links_join_first():
    tree = merge_points(4, links_of((0, 1, 1.0), (1, 2, 0.1), (2, 3, 0.9)), 0.0)
    assert sorted(map(sorted, tree.children[4:6].tolist())) == [[0, 1], [2, 3]]
    assert sorted(tree.children[6].tolist()) == [4, 5]
    assert tree.count.tolist()[4:] == [2, 2, 4]
    assert tree.across[6] == pytest.approx(0.1)


def test_what_is_not_linked_stays_apart():
    tree = merge_points(5, links_of((0, 1, 1.0), (2, 3, 1.0)), 0.5)
    assert np.count_nonzero(tree.parent < 0) == 3
    assert tree.parent[4] == -1


def test_no_links_join_nothing():
    none = np.zeros(0, np.int64)
    tree = merge_points(3, Links(first=none, second=none, weight=np.zeros(0)), 0.5)
    assert len(tree) == 3
    assert tree.spans() == []
    assert tree.order.tolist() == [0, 1, 2]


@settings(max_examples=30, deadline=None)
@given(count=st.integers(2, 40), seed=st.integers(0, 1000), power=st.floats(0, 1))
def test_every_node_has_the_points_of_its_children_beside_each_other(count, seed, power):
    rng = np.random.default_rng(seed)
    pairs = np.unique(np.sort(rng.integers(count, size=(3 * count, 2)), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    links = Links(first=pairs[:, 0], second=pairs[:, 1], weight=rng.random(len(pairs)))
    tree = merge_points(count, links, power)
    assert sorted(tree.order.tolist()) == list(range(count))
    for node in range(count, len(tree)):
        own, (one, two) = set(points_of(tree, node)), tree.children[node]
        assert own == set(points_of(tree, one)) | set(points_of(tree, two))
        assert tree.count[node] == tree.count[one] + tree.count[two]
        assert tree.count[one] >= tree.count[two]
        assert tree.parent[one] == tree.parent[two] == node


def points_of(tree, node):
    return tree.order[tree.start[node] : tree.start[node] + tree.count[node]].tolist()


def test_leaves_that_stand_apart_are_regions_of_their_own():
    points_m, leaf = scanned_leaves(8, 120)
    cloud = prepare_cloud(points_m)
    links = link_points(cloud)
    assert (leaf[links.first] == leaf[links.second]).all()
    tree = merge_points(len(cloud), links, 0.7)
    large = np.flatnonzero(tree.count > 100)
    tops = large[tree.parent[large] < 0]
    assert sorted(int(leaf[points_of(tree, node)][0]) for node in tops) == list(range(8))
