"""Points that are joined to regions, the surest first."""

from dataclasses import replace

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
    tree = merge_points(count, random_links(count, 3, seed), power)
    assert sorted(tree.order.tolist()) == list(range(count))
    for node in range(count, len(tree)):
        own, (one, two) = set(points_of(tree, node)), tree.children[node]
        assert own == set(points_of(tree, one)) | set(points_of(tree, two))
        assert tree.count[node] == tree.count[one] + tree.count[two]
        assert tree.count[one] >= tree.count[two]
        assert tree.parent[one] == tree.parent[two] == node


@settings(max_examples=60, deadline=None)
@given(count=st.integers(2, 60), degree=st.integers(1, 6), seed=st.integers(0, 1000), levels=st.integers(1, 9))
def test_the_tree_is_that_of_rounds_over_all_links(count, degree, seed, levels):
    """To the bit, also where many links are equally strong."""
    links = random_links(count, degree, seed)
    links = replace(links, weight=np.ceil(links.weight * levels) / levels)
    power = (seed % 11) / 10
    tree = merge_points(count, links, power)
    children, linkage, across, size, rounds = merge_all_links(count, links, power)
    np.testing.assert_array_equal(tree.children[count:], children)
    np.testing.assert_array_equal(tree.linkage[count:], linkage)
    np.testing.assert_array_equal(tree.across[count:], across)
    np.testing.assert_array_equal(tree.count[count:], size)
    np.testing.assert_array_equal(tree.rounds - count, rounds)


def random_links(count, degree, seed):
    rng = np.random.default_rng(seed)
    pairs = np.unique(np.sort(rng.integers(count, size=(degree * count, 2)), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    return Links(first=pairs[:, 0].copy(), second=pairs[:, 1].copy(), weight=rng.random(len(pairs)))


def merge_all_links(count, links, size_power):
    """What merge_regions computes, with every link looked at in every round: regions are numbered anew after each."""
    node, size = np.arange(count), np.ones(count, np.int64)
    first, second, weight = links.first, links.second, links.weight
    children, linkage, across, sizes, rounds = [np.zeros((0, 2), int)], [], [], [], [0]
    while len(first):
        strength = weight / np.minimum(size[first], size[second]).astype(float) ** size_power
        rank = np.empty(len(first), np.int64)
        rank[np.argsort(-strength, kind="stable")] = np.arange(len(first))
        best = np.full(len(size), len(first))
        np.minimum.at(best, first, rank)
        np.minimum.at(best, second, rank)
        pairs = np.flatnonzero((best[first] == rank) & (best[second] == rank) & (strength > 1e-3))
        if not len(pairs):
            break
        one, two = first[pairs], second[pairs]
        larger = size[one] >= size[two]
        one, two = np.where(larger, one, two), np.where(larger, two, one)
        children.append(np.column_stack([node[one], node[two]]))
        linkage.append(strength[pairs])
        across.append(weight[pairs])
        size[one] += size[two]
        sizes.append(size[one])
        node[one] = count + rounds[-1] + np.arange(len(pairs))
        rounds.append(rounds[-1] + len(pairs))

        stays = np.ones(len(size), bool)
        stays[two] = False
        number = np.cumsum(stays) - 1
        number[two] = number[one]
        size, node = size[stays], node[stays]
        ends = np.sort(np.column_stack([number[first], number[second]]), axis=1)
        apart = ends[:, 0] != ends[:, 1]
        key, place = np.unique(ends[apart] @ [len(size), 1], return_inverse=True)
        weight = np.bincount(place, weight[apart], len(key)).astype(float)
        first, second = np.divmod(key, len(size))
    return np.concatenate(children), *(np.concatenate([[], *each]) for each in (linkage, across, sizes)), rounds


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
