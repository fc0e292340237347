"""What of a cloud is the plant."""

import numpy as np
import pytest
from usdfoliage.isolation.focus import find_focus
from usdfoliage.isolation.plant import IsolatedPlant, IsolationSettings, PointKind, isolate_plant

from tests.support.isolated_plants import BARK, CLOTH, LEAF, POT, Scene, potted_plant, ring_of_cameras, tilt


def isolate(
    scene: Scene, aim_m=(0, 0.35, 0), distance_m: float = 0.9, tilt_rad: float = 0.0, **options
) -> IsolatedPlant:
    places, axes = ring_of_cameras(aim_m, distance_m)
    turn = tilt(tilt_rad)
    return isolate_plant(
        scene.turned(tilt_rad), scene.srgb, places @ turn.T, axes @ turn.T, IsolationSettings(**options)
    )


def kept(scene: Scene, found: IsolatedPlant, name: str) -> float:
    return float(found.plant[scene.of(name)].mean())


@pytest.mark.parametrize("tilt_deg", [0.0, 8.0, -12.0])
def test_a_potted_plant_is_separated_from_floor_pot_and_outliers(tilt_deg: float) -> None:
    scene = potted_plant()
    found = isolate(scene, tilt_rad=np.radians(tilt_deg))
    assert kept(scene, found, "plant") > 0.97
    for name in ("floor", "pot", "soil", "reflections", "outliers"):
        assert kept(scene, found, name) < 0.02, name
    assert found.container is not None
    assert found.support is not None
    slope = np.arctan(np.hypot(*found.support.plane[:2]))
    assert slope == pytest.approx(abs(np.radians(tilt_deg)), abs=np.radians(1))


def test_the_same_cloud_gives_the_same_plant() -> None:
    scene = potted_plant()
    assert np.array_equal(isolate(scene).kind, isolate(scene).kind)


def test_far_from_the_origin_and_in_another_unit_it_is_the_same_plant() -> None:
    scene = potted_plant()
    places, axes = ring_of_cameras((0, 0.35, 0), 0.9)
    moved = isolate_plant(100 * scene.points_m + 4e4, scene.srgb, 100 * places + 4e4, axes)
    assert (moved.kind == isolate(scene).kind).mean() > 0.998


def test_a_plant_without_floor_stays_whole() -> None:
    scene = Scene()
    scene.shell((0, 0.4, 0), 0.3)
    scene.shell((0.25, 0.7, 0), 0.2)
    found = isolate(scene, (0, 0.5, 0))
    assert found.plant.all()
    assert found.support is None
    assert "isolation-no-floor" in [each.code for each in found.remarks]


def test_a_trunk_on_a_meadow_stays() -> None:
    scene = Scene()
    scene.floor(6, 80_000, LEAF, 0.02)
    scene.tube("trunk", 0.12, 0, 1.8, BARK)
    scene.shell((0, 2.9, 0), 1.2)
    found = isolate(scene, (0, 2, 0), 5.5)
    assert kept(scene, found, "plant") > 0.99
    assert kept(scene, found, "trunk") > 0.95  # but for its foot
    assert kept(scene, found, "floor") < 0.01
    assert found.container is None


def test_of_a_plant_that_is_not_green_no_container_is_left_out() -> None:
    scene = Scene()
    scene.floor(1.6)
    scene.tube("pot", 0.09, 0.005, 0.18, POT)
    scene.shell((0, 0.4, 0), 0.2, color=(150, 90, 40))
    found = isolate(scene)
    assert kept(scene, found, "plant") > 0.97
    assert kept(scene, found, "pot") > 0.8
    assert "isolation-hardly-green" in [each.code for each in found.remarks]


def test_brown_stems_all_over_are_no_pot() -> None:
    scene = Scene()
    scene.floor(1.6)
    for x, z in scene.rng.uniform(-0.3, 0.3, (40, 2)):
        scene.tube("stems", 0.008, 0, 0.25, BARK, 400)
        scene.points[-1] = scene.points[-1] + (x, 0, z)
    for x, z in scene.rng.uniform(-0.25, 0.25, (12, 2)):
        scene.shell((x, 0.38, z), 0.16, 3000)
    found = isolate(scene)
    assert kept(scene, found, "stems") > 0.85  # but for their feet
    assert found.container is None


def test_a_square_pot_is_one_too() -> None:
    scene = potted_plant()
    pot = scene.of("pot")
    points = scene.points_m
    side = np.abs(points[pot][:, [0, 2]]).max(axis=1, keepdims=True)
    points[pot] *= np.insert(0.09 / np.repeat(side, 2, axis=1), 1, 1, axis=1)
    scene.points = [points]
    found = isolate(scene)
    assert kept(scene, found, "pot") < 0.03
    assert kept(scene, found, "plant") > 0.97


def test_a_possible_pot_seen_from_one_side_alone_stays_with_a_remark() -> None:
    scene = potted_plant()
    hidden = (scene.of("pot") | scene.of("soil")) & (scene.points_m[:, 0] < 0.02)
    places, axes = ring_of_cameras((0, 0.35, 0), 0.9)
    found = isolate_plant(scene.points_m[~hidden], scene.srgb[~hidden], places, axes)
    assert found.container is None
    assert "isolation-container-unclear" in [each.code for each in found.remarks]


def test_a_leaf_that_hangs_over_the_rim_stays() -> None:
    scene = potted_plant()
    places = np.column_stack(
        [np.full(900, 0.1), scene.rng.uniform(0.08, 0.4, 900), scene.rng.uniform(-0.03, 0.03, 900)]
    )
    scene.add("hanging", places, LEAF)
    assert kept(scene, isolate(scene), "hanging") > 0.9


def add_wall(scene: Scene, x_m: tuple[float, float], height_m: float, z_m: float, count: int) -> None:
    """An upright wall of cloth."""
    x, y = scene.rng.uniform(*x_m, count), scene.rng.uniform(0, height_m, count)
    scene.add("wall", np.column_stack([x, y, np.full(count, z_m)]), CLOTH)


def test_a_wall_behind_a_plant_is_left_out() -> None:
    scene = Scene()
    scene.floor(1.5)
    scene.shell((0, 0.35, 0), 0.3)
    add_wall(scene, (-1.5, 1.5), 1.5, -1.0, 30_000)
    found = isolate(scene, distance_m=1.2)
    assert kept(scene, found, "wall") < 0.01
    assert kept(scene, found, "plant") > 0.97


@pytest.mark.parametrize(("color", "away_m", "remarked"), [(LEAF, 0.75, True), (CLOTH, 0.75, False), (LEAF, 2, False)])
def test_another_plant_among_the_cameras_is_left_out_with_a_remark(color, away_m, remarked) -> None:
    scene = Scene()
    scene.floor(3)
    scene.shell((0, 0.35, 0), 0.3)
    scene.shell((-away_m, 0.35, 0), 0.27, name="other", color=color)
    found = isolate(scene, distance_m=1.1)
    assert kept(scene, found, "other") < 0.01
    assert kept(scene, found, "plant") > 0.97
    assert ("isolation-other-plant" in [each.code for each in found.remarks]) == remarked


def test_within_masks_what_is_green_is_of_the_plant_and_what_is_not_is_not() -> None:
    """A second stem, a piece of wall and specks of wrong depth, without the floor that would link the stems."""
    scene = Scene()
    scene.shell((0, 0.35, 0), 0.3)
    scene.shell((-0.85, 0.35, 0), 0.15, name="stem")
    scene.shell((0.85, 0.35, 0), 0.1, name="wall", color=CLOTH)
    scene.add("specks", np.array([[0.9, 1.0, 0.9], [-0.9, 1.2, 0.9]]), LEAF)
    places, axes = ring_of_cameras((0, 0.35, 0), 1.1)
    for within_masks in (False, True):
        found = isolate_plant(scene.points_m, scene.srgb, places, axes, within_masks=within_masks)
        assert kept(scene, found, "plant") > 0.97
        assert (kept(scene, found, "stem") > 0.97) == within_masks
        assert kept(scene, found, "wall") < 0.01
        assert kept(scene, found, "specks") == 0


def test_what_is_not_wanted_is_not_done() -> None:
    scene = potted_plant()
    found = isolate(scene, floor=False, container=False, outliers=False)
    assert found.plant.all()
    found = isolate(scene, container=False)
    assert kept(scene, found, "pot") > 0.8
    assert found.share(PointKind.CONTAINER) == 0


def test_photographs_from_the_air_have_no_focus_and_lose_the_ground_alone() -> None:
    scene = Scene()
    scene.floor(30, 80_000, LEAF, 0.05)
    for x, z in ((-15, 3), (8, -10), (12, 14)):
        scene.shell((x, 4, z), 3)
    x, z = np.meshgrid(np.linspace(-20, 20, 5), np.linspace(-20, 20, 5))
    places = np.column_stack([x.ravel(), np.full(25, 50.0), z.ravel()])
    axes = np.tile((0.0, -1.0, 0.0), (25, 1))
    assert find_focus(places, axes) is None
    found = isolate_plant(scene.points_m, scene.srgb, places, axes)
    assert kept(scene, found, "plant") > 0.99
    assert kept(scene, found, "floor") < 0.01
    assert "isolation-no-aim" in [each.code for each in found.remarks]


def test_the_focus_is_where_the_axes_meet() -> None:
    places, axes = ring_of_cameras((3, -2, 7), 4.0)
    focus = find_focus(places, axes)
    assert focus is not None
    assert np.allclose(focus.place_m, (3, -2, 7))
    assert focus.distance_m == pytest.approx(4.0)
    assert find_focus(places, -axes) is None  # behind all cameras


def test_no_points_are_no_plant_and_nothing_breaks() -> None:
    places, axes = ring_of_cameras((0, 0, 0), 1.0)
    for count in (0, 5):
        found = isolate_plant(np.zeros((count, 3)), np.zeros((count, 3), np.uint8), places, axes)
        assert len(found.kind) == count
    with pytest.raises(ValueError, match="points and colours"):
        isolate_plant(np.zeros((4, 3)), np.zeros((3, 3)), places, axes)


def trailing_plant(half_m: float = 0.35) -> Scene:
    """A plant at the edge of a table of cloth, above a floor of bark: a stem trails over the edge."""
    scene = Scene()
    scene.floor(half_m, 40_000)
    x, z = scene.rng.uniform(-1.2, 1.2, (2, 6000))
    scene.add("ground", np.column_stack([x, scene.rng.normal(-0.7, 0.02, 6000), z]), BARK)
    scene.shell((0.2, 0.25, 0), 0.18)
    turn = scene.rng.uniform(0, np.pi / 2, 600)
    out = np.column_stack([0.3 + 0.1 * np.sin(turn), 0.15 + 0.1 * np.cos(turn), scene.rng.normal(0, 0.01, 600)])
    down = np.column_stack(
        [scene.rng.normal(0.4, 0.008, 2000), scene.rng.uniform(-0.4, 0.16, 2000), scene.rng.normal(0, 0.008, 2000)]
    )
    scene.add("plant", out, LEAF)
    scene.add("hanging", down, LEAF)
    return scene


def test_what_trails_over_the_edge_of_a_table_stays() -> None:
    scene = trailing_plant()
    found = isolate(scene, (0.1, 0.15, 0))
    assert found.support is not None
    assert abs(found.support.plane[2]) < 0.01
    assert kept(scene, found, "hanging") > 0.97
    assert kept(scene, found, "plant") > 0.97
    assert kept(scene, found, "floor") < 0.01
    assert kept(scene, found, "ground") < 0.001
    assert "isolation-hanging-parts" in [each.code for each in found.remarks]


def test_below_a_floor_that_is_all_around_nothing_hangs() -> None:
    """As a plant is mirrored in a glossy floor."""
    scene = trailing_plant(1.5)
    chosen = ~scene.of("ground")
    places, axes = ring_of_cameras((0.1, 0.15, 0), 0.9)
    found = isolate_plant(scene.points_m[chosen], scene.srgb[chosen], places, axes)
    assert found.support is not None
    assert not found.plant[scene.points_m[chosen, 1] < -0.02].any()
    assert "isolation-hanging-parts" not in [each.code for each in found.remarks]


def test_a_lawn_beside_and_below_a_terrace_is_none_of_the_plant() -> None:
    scene = trailing_plant()
    scene.colors[1] = np.tile(np.array(LEAF, np.uint8), (len(scene.points[1]), 1))
    found = isolate(scene, (0.1, 0.15, 0))
    assert kept(scene, found, "ground") < 0.001
    assert kept(scene, found, "hanging") > 0.97


@pytest.mark.parametrize("where_m", [(0.1, 1e7, 0.1), (0.1, -1e7, 0.1), (1e7, 0.1, -1e7)])
def test_a_point_that_is_very_far_off_changes_nothing(where_m) -> None:
    scene = potted_plant()
    scene.add("far", np.array([where_m]), LEAF)
    found = isolate(scene)
    assert found.support is not None
    assert kept(scene, found, "plant") > 0.97
    assert kept(scene, found, "floor") < 0.02
    assert not found.plant[scene.of("far")].any()


def test_a_wall_that_is_near_enough_to_be_linked_is_left_out() -> None:
    scene = Scene()
    scene.floor(1.5)
    scene.shell((0, 0.35, 0), 0.3)
    add_wall(scene, (-0.35, 0.35), 0.6, -0.38, 8_000)
    found = isolate(scene, distance_m=1.2)
    assert kept(scene, found, "wall") < 0.01
    assert kept(scene, found, "plant") > 0.97


def test_a_trunk_that_is_torn_from_its_crown_stays() -> None:
    scene = Scene()
    scene.floor(1.5)
    scene.shell((0, 0.6, 0), 0.25)
    y, turn = scene.rng.uniform(0.02, 0.27, 3_000), scene.rng.uniform(0, 2 * np.pi, 3_000)
    scene.add("trunk", np.column_stack([0.02 * np.cos(turn), y, 0.02 * np.sin(turn)]), CLOTH)
    found = isolate(scene, distance_m=1.2)
    assert kept(scene, found, "trunk") > 0.85
    assert kept(scene, found, "plant") > 0.97


@pytest.mark.parametrize(
    ("radius_m", "away_m", "remarked"), [(0.06, 0.23, True), (0.035, 0.18, False), (0.08, 0.17, False)]
)
def test_plants_that_stand_beside_each_other_are_kept_with_a_remark(radius_m, away_m, remarked) -> None:
    """A small one may be a part of the large one, and two that touch are one."""
    scene = Scene()
    scene.floor(1.5)
    scene.shell((0, 0.1, 0), 0.1)
    scene.shell((-away_m, radius_m, 0), radius_m, name="other")
    found = isolate(scene, aim_m=(0, 0.1, 0), distance_m=1.4)
    assert kept(scene, found, "plant") > 0.8
    assert kept(scene, found, "other") > 0.8
    assert ("isolation-several-stands" in [each.code for each in found.remarks]) == remarked


def test_a_stem_that_wrong_depth_bridges_to_a_wall_stays_without_the_wall() -> None:
    scene = Scene()
    scene.floor(1.5)
    scene.shell((0, 0.35, 0), 0.3)
    add_wall(scene, (-0.35, 0.0), 0.6, -0.38, 10_000)
    scene.shell((-0.3, 0.45, -0.33), 0.05, name="stem")
    found = isolate(scene, distance_m=1.2)
    assert kept(scene, found, "wall") < 0.05
    assert kept(scene, found, "plant") > 0.97
    assert kept(scene, found, "stem") > 0.9


def test_a_bare_plant_with_some_moss_keeps_its_branches() -> None:
    scene = Scene()
    scene.floor(1.5)
    along = scene.rng.uniform(0, 1, 12_000)
    side = np.repeat([-1.0, 1.0, 0.0], 4_000)
    places = np.column_stack([0.4 * side * along, 0.03 + (0.6 - 0.2 * np.abs(side)) * along, np.zeros(12_000)])
    scene.add("branches", places + scene.rng.normal(0, 0.003, places.shape), CLOTH)
    scene.shell((0, 0.3, 0), 0.04, name="moss")
    found = isolate(scene, distance_m=1.2)
    assert kept(scene, found, "branches") > 0.9
    assert kept(scene, found, "moss") > 0.9


def test_bare_wood_beside_the_leaves_stays() -> None:
    """A stem beside a crown, and a bough that begins where nothing is seen: thin, not wide as a wall."""
    scene = Scene()
    scene.floor(1.5)
    scene.shell((0, 0.35, 0), 0.25)
    y, turn = scene.rng.uniform(0.02, 0.6, 3_000), scene.rng.uniform(0, 2 * np.pi, 3_000)
    scene.add("stem", np.column_stack([0.36 + 0.01 * np.cos(turn), y, 0.01 * np.sin(turn)]), CLOTH)
    x = scene.rng.uniform(-0.55, -0.3, 3_000)
    scene.add("bough", np.column_stack([x, 0.4 + 0.01 * np.cos(turn), 0.01 * np.sin(turn)]), CLOTH)
    found = isolate(scene, distance_m=2.0)
    assert kept(scene, found, "stem") > 0.8
    assert kept(scene, found, "bough") > 0.8
    assert "isolation-wall-left-out" not in [each.code for each in found.remarks]
