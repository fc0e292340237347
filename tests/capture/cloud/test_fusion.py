"""Clouds of surfaces that are known."""

import weakref

import numpy as np
import pytest
from usdfoliage.capture.cloud.fusion import CloudSettings, SeenSurface, merge_views
from usdfoliage.capture.cloud.model import Cloud

from tests.support.plain_clouds import looking_down

WIDTH, HEIGHT = 60, 44


def seen(camera, srgb=(90, 160, 40), confidence=0.8, noise_m=0.0, seed=0):
    """The plane, as a view above it sees it."""
    shape = (HEIGHT, WIDTH)
    depth = np.full(shape, camera.position_m[2]) + np.random.default_rng(seed).normal(size=shape) * noise_m
    return SeenSurface(
        camera=camera,
        depth_m=depth.astype(np.float32),
        normals=np.broadcast_to(np.float32([0, 0, 1]), (*shape, 3)),
        srgb=np.broadcast_to(np.uint8(srgb), (*shape, 3)),
        confidence=np.full(shape, confidence, np.float32),
    )


def test_points_lie_on_the_surface_in_its_colour():
    cloud = merge_views([seen(looking_down()), seen(looking_down(0.3, 0.1))])
    assert np.abs(cloud.points_m[:, 2]).max() < 1e-6
    assert cloud.normals == pytest.approx(np.tile([0, 0, 1], (len(cloud), 1)))
    assert (cloud.srgb == (90, 160, 40)).all()
    assert (cloud.confidence == np.float32(0.8)).all()
    both = np.abs(cloud.points_m[:, 0] - 0.15) < 0.5
    assert set(cloud.views.tolist()) == {1, 2}
    assert cloud.views[both].mean() > 1.5


def test_what_few_views_see_is_left_out():
    views = [seen(looking_down(x)) for x in (0.0, 0.2, 0.4)]
    everything = merge_views(views, CloudSettings(cell_m=0.1))
    sure = merge_views(views, CloudSettings(cell_m=0.1, min_views=3))
    assert 0 < len(sure) < len(everything)
    assert np.array_equal(sure.points_m, everything.take(everything.views >= 3).points_m)


def test_views_that_agree_have_seen_a_point():
    view = seen(looking_down())
    agreeing = np.zeros((HEIGHT, WIDTH), np.uint8)
    agreeing[:, : WIDTH // 2] = 3
    cloud = merge_views([SeenSurface(**{**vars(view), "agreeing": agreeing})])
    left = cloud.points_m[:, 0] < 0
    assert (cloud.views[left] == 4).all()
    assert (cloud.views[~left] == 1).all()
    sure = merge_views([SeenSurface(**{**vars(view), "agreeing": agreeing})], CloudSettings(min_views=2))
    assert np.array_equal(sure.points_m, cloud.points_m[left])
    with pytest.raises(ValueError, match="agreeing"):
        merge_views([SeenSurface(**{**vars(view), "agreeing": agreeing[1:]})])


@pytest.mark.parametrize("scale", [0.01, 1.0, 100.0])
def test_cells_follow_the_footprint_of_a_pixel(scale):
    cloud = merge_views([seen(looking_down(height_m=2 * scale))])
    assert len(cloud) == pytest.approx(WIDTH * HEIGHT, rel=0.1)
    coarse = merge_views([seen(looking_down(height_m=2 * scale))], CloudSettings(cell_footprints=4.0))
    assert len(coarse) == pytest.approx(WIDTH * HEIGHT / 16, rel=0.2)


def test_noise_is_averaged_and_the_near_view_counts_more():
    near, far = seen(looking_down(height_m=1.0), (200, 0, 0)), seen(looking_down(height_m=3.0), (0, 0, 200))
    cloud = merge_views([near, far], CloudSettings(cell_m=0.2))
    center = np.linalg.norm(cloud.points_m[:, :2], axis=1) < 0.2
    assert (cloud.srgb[center, 0] > 2 * cloud.srgb[center, 2]).all()
    noisy = [seen(looking_down(), noise_m=0.01, seed=seed) for seed in range(16)]
    flat = merge_views(noisy, CloudSettings(cell_m=0.1, min_views=10))
    # The first point's height parts cells: what is above it and what is below is averaged apart.
    assert np.std(np.abs(flat.points_m[:, 2])) < 0.003


def test_colours_are_those_of_the_views_that_see_best():
    near, far = seen(looking_down(height_m=1.0), (200, 0, 0)), seen(looking_down(height_m=2.0), (0, 0, 200))
    cloud = merge_views([far, near, far], CloudSettings(cell_m=0.2))
    center = np.linalg.norm(cloud.points_m[:, :2], axis=1) < 0.2
    assert (cloud.srgb[center, 0] > 195).all()
    assert (cloud.srgb[center, 2] < 5).all()


def test_the_order_of_the_views_does_not_matter_much_and_the_same_gives_the_same():
    views = [seen(looking_down(x), noise_m=0.003, seed=number) for number, x in enumerate((0.0, 0.1, 0.2))]
    settings = CloudSettings(cell_m=0.05)
    assert np.array_equal(merge_views(views, settings).points_m, merge_views(iter(views), settings).points_m)
    assert len(merge_views(views[::-1], settings)) == pytest.approx(len(merge_views(views, settings)), rel=0.1)


def test_nothing_and_broken_depth():
    assert len(merge_views([])) == 0
    empty = seen(looking_down())
    empty.depth_m[:] = 0
    assert len(merge_views([empty])) == 0
    broken = seen(looking_down())
    broken.depth_m[:, ::2] = np.nan
    broken.depth_m[0] = -1
    broken.depth_m[1, 1] = np.inf
    cloud = merge_views([empty, broken])
    assert len(cloud) > 0
    assert np.isfinite(cloud.points_m).all()
    with pytest.raises(ValueError, match="srgb"):
        merge_views([SeenSurface(**{**vars(seen(looking_down())), "srgb": np.zeros((3, 3, 3), np.uint8)})])
    with pytest.raises(ValueError, match="cells"):
        merge_views([seen(looking_down())], CloudSettings(cell_m=1e-9))


@pytest.mark.parametrize("wrong", [{"cell_m": 0.0}, {"cell_m": np.nan}, {"cell_footprints": 0.0}, {"min_views": 0}])
def test_settings_that_cannot_be(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        CloudSettings(**wrong)


def test_threads_change_nothing():
    views = [seen(looking_down(0.1 * k, 0.05 * k), noise_m=0.02, seed=k) for k in range(9)]
    settings = CloudSettings(cell_m=0.05)
    alone = merge_views(views, settings, threads=1)
    for threads in (0, 2, 4):
        cloud = merge_views(iter(views), settings, threads=threads)
        for name in Cloud.__dataclass_fields__:
            assert np.array_equal(getattr(cloud, name), getattr(alone, name))


@pytest.mark.parametrize("threads", [1, 2])
def test_of_many_views_few_are_in_memory(threads):
    given, max_in_memory = [], 0

    def views():
        nonlocal max_in_memory
        for k in range(40):
            view = seen(looking_down(0.1 * k))
            given.append(weakref.ref(view))
            yield view
            del view
            max_in_memory = max(max_in_memory, sum(each() is not None for each in given))

    merge_views(views(), threads=threads)
    assert max_in_memory <= threads + 2
