"""Trees of nodes: sums and paths equal those of a loop, whatever order the nodes come in."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths

SEEDS = st.integers(0, 2**32 - 1)


def random_parents(seed: int, max_nodes: int = 40) -> np.ndarray:
    """Parents of a forest whose nodes come in any order."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, max_nodes))
    parent = np.array([rng.integers(-1, node) if rng.random() < 0.9 else -1 for node in range(count)])
    name = rng.permutation(count)
    renamed = np.full(count, -1, np.int32)
    renamed[name] = np.where(parent < 0, -1, name[parent])
    return renamed


def path_to_root(parent: np.ndarray, node: int) -> list[int]:
    path = [node]
    while parent[path[-1]] >= 0:
        path.append(int(parent[path[-1]]))
    return path


@given(seed=SEEDS)
def test_sums_are_those_of_a_loop(seed):
    parent = random_parents(seed)
    tree, own = RootedTree(parent), np.random.default_rng(seed).uniform(0, 1, len(parent))
    paths = [path_to_root(parent, node) for node in range(len(parent))]
    above = [[other for other in range(len(parent)) if node in paths[other]] for node in range(len(parent))]
    assert tree.depth.tolist() == [len(path) - 1 for path in paths]
    assert tree.sum_below(own) == pytest.approx([own[path].sum() for path in paths])
    assert tree.sum_above(own) == pytest.approx([own[nodes].sum() for nodes in above])
    farthest = [max(own[paths[o][: paths[o].index(n)]].sum() for o in above[n]) for n in range(len(parent))]
    assert tree.farthest_above(own) == pytest.approx(farthest)


@given(seed=SEEDS)
def test_levels_and_children_hold_every_node_once(seed):
    parent = random_parents(seed)
    tree = RootedTree(parent)
    assert np.sort(np.concatenate(tree.levels)).tolist() == list(range(len(parent)))
    for level, nodes in enumerate(tree.levels):
        assert (tree.depth[nodes] == level).all()
    for node in range(len(parent)):
        children = tree.children_of(np.array([node]))
        assert children.tolist() == np.flatnonzero(parent == node).tolist()
        assert tree.child_counts()[node] == len(children)


@given(seed=SEEDS)
def test_the_first_child_has_the_highest_rank_and_of_equals_the_lowest_number(seed):
    parent = random_parents(seed)
    rank = np.random.default_rng(seed).integers(0, 3, len(parent)).astype(float)
    first = RootedTree(parent).first_child(rank)
    for node in range(len(parent)):
        children = np.flatnonzero(parent == node)
        assert first[node] == (children[np.argmax(rank[children])] if len(children) else -1)


@pytest.mark.parametrize("parent", [[0], [1, 0], [-1, 0, 3, 4, 2]])
def test_parents_in_a_circle_are_refused(parent):
    with pytest.raises(ValueError, match="go in a circle"):
        RootedTree(np.array(parent, np.int32)).sum_above(np.ones(len(parent)))


def test_a_tree_without_nodes_has_nothing():
    tree = RootedTree(np.zeros(0, np.int32))
    assert not len(tree.sum_above(np.zeros(0)))
    assert not len(tree.first_child(np.zeros(0)))


def test_steps_lead_from_the_parent():
    centers_m = np.array([[1.0, 1, 1], [1, 4, 5], [0, 4, 5]])
    assert step_lengths(centers_m, np.array([-1, 0, 1])).tolist() == [0, 5, 1]
