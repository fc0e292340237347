"""Skeletons along drawn veins: they follow these, are trees inside the blade, and fold nothing."""

import cv2
import numpy as np
import pytest
from usdfoliage.geometry.lines import spread_evenly
from usdfoliage.leaf.lobed.model import model_lobed_leaf
from usdfoliage.leaf.lobed.veins import (
    choose_base,
    draw_veins,
    find_paths,
    find_vein_ends,
    follow_veins,
    measure_veins,
)

HUB = np.array([200, 330])
TIPS = np.array([[40, 250], [90, 90], [200, 30], [310, 90], [360, 250]])


def drawn() -> tuple[np.ndarray, np.ndarray]:
    """The mask of a palmate leaf and the region of its veins, which bend and are not in the middle of lobes."""
    mask, veins = np.zeros((400, 400), np.uint8), np.zeros((400, 400), np.uint8)
    for tip in TIPS:
        middle = (HUB + tip) / 2 + 0.08 * (tip - HUB)[::-1] * [1, -1]
        line = np.round([HUB, middle, tip]).astype(np.int32)
        cv2.polylines(mask, [line], False, 1, 70)
        cv2.polylines(veins, [line], False, 1, 5)
    return mask > 0, veins > 0


def on_veins(leaf, veins: np.ndarray, within: float) -> float:
    """The part of the skeleton's length that is within so many pixels of the veins."""
    away = cv2.distanceTransform((~veins).astype(np.uint8), cv2.DIST_L2, 5)
    places = np.concatenate([spread_evenly(limb.points, 400) for limb in leaf.limbs.limbs]) * [1, -1]
    weight = np.concatenate(
        [np.full(400, np.linalg.norm(np.diff(limb.points, axis=0), axis=1).sum()) for limb in leaf.limbs.limbs]
    )
    near = away[places[:, 1].astype(int), places[:, 0].astype(int)] <= within
    return float((near * weight).sum() / weight.sum())


def test_a_skeleton_follows_given_veins_and_folds_nothing():
    mask, veins = drawn()
    leaf = model_lobed_leaf(mask, base_px=np.array([200.0, -362.0]), veins=draw_veins(veins, mask))
    assert leaf.on_veins
    assert (leaf.ties.areas() > 0).all()
    assert leaf.lobes == 5
    assert on_veins(leaf, veins, 4) > 0.8
    assert np.linalg.norm(leaf.limbs.nodes[leaf.limbs.base] - [200, -362]) < 8


@pytest.mark.parametrize("color", [(150, 165, 110), (40, 70, 30)])
def test_veins_are_traced_in_a_picture_whether_light_or_dark(color):
    mask, veins = drawn()
    picture = np.full((400, 400, 3), 240, np.float64)
    picture[mask], picture[veins & mask] = (70, 110, 50), color
    rough = np.clip(picture + np.random.default_rng(0).normal(0, 4, picture.shape), 0, 255).astype(np.uint8)
    found = measure_veins(rough, mask)
    inside = cv2.erode(mask.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert found[veins & inside].mean() > 4 * found[~veins & inside].mean()
    leaf = model_lobed_leaf(mask, base_px=np.array([200.0, -362.0]), veins=found)
    assert leaf.on_veins
    assert on_veins(leaf, veins, 5) > 0.75


def test_the_base_is_where_veins_meet():
    mask, veins = drawn()
    ends = np.array([[200.0, 120.0], [200.0, 330.0], [90.0, 100.0]])
    assert choose_base(ends, draw_veins(veins, mask), mask) == pytest.approx(HUB)
    with pytest.raises(ValueError, match="one place at least"):
        choose_base(np.empty((0, 2)), draw_veins(veins, mask), mask)


def test_paths_make_a_tree_inside_the_blade():
    mask, veins = drawn()
    paths = find_paths(draw_veins(veins, mask), mask, np.array([200.0, -362.0]))
    axis = follow_veins(paths, TIPS * [1.0, -1.0])
    edges = sum(len(near) for near in axis.neighbors) / 2
    assert edges == len(axis.places) - 1
    place = np.floor(axis.places * [1, -1]).astype(int)
    room = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert room[place[:, 1], place[:, 0]].all()


def test_ends_of_veins_are_found_without_tips():
    mask, veins = drawn()
    paths = find_paths(draw_veins(veins, mask), mask, np.array([200.0, -362.0]))
    lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    ends = find_vein_ends(paths, lines[0][:, 0, :] * [1.0, -1.0])
    gaps = np.linalg.norm(ends[:, None] - TIPS * [1, -1], axis=2).min(axis=0)
    assert (gaps < 50).all()


def test_without_a_vein_paths_still_reach_the_tips():
    mask, _ = drawn()
    leaf = model_lobed_leaf(mask, base_px=np.array([200.0, -362.0]), veins=np.zeros(mask.shape, np.float32))
    assert leaf.lobes >= 3
    assert (leaf.ties.areas() > 0).all()


def test_veins_of_another_size_are_refused():
    mask, _ = drawn()
    with pytest.raises(ValueError, match="do not match"):
        find_paths(np.zeros((10, 10), np.float32), mask, np.array([200.0, -362.0]))
