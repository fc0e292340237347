"""Segments of photographs, and the planes that hold them together."""

import numpy as np
import pytest
from usdfoliage.capture.mvs.segment_planes import SegmentSettings, fit_segment_planes, segment_photo

SIZE = 60, 80


def two_colors():
    srgb = np.full((*SIZE, 3), (60, 120, 40), np.uint8)
    srgb[:, 43:] = (150, 140, 130)
    noise = np.random.default_rng(1).normal(0, 4, srgb.shape)
    return np.clip(srgb + noise, 0, 255).astype(np.uint8)


def test_segments_end_where_colors_do():
    labels = segment_photo(two_colors())
    assert labels.shape == SIZE
    left, right = set(np.unique(labels[4:-4, 4:42])), set(np.unique(labels[4:-4, 45:-4]))
    assert not left & right
    assert 4 <= len(left) <= 60
    assert np.array_equal(labels, segment_photo(two_colors()))


def field(value, right, down, columns, rows):
    planes = np.zeros((*SIZE, 3), np.float32)
    planes[..., 0] = value + right * columns + down * rows
    planes[..., 1], planes[..., 2] = right, down
    return planes


def test_a_plane_is_found_among_outliers_and_thin_segments_lie_flat_across():
    rows, columns = np.indices(SIZE)
    labels = (columns >= 43).astype(np.int32)
    labels[:, 42] = 2
    planes = field(1.0, 0.002, -0.001, columns, rows)
    true = planes.copy()
    rng = np.random.default_rng(3)
    wrong = rng.random(SIZE) < 0.3
    planes[wrong, 0] = rng.uniform(0.4, 2.0, wrong.sum())
    cost = np.where(wrong, 0.9, 0.3).astype(np.float32)
    fitted = fit_segment_planes(planes, cost, labels, 0.01)
    wide = labels < 2
    assert fitted[wide] == pytest.approx(true[wide], abs=2e-3)
    thin = labels == 2
    assert np.abs(fitted[thin][:, 1]).max() < 5e-4
    assert fitted[thin][:, 0] == pytest.approx(true[thin][:, 0], abs=5e-3)


def test_segments_without_enough_depth_have_no_plane():
    rows, columns = np.indices(SIZE)
    labels = (columns // 20).astype(np.int32)
    planes = field(1.0, 0.0, 0.0, columns, rows)
    planes[labels == 1] = 0
    planes[labels == 2, 0] = np.random.default_rng(0).uniform(0.2, 3.0, (labels == 2).sum())
    fitted = fit_segment_planes(planes, np.zeros(SIZE, np.float32), labels, 0.01)
    assert fitted[labels == 0, 0] == pytest.approx(1.0)
    assert fitted[labels == 3, 0] == pytest.approx(1.0)
    assert not fitted[labels == 1].any()
    assert not fitted[labels == 2].any()
    assert not fit_segment_planes(np.zeros((*SIZE, 3), np.float32), np.zeros(SIZE, np.float32), labels, 0.01).any()


@pytest.mark.parametrize("wrong", [{"size_px": 2}, {"color": 0.0}, {"min_share": 2.0}, {"refits": 0}])
def test_wrong_settings(wrong):
    with pytest.raises(ValueError, match="must be"):
        SegmentSettings(**wrong)
