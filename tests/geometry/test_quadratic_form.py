"""Quadratic forms: the odds of a known one, and what is learned, formatted and read again."""

import numpy as np
import pytest
from usdfoliage.geometry.quadratic_form import QuadraticForm, parse_form

from tools.learned_forms import format_form, learn_form

FORM = QuadraticForm(
    middle=np.array([1.0, 2.0]),
    spread=np.array([2.0, 0.5]),
    offset=0.25,
    linear=np.array([1.0, -1.0]),
    square=np.array([[0.5, 0.0], [2.0, -1.0]]),
)


def test_odds_are_those_of_the_formula():
    # z = (1, 2): 0.25 + (1 - 2) + (0.5 + 2 * 2 * 1 - 4)
    assert FORM.odds(np.array([[3.0, 3.0]])) == pytest.approx([-0.25])
    assert FORM.probability(np.array([[3.0, 3.0]])) == pytest.approx([1 / (1 + np.exp(0.25))])


def test_a_form_is_read_as_it_was_formatted():
    read = parse_form(format_form("some", FORM), "some")
    for name in ("middle", "spread", "offset", "linear", "square"):
        np.testing.assert_allclose(getattr(read, name), getattr(FORM, name))


def test_what_lies_in_a_ring_is_learned():
    rng = np.random.default_rng(0)
    facts = rng.normal(size=(4000, 2))
    inside = (facts**2).sum(axis=1) < 1.2
    form = learn_form([facts[:2000], facts[2000:]], [inside[:2000].astype(float), inside[2000:].astype(float)])
    again = rng.normal(size=(2000, 2))
    assert ((form.odds(again) > 0) == ((again**2).sum(axis=1) < 1.2)).mean() > 0.97


def test_what_counts_for_nothing_is_not_learned():
    facts = np.linspace(-1, 1, 200)[:, None]
    worth = (facts[:, 0] > 0).astype(float)
    wrong = np.concatenate([worth, 1 - worth])
    shares = np.concatenate([np.ones(200), np.zeros(200)])
    form = learn_form([np.concatenate([facts, facts])], [wrong], [shares])
    assert (form.odds(np.array([[-0.5], [0.5]])) * [-1, 1] > 1).all()
