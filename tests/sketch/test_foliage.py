"""Leaves in a photograph: mixtures of colours, a minimum cut, and both on drawn trees."""

import itertools

import cv2
import numpy as np
import pytest
from usdfoliage.sketch.foliage import FoliageCutSettings, fill_outline, find_foliage, rate_components
from usdfoliage.sketch.minimum_cut import cut_pixels
from usdfoliage.sketch.mixtures import Mixture, fit_mixture, log_density

from tests.support.photographs.drawn_trees import draw_bare, draw_leafy


def test_a_mixture_finds_its_clusters():
    rng = np.random.default_rng(3)
    means = np.array([[30.0, 60, 20], [200, 210, 240], [120, 90, 60]])
    share = np.array([0.5, 0.3, 0.2])
    colors = np.concatenate(
        [rng.normal(mean, 6, (int(4000 * part), 3)) for mean, part in zip(means, share, strict=True)]
    )
    found = fit_mixture(colors, 3, 0)
    order = np.argsort(found.mean[:, 0])
    np.testing.assert_allclose(found.mean[order], means[[0, 2, 1]], atol=1.0)
    np.testing.assert_allclose(found.weight[order], share[[0, 2, 1]], atol=0.01)


def test_a_density_is_that_of_normal_distributions():
    mixture = Mixture(weight=np.array([1.0]), mean=np.zeros((1, 3)), covariance=4 * np.eye(3)[None])
    colors = np.array([[0.0, 0, 0], [2, 0, 0]])
    expected = -1.5 * np.log(2 * np.pi * 4) - np.array([0, 0.5])
    np.testing.assert_allclose(log_density(mixture, colors), expected)


def test_few_colours_make_few_components():
    found = fit_mixture(np.array([[10.0, 20, 30]]), 5, 0)
    assert len(found) == 1
    assert np.isfinite(log_density(found, np.array([[10.0, 20, 30]]))).all()


@pytest.mark.parametrize("seed", range(5))
def test_a_cut_has_the_minimum_of_all_labels(seed):
    rng = np.random.default_rng(seed)
    energy, right, down = rng.normal(0, 2, (3, 3)), rng.uniform(0, 1.5, (3, 2)), rng.uniform(0, 1.5, (2, 3))

    def total(labels):
        return (
            (energy * labels).sum()
            + (right * (labels[:, 1:] != labels[:, :-1])).sum()
            + (down * (labels[1:] != labels[:-1])).sum()
        )

    found = cut_pixels(energy, right, down, np.ones((3, 3), bool))
    minimum = min(total(np.array(bits, bool).reshape(3, 3)) for bits in itertools.product((0, 1), repeat=9))
    assert total(found) == pytest.approx(minimum, abs=0.1)


def test_outside_of_the_domain_all_is_background():
    domain = np.zeros((4, 5), bool)
    domain[1:3, 1:4] = True
    found = cut_pixels(np.full((4, 5), -3.0), np.ones((4, 4)), np.ones((3, 5)), domain)
    np.testing.assert_array_equal(found, domain)
    assert not cut_pixels(np.zeros((2, 2)), np.ones((2, 1)), np.ones((1, 2)), np.zeros((2, 2), bool)).any()


def test_leaves_of_a_drawn_tree_are_found():
    tree = draw_leafy()
    found = find_foliage(tree.srgb, tree.strokes.crown_px, 0)
    both = (found.mask & tree.leaves).sum() / (found.mask | tree.leaves).sum()
    assert both > 0.95
    assert not found.is_thin
    assert not found.is_bare
    again = find_foliage(tree.srgb, tree.strokes.crown_px, 0)
    np.testing.assert_array_equal(found.mask, again.mask)


def test_pixels_that_are_half_sky_are_not_pure():
    """A fringe of fine leaves, through which the sky shows: it is of the tree, and its colours are not the leaves'."""
    tree = draw_leafy()
    sky = np.median(tree.srgb[:20], axis=(0, 1))
    fringe = (cv2.dilate(tree.leaves.astype(np.uint8), np.ones((11, 11), np.uint8)) > 0) & ~tree.leaves
    fringe &= np.arange(len(fringe))[:, None] < np.nonzero(tree.leaves)[0].mean()  # before the sky alone
    leaf = tree.srgb[tree.leaves].mean(axis=0)
    srgb = tree.srgb.copy()
    srgb[fringe] = (0.55 * leaf + 0.45 * sky).round().astype(np.uint8)
    found = find_foliage(srgb, tree.strokes.crown_px, 0)
    assert found.mask[fringe].mean() > 0.8
    assert found.pure[fringe].mean() < 0.1
    assert found.pure[tree.leaves].mean() > 0.8
    assert not (found.pure & ~found.mask).any()


def test_twigs_alone_are_no_leaves():
    tree = draw_bare()
    found = find_foliage(tree.srgb, tree.strokes.crown_px, 0, branches_px=tree.strokes.branches_px)
    assert found.is_thin
    assert found.is_bare


def test_a_stroke_that_crosses_itself_holds_both_of_its_loops():
    outline = np.array([[0.0, 0], [10, 10], [10, 0], [0, 10]])
    filled = fill_outline(outline, (10, 10))
    assert filled[5, 1]
    assert filled[5, 8]


def test_a_stroke_outside_of_the_picture_holds_nothing():
    with pytest.raises(ValueError, match="inside"):
        find_foliage(np.zeros((20, 20, 3), np.uint8), np.array([[50.0, 50], [60, 50], [60, 60]]), 0)


def test_components_that_strokes_of_branches_show_are_less_likely_leaves():
    """Limbs that are seen through the crown are oftener under the strokes than elsewhere in it."""
    rng = np.random.default_rng(0)
    leaf, bark, sky = ((60, 120, 40), (120, 95, 75), (190, 210, 240))
    inside = np.concatenate([rng.normal(leaf, 6, (3000, 3)), rng.normal(bark, 6, (900, 3))])
    around = rng.normal(sky, 6, (2000, 3))
    mixture = fit_mixture(inside, 4, 0)
    barks = np.linalg.norm(mixture.mean - bark, axis=1) < 40
    assert barks.any()
    assert not barks.all()
    settings = FoliageCutSettings()
    for under, falls in ((rng.normal(bark, 6, (200, 3)), True), (inside[::20], False)):
        before = rate_components(mixture, inside, around, settings)
        after = rate_components(mixture, inside, around, settings, under_strokes=under)
        assert (after[barks] < before[barks] - 0.1).all() == falls
        np.testing.assert_allclose(after[~barks], before[~barks], atol=0.05)
