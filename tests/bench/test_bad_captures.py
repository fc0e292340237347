"""Captures that are spoiled give fewer leaves, and a remark on the reason."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.capture.view_check import check_views
from usdfoliage.leaf.model import LeafOrigin, Leaves

from tools.bench import bad_captures
from tools.bench.bad_captures import Outcome, build_capture, find_misses, run_capture
from tools.synthetic.spoiled import KINDS, SMALL, SpoilSettings, spoil_capture

TINY = replace(SMALL, leaves=14, views=6, width_px=240, height_px=180)


def test_leaves_that_move_are_fewer_and_reported(tmp_path):
    outcome = run_capture(SpoilSettings(kind="moving leaves", scene=TINY), tmp_path / "capture")
    assert "plant-without-depth" in outcome.remarks
    assert outcome.found < 0.6 * outcome.visible


def test_inverted_masks_give_an_error_and_no_leaves_of_the_wall(tmp_path):
    outcome = run_capture(SpoilSettings(kind="masks inverted", scene=TINY), tmp_path / "capture")
    assert outcome.found == 0
    assert "seem to be inverted" in outcome.remarks[0]


def test_a_build_whose_masks_are_inverted_is_an_error_and_writes_nothing(tmp_path):
    outcome = build_capture(SpoilSettings(kind="masks inverted", scene=TINY), tmp_path / "capture")
    assert outcome.found == outcome.filled_in == 0
    assert "seem to be inverted" in outcome.remarks[0]
    assert not (tmp_path / "capture_asset").exists()


def test_filled_in_leaves_of_a_build_do_not_count_as_found(tmp_path, monkeypatch):
    settings = SpoilSettings(kind="good", scene=TINY)
    truth = spoil_capture(settings).truth
    origin = np.where(np.arange(TINY.leaves) % 2, LeafOrigin.FOUND, LeafOrigin.FILLED_IN)
    true = Leaves(
        parameters=truth["parameters"],
        base_m=truth["base"],
        orientation=truth["orientation"],
        length_m=truth["chord"],
        phase=np.zeros(TINY.leaves),
        origin=origin,
    )
    monkeypatch.setattr(bad_captures, "_build", lambda capture, asset: (True, ()))
    monkeypatch.setattr(bad_captures, "read_asset_leaves", lambda asset: true)
    outcome = build_capture(settings, tmp_path / "capture")
    assert (outcome.found, outcome.filled_in) == (7, 7)
    assert outcome.precision == 1
    assert outcome.recall < 0.8


def test_exposures_that_differ_are_reported(tmp_path):
    outcome = run_capture(SpoilSettings(kind="other exposures", scene=TINY), tmp_path / "capture")
    assert "exposures-differ" in outcome.remarks


@pytest.mark.parametrize("kind", KINDS)
def test_a_spoiled_capture_has_the_truth_of_the_good_one(kind):
    good, spoiled = (spoil_capture(SpoilSettings(kind=each, scene=replace(TINY, views=2))) for each in ("good", kind))
    np.testing.assert_array_equal(good.truth["parameters"], spoiled.truth["parameters"])
    if kind not in ("two plants", "cut by the border"):
        for one, other in zip(good.views, spoiled.views, strict=True):
            np.testing.assert_array_equal(one.depth_m, other.depth_m)
    if kind not in ("good", "good masks"):
        pairs = zip(good.views, spoiled.views, strict=True)
        assert any(one.srgb.shape != other.srgb.shape or (one.srgb != other.srgb).any() for one, other in pairs) or (
            "masks" in kind
        )


def test_what_is_worse_than_it_may_be_is_named():
    good = Outcome(kind="good", visible=10, found=10, recall=0.9, precision=1.0, seconds=1.0, remarks=())
    worse = replace(good, kind="bad", recall=0.5, precision=0.5)
    assert len(find_misses([good, worse])) == 2
    assert len(find_misses([good, replace(worse, precision=0.9, remarks=("a-code",))])) == 0
    assert find_misses([good, replace(good, kind="none", found=0, recall=0.0, precision=np.nan, remarks=("a",))]) == []


def test_kinds_that_are_unknown_are_refused():
    with pytest.raises(ValueError, match="kind must be one of good"):
        SpoilSettings(kind="worse")


@pytest.mark.parametrize(("kind", "codes"), [("good masks", []), ("masks shifted", ["masks-beside-plant"])])
def test_shifted_masks_are_reported_and_good_ones_are_not(kind, codes):
    views = spoil_capture(SpoilSettings(kind=kind, scene=TINY)).views
    assert [each.code for each in check_views(views) if each.code == "masks-beside-plant"] == codes
