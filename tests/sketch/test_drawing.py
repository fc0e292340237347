import numpy as np
import pytest
from usdfoliage.sketch.drawing import even_out

ANGLE = np.linspace(0, 2 * np.pi, 60, endpoint=False)
CIRCLE = 100 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=-1) + 200


def test_a_circle_stays_where_it_is():
    found = even_out(CIRCLE, 8.0)
    np.testing.assert_allclose(np.linalg.norm(found - 200, axis=1), 100, atol=1.0)


@pytest.mark.parametrize("seed", range(3))
def test_the_tremor_of_a_hand_is_less(seed):
    shaken = CIRCLE + np.random.default_rng(seed).normal(0, 5, CIRCLE.shape)
    before, after = (np.abs(np.linalg.norm(line - 200, axis=1) - 100) for line in (shaken, even_out(shaken, 20.0)))
    assert after.mean() < 0.65 * before.mean()


@pytest.mark.parametrize("outline", [CIRCLE[:1], np.repeat(CIRCLE[:1], 3, axis=0)])
def test_an_outline_without_length_is_returned(outline):
    assert even_out(outline, 8.0) is outline
