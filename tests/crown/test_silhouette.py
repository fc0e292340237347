import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.crown.silhouette import SilhouetteSettings, fit_star_silhouette
from usdfoliage.errors import FitError

from tests.support.crown_shapes import disc_mask, ellipse_mask


def test_a_disc_is_seen_from_its_middle():
    silhouette = fit_star_silhouette(disc_mask(90, center_px=(140, 155)))

    assert silhouette.center_px == pytest.approx([140, 155], abs=0.5)
    assert silhouette.radius_px == pytest.approx(np.full(1024, 90), abs=1.2)
    assert silhouette.iou > 0.995
    assert silhouette.lost_share < 0.005


def test_radius_of_an_ellipse_by_angle():
    silhouette = fit_star_silhouette(ellipse_mask(120, 60))

    angle = 2 * np.pi * np.arange(1024) / 1024
    expected = 1 / np.hypot(np.cos(angle) / 120, np.sin(angle) / 60)
    assert silhouette.radius_px == pytest.approx(expected, abs=1.5)


def test_angles_run_anticlockwise_as_one_sees_the_picture():
    mask = disc_mask(60)
    mask[20:100, 148:152] = True  # a spike upwards

    silhouette = fit_star_silhouette(mask)

    assert np.argmax(silhouette.radius_px) == pytest.approx(256, abs=4)
    top = silhouette.curve_px()[:, 1].min()
    assert top == pytest.approx(20, abs=1.5)


def test_center_of_a_crescent_lies_inside_it():
    mask = disc_mask(100) & ~disc_mask(95, center_px=(205.0, 150.0))
    rows, columns = np.nonzero(mask)
    assert not mask[150, 150], "the middle of the full disc is not in the crescent"

    silhouette = fit_star_silhouette(mask)

    x, y = silhouette.center_px
    assert mask[int(y), int(x)]
    from_centroid = fit_star_silhouette(mask, SilhouetteSettings(equal_share=10.0))  # any loss is good enough
    assert silhouette.lost_share <= from_centroid.lost_share
    assert from_centroid.center_px == pytest.approx([columns.mean(), rows.mean()], abs=3)


def test_lost_share_is_what_curve_and_mask_do_not_share():
    # A disc with a slot that no ray from the middle can enter otherwise than through foliage.
    mask = disc_mask(100)
    mask[140:160, 180:220] = False

    silhouette = fit_star_silhouette(mask)

    curve = np.rint(silhouette.curve_px() * 16 - 8).astype(np.int32)
    drawn = cv2.fillPoly(np.zeros(mask.shape, np.uint8), [curve], 1, shift=4) > 0
    assert silhouette.lost_share == pytest.approx((drawn ^ mask).sum() / mask.sum(), abs=0.02)
    assert silhouette.iou == pytest.approx((drawn & mask).sum() / (drawn | mask).sum(), abs=0.02)


@settings(max_examples=12, deadline=None)
@given(x=st.floats(100, 200), y=st.floats(100, 200), radius_px=st.floats(20, 90), scale=st.sampled_from([1, 2]))
def test_radius_does_not_depend_on_where_the_crown_stands(x, y, radius_px, scale):
    mask = disc_mask(radius_px, center_px=(x, y))
    mask = np.kron(mask, np.ones((scale, scale))).astype(bool)

    silhouette = fit_star_silhouette(mask, SilhouetteSettings(angles=256))

    assert silhouette.center_px == pytest.approx([x * scale, y * scale], abs=2.0 * scale)
    assert np.median(silhouette.radius_px) == pytest.approx(radius_px * scale, abs=1.5 * scale)


def test_an_empty_mask_is_refused():
    with pytest.raises(FitError, match="empty"):
        fit_star_silhouette(np.zeros((50, 50), bool))


def test_a_line_is_refused():
    mask = np.zeros((50, 50), bool)
    mask[25, 5:45] = True
    with pytest.raises(FitError, match="40 x 1"):
        fit_star_silhouette(mask)


def test_a_mask_of_three_dimensions_is_refused():
    with pytest.raises(ValueError, match=r"\(H, W\)"):
        fit_star_silhouette(np.zeros((5, 5, 3), bool))
