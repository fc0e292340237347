"""Branches that paths reached from both ends."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.meeting_fronts import FrontSettings, join_fronts

from tests.support.branch_shapes import random_tree

STEP_M = 0.01
WINDOW_M = 0.03


def grow(start, end, parent, nodes, parents):
    """Nodes STEP_M apart from a start, which is the node `parent`, to an end; their numbers."""
    count = round(float(np.linalg.norm(np.subtract(end, start))) / STEP_M)
    first = len(nodes)
    for k in range(1, count + 1):
        nodes.append(np.add(start, np.subtract(end, start) * k / count))
        parents.append(parent if k == 1 else len(nodes) - 2)
    return list(range(first, len(nodes)))


def crossing(backwards):
    """A branch that leaves a trunk level; another one touches it at .7 m. Where it runs backwards, from there on and
    back to .4 m it hangs on the other one. Nodes, parents, and the branch from the trunk to its tip."""
    nodes, parents = [np.zeros(3)], [-1]
    trunk = grow([0, 0, 0], [0, 2, 0], 0, nodes, parents)
    low, high = trunk[49], trunk[99]
    other = grow(nodes[low], [0.7, 0.98, 0], low, nodes, parents)
    if not backwards:
        return np.array(nodes), np.array(parents, np.int32), grow(nodes[high], [1.5, 1, 0], high, nodes, parents)
    base = grow(nodes[high], [0.4, 1, 0], high, nodes, parents)
    contact = grow(nodes[other[-1]], [0.7, 1, 0], other[-1], nodes, parents)
    arm = grow([0.7, 1, 0], [0.41, 1, 0], contact[-1], nodes, parents)
    outer = grow([0.7, 1, 0], [1.5, 1, 0], contact[-1], nodes, parents)
    return np.array(nodes), np.array(parents, np.int32), [*base, *arm[::-1], *outer]


def joined(nodes, parents, **settings):
    return join_fronts(nodes, parents, np.full(len(nodes), 0.005), 0.02, WINDOW_M, FrontSettings(**settings))


def test_a_branch_that_was_reached_from_both_ends_is_one_again():
    nodes, parents, branch = crossing(backwards=True)
    assert parents[branch[-1]] != parents[branch[0]]
    found = joined(nodes, parents)
    path = [branch[-1]]
    while found[path[-1]] >= 0:
        path.append(int(found[path[-1]]))
    on_branch = [node for node in path if node in branch]
    assert np.isin(branch, on_branch).mean() > 0.97  # the node at which both touch may be on the other one
    assert nodes[path][:, 1].min() == 0
    level = nodes[path][nodes[path][:, 0] > 0.05]
    assert np.abs(level[:, 1] - 1).max() < 0.03  # it never goes down to the other one
    assert (found < 0).sum() == 1


def test_a_branch_that_is_right_stays():
    nodes, parents, _ = crossing(backwards=False)
    assert np.array_equal(joined(nodes, parents), parents)


def test_tips_that_are_no_branch_together_stay():
    nodes, parents, _ = crossing(backwards=True)
    assert np.array_equal(joined(nodes, parents, sharper=3.0), parents)
    bent = nodes.copy()
    tip = np.flatnonzero((np.abs(nodes[:, 1] - 1) < 1e-9) & (nodes[:, 0] > 0.405) & (nodes[:, 0] < 0.7))
    bent[tip, 2] += 2 * (0.7 - bent[tip, 0])  # the arm turns off to the side
    assert np.array_equal(joined(bent, parents), parents)


@pytest.mark.parametrize("seed", range(5))
def test_any_tree_stays_a_tree(seed):
    tree = random_tree(seed, 40, True)
    nodes, parents = tree.points_m, np.arange(-1, len(tree.points_m) - 1).astype(np.int32)
    parents[tree.first] = np.where(tree.parent_curve < 0, -1, tree.parent_vertex)
    found = join_fronts(nodes, parents, tree.radius_m, 0.0, 0.2)
    assert (found < 0).sum() == (parents < 0).sum()
    at = found.copy()
    for _ in range(len(at)):
        at = np.where(at >= 0, found[at], -1)
    assert (at < 0).all()


def test_settings_are_checked():
    with pytest.raises(ValueError, match="windows"):
        FrontSettings(windows=0)
    with pytest.raises(ValueError, match="in_line"):
        FrontSettings(in_line=2.0)
