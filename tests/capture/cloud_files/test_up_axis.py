"""Up in a cloud: found by trunk or ground however the cloud lies, assumed where neither shows it."""

from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from usdfoliage.capture.cloud_files.ply import read_cloud_file
from usdfoliage.capture.cloud_files.up_axis import find_cloud_up
from usdfoliage.geometry.up_turn import axis_vector, turn_to_y_up

SHARED = Path(__file__).parents[4] / "shared" / "data"
AXES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")


def disk(radius_m, count=8000, slope=0.0):
    rng = np.random.default_rng(1)
    angle, away = rng.uniform(0, 2 * np.pi, count), radius_m * np.sqrt(rng.uniform(0, 1, count))
    x, y = away * np.cos(angle), away * np.sin(angle)
    return np.column_stack([x, y, slope * x + rng.normal(0, 0.01, count)])


def trunk(length_m, radius_m=0.15, lean=0.0, count=3000):
    rng = np.random.default_rng(2)
    angle, z = rng.uniform(0, 2 * np.pi, count), rng.uniform(0, length_m, count)
    return np.column_stack([radius_m * np.cos(angle) + lean * z, radius_m * np.sin(angle), z])


def arm(low_m, out, count=400):
    share = np.linspace(0, 1, count)[:, None]
    spread = np.random.default_rng(8).normal(0, 0.01, (count, 3))
    return [0, 0, low_m] + share * [0.85 * out[0], 0.85 * out[1], 0.5] + spread


def ball(radius_m, center, count=20_000):
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(count, 3))
    return (
        directions / np.linalg.norm(directions, axis=1, keepdims=True) * radius_m * rng.uniform(0.5, 1, (count, 1))
        + center
    )


def cone(radius_m, low_m, high_m, count=20_000):
    rng = np.random.default_rng(4)
    height, angle = 1 - np.sqrt(rng.uniform(0, 1, count)), rng.uniform(0, 2 * np.pi, count)
    away = radius_m * (1 - height) * rng.uniform(0.3, 1, count)
    return np.column_stack([away * np.cos(angle), away * np.sin(angle), low_m + height * (high_m - low_m)])


def box(sides_m, count=20_000):
    return np.random.default_rng(5).uniform((-0.5, -0.5, 0), (0.5, 0.5, 1), (count, 3)) * sides_m


def bush():
    half = ball(1, 0, 40_000)
    half[:, 2] = np.abs(half[:, 2])
    return half


LOLLIPOP = np.concatenate([trunk(3), ball(2, (0, 0, 4.5))])
CLEAR = {
    "lollipop": LOLLIPOP,
    "lollipop on the ground": np.concatenate([LOLLIPOP, disk(4)]),
    "lollipop on a slope": np.concatenate([LOLLIPOP, disk(4, slope=0.3)]),
    "lollipop with grass at its foot": np.concatenate([LOLLIPOP, disk(0.5, 500)]),
    "inclined trunk": np.concatenate([trunk(3, lean=0.5), ball(2, (1.7, 0, 4.5))]),
    "conifer with a bare trunk": np.concatenate([trunk(3, 0.2), cone(2, 2, 14)]),
    "conifer on the ground": np.concatenate([cone(2, 0.1, 10), disk(4)]),
    "bush on the ground": np.concatenate([bush(), disk(2)]),
    "hedge on the ground": np.concatenate([box((6, 1, 1.5)), box((7, 3, 0.03), 8000)]),
}
UNCLEAR = {
    "bush": bush(),
    "hedge": box((6, 1, 1.5)),
    "conifer to the ground": cone(2, 0, 10),
    "conifer with a leader": np.concatenate(
        [trunk(1, 0.2), cone(2, 1, 10), np.add(trunk(1.2, 0.01, count=60), (0, 0, 10))]
    ),
    "stem": trunk(4, 0.3),
    "slim tree with few branches": np.concatenate(
        [trunk(4, 0.05)]
        + [arm(at, out) for at, out in ((1.5, (1, 0)), (2.0, (-0.7, 0.7)), (2.5, (0.1, -1)), (3.0, (0.6, 0.8)))]
    ),
    "one point": np.ones((1, 3)),
    "one place": np.ones((9, 3)),
    "sheet": disk(2) * [1, 1, 0],
}
# Proper rotations from Z up to each axis up.
TURNS = {axis: turn_to_y_up(axis_vector(axis)).T @ turn_to_y_up(axis_vector("+Z")) for axis in AXES}


def name_of(axis) -> str:
    return next(name for name in AXES if np.array_equal(axis_vector(name), axis))


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("shape", CLEAR)
def test_trunk_and_ground_show_up_however_the_cloud_lies(shape, axis):
    found = find_cloud_up(CLEAR[shape] @ TURNS[axis].T)
    assert name_of(found.axis) == axis, found.how
    assert "by" in found.how


@pytest.mark.parametrize("shape", UNCLEAR)
def test_without_evidence_z_is_up_and_not_sure(shape):
    for axis in AXES:
        found = find_cloud_up(UNCLEAR[shape] @ TURNS[axis].T)
        assert name_of(found.axis) == "+Z", (axis, found.how)
        assert not found.sure
        assert "assumed" in found.how or "by" in found.how
    of_format = find_cloud_up(UNCLEAR[shape], format_up="Y")
    assert name_of(of_format.axis) == "+Y"
    assert of_format.sure


def test_a_stated_axis_is_followed_and_uncertain_against_a_trunk():
    assert find_cloud_up(LOLLIPOP, "Z").sure
    uncertain = find_cloud_up(LOLLIPOP, "y")
    assert name_of(uncertain.axis) == "+Y"
    assert not uncertain.sure
    assert uncertain.how.startswith("+Y as stated, but a trunk indicates +Z")
    upside_down = find_cloud_up(LOLLIPOP @ TURNS["-Z"].T, "+Z")
    assert not upside_down.sure
    assert "-Z: it may lie or stand upside down" in upside_down.how
    assert find_cloud_up(UNCLEAR["bush"], "-X").sure


def test_a_clear_trunk_overrules_the_axis_of_the_format():
    assert name_of(find_cloud_up(LOLLIPOP @ TURNS["+Y"].T, format_up="+Z").axis) == "+Y"
    assert find_cloud_up(LOLLIPOP, format_up="+Z").sure


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32 - 1), shape=st.sampled_from(sorted({**CLEAR, **UNCLEAR})),
    scale=st.sampled_from([0.01, 1.0, 64.0]),
)  # fmt: skip
def test_the_order_of_the_points_and_the_size_do_not_matter(seed, shape, scale):
    points = {**CLEAR, **UNCLEAR}[shape]
    shuffled = np.random.default_rng(seed).permutation(points)
    first, second = find_cloud_up(points), find_cloud_up(scale * shuffled)
    assert np.array_equal(first.axis, second.axis)
    assert (first.sure, first.how) == (second.sure, second.how) or scale != 1


def test_how_dense_the_scan_is_does_not_matter():
    dense_crown = np.concatenate([LOLLIPOP, ball(2, (0, 0, 4.5), 200_000)])
    dense_foot = np.concatenate([LOLLIPOP, trunk(0.5, count=200_000)])
    for points in (dense_crown, dense_foot):
        assert name_of(find_cloud_up(points).axis) == "+Z"


def test_outliers_do_not_matter():
    outliers = np.random.default_rng(6).uniform(-30, 30, (8, 3))
    assert name_of(find_cloud_up(np.concatenate([LOLLIPOP, outliers]) @ TURNS["+Y"].T).axis) == "+Y"


@pytest.mark.parametrize("axis", AXES)
def test_turning_is_a_rotation_that_brings_the_axis_to_y(axis):
    turn = turn_to_y_up(axis_vector(axis))
    np.testing.assert_array_equal(turn @ axis_vector(axis), [0, 1, 0])
    np.testing.assert_array_equal(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)


def test_z_up_is_turned_as_everywhere():
    np.testing.assert_array_equal(turn_to_y_up(axis_vector("Z")) @ [1.0, 2.0, 3.0], [1, 3, -2])
    np.testing.assert_array_equal(turn_to_y_up(axis_vector("Y")), np.eye(3))


def test_wrong_arguments_are_refused():
    for points in (np.zeros(3), np.zeros((0, 3)), np.zeros((5, 2))):
        with pytest.raises(ValueError, match="points_m must be"):
            find_cloud_up(points)
    with pytest.raises(ValueError, match="an axis is"):
        find_cloud_up(LOLLIPOP, "W")
    for axis in ([0, 0, 2], [1, 1, 0], [0, 0, 0]):
        with pytest.raises(ValueError, match="axis must be a direction of length 1"):
            turn_to_y_up(np.array(axis, float))


@pytest.mark.parametrize("turned", AXES)
def test_scanned_trees_are_not_turned_wrongly(turned):
    paths = [*SHARED.glob("cloud-*/*.ply"), *SHARED.glob("synthetic/tree_leaf_*/scan.ply")]
    if not paths:
        pytest.skip("../shared/data has no clouds of trees")
    right = 0
    for path in sorted(paths):
        found = find_cloud_up(read_cloud_file(path).cloud.points_m @ TURNS[turned].T)
        right += name_of(found.axis) == turned
        assert name_of(found.axis) == turned or not found.sure, (path, found.how)
    assert right >= 0.75 * len(paths)


@pytest.mark.parametrize(
    ("cloud", "cut"),
    [("cloud-itsme/tree_1.ply", 0.3), ("cloud-archi/tree_1.ply", 0.5), ("cloud-treels/pine.ply", 0.3)],
)
def test_neither_the_bark_nor_the_foot_of_a_stem_that_was_cut_out_is_taken_for_ground_or_a_crown(cloud, cut):
    """Seen from the side, bark fills nearly all places of a strip; a foot with roots is as wide as a crown."""
    if not (SHARED / cloud).exists():
        pytest.skip("../shared/data has no clouds of trees")
    points = read_cloud_file(SHARED / cloud).cloud.points_m
    high = points[:, 2] - points[:, 2].min()
    found = find_cloud_up(points[high < cut * high.max()])
    assert name_of(found.axis) == "+Z", found.how
