import cv2
import numpy as np
import pytest
from usdfoliage.leaf.segmentation.paper.superpixels import SuperpixelSettings, renumber, segment_superpixels


def two_colors(height: int = 60, width: int = 90) -> np.ndarray:
    srgb = np.full((height, width, 3), (40, 120, 40), np.uint8)
    srgb[:, 37:] = (200, 190, 90)
    return srgb


def test_superpixels_do_not_cross_from_one_color_to_another():
    labels = segment_superpixels(two_colors(), settings=SuperpixelSettings(size_px=10))
    left, right = np.unique(labels[:, :36]), np.unique(labels[:, 38:])  # a pixel each side is blurred
    assert not set(left) & set(right)
    assert labels.dtype == np.int32
    assert np.array_equal(np.unique(labels), np.arange(labels.max() + 1))
    assert 30 < labels.max() < 90


def test_every_superpixel_is_one_piece():
    labels = segment_superpixels(two_colors(), settings=SuperpixelSettings(size_px=12))
    for number in range(labels.max() + 1):
        count, _ = cv2.connectedComponents((labels == number).astype(np.uint8), connectivity=8)
        assert count == 2


def test_only_where_wanted():
    valid = np.zeros((60, 90), np.bool_)
    valid[10:40, 20:70] = True
    labels = segment_superpixels(two_colors(), valid, SuperpixelSettings(size_px=10))
    assert (labels[~valid] == -1).all()
    assert (labels[valid] >= 0).all()
    assert np.array_equal(np.unique(labels), np.arange(-1, labels.max() + 1))


def test_the_side_follows_the_picture():
    settings = SuperpixelSettings(finest=120)
    assert settings.side_px(900, 1200) == 10
    assert settings.side_px(2700, 3600) == 30
    assert settings.side_px(50, 60) == 5


@pytest.mark.parametrize("shape", [(1, 1), (2, 50), (3, 3)])
def test_tiny_pictures(shape):
    labels = segment_superpixels(np.zeros((*shape, 3), np.uint8))
    assert labels.shape == shape
    assert labels.min() == 0


def test_numbers_follow_first_pixels():
    labels = np.array([[7, 7, -1], [3, 9, 3]], np.int32)
    assert renumber(labels).tolist() == [[0, 0, -1], [1, 2, 1]]


def test_the_same_for_any_number_of_threads():
    srgb = np.random.default_rng(1).integers(0, 255, (80, 100, 3)).astype(np.uint8)
    before = cv2.getNumThreads()
    try:
        results = []
        for threads in (1, 4):
            cv2.setNumThreads(threads)
            results.append(segment_superpixels(srgb, settings=SuperpixelSettings(size_px=8)))
    finally:
        cv2.setNumThreads(before)
    assert np.array_equal(*results)


def test_refusals():
    with pytest.raises(ValueError, match="srgb"):
        segment_superpixels(np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match="valid"):
        segment_superpixels(np.zeros((4, 4, 3), np.uint8), np.ones((3, 4), np.bool_))
    with pytest.raises(ValueError, match="size_px"):
        SuperpixelSettings(size_px=1)
