"""Which views see points above and on a plane that they look down on, and which see through them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.capture.cloud.visibility import VisibilitySettings, count_views, drop_seen_through

from tests.support.plain_clouds import cloud_of, looking_down

SIDE, FOCAL, HEIGHT_M = 40, 40.0, 2.0  # a view sees 2 x 2 m of the plane z = 0


def plane(x=0.0):
    return view_from(x), np.full((SIDE, SIDE), HEIGHT_M, np.float32)


def view_from(x):
    return looking_down(x, height_m=HEIGHT_M, size=(SIDE, SIDE), focal_px=FOCAL)


ON, ABOVE, BELOW, NEARLY, OUTSIDE = (0.1, 0.2, 0), (0.1, 0.2, 0.5), (0.1, 0.2, -0.5), (0.1, 0.2, 0.015), (9, 9, 0)


def test_a_point_is_had_seen_through_hidden_or_out_of_the_picture():
    having, through = count_views(np.array([ON, ABOVE, BELOW, NEARLY, OUTSIDE]), [plane(), plane(0.2), plane(-0.2)])
    assert having.tolist() == [3, 0, 0, 3, 0]
    assert through.tolist() == [0, 3, 0, 0, 0]


def test_points_that_views_see_through_go_and_the_others_know_their_views():
    cloud = cloud_of([ON, ABOVE, BELOW, OUTSIDE], views=1)
    left = drop_seen_through(cloud, [plane(), plane(0.2), plane(-0.2)])
    assert left.points_m.tolist() == [list(ON), list(BELOW), list(OUTSIDE)]
    assert left.views.tolist() == [3, 1, 1]
    assert len(drop_seen_through(cloud, [plane(), plane(0.2)])) == 4  # one that made it, two against it
    assert len(drop_seen_through(cloud, [plane()] * 9, VisibilitySettings(through=np.inf))) == 4


def test_a_view_without_depth_neither_has_a_point_nor_sees_through_it():
    camera, depth_m = plane()
    having, through = count_views(np.array([ON, ABOVE]), [(camera, np.zeros_like(depth_m))])
    assert not having.any()
    assert not through.any()


@given(st.integers(0, 2**32 - 1))
def test_the_order_of_views_and_points_is_the_same(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.5, 1.5, (50, 3)) * (1, 1, 0.5)
    views = [(view_from(x), rng.uniform(1.2, 2.4, (SIDE, SIDE)).astype(np.float32)) for x in (0.0, 0.3, -0.5)]
    order = rng.permutation(50)
    there, again = count_views(points, views), count_views(points[order], views[::-1])
    for first, second in zip(there, again, strict=True):
        assert np.array_equal(first[order], second)


@pytest.mark.parametrize("wrong", [{"through": -1}, {"through": np.nan}, {"agree_share": 0}, {"agree_share": np.inf}])
def test_wrong_settings(wrong):
    with pytest.raises(ValueError, match="must"):
        VisibilitySettings(**wrong)
