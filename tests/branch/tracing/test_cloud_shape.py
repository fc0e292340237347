"""What a cloud is of: houses, walls, ground and hedges are found, and what any plant may look like is a plant."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.cloud_shape import CloudKind, CloudShapeSettings, judge_cloud_shape
from usdfoliage.branch.tracing.roots import find_roots

from tests.support.branch_clouds import block, cloud_of, cone, gabled_house, rectangle, small_tree

HEDGE_M = (6.0, 1.5, 0.8)


def judge(points_m):
    return judge_cloud_shape(points_m, find_roots(points_m))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [3, 500])
def test_equal_points_have_no_shape(count):
    points_m = np.ones((count, 3))
    shape = judge_cloud_shape(points_m, points_m[:1])
    assert (shape.kind, shape.planes, shape.length_m, shape.height_m) == (CloudKind.PLANT, 0, 0, 0)


def tree(scale: float = 1.0) -> np.ndarray:
    return scale * cloud_of(small_tree(), per_m2=3000)


def clutter_in(points_m: np.ndarray, share: float) -> np.ndarray:
    """Points and so many of their number more, anywhere between them."""
    rng = np.random.default_rng(3)
    more_m = rng.uniform(points_m.min(axis=0), points_m.max(axis=0), (round(share * len(points_m)), 3))
    return np.concatenate([points_m, more_m])


def espalier() -> np.ndarray:
    """A trunk with four pairs of level limbs, along one plane."""
    limbs = [
        cone([0, y, 0], [side * 2, y, 0.02], (0.03, 0.015), 1500, seed)
        for seed, (y, side) in enumerate((y, side) for y in (0.4, 0.9, 1.4, 1.9) for side in (-1, 1))
    ]
    return np.concatenate([cone([0, 0, 0], [0, 1.9, 0], 0.05, 2000), *limbs])


def dome(size_m) -> np.ndarray:
    """Points in the upper half of an ellipsoid, as of a broad shrub."""
    points_m = np.random.default_rng(5).normal(size=(12_000, 3))
    points_m *= (np.random.default_rng(6).uniform(0.7, 1, 12_000) / np.linalg.norm(points_m, axis=1))[:, None]
    points_m[:, 1] = np.abs(points_m[:, 1])
    return points_m * size_m


@pytest.mark.parametrize("make", [gabled_house, lambda: clutter_in(gabled_house(), 0.2)])
def test_a_house_is_a_building(make):
    shape = judge(make())
    assert shape.kind == CloudKind.BUILDING
    assert shape.on_planes > 0.8
    assert shape.on_other_walls > 0.15


def test_a_plant_of_flat_upright_leaves_is_no_building():
    sides = [(0.4, 0, 0), (0, 0, 0.4)] * 2
    feet = [(0, 0, 0), (0.6, 0, 0.3), (1.2, 0, 0), (0, 0, 0.8)]
    leaves = [
        rectangle(foot, side, (0, 1.2, 0), 8000, 0.001, k)
        for k, (foot, side) in enumerate(zip(feet, sides, strict=True))
    ]
    shape = judge(np.concatenate(leaves))
    assert shape.on_walls > 0.8
    assert shape.kind == CloudKind.PLANT


def test_one_wall_is_a_wall_unless_a_plant_stands_before_it():
    wall_m = rectangle((-5, 0, -2), (10, 0, 0), (0, 5, 0), 200, 0.02, 0)
    assert judge(wall_m).kind == CloudKind.WALL
    before_m = dome((1.0, 1.2, 1.0))[:2500]
    assert judge(np.concatenate([wall_m, before_m])).kind == CloudKind.PLANT


def test_level_ground_alone_is_ground():
    ground_m = rectangle((0, 0, 0), (10, 0, 0), (0, 0, 10), 100, 0.02, 0)
    assert judge(ground_m).kind == CloudKind.GROUND
    plants_m = np.concatenate([dome((0.6, 1.0, 0.6))[:150] + np.array([x, 0, x]) for x in (2.0, 5.0, 8.0)])
    shape = judge(np.concatenate([ground_m, plants_m]))
    assert (shape.kind, shape.on_level > 0.9) == (CloudKind.PLANT, True)


@pytest.mark.parametrize("middle_m", [None, 0.1])
def test_a_long_low_block_of_leaves_is_a_hedge(middle_m):
    shape = judge(block(HEDGE_M, 12_000, middle_m=middle_m))
    assert shape.kind == CloudKind.HEDGE
    assert (shape.length_m, shape.height_m, shape.width_m) == pytest.approx(HEDGE_M, rel=0.05)


def test_a_hedge_on_rough_ground_is_measured_without_it():
    ground_m = rectangle((-2, 0, -3), (10, 0, 0), (0, 0, 7), 120, 0.015, 0)
    shape = judge(np.concatenate([block(HEDGE_M, 12_000, middle_m=0.1), ground_m]))
    assert shape.kind == CloudKind.HEDGE
    assert shape.length_m < 6.5


@pytest.mark.parametrize(
    "make",
    [
        tree,
        lambda: tree()[::20],
        lambda: clutter_in(tree(), 0.5),
        lambda: np.concatenate([tree(), tree() + np.array([4.0, 0, 0])]),
        lambda: np.concatenate([tree(), rectangle((-3, 0, -1.5), (6, 0, 0), (0, 3, 0), 300, 0.01, 0)]),
        lambda: cone([0, 0, 0], [0.1, 6, 0], (0.15, 0.1), 5000, noise_m=0.003),
        lambda: cone([0, 0, 0], [0, 0.5, 0], 0.4, 5000, noise_m=0.003),
        lambda: cone([0, 0.3, 0], [5, 0.3, 0], 0.3, 5000, noise_m=0.005),  # a log that lies
        espalier,
        lambda: dome((2.0, 1.5, 1.8)),
        lambda: dome((3.0, 1.2, 1.4)),
        lambda: dome((2.0, 0.4, 1.8)),
        lambda: cone([0, 0, 0], [0, 6, 0], (0.7, 0.1), 9000, noise_m=0.08),  # a cypress,
        lambda: cone([0, 0.7, 0], [6, 0.7, 0], (0.7, 0.1), 9000, noise_m=0.08),  # and one that lies
    ],
)
def test_what_a_plant_may_look_like_is_a_plant(make):
    assert judge(make()).kind == CloudKind.PLANT


def test_where_a_trunk_stands_at_the_root_it_is_a_plant_whatever_else_there_is():
    around_m = gabled_house() - [5, 0, 4]
    points_m = np.concatenate([around_m, cone([0, 0, 0], [0, 8, 0], 0.25, 8000)])
    shape = judge_cloud_shape(points_m, np.zeros((1, 3)))
    assert shape.on_planes > CloudShapeSettings().building - 0.2
    assert (shape.stems, shape.kind) == (1.0, CloudKind.PLANT)
    assert judge(around_m).stems == 0


@pytest.mark.parametrize("wrong", [{"building": 0.0}, {"filled": 1.5}, {"long": 1.0}, {"level": 1.0}])
def test_settings_are_checked(wrong):
    with pytest.raises(ValueError, match=r"must be|above"):
        CloudShapeSettings(**wrong)
