import numpy as np
import pytest
from usdfoliage.leaf.segmentation.paper.picture import PictureSettings, segment_picture
from usdfoliage.leaf.segmentation.paper.superpixels import SuperpixelSettings

from tests.support.leaves.views import Disc, draw_view

SETTINGS = PictureSettings(superpixels=SuperpixelSettings(size_px=6))


def test_leaves_of_other_colors_are_parted():
    discs = [
        Disc(center=(-0.02, 0, 1.0), turn=0.3, color=(60, 140, 50)),
        Disc(center=(0.02, 0.01, 0.9), turn=1.2, color=(110, 180, 80)),
    ]
    view, owner = draw_view(discs)
    found = segment_picture(view.srgb, SETTINGS)
    for number in range(2):
        truth = owner == number
        shares = [
            np.count_nonzero(truth & (found.labels == k)) / np.count_nonzero(truth | (found.labels == k))
            for k in range(1, found.labels.max() + 1)
        ]
        assert max(shares) > 0.75
    assert len(found.confidence) == found.labels.max()


def test_only_inside_the_mask():
    view, owner = draw_view([Disc(center=(0, 0, 1.0))])
    found = segment_picture(view.srgb, SETTINGS, mask=owner >= 0)
    assert not found.labels[owner < 0].any()
    assert found.labels.max() == 1
    assert found.confidence[0] > 0.9


@pytest.mark.parametrize("shape", [(1, 1), (40, 30)])
def test_a_picture_of_nothing(shape):
    found = segment_picture(np.full((*shape, 3), 90, np.uint8))
    assert not found.labels.any()
    assert len(found.confidence) == 0
    everywhere_else = segment_picture(np.full((*shape, 3), 90, np.uint8), mask=np.zeros(shape, np.bool_))
    assert len(everywhere_else.confidence) == 0


def test_refusals():
    with pytest.raises(ValueError, match="tolerance"):
        PictureSettings(tolerance=-1)
