"""Leaves fitted to the points of known ones: where the surface is, however little is known before."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.fit.prior import generic_prior, learn_prior
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.points import LeafPoints
from usdfoliage.leaf.segmentation.dense.proposals import join_proposals, propose_leaves, refit_proposals

from tests.support.leaves.points import known_leaves, leaf_points
from tests.support.leaves.proposals import flat_leaves, proposed, surface_distances

LENGTH_M, WIDTH = 0.1, 0.5
TOLERANCE_M = 0.002


def as_leaves(known) -> Leaves:
    parameters, axes, base_m, length_m = known
    return Leaves(
        parameters=parameters,
        base_m=base_m,
        orientation=Rotation.from_matrix(axes).as_quat(),
        length_m=length_m,
        phase=np.zeros(len(base_m)),
    )


def moved(points: LeafPoints, scale: float, shift_m) -> LeafPoints:
    return replace(points, points_m=points.points_m * scale + shift_m)


@pytest.fixture(scope="module")
def known():
    return known_leaves(16, seed=3, length_m=LENGTH_M)


@pytest.fixture(scope="module")
def found(known):
    return propose_leaves(leaf_points(known), LENGTH_M, WIDTH, TOLERANCE_M)


def test_surfaces_of_leaves_seen_whole_are_found(known, found):
    distance = surface_distances(found.leaves, as_leaves(known))
    assert np.median(distance) < 0.015
    assert distance.max() < 0.03
    assert found.leaves.length_m == pytest.approx(known[3], rel=0.1)
    assert (found.explained > 0.9).all()


@pytest.mark.parametrize("factor", [0.6, 1.7])
def test_a_wrong_expected_length_does_little_harm(known, factor):
    found = propose_leaves(leaf_points(known), factor * LENGTH_M, WIDTH, TOLERANCE_M)
    assert np.median(surface_distances(found.leaves, as_leaves(known))) < 0.03


def test_noise_and_points_that_lie_apart_do_little_harm(known):
    points = leaf_points(known, noise_m=0.001, outliers=0.05, outlier_m=0.03)
    found = propose_leaves(points, LENGTH_M, WIDTH, 2 * TOLERANCE_M)
    distance = surface_distances(found.leaves, as_leaves(known))
    assert np.median(distance) < 0.025
    assert (found.explained > 0.8).all()


def test_what_is_no_leaf_is_not_explained(known):
    rng = np.random.default_rng(0)
    points = leaf_points(known)
    cloud = replace(points, points_m=rng.uniform(0, LENGTH_M, points.points_m.shape))
    assert (propose_leaves(cloud, LENGTH_M, WIDTH, TOLERANCE_M).explained < 0.5).all()


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_scale_and_place_do_not_matter(known, found, scale):
    shift_m = np.array([3.0, -5.0, 2.0]) * scale
    far = propose_leaves(moved(leaf_points(known), scale, shift_m), LENGTH_M * scale, WIDTH, TOLERANCE_M * scale)
    back = replace(far.leaves, base_m=(far.leaves.base_m - shift_m) / scale, length_m=far.leaves.length_m / scale)
    assert np.quantile(surface_distances(back, found.leaves), 0.9) < 0.01
    assert far.explained == pytest.approx(found.explained, abs=0.05)


def test_threads_do_not_matter(known):
    points = leaf_points(known, noise_m=0.001)
    prior = generic_prior(LENGTH_M, WIDTH)
    one, two = (propose_leaves(points, LENGTH_M, WIDTH, TOLERANCE_M, threads=threads) for threads in (1, 2))
    again = [refit_proposals(points, one, prior, TOLERANCE_M, threads=threads) for threads in (1, 2)]
    for first, second in ((one, two), again):
        assert np.array_equal(first.numbers(), second.numbers())
        assert np.array_equal(first.leaves.base_m, second.leaves.base_m)
        assert np.array_equal(first.explained, second.explained)


def test_each_leaf_is_fitted_for_itself(known, found):
    alone = propose_leaves(leaf_points([array[:1] for array in known]), LENGTH_M, WIDTH, TOLERANCE_M)
    points = leaf_points([array[:1] for array in known])
    with_none = propose_leaves(
        replace(
            points,
            offsets=np.array([0, 0, len(points.points_m)]),
            confidence=np.ones(2),
            view=np.zeros(2, np.int32),
        ),
        LENGTH_M, WIDTH, TOLERANCE_M,
    )  # fmt: skip
    assert np.array_equal(with_none.numbers()[1], alone.numbers()[0])
    assert np.isfinite(with_none.numbers()).all()
    assert np.isfinite(with_none.leaves.base_m).all()
    assert with_none.explained[0] == 0


def test_a_prior_of_the_set_completes_leaves_seen_in_part(known):
    half = leaf_points(known, v_range=(0.0, 0.6), noise_m=0.0005)
    truth = as_leaves(known)
    first = propose_leaves(half, LENGTH_M, WIDTH, TOLERANCE_M)
    prior = learn_prior(
        proposed(as_leaves(known_leaves(60, seed=8, length_m=LENGTH_M))).numbers(), generic_prior(LENGTH_M, WIDTH)
    )
    again = refit_proposals(half, first, prior, TOLERANCE_M)
    before, after = (surface_distances(proposals.leaves, truth) for proposals in (first, again))
    assert np.median(after) < 0.8 * np.median(before)
    assert (again.explained > 0.85).all()


def test_refits_to_all_of_a_leaf_stay_on_it(known, found):
    prior = learn_prior(found.numbers(), generic_prior(LENGTH_M, WIDTH))
    again = refit_proposals(leaf_points(known, noise_m=0.0005), found, prior, TOLERANCE_M)
    assert np.median(surface_distances(again.leaves, as_leaves(known))) < 0.015
    assert (again.explained > 0.9).all()


def test_no_leaves():
    nothing = leaf_points(known_leaves(0))
    none = propose_leaves(nothing, LENGTH_M, WIDTH, TOLERANCE_M)
    again = refit_proposals(nothing, none, generic_prior(LENGTH_M, WIDTH), TOLERANCE_M)
    for proposals in (none, again):
        assert len(proposals) == 0
        assert proposals.numbers().shape == (0, 22)


def test_joined_and_taken_proposals_keep_their_order():
    first = proposed(flat_leaves([(0, 0, 0), (1, 0, 0)], [0.1, 0.2]), [0.3, 0.4])
    second = proposed(flat_leaves([(2, 0, 0)], 0.3), 0.5)
    joined = join_proposals(first, second)
    assert joined.leaves.base_m[:, 0].tolist() == [0, 1, 2]
    assert joined.explained.tolist() == [0.3, 0.4, 0.5]
    assert np.exp(joined.numbers()[:, -1]) == pytest.approx([0.1, 0.2, 0.3])
    assert joined.take(np.array([2, 0])).leaves.length_m.tolist() == [0.3, 0.1]
    assert joined.take(np.array([False, True, False])).explained.tolist() == [0.4]
