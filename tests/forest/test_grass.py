"""Clumps of grass: on vegetated ground that a camera sees from near, fewer with the distance, and never too many."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from usdfoliage.forest.grass import LOWEST, GrassSettings, clump_share, even_places, place_clumps
from usdfoliage.forest.grass_clump import POINTS, ClumpSettings, build_clump
from usdfoliage.forest.raster import Raster, is_inside, sample_nearest
from usdfoliage.forest.shots import CameraPath

SIDE_M = 80.0
ORIGIN_M = np.array([455_000.0, 4_660_000.0])  # of the south-west corner
SETTINGS = GrassSettings(distance_m=20, max_clumps=10_000_000, clumps_per_m2=30, near_m=5)
# (east, north, up) from the corner to (x, y, z): east, up, south.
ASSET_FROM_GROUND = np.array([[1.0, 0, 0, -ORIGIN_M[0]], [0, 0, 1, 0], [0, -1, 0, ORIGIN_M[1]], [0, 0, 0, 1]])


def ground(cell_m: float = 0.5, west: float = 1.0) -> Raster:
    """Vegetation on the west part of the ground."""
    count = round(SIDE_M / cell_m)
    values = np.zeros((count, count), np.float32)
    values[:, : round(west * count)] = 1
    matrix = np.array([[cell_m, 0, ORIGIN_M[0]], [0, -cell_m, ORIGIN_M[1] + SIDE_M]])
    return Raster(values=values, ground_from_pixel=matrix)


def camera(*eyes_m: tuple[float, float, float], wide: float = 1.0) -> CameraPath:
    """A camera at places given by east, north and height from the corner, which looks north and a little down."""
    count = len(eyes_m)
    east, north, up = np.array(eyes_m).T
    back = np.array([0.0, 0.2, 1.0]) / np.hypot(1, 0.2)
    right = np.array([1.0, 0, 0])
    axes = np.array([right, np.cross(back, right), back])
    return CameraPath(
        frame=np.arange(count, dtype=float),
        eye_m=np.stack([east, up, -north], axis=-1),
        axes=np.repeat(axes[None], count, axis=0),
        window=np.tile([-wide, wide, -wide, wide], (count, 1)),
    )


def slope(ground_m):
    return 0.1 * (ground_m[:, 0] - ORIGIN_M[0]) - 0.05 * (ground_m[:, 1] - ORIGIN_M[1])


def level(ground_m):
    return np.zeros(len(ground_m))


def place(path, settings=SETTINGS, *, raster=None, height=level, seed=0):
    return place_clumps(raster or ground(), height, path, ASSET_FROM_GROUND, seed, 0.1, settings)


def test_clumps_are_before_the_camera_and_within_the_distance():
    clumps = place(camera((40, 30, 1.7)))
    offset = clumps.ground_m - ORIGIN_M - [40, 30]
    away = np.linalg.norm(np.column_stack([offset, np.full(len(offset), 1.7)]), axis=1)
    assert len(clumps) > 1000
    assert away.max() < SETTINGS.distance_m + 1  # a cell is there as its middle is
    assert offset[:, 1].min() > -2
    depth = (offset[:, 1] + 0.2 * 1.7) / np.hypot(1, 0.2)
    # Beyond the margin of the picture stand those whose cell reaches into it.
    assert (np.abs(offset[:, 0]) < 1.2 * np.maximum(depth, 0) + 3).all()
    left = offset[:, 0] < 0
    assert 0.45 < left.mean() < 0.55


def test_how_many_there_are_follows_the_distance():
    clumps = place(camera((40, 20, 1.7)))
    offset = clumps.ground_m - ORIGIN_M - [40, 20]
    away = np.hypot(*offset.T)
    ahead = np.abs(np.arctan2(offset[:, 0], offset[:, 1])) < 0.6
    for low, high in ((2.5, 4.5), (8, 10), (12, 13), (16, 17)):
        found = ((away > low) & (away < high) & ahead).sum() / (0.6 * (high**2 - low**2))
        wanted = SETTINGS.clumps_per_m2 * clump_share(np.array([np.hypot((low + high) / 2, 1.7)]), SETTINGS)[0]
        assert found == pytest.approx(wanted, rel=0.12)
    far, near = away > 18, away < 4
    assert clumps.across[far].min() > 2 * clumps.across[near].max()
    assert clumps.height_m[far].mean() < 0.75 * clumps.height_m[near].mean()
    assert clumps.height_m.min() >= LOWEST * SETTINGS.height_m[0]
    assert clumps.height_m.max() <= SETTINGS.height_m[1]


def test_clumps_stand_on_vegetated_ground_alone():
    for cell_m in (0.5, 4.0):
        raster = ground(cell_m, west=0.5)
        clumps = place(camera((40, 30, 1.7)), raster=raster)
        inside = sample_nearest(raster, clumps.ground_m) > 0
        assert inside.mean() > 0.9
        assert (clumps.ground_m[:, 0] - ORIGIN_M[0]).max() < 40 + 0.3 * cell_m  # the border is drawn between pixels
    assert not len(place(camera((40, 30, 1.7)), raster=ground(west=0.0)))


@pytest.mark.parametrize("bound", [1000, 2000, 5000])
def test_there_are_never_more_than_may_be_and_these_are_the_nearest(bound):
    path = camera(*((40.0, north, 1.7) for north in np.linspace(5, 30, 6)))
    everything = place(path)
    some = place(path, replace(SETTINGS, max_clumps=bound))
    assert len(everything) > 1.2 * bound
    assert 0.9 * bound <= len(some) <= bound
    if bound == 2000:
        aside = [np.abs(each.ground_m[:, 0] - ORIGIN_M[0] - 40).mean() for each in (some, everything)]
        assert aside[0] < 0.8 * aside[1]


def test_heights_and_slopes_are_those_of_the_ground():
    clumps = place(camera((40, 30, 4.2)), height=slope)
    np.testing.assert_allclose(clumps.elevation_m, slope(clumps.ground_m))
    np.testing.assert_allclose(clumps.slope, np.tile([0.1, -0.05], (len(clumps), 1)), atol=1e-6)


@pytest.mark.parametrize(
    "eye_m",
    [(40, 30, 60), (-500, -500, 1.7), (1e12, -1e12, 1.7), (40, 95, 1.7)],
    ids=["above", "off", "lost", "behind"],
)
def test_a_camera_that_is_never_near_has_none(eye_m):
    assert not len(place(camera(eye_m)))


def test_frames_far_away_change_nothing():
    one = place(camera((40, 30, 1.7)))
    path = camera((40, 30, 1.7), (1e9, 30, 1.7), (40, 30, 500))
    both = place(path)
    np.testing.assert_array_equal(one.ground_m, both.ground_m)


def test_none_stands_where_there_is_no_ground():
    """The vegetation may be of more ground than there is, and be turned."""

    def half(ground_m):
        return np.where(ground_m[:, 0] < ORIGIN_M[0] + 45, 0.0, np.nan)

    clumps = place(camera((40, 30, 1.7)), height=half)
    assert len(clumps) > 500
    assert (clumps.ground_m[:, 0] < ORIGIN_M[0] + 45).all()
    assert np.isfinite(clumps.slope).all()
    raster = ground()
    turned = np.array([[0.4, 0.3], [0.3, -0.4]])
    middle_m = ORIGIN_M + np.array([40.0, 30])
    turned = np.column_stack([turned, middle_m - turned @ [80, 80]])
    raster = replace(raster, ground_from_pixel=turned)
    clumps = place(camera((40, 10, 1.7)), raster=raster)
    assert len(clumps) > 500
    assert is_inside(raster, clumps.ground_m).all()


def test_one_seed_gives_the_same_and_another_others():
    path = camera((40, 30, 1.7))
    first, again, other = place(path), place(path), place(path, seed=1)
    for name in ("ground_m", "height_m", "turn_deg", "form", "shade"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert not np.isin(other.ground_m[:, 0], first.ground_m[:, 0]).any()


def test_every_beginning_of_even_places_is_even():
    places = even_places(256, 4.0, np.random.default_rng(0))
    assert places.min() >= 0
    assert places.max() < 4
    for count in (16, 64, 256):
        near = cKDTree(places[:count], boxsize=4.0).query(places[:count], k=2)[0][:, 1]
        assert near.min() > 0.55 * 4 / np.sqrt(count)


@pytest.mark.parametrize(
    "wrong",
    [
        {"distance_m": 0.0},
        {"distance_m": float("nan")},
        {"max_clumps": 999},
        {"clumps_per_m2": -1.0},
        {"near_m": 0.0},
        {"widest": 0.5},
        {"height_m": (0.2, 0.1)},
    ],
)
def test_settings_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must be"):
        GrassSettings(**wrong)


def test_a_clump_is_of_whole_blades():
    clump = build_clump(np.random.default_rng(0))
    blades = ClumpSettings().blades
    assert clump.points.shape == clump.normals.shape == (POINTS * blades, 3)
    assert clump.points[:, 1].min() == 0
    assert clump.points[:, 1].max() == 1
    np.testing.assert_allclose(np.linalg.norm(clump.normals, axis=1), 1)
    assert clump.normals[:, 1].min() > 0.9
    assert clump.face_counts.sum() == len(clump.face_indices)
    assert set(clump.face_indices.tolist()) == set(range(POINTS * blades))
    of_face = np.repeat(np.arange(len(clump.face_counts)), clump.face_counts)
    assert (clump.face_indices // POINTS == of_face // 2).all()  # two faces a blade, of its own points
    assert clump.shade.mean() == pytest.approx(1)
    for wrong in ({"blades": 0}, {"width_m": (0.0, 1.0)}, {"shade": 1.0}, {"radius_m": -1.0}):
        with pytest.raises(ValueError, match=r"must"):
            ClumpSettings(**wrong)
