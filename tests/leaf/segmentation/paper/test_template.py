import numpy as np
import pytest
from usdfoliage.errors import FitError
from usdfoliage.leaf.segmentation.paper.template import TemplateSettings, draw_template, measure_ratio


def test_the_surest_teach_the_ratio():
    half_axes = np.array([[2.0, 1.0]] * 3 + [[20.0, 10.0]] * 2 + [[9.0, 1.0]] * 40)
    confidence = np.array([0.9] * 5 + [0.5] * 40)
    assert measure_ratio(half_axes, confidence, TemplateSettings(surest=8)) == 2.0
    assert measure_ratio(half_axes * 10, confidence, TemplateSettings(surest=8)) == 2.0
    assert measure_ratio(half_axes, confidence) == 9.0


def test_nothing_to_learn_from():
    with pytest.raises(FitError, match="no candidate"):
        measure_ratio(np.empty((0, 2)), np.empty(0))
    with pytest.raises(FitError, match="no candidate"):
        measure_ratio(np.array([[1.0, 0.0]]), np.ones(1))
    with pytest.raises(ValueError, match="half_axes_m"):
        measure_ratio(np.ones((3, 2)), np.ones(2))


@pytest.mark.parametrize("ratio", [1.0, 2.5])
def test_the_template_fills_an_ellipse(ratio):
    points = draw_template(ratio)
    assert np.ptp(points[:, 0]) == pytest.approx(1)
    assert np.ptp(points[:, 1]) == pytest.approx(1 / ratio, rel=0.02)
    # of a filled ellipse: a quarter of the squared half axes
    assert points[:, 0].var() == pytest.approx(0.25 / 4, rel=0.2)
    assert points[:, 1].var() == pytest.approx(0.25 / ratio**2 / 4, rel=0.2)
    assert (points[:, 2] == 0).all()
    with pytest.raises(ValueError, match="ratio"):
        draw_template(0.5)
