import numpy as np
import pytest
from usdfoliage.capture.view import View
from usdfoliage.errors import FitError
from usdfoliage.leaf.segmentation.paper.segment import PaperSegmentationSettings, segment_paper
from usdfoliage.leaf.segmentation.paper.superpixels import SuperpixelSettings

from tests.support.leaves.views import Disc, camera, draw_view

SETTINGS = PaperSegmentationSettings(superpixels=SuperpixelSettings(size_px=8))
LEAVES = (
    Disc(center=(-0.05, -0.02, 1.0), tilt=0.3, turn=0.4),
    Disc(center=(0.05, -0.02, 1.05), tilt=-0.4, turn=1.0),
    Disc(center=(0.0, 0.04, 0.95), tilt=-0.5, turn=-0.5),
)


def views(scale: float = 1.0) -> list[View]:
    return [draw_view(LEAVES, camera(x=x, scale=scale), scale=scale, noise_m=0.0003)[0] for x in (-0.03, 0.03)]


def blind(view: View) -> View:
    return View(name=view.name, camera=view.camera, srgb=view.srgb, depth_m=np.zeros_like(view.depth_m))


def test_three_leaves_in_two_views():
    calls: list[tuple[int, int]] = []
    segmentation = segment_paper(views(), SETTINGS, lambda done, total: calls.append((done, total)))
    assert len(segmentation.leaves) == 3
    assert calls[-1] == (2, 2)
    assert len(segmentation.candidates) == 2
    centers = [
        segmentation.leaves.points_m[a:b].mean(axis=0)
        for a, b in zip(segmentation.leaves.offsets[:-1], segmentation.leaves.offsets[1:], strict=True)
    ]
    for leaf in LEAVES:
        assert min(np.linalg.norm(center - leaf.center) for center in centers) < 0.005
    assert (segmentation.leaves.confidence > 0.8).all()
    assert set(segmentation.leaves.view) <= {0, 1}


def test_the_same_again():
    one, other = segment_paper(views(), SETTINGS), segment_paper(views(), SETTINGS)
    assert np.array_equal(one.leaves.points_m, other.leaves.points_m)
    assert np.array_equal(one.leaves.offsets, other.leaves.offsets)
    assert one.dropped == other.dropped


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_scale_does_not_matter(scale):
    one, other = segment_paper(views(), SETTINGS), segment_paper(views(scale), SETTINGS)
    np.testing.assert_allclose(np.diff(one.leaves.offsets), np.diff(other.leaves.offsets), rtol=0.02)
    np.testing.assert_allclose(one.leaves.confidence, other.leaves.confidence, atol=0.02)


def test_a_view_without_depth_gives_nothing():
    both = views()
    with_blind = segment_paper([both[0], blind(both[1])], SETTINGS)
    assert with_blind.dropped["views without depth"] == 1
    assert (with_blind.leaves.point_view == 0).all()
    assert not with_blind.candidates[1].labels.any()
    assert len(with_blind.leaves) == 3


def test_no_depth_and_no_leaf():
    with pytest.raises(FitError, match="no view has depth"):
        segment_paper([blind(view) for view in views()], SETTINGS)
    wall, _ = draw_view([Disc(center=(0, 0, 1), half=(5, 5))])
    empty = segment_paper([wall], SETTINGS)
    assert len(empty.leaves) == 0
    assert empty.dropped["components too large for a leaf"] == 1
    with pytest.raises(ValueError, match="plane_threshold_m"):
        PaperSegmentationSettings(plane_threshold_m=-1.0)
