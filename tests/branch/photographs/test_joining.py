"""Places on stems become one skeleton from the soil to the leaves."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from usdfoliage.branch.photographs.join_settings import JoinSettings
from usdfoliage.branch.photographs.joined import JoinedStems
from usdfoliage.branch.photographs.joining import find_turned, join_stems
from usdfoliage.branch.photographs.stem_points import StemPoints

FOOTPRINT_M = 0.0005
NO_LEAVES = np.zeros((0, 3))


def places_on(*ends_m: tuple, radius_m: float = 0.002, odds: float = 1.5) -> StemPoints:
    """Places a millimetre apart on straight lines, each given by its two ends."""
    points, along = [], []
    for start, end in ends_m:
        start, end = np.array(start, float), np.array(end, float)
        length_m = np.linalg.norm(end - start)
        share = np.linspace(0, 1, int(length_m / 0.001))
        points.append(start + share[:, None] * (end - start))
        along.append(np.tile((end - start) / length_m, (len(share), 1)))
    count = sum(map(len, points))
    return StemPoints(
        points_m=np.concatenate(points),
        along=np.concatenate(along),
        radius_m=np.full(count, radius_m),
        odds=np.full(count, odds),
        footprint_m=FOOTPRINT_M,
    )


def both(one: StemPoints, other: StemPoints) -> StemPoints:
    joined = {
        name: np.concatenate([getattr(one, name), getattr(other, name)])
        for name in ("points_m", "along", "radius_m", "odds")
    }
    return replace(one, **joined)


def stem_of(joined: JoinedStems | None) -> np.ndarray:
    assert joined is not None
    return joined.skeleton.points_m[joined.skeleton.branch(0)]


STEM = ((0.0, 0.06, 0.0), (0.02, 0.3, 0.0))


def test_a_stem_goes_on_to_the_soil_and_keeps_its_radius():
    joined = join_stems(places_on(STEM), NO_LEAVES, 0.0)
    stem_m = stem_of(joined)
    assert len(joined.skeleton) == 1
    assert stem_m[0, 1] == pytest.approx(0.0, abs=1e-6)
    assert stem_m[-1] == pytest.approx((0.02, 0.3, 0.0), abs=0.002)
    assert joined.skeleton.radius_m == pytest.approx(0.002, rel=0.05)


def test_a_gap_in_a_stem_is_bridged_straight():
    joined = join_stems(places_on(((0, 0.0, 0), (0, 0.1, 0)), ((0, 0.125, 0), (0, 0.3, 0))), NO_LEAVES, 0.0)
    assert len(joined.skeleton) == 1
    assert np.abs(stem_of(joined)[:, [0, 2]]).max() < 1e-3
    assert stem_of(joined)[-1, 1] == pytest.approx(0.3, abs=0.002)


def test_a_piece_far_from_the_plant_is_listed_and_left_out():
    far = places_on(((0.4, 0.2, 0.0), (0.44, 0.22, 0.0)))
    joined = join_stems(both(places_on(STEM), far), NO_LEAVES, 0.0)
    assert joined.skeleton.points_m[:, 0].max() < 0.1
    (piece,) = joined.apart
    assert piece.length_m == pytest.approx(0.045, abs=0.003)
    assert piece.middle_m == pytest.approx((0.42, 0.21, 0.0), abs=0.003)


def test_a_petiole_leads_to_its_leaf_though_nothing_shows_it():
    base_m = np.array([[0.035, 0.22, 0.0]])
    joined = join_stems(places_on(STEM), base_m, 0.0)
    assert len(joined.skeleton) == 2
    assert joined.leaf[0] >= 0
    assert joined.skeleton.points_m[joined.leaf[0]] == pytest.approx(base_m[0], abs=1e-3)
    assert joined.skeleton.order.tolist() == [0, 1]


def test_places_that_are_rather_of_leaves_are_no_branch():
    border = places_on(((0.013, 0.22, 0.0), (0.06, 0.25, 0.0)), odds=-2.0)
    joined = join_stems(both(places_on(STEM), border), NO_LEAVES, 0.0)
    assert len(joined.skeleton) == 1


def test_two_stems_have_two_roots_though_their_leaves_touch():
    pair = places_on(((-0.03, 0.05, 0), (-0.03, 0.28, 0)), ((0.03, 0.05, 0), (0.03, 0.3, 0)))
    touching = places_on(((-0.03, 0.28, 0), (0.03, 0.29, 0)), odds=0.2)
    skeleton = join_stems(both(pair, touching), NO_LEAVES, 0.0).skeleton
    roots_m = skeleton.points_m[skeleton.first[skeleton.parent_curve < 0]]
    assert sorted(roots_m[:, 0].round(3).tolist()) == [-0.03, 0.03]


def test_moving_the_plant_moves_its_skeleton():
    stems, base_m, moved_m = places_on(STEM), np.array([[0.035, 0.22, 0.0]]), np.array([0.7, -0.2, 1.1])
    here = join_stems(stems, base_m, 0.0).skeleton
    there = join_stems(replace(stems, points_m=stems.points_m + moved_m), base_m + moved_m, -0.2).skeleton
    assert there.counts.tolist() == here.counts.tolist()
    assert cKDTree(here.points_m + moved_m).query(there.points_m)[0].max() < 1e-6


def test_nothing_gives_no_skeleton():
    assert join_stems(places_on(STEM).take(np.zeros(0, np.int64)), NO_LEAVES, 0.0) is None
    assert join_stems(places_on(STEM, odds=-3.0), NO_LEAVES, 0.0) is None
    with pytest.raises(ValueError, match="gap"):
        JoinSettings(gap=0)


def test_a_leaf_hangs_on_the_stem_by_the_end_that_is_at_it_unless_the_other_is_certain():
    stem = places_on(((0.0, 0.0, 0.0), (0.0, 0.3, 0.0)))
    near_m, far_m = np.array([[0.01, 0.2, 0.0]]), np.array([[0.08, 0.22, 0.0]])
    for certainty, turned in ((0.5, True), (0.6, True), (0.99, False)):
        assert find_turned(stem, far_m, near_m, np.array([certainty]), 0.0) == [turned]
        assert not find_turned(stem, near_m, far_m, np.array([certainty]), 0.0).any()
    joined = join_stems(stem, far_m, 0.0, apices_m=near_m)
    assert joined is not None
    assert joined.turned.tolist() == [True]
    assert np.linalg.norm(joined.skeleton.points_m - near_m, axis=1).min() < 1e-6
    assert np.linalg.norm(joined.skeleton.points_m - far_m, axis=1).min() > 0.05


def test_scraps_of_lines_among_leaves_make_no_stems():
    rng = np.random.default_rng(2)
    starts_m = rng.uniform((-0.1, 0.0, -0.1), (0.1, 0.3, 0.1), (30, 3))
    scraps = places_on(*((start, start + rng.normal(0, 0.004, 3)) for start in starts_m))
    assert join_stems(scraps, starts_m, 0.0) is None
    assert join_stems(places_on(STEM), starts_m, 0.0) is not None


def test_what_is_high_above_the_soil_and_hardly_seen_gets_no_stem_of_its_own():
    stem = places_on(((0.0, 0.0, 0.0), (0.0, 0.3, 0.0)))
    scrap = places_on(((0.06, 0.125, 0.0), (0.06, 0.132, 0.0)))  # of the border of a leaf, whose petiole is hidden
    joined = join_stems(both(stem, scrap), np.array([[0.06, 0.14, 0.0]]), 0.0)
    assert joined is not None
    assert (joined.skeleton.parent_curve < 0).sum() == 1


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("low", 1.1),
        ("low", -0.1),
        ("stem", 1.5),
        ("highest_root", float("nan")),
        ("stiffness", -1.0),
        ("min_visible", -0.1),
        ("unbroken", float("nan")),
        ("sure", float("inf")),
        ("end", -1.0),
    ],
)
def test_settings_that_cannot_be(name, value):
    with pytest.raises(ValueError, match=f"{name} must be .*{value:g}"):
        JoinSettings(**{name: value})


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 1000))
def test_the_leaves_that_are_turned_are_joined_by_their_other_ends(seed):
    """Stems with leaves any way: as if the leaves had been given with the ends that are their bases."""
    rng = np.random.default_rng(seed)
    stems = places_on(STEM, ((0.02, 0.2, 0.0), (0.1, 0.26, 0.03)))
    bases_m = rng.uniform((-0.05, 0.05, -0.05), (0.12, 0.3, 0.05), (12, 3))
    apices_m = bases_m + rng.normal(0, 0.03, (12, 3))
    certainty = rng.uniform(0.5, 1.0, 12)
    joined = join_stems(stems, bases_m, 0.0, apices_m=apices_m, certainty=certainty)
    turned = find_turned(stems, bases_m, apices_m, certainty, 0.0)
    alone = join_stems(stems, np.where(turned[:, None], apices_m, bases_m), 0.0)
    assert joined is not None
    assert alone is not None
    np.testing.assert_array_equal(joined.turned, turned)
    np.testing.assert_array_equal(joined.leaf, alone.leaf)
    np.testing.assert_array_equal(joined.joined, alone.joined)
    np.testing.assert_allclose(joined.skeleton.points_m, alone.skeleton.points_m, atol=1e-12)
