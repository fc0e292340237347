import numpy as np
import pytest
from usdfoliage.capture.view import View
from usdfoliage.errors import FitError
from usdfoliage.leaf.segmentation.paper.affinity import AffinitySettings
from usdfoliage.leaf.segmentation.paper.plane_threshold import auto_plane_threshold, measure_footprints

from tests.support.leaves.views import Disc, draw_view

LEAVES = (Disc(center=(0, 0, 1.0)), Disc(center=(0.03, 0.02, 1.1)), Disc(center=(0, 0, 1.2), half=(0.3, 0.3)))


def test_two_footprints_hold_together():
    view, _ = draw_view(LEAVES)
    footprints, noise_m = measure_footprints(view)
    assert np.median(footprints) == pytest.approx(0.001, rel=0.12)  # of the leaves before, at 1 and 1.1 m
    assert noise_m < 1e-6
    assert auto_plane_threshold([view]) * AffinitySettings().reach == pytest.approx(0.002, rel=0.12)


def test_the_noise_is_found():
    view, _ = draw_view(LEAVES, noise_m=0.001)
    assert measure_footprints(view)[1] == pytest.approx(0.001, rel=0.15)


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_it_follows_the_scale_of_the_scene(scale):
    at_1 = auto_plane_threshold([draw_view(LEAVES, noise_m=0.0005)[0]])
    scaled = auto_plane_threshold([draw_view(LEAVES, noise_m=0.0005, scale=scale)[0]])
    assert scaled == pytest.approx(scale * at_1, rel=1e-3)


def test_a_far_wall_does_not_count():
    near = auto_plane_threshold([draw_view(LEAVES[:2])[0]])
    wall = Disc(center=(0, 0, 8.0), half=(9, 9))
    with_wall = auto_plane_threshold([draw_view((*LEAVES[:2], wall))[0]])
    assert with_wall == pytest.approx(near, rel=0.1)


def test_views_without_depth():
    view, _ = draw_view(LEAVES)
    blind = View(name="b", camera=view.camera, srgb=view.srgb, depth_m=np.zeros_like(view.depth_m))
    assert auto_plane_threshold([blind, view]) == auto_plane_threshold([view])
    with pytest.raises(FitError, match="no view has depth"):
        auto_plane_threshold([blind])
