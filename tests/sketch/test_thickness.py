import numpy as np
import pytest
from usdfoliage.sketch.axes import Axis
from usdfoliage.sketch.thickness import find_radii

COUNT = 41
CONE_PX = np.linspace(10.0, 4.0, COUNT)


def trunk(half):
    points = np.column_stack([np.zeros(COUNT), np.linspace(0.0, 400.0, COUNT), np.zeros(COUNT)])
    return Axis(points=points, half=np.asarray(half, float), parent=-1, parent_point=-1, order=0, inferred=False)


def radius_of(half):
    return find_radii([trunk(half)], exponent=0.5, tip_px=0.5, stem_px=5.0)[0]


def test_a_cone_that_is_seen_is_the_cone():
    np.testing.assert_allclose(radius_of(CONE_PX), CONE_PX, rtol=0.03)


@pytest.mark.parametrize("first", range(6))
def test_leaves_before_a_trunk_do_not_make_it_thin(first):
    """Every third place is hidden to a quarter of its width; what is above a place never is thinner for it."""
    half = CONE_PX.copy()
    half[first::3] *= 0.25
    radius = radius_of(half)
    np.testing.assert_allclose(radius[3:-4], CONE_PX[3:-4], rtol=0.2)


def test_a_trunk_never_becomes_thicker_upwards():
    rng = np.random.default_rng(3)
    radius = radius_of(CONE_PX * rng.uniform(0.3, 1.5, COUNT))
    assert np.all(np.diff(radius) <= 1e-9)


def test_a_trunk_tapers_where_it_is_hidden():
    radius = radius_of(np.where(np.arange(COUNT) < 20, CONE_PX, np.nan))
    np.testing.assert_allclose(radius[:17], CONE_PX[:17], rtol=0.05)
    assert radius[-1] < 0.25 * radius[19]


def test_a_trunk_goes_on_into_the_crown_that_hides_it():
    """Only a slit of it is seen there: it is not a bottle."""
    half = np.where(np.arange(COUNT) < 15, 10.0, 1.0)
    radius = radius_of(half)
    even = 10.0 * (1 - 0.88 * np.linspace(0, 1, COUNT) ** 0.9)
    assert np.all(radius >= 0.69 * even)


def test_a_hidden_trunk_is_as_thick_as_the_limbs_that_it_carries_ask_for():
    """Two limbs leave it at three quarters of its height, each as long as itself: below them it hardly tapers."""
    stem = trunk(np.where(np.arange(COUNT) < 12, 10.0, 1.0))
    limbs = [
        Axis(
            points=stem.points[30] + np.linspace(0, 400.0, 20)[:, None] * [side, 0.3, 0],
            half=np.full(20, np.nan),
            parent=0,
            parent_point=30,
            order=1,
            inferred=False,
        )
        for side in (-1, 1)
    ]
    radius = find_radii([stem, *limbs], exponent=0.5, tip_px=0.5, stem_px=5.0)[0]
    alone = radius_of(stem.half)
    carried = 1 + 2 * np.linalg.norm([1, 0.3])
    assert radius[29] == pytest.approx(0.7 * 10.0 * np.sqrt((carried - 0.725) / carried), rel=0.05)
    assert radius[29] > 1.5 * alone[29]
    assert radius[31] < 0.8 * radius[29]
