"""Which leaves a plant gets."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.model_file import TracedPlant
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.fitted_leaves import FittedLeaves
from usdfoliage.jobs.plant.settings import BuildSettings, FoliageSettings
from usdfoliage.jobs.plant.stages import found_leaves
from usdfoliage.jobs.plant.stages.foliage import choose_foliage, leaf_cover
from usdfoliage.jobs.plant.stages.models import CapturedLeaves
from usdfoliage.jobs.plant.stages.parts import known_species
from usdfoliage.leaf.model import LeafOrigin, Leaves, count_origins
from usdfoliage.leaf.shape.edits import NEUTRAL
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

from tests.support.branch_shapes import random_tree
from tests.support.leaves.assets import random_leaves

FRAME = np.eye(4)


def points_on(leaves: Leaves) -> np.ndarray:
    places = grid_places(np.linspace(-0.9, 0.9, 7), np.linspace(0.05, 0.95, 9))
    return evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf()).reshape(-1, 3)


def sure_leaves(count: int = 40, confidence: float = 0.9) -> Leaves:
    rng = np.random.default_rng(5)
    leaves = random_leaves(count, seed=5)
    return replace(
        leaves,
        base_m=rng.uniform(0, 3, (count, 3)),
        length_m=np.full(count, 0.1),
        confidence=np.full(count, confidence),
    )


def captured(leaves: Leaves, own_from_capture: np.ndarray = FRAME) -> CapturedLeaves:
    fitted = FittedLeaves(leaves=leaves, edits=NEUTRAL, appearance=LeafAppearance())
    return CapturedLeaves(fitted=fitted, own_from_capture=own_from_capture)


def twig_through(points_m: np.ndarray) -> Skeleton:
    """One branch that comes by every leaf."""
    count = len(points_m)
    return Skeleton(
        points_m=points_m,
        radius_m=np.full(count, 0.001),
        counts=np.array([count], np.int32),
        parent_curve=np.array([-1], np.int32),
        parent_vertex=np.array([-1], np.int32),
        order=np.zeros(1, np.int32),
    )


def traced(leafy_m: np.ndarray, *, knows_leaves: bool = True) -> TracedPlant:
    wood_m = np.random.default_rng(6).uniform(0, 3, (200, 3))
    return TracedPlant(
        points_m=np.concatenate([wood_m, leafy_m]),
        wood=np.arange(200 + len(leafy_m)) < 200,
        knows_leaves=knows_leaves,
        colors=None,
        plant_from_capture=FRAME,
        skeleton=twig_through(leafy_m) if len(leafy_m) else random_tree(3),
    )


def kind_of(found: CapturedLeaves | None, plant: TracedPlant | None) -> str:
    return choose_foliage(found, plant, BuildSettings(), FRAME).kind


def test_points_on_leaves_are_covered_and_those_elsewhere_are_not() -> None:
    leaves = sure_leaves()
    on_m = points_on(leaves)
    assert leaf_cover(on_m, leaves) == 1
    assert leaf_cover(on_m + 10, leaves) == 0
    assert leaf_cover(np.concatenate([on_m, on_m + 10]), leaves) == pytest.approx(0.5)
    both_m = np.concatenate([on_m, on_m + 10])
    green, grey = np.tile([[60, 140, 40]], (len(on_m), 1)), np.tile([[120, 120, 120]], (len(on_m), 1))
    assert leaf_cover(both_m, leaves, np.concatenate([green, grey]).astype(np.uint8)) == 1  # a wall behind the plant
    for colors in ((green, green), (grey, grey), (grey, green)):
        assert leaf_cover(both_m, leaves, np.concatenate(colors).astype(np.uint8)) == pytest.approx(0.5)
    assert leaf_cover(np.zeros((0, 3)), leaves) == leaf_cover(on_m, leaves.take(np.zeros(0, int))) == 0


def test_leaves_that_cover_the_plant_stay_where_they_were_found() -> None:
    leaves = sure_leaves()
    chosen = choose_foliage(captured(leaves), traced(points_on(leaves)), BuildSettings(), FRAME)
    assert chosen.kind == "captured"
    assert chosen.leaves is not None
    np.testing.assert_array_equal(chosen.leaves.leaves.base_m, leaves.base_m)


def test_captured_leaves_are_brought_into_the_plants_frame() -> None:
    leaves = sure_leaves()
    own, plant = np.eye(4), np.eye(4)
    own[:3, 3], plant[:3, 3] = (1, 2, 3), (5, 5, 5)
    chosen = choose_foliage(captured(leaves, own), None, BuildSettings(), plant)
    assert chosen.leaves is not None
    np.testing.assert_allclose(chosen.leaves.leaves.base_m, leaves.base_m + np.array([4.0, 3, 2]))


@pytest.mark.parametrize(
    ("count", "confidence", "away_m", "kind"),
    [
        (40, 0.9, 10.0, "filled"),  # good ones, but of a small part of the plant
        (10, 0.9, 10.0, "species"),  # too few to draw from
    ],
)
def test_else_the_cloud_or_the_twigs_carry_them(count: int, confidence: float, away_m: float, kind: str) -> None:
    leaves = sure_leaves(count, confidence)
    chosen = choose_foliage(captured(leaves), traced(points_on(leaves) + away_m), BuildSettings(), FRAME)
    assert chosen.kind == kind
    assert chosen.leaves is not None
    assert chosen.remarks


@pytest.mark.parametrize("origin", [LeafOrigin.FOUND, LeafOrigin.COMPLETED, None])
def test_leaves_that_were_found_count_as_such_beside_those_that_were_filled_in(origin: LeafOrigin | None) -> None:
    leaves = replace(sure_leaves(40, 0.9), origin=None if origin is None else np.full(40, origin, np.int32))
    chosen = choose_foliage(captured(leaves), traced(points_on(leaves) + 10), BuildSettings(), FRAME)
    assert chosen.kind == "filled"
    assert chosen.leaves is not None
    counts = count_origins(chosen.leaves.leaves)
    assert counts["completed" if origin == LeafOrigin.COMPLETED else "found"] == 40
    assert counts["filled_in"] == len(chosen.leaves.leaves) - 40 > 0


def test_few_leaves_that_cover_the_plant_or_hang_on_stems_of_photographs_are_kept() -> None:
    few = sure_leaves(8)
    assert kind_of(captured(few), traced(points_on(few))) == "captured"
    elsewhere = traced(points_on(few) + 10)
    assert kind_of(captured(few), elsewhere) == "species"
    assert kind_of(captured(few), replace(elsewhere, of_photographs=True)) == "captured"
    assert kind_of(None, replace(elsewhere, of_photographs=True)) == "species"


def test_a_wall_behind_a_plant_with_stems_of_photographs_is_not_of_its_leaves() -> None:
    leaves = sure_leaves()
    on_m = points_on(leaves)
    wall_m = np.column_stack([np.random.default_rng(1).uniform(0, 3, (4 * len(on_m), 2)), np.full(4 * len(on_m), -5.0)])
    plant = traced(np.concatenate([on_m, wall_m]))
    green = (np.arange(len(plant.points_m)) >= 200) & (np.arange(len(plant.points_m)) < 200 + len(on_m))
    colors = np.where(green[:, None], (60.0, 160.0, 40.0), (120.0, 120.0, 120.0))
    walled = replace(plant, colors=colors, of_photographs=True)
    assert kind_of(captured(leaves), walled) == "captured"
    assert kind_of(captured(leaves), replace(walled, of_photographs=False)) == "filled"


@pytest.mark.parametrize("kind", ["captured", "filled"])
def test_where_all_found_leaves_are_of_stems_there_are_none(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    leaves = sure_leaves()
    monkeypatch.setattr(found_leaves, "lie_along_stems", lambda each, skeleton: np.ones(len(each), bool))
    wanted = replace(BuildSettings(), foliage=FoliageSettings(kind=kind))
    with pytest.raises(FoliageError):
        choose_foliage(captured(leaves), traced(points_on(leaves)), wanted, FRAME)


def test_a_leaf_that_a_stem_leads_to_by_its_apex_is_turned() -> None:
    leaves = sure_leaves()
    plant = replace(traced(points_on(leaves)), turned=np.array([3], np.int32))
    chosen = choose_foliage(captured(leaves), plant, BuildSettings(), FRAME)
    assert chosen.leaves is not None
    apex_m = leaves.asset_from_leaf()[3] @ (0, 1, 0, 1)
    np.testing.assert_allclose(chosen.leaves.leaves.base_m[3], apex_m[:3])
    np.testing.assert_array_equal(np.delete(chosen.leaves.leaves.base_m, 3, 0), np.delete(leaves.base_m, 3, 0))


def test_guessed_leaves_are_no_model_for_more() -> None:
    leaves = sure_leaves()
    confidence = np.where(np.arange(40) % 2, 0.1, 0.4)
    wide = leaves.parameters.copy()
    wide[1::2, 2:5, 1] *= 3  # the guessed ones
    found = replace(leaves, confidence=confidence, parameters=wide)
    chosen = choose_foliage(captured(found), traced(points_on(leaves) + 10), BuildSettings(), FRAME)
    assert chosen.leaves is not None
    others = chosen.leaves.leaves.parameters[40:]
    assert len(others)
    assert (np.abs(others[:, None] - leaves.parameters[None, ::2]).max(axis=(2, 3)).min(axis=1) == 0).all()


def test_leaves_that_cannot_be_distinguished_in_the_cloud_are_on_the_twigs() -> None:
    leaves = sure_leaves()
    assert kind_of(captured(leaves), traced(points_on(leaves) + 10, knows_leaves=False)) == "drawn"


def test_leaves_that_are_probably_right_stay_beside_others_on_the_twigs() -> None:
    leaves = replace(sure_leaves(), confidence=np.where(np.arange(40) % 4, 0.3, 0.8))
    away = traced(points_on(leaves) + 10, knows_leaves=False)
    chosen = choose_foliage(captured(leaves), away, BuildSettings(), FRAME)
    assert chosen.kind == "drawn"
    np.testing.assert_array_equal(chosen.kept, np.arange(0, 40, 4))
    assert chosen.leaves is not None
    every = chosen.leaves.leaves
    np.testing.assert_array_equal(every.base_m[:10], leaves.base_m[::4])
    counts = count_origins(every)
    assert counts["filled_in"] == len(every) - 10 > 0
    (kept,) = (each for each in chosen.remarks if each.code == "found-leaves-kept")
    assert kept.text.startswith("10 leaves")
    asked = replace(BuildSettings(), foliage=FoliageSettings(kind="drawn"))
    alone = choose_foliage(captured(leaves), away, asked, FRAME)
    assert alone.leaves is not None
    assert len(alone.kept) == count_origins(alone.leaves.leaves)["found"] == 0


def test_no_leaf_on_a_twig_lies_in_one_that_was_found() -> None:
    leaves = sure_leaves()
    chosen = choose_foliage(captured(leaves), traced(points_on(leaves), knows_leaves=False), BuildSettings(), FRAME)
    assert chosen.leaves is not None
    every = chosen.leaves.leaves
    others = every.take(np.arange(40, len(every)))
    middle_m = evaluate_points(others.parameters, [[0.0, 0.5]], placements=others.asset_from_leaf()).reshape(-1, 3)
    assert len(others)
    assert leaf_cover(middle_m, leaves) == 0


def test_what_found_leaves_leave_bare_is_filled_with_leaves_like_them() -> None:
    leaves = sure_leaves()
    elsewhere_m = points_on(leaves) + 10
    plant = traced(np.concatenate([points_on(leaves), elsewhere_m, points_on(leaves) + 20, points_on(leaves) + 30]))
    chosen = choose_foliage(captured(leaves), plant, BuildSettings(), FRAME)
    assert chosen.kind == "filled"
    assert chosen.leaves is not None
    filled = chosen.leaves.leaves
    np.testing.assert_array_equal(filled.base_m[:40], leaves.base_m)
    assert filled.confidence is not None
    assert (filled.confidence[40:] == 0).all()  # guessed
    assert leaf_cover(elsewhere_m, filled) > 0.6
    assert 0.5 < (len(filled) - 40) / (3 * 40) < 4  # not one for each point, nor one for all
    again = choose_foliage(captured(leaves), plant, BuildSettings(), FRAME)
    assert again.leaves is not None
    np.testing.assert_array_equal(again.leaves.leaves.base_m, filled.base_m)


def test_pods_get_leaves_as_slim_as_they_are() -> None:
    leaves = sure_leaves()
    rng = np.random.default_rng(3)
    pods_m = [
        np.linspace((0, 20 + k, 0), (0.09, 20 + k, 0), 3000) + rng.uniform(-0.002, 0.002, (3000, 3)) for k in range(3)
    ]
    plant = traced(np.concatenate([points_on(leaves), points_on(leaves) + 10, *pods_m]))
    plant = replace(plant, skeleton=twig_through(np.array([[-0.05, 20.0 + k, 0] for k in range(3)])))
    chosen = choose_foliage(captured(leaves), plant, BuildSettings(), FRAME)
    assert chosen.leaves is not None
    chosen_leaves = chosen.leaves.leaves
    pods = chosen_leaves.base_m[:, 1] > 19
    assert pods.sum() == 3
    assert (leaf_width(chosen_leaves.parameters[pods]) * chosen_leaves.length_m[pods] < 0.006).all()
    assert (leaf_width(chosen_leaves.parameters[~pods]) * chosen_leaves.length_m[~pods] > 0.006).all()


def test_a_bare_plant_stays_bare_unless_leaves_cannot_be_distinguished() -> None:
    none_m = np.zeros((0, 3))
    assert kind_of(None, traced(none_m)) == "none"
    assert kind_of(None, traced(none_m, knows_leaves=False)) == "species"
    assert kind_of(None, None) == "none"
    assert kind_of(captured(sure_leaves()), None) == "captured"


@pytest.mark.parametrize("kind", ["captured", "drawn", "species"])
def test_leaves_that_cannot_be_made_are_reported(kind: str) -> None:
    settings = replace(BuildSettings(), foliage=FoliageSettings(kind=kind))  # type: ignore[arg-type]
    with pytest.raises(FoliageError, match=r"foliage\.kind"):
        choose_foliage(None, None, settings, FRAME)


def test_a_species_may_be_a_name_alone() -> None:
    assert known_species("Maple") is not None
    assert known_species("Acer pseudoplatanus L.") is None
    assert known_species("") is None
