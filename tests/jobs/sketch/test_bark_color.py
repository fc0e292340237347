"""The colour of the bark of a sketched tree."""

from types import SimpleNamespace

import numpy as np
import pytest
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.jobs.sketch.model import _bark_color
from usdfoliage.sketch.strokes import TreeStrokes

SKY, BARK = (230, 150, 160), (60, 45, 35)


@pytest.mark.parametrize(("first", "color"), [(0, BARK), (-5, SKY)])
def test_it_is_that_of_the_stem_below_the_crown_as_far_as_there_is_one(first, color):
    srgb = np.full((100, 50, 3), SKY, np.uint8)
    srgb[60:, 20:30] = BARK
    inside = np.zeros((100, 50), bool)
    inside[:60] = True  # the crown, through which the sky is seen
    line = np.stack([np.full(45, 25.0), np.linspace(98, 5, 45)], axis=-1)[first:]
    tree = SimpleNamespace(
        traced=SimpleNamespace(
            branches=[SimpleNamespace(points_px=line, parent=-1)], likely=np.zeros((100, 50), np.float32)
        ),
        foliage=SimpleNamespace(mask=np.zeros((100, 50), bool), inside=inside),
    )
    found = _bark_color(srgb, TreeStrokes(crown_px=line, branches_px=(line,)), tree)
    assert found == pytest.approx(tuple(decode_srgb(np.array(color) / 255)), abs=1e-6)


def test_all_places_along_a_stem_count_not_its_corners_alone():
    litter = (200, 180, 120)
    srgb = np.full((100, 50, 3), SKY, np.uint8)
    srgb[20:, 20:30] = BARK
    srgb[94:] = litter
    line = np.array([[25.0, 99.0], [25.0, 97.0], [25.0, 20.5]])
    tree = SimpleNamespace(
        traced=SimpleNamespace(
            branches=[SimpleNamespace(points_px=line, parent=-1)], likely=np.zeros((100, 50), np.float32)
        ),
        foliage=SimpleNamespace(mask=np.zeros((100, 50), bool), inside=np.zeros((100, 50), bool)),
    )
    found = _bark_color(srgb, TreeStrokes(crown_px=line, branches_px=(line,)), tree)
    assert found == pytest.approx(tuple(decode_srgb(np.array(BARK) / 255)), abs=1e-6)
