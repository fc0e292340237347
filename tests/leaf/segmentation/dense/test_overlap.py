"""Which patches of different views are of one surface."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.leaf.segmentation.dense.overlap import Overlaps, group_patches, measure_overlaps

from tests.support.leaves.views import Disc, camera, draw_view

LEFT = Disc(center=(-0.04, 0.0, 1.0), turn=1.2, tilt=0.2)
RIGHT = Disc(center=(0.04, 0.0, 1.05), turn=1.7, tilt=-0.2)
BEFORE = Disc(center=(0.01, 0.0, 0.7), half=(0.5, 0.5))


def look(discs, *, scale: float = 1.0, noise_m: float = 0.0, only=None, cameras=(-0.02, 0.02)):
    """What measure_overlaps takes: the discs from cameras side by side, each disc a patch unless `only` are drawn."""
    views, labels = [], []
    for index, x in enumerate(cameras):
        some = discs if only is None else only[index]
        view, owner = draw_view(some, camera(x=x, scale=scale), scale=scale, noise_m=noise_m, seed=index)
        views.append(view)
        labels.append((owner + 1).astype(np.int32))
    counts = [int(label.max()) for label in labels]
    neighbors = [[other for other in range(len(views)) if other != index] for index in range(len(views))]
    depths = [view.depth_m for view in views]
    return views, depths, labels, counts, neighbors


def overlap_of(arguments, noise_m: float = 0.0) -> Overlaps:
    return measure_overlaps(*arguments, 4.0, noise_m)


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_a_leaf_in_two_views_overlaps_in_both_directions(scale):
    found = overlap_of(look([LEFT, RIGHT], scale=scale))
    assert found.first.tolist() == [0, 2, 4]
    assert found.view.tolist() == [0, 0, 1, 1]
    expected = np.zeros((4, 4))
    expected[[0, 1, 2, 3], [2, 3, 0, 1]] = 1
    assert found.share.toarray() == pytest.approx(expected, abs=0.05)
    assert found.seen == pytest.approx(np.array([[0, 1], [0, 1], [1, 0], [1, 0]]), abs=0.06)
    assert (found.stability > 0.95).all()
    assert found.views_seen.tolist() == [1] * 4


def test_noise_is_allowed_for():
    arguments = look([LEFT, RIGHT], noise_m=0.004)
    assert overlap_of(arguments).seen[0, 1] < 0.9
    assert overlap_of(arguments, 0.006).seen[0, 1] > 0.9


def test_what_is_hidden_in_a_view_overlaps_with_nothing_there():
    found = overlap_of(look(None, only=[[LEFT], [BEFORE, LEFT]]))
    assert found.share[0].nnz == 0
    assert found.seen[0].tolist() == [0, 0]
    assert found.views_seen[0] == 0
    assert found.stability[0] == 0


def test_what_lies_outside_of_a_picture_is_not_seen_there():
    found = overlap_of(look([LEFT], cameras=(-0.02, -0.02 + 0.3)))
    assert found.view.tolist() == [0]
    assert found.seen.sum() == 0


def test_two_leaves_that_are_one_patch_in_another_view():
    views, depths, labels, _, neighbors = look([LEFT, RIGHT])
    labels[1] = np.minimum(labels[1], 1)
    found = overlap_of((views, depths, labels, [2, 1], neighbors))
    share = found.share.toarray()
    assert share[:2, 2] == pytest.approx([1, 1], abs=0.05)
    assert share[2, :2] == pytest.approx([0.5, 0.5], abs=0.1)
    assert share[2, :2].sum() == pytest.approx(1, abs=0.06)
    assert found.stability == pytest.approx([0.5] * 3, abs=0.1)
    assert sorted(map(sorted, group_patches(found, np.ones(3)))) == [[0], [1], [2]]


def test_neighbors_alone_are_looked_into():
    views, depths, labels, counts, _ = look([LEFT], cameras=(-0.02, 0.0, 0.02))
    found = overlap_of((views, depths, labels, counts, [[1], [0], []]))
    assert (found.share.toarray() > 0.9).tolist() == [[False, True, False], [True, False, False], [False] * 3]


def test_no_patches_and_no_views():
    views, depths, labels, _, neighbors = look([LEFT])
    found = overlap_of((views, depths, [label * 0 for label in labels], [0, 0], neighbors))
    assert found.first.tolist() == [0, 0, 0]
    assert found.share.shape == (0, 0)
    assert group_patches(found, np.zeros(0)) == []
    assert len(overlap_of(([], [], [], [], [])).view) == 0


def made_up(share, view) -> Overlaps:
    """Overlaps of patches that all views see."""
    view = np.asarray(view)
    views = int(view.max()) + 1
    return Overlaps(
        first=np.searchsorted(view, np.arange(views + 1)),
        view=view,
        share=sp.csr_matrix(np.asarray(share, float)),
        seen=np.ones((len(view), views)),
        stability=np.ones(len(view)),
        views_seen=np.full(len(view), views - 1),
    )


def test_groups_do_not_chain():
    chain = np.zeros((3, 3))
    chain[[0, 1, 1, 2], [1, 0, 2, 1]] = 1.0
    overlaps = made_up(chain, [0, 1, 2])
    assert [group.tolist() for group in group_patches(overlaps, np.array([3.0, 2, 1]))] == [[0, 1], [2]]
    assert [sorted(group.tolist()) for group in group_patches(overlaps, np.array([1.0, 3, 2]))] == [[0, 1, 2]]


def test_overlap_in_one_direction_is_not_enough():
    one_sided = np.array([[0.0, 1.0], [0.2, 0.0]])
    assert [group.tolist() for group in group_patches(made_up(one_sided, [0, 1]), np.ones(2))] == [[0], [1]]


@given(data=st.data(), count=st.integers(1, 8))
def test_every_worthy_patch_is_in_one_group_and_the_worthiest_comes_first(data, count):
    rng = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    worth = np.array(data.draw(st.lists(st.sampled_from([0.0, 0.1, 0.5, 1.0, 2.0]), min_size=count, max_size=count)))
    share = rng.random((count, count)) ** 0.3 * (rng.random((count, count)) < 0.6)
    view = np.arange(count)  # a patch a view
    groups = group_patches(made_up(share * (1 - np.eye(count)), view), worth)
    members = np.concatenate([*groups, np.zeros(0, int)]).astype(int)
    assert len(set(members)) == len(members)
    assert set(np.flatnonzero(worth > 0)) <= set(members)
    heads = [worth[group[0]] for group in groups]
    assert heads == sorted(heads, reverse=True)
    assert all(head > 0 for head in heads)
