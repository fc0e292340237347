"""Priors of leaves: their four versions, and learning from leaves that lie either way round."""

import numpy as np
import pytest
from usdfoliage.leaf.fit.prior import LeafPrior, align_leaves, exchange_ends, generic_prior, learn_prior
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.leaf.shape.variation import VariationSettings, default_leaf, vary_leaves

PLACES = grid_places(np.linspace(-1, 1, 7), np.linspace(0, 1, 9))


def numbers(leaves, length_m=0.1):
    return np.column_stack([leaves.reshape(len(leaves), 21), np.full(len(leaves), np.log(length_m))])


def some_leaves(count, seed=0):
    return vary_leaves(count, np.random.default_rng(seed), VariationSettings())


def test_exchanged_ends_are_the_same_surface_turned():
    leaves = some_leaves(5)

    exchanged = evaluate_points(exchange_ends(leaves), PLACES)

    there = evaluate_points(leaves, PLACES * (-1, -1) + (0, 1))
    assert exchanged == pytest.approx(there * (-1, -1, 1) + (0, 1, 0), abs=1e-12)
    assert exchange_ends(exchange_ends(leaves)) == pytest.approx(leaves)


def test_every_version_of_a_leaf_has_the_same_cost():
    prior = learn_prior(numbers(some_leaves(50)), generic_prior(0.1, 0.5))
    means, precisions = prior.versions()
    leaf = some_leaves(1, seed=3)
    mirrored = leaf.copy()
    mirrored[:, :2, 0] *= -1
    versions = [leaf, exchange_ends(leaf), mirrored]

    costs = []
    for version, mean, precision in zip(versions, means, precisions, strict=False):
        offset = numbers(version)[0] - mean
        costs.append(offset @ precision @ offset)

    assert costs == pytest.approx([costs[0]] * 3, rel=1e-6)
    assert prior.exchanged().exchanged().mean == pytest.approx(prior.mean)


def test_leaves_with_exchanged_ends_are_aligned():
    leaves = some_leaves(60)
    turned = np.random.default_rng(1).random(60) < 0.5
    mixed = leaves.copy()
    mixed[turned] = exchange_ends(leaves[turned])

    aligned, version = align_leaves(numbers(mixed), generic_prior(0.1, 0.5))

    assert len(set(zip(turned, version % 2, strict=True))) == 2  # all one way, whichever
    widths = aligned[:, [7, 13]]
    assert (widths[:, 0] > widths[:, 1]).all() or (widths[:, 0] < widths[:, 1]).all()


def test_many_leaves_teach_their_mean_and_one_or_none_nothing():
    leaves = some_leaves(400)
    before = generic_prior(0.2, 0.3)

    learned = learn_prior(numbers(leaves), before)

    means = learned.versions()[0]
    assert np.abs(means[:, 7] - default_leaf()[2, 1]).min() < 0.02
    assert np.exp(learned.mean[21]) == pytest.approx(0.1, rel=0.05)
    assert np.diag(learned.covariance).sum() < np.diag(before.covariance).sum()
    assert learn_prior(numbers(leaves[:1]), before) is before
    assert learn_prior(numbers(leaves[:0]), before) is before


def test_a_stranger_among_the_leaves_changes_little():
    leaves = some_leaves(100)
    strangers = leaves.copy()
    strangers[:5] = np.random.default_rng(2).normal(size=(5, 7, 3))

    learned, with_strangers = (learn_prior(numbers(each), generic_prior(0.1, 0.5)) for each in (leaves, strangers))

    differences = [np.abs(mean - learned.mean).max() for mean in with_strangers.versions()[0]]
    assert min(differences) < 0.03


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match=r"\(22,\)"):
        LeafPrior(mean=np.zeros(21), covariance=np.eye(22))
