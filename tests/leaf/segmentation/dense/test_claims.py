"""Pixels that known leaves claim, and the points that come of them."""

import numpy as np
import pytest
from usdfoliage.leaf.points import FREE_EDGE, HIDDEN_EDGE
from usdfoliage.leaf.segmentation.dense.claims import ClaimSettings, PointSettings, claim_pixels, collect_points

from tests.support.leaves.captures import known_foliage


@pytest.fixture(scope="module")
def known():
    return known_foliage()


@pytest.fixture(scope="module")
def depths(known):
    return [view.depth_m for view in known.views]


def test_leaves_claim_their_own_pixels(known, depths):
    labels = claim_pixels(known.leaves, known.views, depths, 0.0)
    for claimed, true in zip(labels, known.leaf_ids, strict=True):
        assert (claimed == true)[true > 0].mean() > 0.995
        assert (claimed[true == 0] > 0).mean() < 0.005


def test_with_noise_the_majority_of_pixels_stays_with_their_leaves(known):
    depths = [view.depth_m for view in known.noisy_views]
    for claimed, true in zip(claim_pixels(known.leaves, known.views, depths, 0.001), known.leaf_ids, strict=True):
        sure = (true > 0) & (claimed > 0)
        assert (claimed == true)[sure].mean() > 0.97


def test_threads_do_not_matter(known, depths):
    one, three = (claim_pixels(known.leaves, known.views, depths, 0.0, threads=n) for n in (1, 3))
    assert all(np.array_equal(a, b) for a, b in zip(one, three, strict=True))


def test_noise_may_be_given_for_each_view(known, depths):
    each = claim_pixels(known.leaves, known.views[:2], depths[:2], [0.001, 0.002])
    assert np.array_equal(each[0], claim_pixels(known.leaves, known.views[:1], depths[:1], 0.001)[0])
    assert np.array_equal(each[1], claim_pixels(known.leaves, known.views[1:2], depths[1:2], 0.002)[0])


def test_points_are_where_the_pixels_are(known, depths):
    count = len(known.leaves)
    ids = [one.astype(np.int32) for one in known.leaf_ids]
    points = collect_points(known.views, depths, ids, count, settings=PointSettings(max_per_leaf=10**6))
    pixels = np.array([np.bincount(one.ravel(), minlength=count + 1)[1:] for one in ids])
    assert np.array_equal(np.diff(points.offsets), pixels.sum(axis=0))
    seen = pixels.sum(axis=0) > 0
    assert np.array_equal(points.view[seen], pixels.argmax(axis=0)[seen])
    assert (points.confidence == 1).all()
    for number, view in enumerate(known.views):
        mine = points.point_view == number
        places, z = view.camera.project(points.points_m[mine])
        free = points.kind[mine] == FREE_EDGE
        column, row = places[~free].astype(int).T
        leaf = np.searchsorted(points.offsets, np.flatnonzero(mine), side="right")
        assert np.array_equal(ids[number][row, column], leaf[~free])
        assert z[~free] == pytest.approx(depths[number][row, column], rel=1e-6)
        # Those of free edges are moved to where the leaf ends, half a pixel outwards where nothing is missing beside.
        labels = np.pad(ids[number], 1)
        column, row = places[free].astype(int).T
        around = [labels[row + down, column + right] == leaf[free] for down in range(3) for right in range(3)]
        assert np.any(around, axis=0).all()
        towards = view.camera.position_m - points.points_m[mine]
        assert (np.sum(points.normals[mine] * towards, axis=1) > 0).all()
    assert np.linalg.norm(points.normals, axis=1) == pytest.approx(1)
    assert (points.kind == FREE_EDGE).sum() > 0.02 * len(points.kind)
    assert (points.kind == HIDDEN_EDGE).any()


def test_points_are_thinned_evenly(known, depths):
    count = len(known.leaves)
    ids = [one.astype(np.int32) for one in known.leaf_ids]
    whole = collect_points(known.views, depths, ids, count, settings=PointSettings(max_per_leaf=10**6))
    few = collect_points(known.views, depths, ids, count, settings=PointSettings(max_per_leaf=200))
    again = collect_points(known.views, depths, ids, count, settings=PointSettings(max_per_leaf=200), threads=1)
    assert np.array_equal(few.points_m, again.points_m)
    assert np.array_equal(few.normals, again.normals)
    assert np.array_equal(np.diff(few.offsets), np.minimum(np.diff(whole.offsets), 200))
    for leaf in range(count):
        all_of_it, some = (slice(*one.offsets[leaf : leaf + 2]) for one in (whole, few))
        if all_of_it.stop - all_of_it.start < 400:
            continue
        shares, own = (
            np.bincount(one.point_view[part], minlength=len(ids)) / (part.stop - part.start)
            for one, part in ((whole, all_of_it), (few, some))
        )
        assert own == pytest.approx(shares, abs=0.02)


def test_no_leaves_and_no_views(known, depths):
    none = known.leaves.take(np.zeros(0, int))
    labels = claim_pixels(none, known.views, depths, 0.0)
    assert not any(one.any() for one in labels)
    assert len(collect_points(known.views, depths, labels, 0)) == 0
    assert claim_pixels(known.leaves, [], [], 0.0) == ()
    assert len(collect_points([], [], [], 3)) == 3
    empty = collect_points(known.views, depths, labels, 2, np.array([0.5, 0.2]), np.array([1, 0]))
    assert empty.offsets.tolist() == [0, 0, 0]
    assert empty.confidence.tolist() == [0.5, 0.2]
    assert empty.view.tolist() == [1, 0]


def test_pixels_without_depth_give_no_points(known, depths):
    label = np.ones_like(known.leaf_ids[0], np.int32)
    depth = np.where(known.leaf_ids[0] == 5, depths[0], 0)
    points = collect_points(known.views[:1], [depth], [label], 1)
    assert len(points.points_m) == min((known.leaf_ids[0] == 5).sum(), 4000)


def test_wrong_arguments_are_refused(known, depths):
    with pytest.raises(ValueError, match="at most 3"):
        collect_points(known.views, depths, [one.astype(np.int32) for one in known.leaf_ids], 3)
    with pytest.raises(ValueError, match="labels must be"):
        collect_points(known.views[:1], depths[:1], [np.zeros((3, 4), np.int32)], 3)
    with pytest.raises(ValueError, match="shorter"):
        claim_pixels(known.leaves, known.views, depths[:-1], 0.0)
    for wrong in ({"footprints": -1.0}, {"beyond_side": 0.0}, {"rows": 2}):
        with pytest.raises(ValueError, match="not"):
            ClaimSettings(**wrong)
    with pytest.raises(ValueError, match="not"):
        PointSettings(max_per_leaf=0)
