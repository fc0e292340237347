"""Points that are strewn all over the box of a cloud, and no part of a plant that looks like them."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.noise_points import NoisePointSettings, find_noise_points

COUNT = 12_000


def tree():
    """(N, 3) points of a trunk of 3 m, of limbs in a round crown and of twigs on them; Z up."""
    rng = np.random.default_rng(1)
    lines = [(np.zeros(3), np.array([0, 0, 3.0]), 0.1)]
    for _ in range(60):
        start = np.array([0, 0, rng.uniform(1.5, 3)])
        out = rng.normal(size=3)
        end = np.array([0, 0, 3.0]) + 1.4 * out / np.linalg.norm(out)
        lines.append((start, end, 0.015))
    lengths = np.array([np.linalg.norm(end - start) for start, end, _ in lines])
    of = rng.choice(len(lines), COUNT, p=lengths / lengths.sum())
    start, end = (np.array([line[k] for line in lines])[of] for k in (0, 1))
    radius_m = np.array([line[2] for line in lines])[of]
    return start + rng.uniform(size=(COUNT, 1)) * (end - start) + rng.normal(size=(COUNT, 3)) * radius_m[:, None] / 2


def strewn(points_m, count, beyond_m=0.0):
    low_m, high_m = points_m.min(axis=0) - beyond_m, points_m.max(axis=0) + beyond_m
    return np.random.default_rng(2).uniform(low_m, high_m, (count, 3))


@pytest.mark.parametrize("share", [0.15, 0.5, 1.0])
@pytest.mark.parametrize("beyond_m", [0.0, 0.4])
def test_what_is_strewn_over_the_box_goes_and_the_tree_stays(share, beyond_m):
    wood_m = tree()
    noise_m = strewn(wood_m, int(share * COUNT), beyond_m)
    noise = find_noise_points(np.concatenate([wood_m, noise_m]))
    assert noise[COUNT:].mean() > 0.8
    assert noise[:COUNT].mean() < 0.05


def test_neither_size_nor_place_matter():
    points_m = tree()
    points_m = np.concatenate([points_m, strewn(points_m, COUNT // 2)])
    assert np.array_equal(find_noise_points(points_m), find_noise_points(1000 * points_m))
    assert np.mean(find_noise_points(points_m) != find_noise_points(np.add(points_m, (3, -7, 2)))) < 1e-3


def test_a_tree_alone_has_none():
    assert not find_noise_points(tree()).any()
    assert not find_noise_points(tree()[::20]).any()


def test_a_plant_that_fills_its_box_stays():
    rng = np.random.default_rng(3)
    assert not find_noise_points(rng.uniform(0, 1, (20_000, 3))).any()
    leaves_m = np.repeat(rng.uniform(0, 1, (3000, 3)), 10, axis=0)
    assert not find_noise_points(leaves_m + rng.normal(0, 0.004, leaves_m.shape)).any()


def test_of_few_points_in_one_place_or_in_a_plane_none_are_noise():
    flat_m = np.random.default_rng(4).uniform(0, 1, (9000, 3)) * [1, 1, 0]
    for points_m in (np.zeros((0, 3)), np.zeros((1, 3)), np.zeros((9000, 3)), flat_m):
        assert not find_noise_points(points_m).any()


def test_settings_are_checked():
    with pytest.raises(ValueError, match="filled"):
        NoisePointSettings(filled=0)
    with pytest.raises(ValueError, match="closer"):
        NoisePointSettings(closer=1.5)
