"""The whole run on arrays, after a segmentation that knows the truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.leaf import reconstruct
from usdfoliage.leaf.photographs.average_texture import AverageTextureSettings
from usdfoliage.leaf.photographs.colors import LeafColors
from usdfoliage.leaf.reconstruct import (
    STEPS,
    ReconstructionSettings,
    choose_sound,
    describe_leaves,
    describe_low_confidence,
    median_length_px,
    reconstruct_leaves,
)

from tests.support.leaves.captures import known_foliage
from tests.support.leaves.proposals import flat_leaves
from tests.support.leaves.true_segmentation import segment_truly

METHODS = ("dense", "paper")
FAST = ReconstructionSettings(texture=AverageTextureSettings(width_px=16, height_px=32, max_pictures=4))


@pytest.fixture(scope="module")
def bed():
    return known_foliage()


@pytest.fixture
def segment(monkeypatch, bed):
    """Put a segmentation in place of both methods'."""
    ids = {view.name: ids for view, ids in zip(bed.views, bed.leaf_ids, strict=True)}

    def use(confidence=0.9, change=lambda segmentation: segmentation):
        def segmented(views, settings, progress, threads=0):
            progress(len(views), len(views))
            return change(segment_truly(views, ids, confidence))

        for method in METHODS:
            monkeypatch.setattr(reconstruct, f"segment_{method}", segmented)

    use()
    return use


@pytest.mark.parametrize("method", METHODS)
def test_leaves_are_found_fitted_and_coloured(segment, bed, method):
    calls = []
    found = reconstruct_leaves(bed.views, replace(FAST, method=method), lambda step, share: calls.append((step, share)))
    leaves = found.leaves
    assert len(leaves) == len(found.source) > 0.6 * len(bed.leaves)
    # Half of them at least lie where a true leaf does.
    middles = [each.base_m + each.asset_from_leaf()[:, :, 1] / 2 for each in (leaves, bed.leaves)]
    away = np.linalg.norm(middles[0][:, None] - middles[1], axis=2).min(axis=1)
    assert np.median(away / leaves.length_m) < 0.15
    for facts in (leaves.color, leaves.confidence, leaves.residual_m, leaves.view):
        assert facts is not None
    assert ((leaves.color > 0) & (leaves.color < 1)).all()
    assert np.median(leaves.color[:, 1] - leaves.color[:, [0, 2]].max(axis=1)) > 0  # green
    assert found.texture is not None
    assert found.remarks == []
    assert tuple(found.seconds) == STEPS
    assert [step for step, share in calls if share == 0.0] == list(STEPS)
    assert {step for step, share in calls if share == 1.0} == set(STEPS)


def test_every_step_is_counted(segment, bed):
    segment(change=lambda found: replace(found, dropped={"without a plane": 3, "too large": 0}))
    found = reconstruct_leaves(bed.views, replace(FAST, min_confidence=0.99))
    counts = {step.name: step.count for step in found.steps}
    assert counts["candidates in single views"] > counts["leaves of the scene"] == len(found.segmentation.leaves)
    assert counts["leaves of the scene"] >= counts["fitted leaves"] >= counts["kept leaves"] == len(found.leaves)
    kept = found.steps[-1]
    assert counts["fitted leaves"] - kept.count == sum(kept.dropped.values()) > 0
    assert list(kept.dropped) == ["of less confidence than 0.99"]
    assert (found.leaves.confidence >= 0.99).all()
    assert found.steps[-3].dropped == {"without a plane": 3}


def test_what_no_asset_takes_is_left_out(bed):
    leaves = bed.leaves.take(np.arange(4))
    parameters = leaves.parameters.copy()
    parameters[0, 3, 0] = parameters[0, 2, 0]
    parameters[1, 6, 2] = np.nan
    leaves = replace(leaves, parameters=parameters, confidence=np.array([0.9, 0.1, 0.1, 0.9]))
    sound, dropped = choose_sound(leaves, 0.5)
    assert sound.tolist() == [False, False, False, True]
    assert dropped == {
        "with numbers that are none": 1,
        "whose silhouette's points are not in order": 1,
        "of less confidence than 0.5": 1,
    }
    assert choose_sound(bed.leaves, 0.5) == (pytest.approx(np.ones(len(bed.leaves))), {})


def test_a_leaf_keeps_its_number(segment, bed):
    found = reconstruct_leaves(bed.views, replace(FAST, min_confidence=0.3))
    points = found.segmentation.leaves
    for number, source in list(enumerate(found.source))[:10]:
        mine = points.points_m[points.offsets[source] : points.offsets[source + 1]]
        middle = found.leaves.base_m[number] + found.leaves.asset_from_leaf()[number, :, 1] / 2
        assert np.linalg.norm(mine.mean(axis=0) - middle) < 0.6 * found.leaves.length_m[number]
        assert found.leaves.view[number] == points.view[source]
    assert found.certainty.shape == (len(found.leaves),)
    assert ((found.certainty >= 0.5) & (found.certainty <= 1)).all()


def test_one_view_gives_remarks_on_its_limits(segment, bed):
    found = reconstruct_leaves(bed.views[:1], FAST)
    assert len(found.leaves) > 0
    assert any(each.text.startswith("there is one view only") for each in found.remarks)


def test_views_without_depth_are_counted(segment, bed):
    blind = replace(bed.views[0], depth_m=np.zeros_like(bed.views[0].depth_m))
    found = reconstruct_leaves([blind, *bed.views[1:]], FAST)
    assert any(each.text.startswith("1 of 4 views have no depth") for each in found.remarks)
    assert len(found.leaves) > 0


def test_no_depth_at_all_is_no_leaf(bed):
    blind = [replace(view, depth_m=np.zeros_like(view.depth_m)) for view in bed.views]
    found = reconstruct_leaves(blind)
    assert len(found.leaves) == 0
    assert found.texture is None
    assert [step.count for step in found.steps] == [0, 0, 0, 0]
    assert found.remarks[0].text == "no view has depth, and leaves are found in depth"
    assert found.remarks[1].text.startswith("no leaf was found, not even a candidate")
    assert all(each.severity == "warning" for each in found.remarks)


def test_no_leaf_among_candidates_is_reported(segment, bed):
    nothing = reconstruct.find_nothing(bed.views).leaves
    segment(change=lambda found: replace(found, leaves=nothing, dropped={"no plane": 7}))
    found = reconstruct_leaves(bed.views)
    assert len(found.leaves) == 0
    assert any("no leaf was found, of" in each.text for each in found.remarks)
    assert found.steps[-3].dropped == {"no plane": 7}


@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        ({}, []),
        ({"confidence": 0.1}, ["the others are guessed"]),
        ({"width": 0.1}, ["grass-like"]),
        ({"width": 6.0}, ["lobed"]),
        ({"confidence": 0.1, "width": 6.0}, ["the others are guessed", "lobed"]),
        ({"width": 2.0}, ["about as wide as long"]),
        ({"outlined": 0.45}, ["seem to be lobed"]),
        ({"outlined": 0.45, "width": 2.0}, ["seem to be lobed"]),
    ],
)
def test_uncertain_leaves_are_reported(bed, changes, texts):
    width = changes.get("width", 1.0)
    parameters = bed.leaves.parameters.copy()
    parameters[:, 2:5, 1] *= width
    confidence = np.full(len(parameters), changes.get("confidence", 0.8))
    leaves = replace(bed.leaves, parameters=parameters, confidence=confidence)
    outlined = np.full(len(leaves), changes["outlined"]) if "outlined" in changes else None
    remarks = describe_leaves(leaves, bed.views, reconstruct.find_nothing(bed.views), outlined=outlined)
    assert len(remarks) == len(texts)
    assert all(words in each.text for words, each in zip(texts, remarks, strict=True))


@pytest.mark.parametrize(("brightest", "expected"), [(1.5, []), (1.7, ["exposures-differ"])])
def test_exposures_that_differ_much_are_reported(bed, brightest, expected):
    gain = np.ones(len(bed.views))
    gain[-1] = brightest
    remarks = describe_leaves(bed.leaves, bed.views, reconstruct.find_nothing(bed.views), gain=gain)
    assert [each.code for each in remarks] == expected
    for each in remarks:
        assert "1.7 times as bright" in each.text
        assert bed.views[-1].name in each.subject


@pytest.mark.parametrize(("longer", "codes"), [(1.05, []), (0.95, ["leaves-small"])])
def test_leaves_too_short_in_their_photographs_are_reported(bed, longer, codes):
    """Each leaf where it is, of the length that is so many times 40 pixels in its photograph."""
    camera = bed.views[0].camera
    middle_m = bed.leaves.asset_from_leaf() @ (0.0, 0.5, 0.0, 1.0)
    away_m = np.linalg.norm(middle_m - camera.position_m, axis=1)
    length_m = longer * 40 * away_m / camera.focal_px[0]
    half = 0.5 * (bed.leaves.length_m - length_m)[:, None]
    along = Rotation.from_quat(bed.leaves.orientation).apply([0.0, 1.0, 0.0])
    count = len(length_m)
    leaves = replace(
        bed.leaves,
        base_m=bed.leaves.base_m + half * along,
        length_m=length_m,
        confidence=np.full(count, 0.8),
        view=np.zeros(count, np.int32),
    )
    assert median_length_px(leaves, bed.views) == pytest.approx(40 * longer, rel=1e-6)
    remarks = describe_leaves(leaves, bed.views, reconstruct.find_nothing(bed.views))
    assert [each.code for each in remarks] == codes
    assert median_length_px(replace(leaves, view=None), bed.views) is None
    assert median_length_px(replace(leaves, view=np.full(count, -1, np.int32)), bed.views) is None


def test_the_share_of_right_leaves_decides_and_not_the_median():
    """Of one sure leaf and two others more than half are right; of the two others fewer."""
    leaves = replace(flat_leaves(np.zeros((3, 3))), confidence=np.array([1.0, 0.3, 0.3]))
    assert describe_low_confidence(leaves) == ""
    assert describe_low_confidence(leaves.take([1, 2])).startswith("some 1 of 2 leaves")
    assert describe_low_confidence(replace(leaves, confidence=None)) == ""


@pytest.mark.parametrize("wrong", [{"method": "magic"}, {"min_confidence": 1.5}, {"min_confidence": float("nan")}])
def test_settings_that_cannot_be(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ReconstructionSettings(**wrong)


def test_no_views_are_a_wrong_argument():
    with pytest.raises(ValueError, match="no views"):
        reconstruct_leaves([])


def test_a_few_brown_pieces_among_green_leaves_are_no_leaves_but_a_plant_may_have_red_ones():
    green, brown = (0.1, 0.3, 0.05), (0.2, 0.12, 0.06)
    few = np.array([green] * 19 + [brown])
    assert reconstruct.find_green_leaves(few, 0.1).tolist() == [True] * 19 + [False]
    assert reconstruct.find_green_leaves(few, 0).all()
    assert reconstruct.find_green_leaves(np.array([green] * 8 + [brown] * 2), 0.1).all()
    assert reconstruct.find_green_leaves(np.array([brown] * 5), 0.1).all()
    assert reconstruct.find_green_leaves(np.zeros((0, 3)), 0.1).shape == (0,)


@pytest.mark.parametrize(("max_not_green", "left_out"), [(0.1, 1), (0.0, 0)])
def test_leaves_that_are_not_green_are_left_out_with_a_remark_and_can_be_kept(
    bed, segment, monkeypatch, max_not_green, left_out
):
    def redden(leaves, *given):
        color = np.tile((0.1, 0.3, 0.05), (len(leaves), 1))
        color[0] = (0.3, 0.1, 0.1)
        return LeafColors(color=color, seen=np.ones(len(leaves), bool), gain=np.ones(len(bed.views)))

    segment()
    monkeypatch.setattr(reconstruct, "sample_leaf_colors", redden)
    found = reconstruct_leaves(bed.views, replace(FAST, max_not_green=max_not_green))
    fitted = len(found.leaves) + left_out
    assert fitted >= 10
    assert found.steps[-1].dropped.get("of another colour than all others", 0) == left_out
    remarks = [each for each in found.remarks if each.code == "leaves-not-green-left-out"]
    assert [each.text for each in remarks] == [
        f"1 of {fitted} leaves are left out: they are not green, and all others are"
    ][:left_out]
    assert [each.severity for each in remarks] == ["info"] * left_out
