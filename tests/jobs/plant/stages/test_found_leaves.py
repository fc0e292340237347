"""Which of the leaves that were found are of the plant, and what is reported of the others."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.model_file import TracedPlant
from usdfoliage.jobs.fitted_leaves import FittedLeaves
from usdfoliage.jobs.plant.settings import BuildSettings, FoliageSettings
from usdfoliage.jobs.plant.stages.foliage import choose_foliage
from usdfoliage.jobs.plant.stages.found_leaves import (
    keep_found_leaves,
    lie_apart,
    lie_below_stems,
    lie_beside_plant,
)
from usdfoliage.jobs.plant.stages.models import CapturedLeaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, slim_leaves

from tests.support.leaves.proposals import flat_leaves

LENGTH_M = 0.1
FRAME = np.eye(4)
ROOTS_M = np.array([[0.0, 0, 0], [0.05, 0, 0.02]])
GREEN, BROWN = (0.1, 0.2, 0.02), (0.04, 0.03, 0.015)


def stem() -> Skeleton:
    """One stem, 1 m high, on the axis of y."""
    points_m = np.column_stack([np.zeros(101), np.linspace(0, 1, 101), np.zeros(101)])
    return Skeleton(
        points_m=points_m,
        radius_m=np.full(101, 0.002),
        counts=np.array([101], np.int32),
        parent_curve=np.array([-1], np.int32),
        parent_vertex=np.array([-1], np.int32),
        order=np.zeros(1, np.int32),
    )


def plant(unjoined=(), *, of_photographs: bool = True, turned=()) -> TracedPlant:
    return TracedPlant(
        points_m=np.random.default_rng(0).uniform(5, 6, (50, 3)),
        wood=np.zeros(50, bool),
        knows_leaves=True,
        colors=None,
        plant_from_capture=FRAME,
        skeleton=stem(),
        of_photographs=of_photographs,
        unjoined=np.array(unjoined, np.int32),
        turned=np.array(turned, np.int32),
    )


def captured(leaves: Leaves) -> CapturedLeaves:
    fitted = FittedLeaves(leaves=leaves, edits=NEUTRAL, appearance=LeafAppearance())
    return CapturedLeaves(fitted=fitted, own_from_capture=FRAME)


def colored(*leaves_at: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Leaves:
    """Ten green leaves up the stem, whose greens differ a little, and leaves with these bases and colours."""
    bases_m = [(0.01, 0.2 + 0.05 * number, 0.0) for number in range(10)]
    greens = [tuple(np.array(GREEN) * (1, 0.9 + 0.02 * number, 1)) for number in range(10)]
    leaves = flat_leaves([*bases_m, *(base for base, _ in leaves_at)], LENGTH_M)
    return replace(leaves, color=np.array([*greens, *(color for _, color in leaves_at)]))


@pytest.mark.parametrize(
    ("base_m", "color", "is_soil"),
    [
        ((0.01, -0.12, 0.0), BROWN, True),  # all of it below the foot
        ((0.01, -0.07, 0.0), BROWN, True),  # most of it
        ((0.01, -0.03, 0.0), BROWN, False),  # less than half of it
        ((0.01, -0.12, 0.0), GREEN, False),  # a leaf: the soil is lower than stems begin
        ((0.2, -0.12, 0.0), BROWN, False),  # a dry leaf that hangs over the rim
        ((0.01, 0.3, 0.0), BROWN, False),  # a dry leaf on the plant
    ],
)
def test_what_lies_below_the_stems_is_soil_where_place_and_colour_agree(base_m, color, is_soil):
    leaves = colored((base_m, color))
    assert lie_below_stems(leaves, ROOTS_M).tolist() == [False] * 10 + [is_soil]


def test_without_colours_or_leaves_to_compare_with_nothing_is_soil():
    leaves = colored(((0.01, -0.12, 0.0), BROWN))
    assert not lie_below_stems(replace(leaves, color=None), ROOTS_M).any()
    assert not lie_below_stems(leaves.take(np.arange(6, 11)), ROOTS_M).any()
    assert not lie_below_stems(leaves, np.zeros((0, 3))).any()
    assert not lie_below_stems(leaves.take(np.zeros(0, int)), ROOTS_M).any()


def test_soil_is_judged_the_same_at_any_scale():
    leaves = colored(((0.01, -0.12, 0.0), BROWN), ((0.2, -0.12, 0.0), BROWN))
    large = replace(leaves, base_m=30 * leaves.base_m, length_m=30 * leaves.length_m)
    assert lie_below_stems(large, 30 * ROOTS_M).tolist() == lie_below_stems(leaves, ROOTS_M).tolist()


def test_soil_is_left_out_and_counted_where_stems_are_of_photographs():
    leaves = captured(colored(((0.01, -0.12, 0.0), BROWN)))
    found = keep_found_leaves(leaves, plant(), FRAME)
    assert found.leaves is not None
    assert len(found.leaves) == 10
    (remark,) = found.remarks
    assert remark.code == "leaves-below-stems-left-out"
    assert remark.text.startswith("1 of 11 leaves")
    assert "(0.010, -0.070, 0.000)" in remark.text
    of_cloud = keep_found_leaves(leaves, plant(of_photographs=False), FRAME)
    assert of_cloud.leaves is not None
    assert len(of_cloud.leaves) == 11


def test_pieces_of_stems_among_the_leaves_are_left_out_and_counted():
    leaves = colored(((0.01, 0.3, 0.0), BROWN))
    slim = slim_leaves(leaves.parameters[10:], np.array([0.2]))
    leaves = replace(leaves, parameters=np.concatenate([leaves.parameters[:10], slim]))
    for of_photographs in (True, False):
        found = keep_found_leaves(captured(leaves), plant(of_photographs=of_photographs), FRAME)
        assert found.leaves is not None
        np.testing.assert_array_equal(found.leaves.base_m, leaves.base_m[:10])
        (remark,) = found.remarks
        assert remark.code == "slivers-left-out"
        assert remark.text.startswith("1 of 11 leaves")
        assert "(0.010, 0.350, 0.000)" in remark.text


@pytest.mark.parametrize(("away_m", "apart"), [(0.15, False), (0.28, True)])
def test_apart_is_what_is_two_leaf_lengths_from_stems_and_their_leaves(away_m, apart):
    leaves = flat_leaves([(0.0, 0.2, 0.0), (0.02 + away_m, 0.2, 0.0)], LENGTH_M, width=0.4)
    joined = np.array([True, False])
    assert lie_apart(leaves, joined, stem().points_m).tolist() == [False, apart]
    assert not lie_apart(leaves, ~joined, np.zeros((0, 3)))[1]


def test_leaves_that_no_stem_leads_to_are_kept_near_the_plant_and_left_out_apart_from_it():
    leaves = colored(((0.1, 0.5, 0.0), GREEN), ((0.6, 0.5, 0.0), GREEN), ((0.9, 0.5, 0.0), GREEN))
    found = keep_found_leaves(captured(leaves), plant(unjoined=(10, 11, 12)), FRAME)
    assert found.leaves is not None
    np.testing.assert_array_equal(found.leaves.base_m, leaves.base_m[:11])
    assert found.led_to == 10
    (remark,) = found.remarks
    assert remark.code == "leaves-not-joined"
    assert remark.text == (
        "no stem leads to 3 of 13 leaves that were found; 1 near the plant are kept: at (0.100, 0.550, 0.000); "
        "2 apart from it are left out: at (0.600, 0.550, 0.000), (0.900, 0.550, 0.000)"
    )


def test_leaves_of_another_plant_in_a_scan_are_left_out():
    leaves = colored(((0.2, 0.5, 0.0), GREEN), ((50.0, 0.5, 0.0), GREEN))
    near = replace(plant(of_photographs=False), points_m=stem().points_m)
    found = keep_found_leaves(captured(leaves), near, FRAME)
    np.testing.assert_array_equal(found.kept, np.arange(11))
    (remark,) = found.remarks
    assert remark.code == "leaves-beside-plant-left-out"
    assert remark.text.startswith("1 of 12 leaves")
    assert "(50.000, 0.550, 0.000)" in remark.text


@pytest.mark.parametrize(("away_m", "beside"), [(0.19, False), (0.21, True)])
def test_beside_a_plant_is_what_is_two_leaf_lengths_from_its_cloud(away_m, beside):
    half_m = 0.4 * 7 / 8 * LENGTH_M  # a quartic is that wide in its middle
    leaves = flat_leaves([(0.0, 0.2, 0.0), (half_m + away_m, 0.2, 0.0)], LENGTH_M, width=0.4)
    assert lie_beside_plant(leaves, stem().points_m).tolist() == [False, beside]
    assert not lie_beside_plant(leaves, 5 * stem().points_m).any()  # a sparse cloud of a high plant
    assert not lie_beside_plant(leaves, np.zeros((0, 3))).any()


def test_what_is_left_out_is_no_leaf_of_the_plant_for_others():
    """Of two leaves apart none keeps the other, and soil keeps none."""
    soil_m, beside_m = (0.01, -0.3, 0.0), (0.01, -0.46, 0.0)
    leaves = colored((soil_m, BROWN), (beside_m, GREEN))
    found = keep_found_leaves(captured(leaves), plant(unjoined=(11,)), FRAME)
    assert found.leaves is not None
    assert len(found.leaves) == 10


def test_the_remark_counts_how_many_leaves_stems_lead_to():
    leaves = colored(((0.1, 0.5, 0.0), GREEN)).take(np.arange(2, 11))
    chosen = choose_foliage(captured(leaves), plant(unjoined=(8,)), BuildSettings(), FRAME)
    (why,) = (each.text for each in chosen.remarks if each.code == "foliage-chosen")
    assert chosen.kind == "captured"
    assert "9 leaves were found, and stems lead to 8 of them" in why
    assert chosen.found is not None
    assert (len(chosen.found), chosen.explained) == (9, 0.0)


def test_leaves_are_drawn_from_those_that_are_kept():
    """Another place and colour shows that the long one is soil: no leaf on a twig is as long as it."""
    leaves = colored(((0.01, -1.2, 0.0), BROWN))
    long = replace(leaves, length_m=np.where(np.arange(11) == 10, 10 * LENGTH_M, LENGTH_M))
    settings = replace(BuildSettings(), foliage=FoliageSettings(kind="drawn"))
    chosen = choose_foliage(captured(long), plant(), settings, FRAME)
    assert chosen.leaves is not None
    drawn = chosen.leaves.leaves
    assert len(drawn)
    assert np.median(drawn.length_m) < 2 * LENGTH_M
    assert drawn.color is not None
    assert (drawn.color[:, 1] > drawn.color[:, 0]).all()
