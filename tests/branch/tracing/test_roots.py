"""Roots: as many as there are stems, where these stand."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.branch.tracing.roots import RootSettings, find_roots

from tests.support.branch_clouds import cloud_of, cone, small_tree

PLACES_M = np.array([[0, 0], [0.8, 0.1], [-0.5, 0.7], [0.2, -0.9], [-0.9, -0.6]])


def bush(stems: int, height_m: float = 2.0, lean: float = 0.2) -> np.ndarray:
    """Stems that lean outwards, each with fewer points than the one before."""
    parts = []
    for number, (x, z) in enumerate(PLACES_M[:stems]):
        tip = [x * (1 + lean), height_m, z * (1 + lean)]
        parts.append(cone([x, 0, z], tip, (0.03, 0.01), 3000 - 300 * number, number))
    return np.concatenate(parts)


@pytest.mark.parametrize("stems", [1, 2, 3, 5])
@pytest.mark.parametrize("count_given", [True, False])
def test_as_many_stems_are_as_many_roots_at_their_places(stems, count_given):
    roots_m = find_roots(bush(stems), RootSettings(count=stems if count_given else None))
    assert len(roots_m) == stems
    away_m = np.linalg.norm(roots_m[:, None, [0, 2]] - PLACES_M[:stems], axis=2)
    assert (np.sort(away_m.argmin(axis=1)) == np.arange(stems)).all()
    assert away_m.min(axis=1).max() < 0.03  # the radius of a stem
    assert roots_m[:, 1] == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("radius_m", [0.03, 0.05, 0.08, 0.12])
@pytest.mark.parametrize("count", [1, 2, None])
def test_a_thick_stem_is_one_root(radius_m, count):
    stems = [
        cone([x, 0, 0], [x, 2, 0], (radius_m, radius_m / 3), points, 1) for x, points in ((0, 20_000), (1, 12_000))
    ]
    roots_m = find_roots(np.concatenate(stems), RootSettings(count=count))
    assert roots_m == pytest.approx(np.array([[0, 0, 0], [1, 0, 0]])[:count], abs=0.1 * radius_m)


def test_the_densest_come_first_and_no_more_than_are_wanted():
    roots_m = find_roots(bush(5), RootSettings(count=2))
    assert len(roots_m) == 2
    sparse = np.random.default_rng(0).permutation(cone([0.8, 0, 0.1], [0.8, 2, 0.1], 0.03, 3000))[:900]
    first, second = find_roots(np.concatenate([bush(1), sparse]), RootSettings(count=2))
    assert first[[0, 2]] == pytest.approx([0, 0], abs=0.02)
    assert second[[0, 2]] == pytest.approx([0.8, 0.1], abs=0.02)


def test_stems_that_stand_close_are_separated_where_their_number_is_given():
    points_m = np.concatenate([cone([x, 0, 0], [3 * x, 2, 0], 0.02, 2000, 7) for x in (-0.08, 0.08)])
    roots_m = find_roots(points_m, RootSettings(count=2))
    assert np.sort(roots_m[:, 0]) == pytest.approx([-0.08, 0.08], abs=0.02)


def test_what_is_far_above_the_ground_is_no_root():
    twigs_m = cone([1, 0.9, 0], [1, 1.5, 0], 0.03, 9000)
    roots_m = find_roots(np.concatenate([bush(1), twigs_m]))
    assert roots_m == pytest.approx(np.zeros((1, 3)), abs=0.02)


def test_a_tree_has_one_root_at_the_middle_of_its_foot():
    roots_m = find_roots(cloud_of(small_tree(), 8000))
    assert roots_m == pytest.approx(np.zeros((1, 3)), abs=0.02)


@examples(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), x=st.floats(-1000, 1000), y=st.floats(-1000, 1000), scale=st.floats(0.1, 10))
def test_roots_move_and_grow_with_the_plant(seed, x, y, scale):
    points_m = bush(3)
    moved_m = np.random.default_rng(seed).permutation(scale * points_m + [x, y, -x])
    found_m = (find_roots(moved_m) - [x, y, -x]) / scale
    away_m = np.linalg.norm(found_m[:, None] - find_roots(points_m), axis=2)
    assert len(found_m) == 3
    assert away_m.min(axis=1).max() < 0.01


@pytest.mark.parametrize("points_m", [np.ones((1, 3)), np.ones((40, 3))])
def test_one_place_is_a_root(points_m):
    assert find_roots(points_m).tolist() == [[1, 1, 1]]
    assert find_roots(points_m, RootSettings(count=3)).tolist() == [[1, 1, 1]]  # and there are no more


def test_a_flat_cloud_has_roots_somewhere_in_it():
    points_m = np.random.default_rng(0).uniform(-1, 1, (2000, 3)) * [1, 0, 1]
    roots_m = find_roots(points_m)
    assert 1 <= len(roots_m) <= RootSettings().max_count
    assert (np.abs(roots_m) <= 1).all()


@pytest.mark.parametrize("change", [{"slab": 0.0}, {"standing_out": 1.5}, {"cell_of_height": 0.0}])
def test_settings_that_find_nothing_are_refused(change):
    with pytest.raises(ValueError, match="slab and standing_out must be in"):
        RootSettings(**change)


def test_no_roots_are_refused():
    with pytest.raises(ValueError, match="count must be at least 1"):
        RootSettings(count=0)


def test_what_lies_on_the_ground_is_no_root():
    rng = np.random.default_rng(3)
    stem_m = cone([0, 0, 0], [0, 2, 0], (0.05, 0.02), 3000, 1)
    shadow_m = rng.uniform((0.5, 0, -0.2), (0.9, 0.03, 0.2), (30_000, 3))  # denser than the stem
    roots_m = find_roots(np.concatenate([stem_m, shadow_m]))
    assert len(roots_m) == 1
    assert np.hypot(*roots_m[0, [0, 2]]) < 0.05
    assert len(find_roots(shadow_m)) > 0  # without anything else there is a root nevertheless
