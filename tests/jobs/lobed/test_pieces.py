"""Which pixels of a scan are a leaf."""

import numpy as np
import pytest
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.lobed.pieces import PieceSettings, cut_out_scan, split_pieces

from tests.support.leaves.lobed import lobed_mask


def test_leaves_are_counted_from_left_to_right_and_dust_is_left_out():
    one = lobed_mask(size=120)
    mask = np.zeros((140, 400), bool)
    mask[10:130, 240:360] = one
    mask[5:125, 20:140] = one
    mask[70:74, 180:184] = True
    pieces = split_pieces(mask, PieceSettings(min_px=100))
    assert len(pieces.numbers) == 2
    assert pieces.dust == 1
    assert pieces.boxes_px[0][0] < pieces.boxes_px[1][0]
    assert np.array_equal(pieces.mask(0) | pieces.mask(1), mask & ~(pieces.labels == pieces.labels[71, 181]))
    assert not pieces.is_cut(0)


def test_a_leaf_at_the_border_is_cut():
    mask = np.zeros((140, 140), bool)
    mask[:120, 10:130] = lobed_mask(size=120)
    mask[0, 60:70] = True
    mask[0:20, 65] = True
    assert split_pieces(mask, PieceSettings(min_px=100)).is_cut(0)


@pytest.mark.parametrize("mask", [np.zeros((40, 40), bool), np.eye(18, dtype=bool)])
def test_too_few_pixels_are_refused(mask):
    with pytest.raises(CaptureError, match="and a leaf needs 400"):
        split_pieces(mask)


def test_too_many_pieces_are_refused():
    mask = np.zeros((400, 400), bool)
    mask[::4, ::4] = True
    with pytest.raises(CaptureError, match="pieces, and at most 99"):
        split_pieces(mask, PieceSettings(min_px=1))


def test_a_leaf_stands_out_from_its_background():
    mask = lobed_mask()
    rng = np.random.default_rng(0)
    linear = np.where(mask[..., None], [0.05, 0.2, 0.03], [0.8, 0.8, 0.75]) + 0.01 * rng.random((240, 240, 3))
    found, findings = cut_out_scan(linear.astype(np.float32))
    assert (found & mask).sum() / (found | mask).sum() > 0.98
    assert not findings


@pytest.mark.parametrize("background", [0.0, 0.5, 1.0])
def test_an_empty_scan_has_no_leaf(background):
    rng = np.random.default_rng(0)
    linear = np.clip(background + 0.02 * rng.normal(size=(120, 160, 3)), 0, 1).astype(np.float32)
    with pytest.raises(CaptureError, match="no leaf was found"):
        cut_out_scan(linear)
