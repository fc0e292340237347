"""Planes that photographs of known, textured surfaces are matched by."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage import _native
from usdfoliage.capture.mvs.patch_match import (
    MatchedPlanes,
    PatchMatchSettings,
    match_view,
    propose_planes,
    warps,
)

from tests.support.stereo_pictures import (
    CAMERAS,
    FOCAL,
    HEIGHT,
    SLANTED,
    STEP,
    WIDTH,
    camera,
    draw,
    exact_planes,
    inside,
)

SETTINGS = PatchMatchSettings(best_sources=2)
RANGE_M = (0.6, 2.5)


def match(views, settings=SETTINGS, range_m=RANGE_M, **options):
    """From a picture of half the size to the whole one."""
    coarse = match_view(views[0], views[1:], range_m, 1, 5, settings, **options)
    return match_view(views[0], views[1:], range_m, 0, 3, settings, start=coarse, **options)


def test_a_slanted_plane_is_found_with_its_slope():
    views = [draw(cam, SLANTED) for cam in CAMERAS]
    planes = match(views)

    error = np.abs(planes.depth_m / views[0].depth_m - 1)[inside(16)]
    assert np.median(error) < 0.003
    assert np.mean(error < 0.01) > 0.95
    normals = planes.normals()
    assert np.linalg.norm(normals, axis=-1) == pytest.approx(1, abs=1e-5)
    true = -SLANTED[0][0] / np.linalg.norm(SLANTED[0][0])
    assert np.degrees(np.arccos(np.median(normals[inside()] @ true))) < 7
    assert np.median(planes.cost[inside()]) < 0.1


def test_a_step_stays_a_step():
    views = [draw(cam, STEP) for cam in CAMERAS]
    planes = match(views)

    error = np.abs(planes.depth_m / views[0].depth_m - 1)
    assert np.mean(error[inside()] < 0.01) > 0.9
    beside = np.abs(np.arange(WIDTH) + 0.5 - WIDTH / 2) > 6
    assert np.mean(error[:, beside][inside()[:, beside]] < 0.01) > 0.95


def test_color_separates_surfaces_without_texture():
    # A plain twig before a plain wall: at the wall's depth its window lies on the wall in the other photographs.
    twig = [(STEP[0][0], STEP[0][1], (1, 1, 1)), (STEP[1][0], lambda at: np.abs(at[..., 0]) < 0.02, (0.3, 0.8, 0.2))]
    views = [draw(cam, twig, plain=True) for cam in (camera(), camera(0.25))]
    middle = np.abs(np.arange(WIDTH) + 0.5 - WIDTH / 2) < 1
    settings = replace(SETTINGS, best_sources=1)
    blind = replace(settings, brightness_weight=0.0, tint_weight=0.0)
    more = []
    for weights in (blind, settings):
        wall, twig = (
            match_view(views[0], views[1:], RANGE_M, 0, 0, weights, start=exact_planes(CAMERAS[0], normal)).cost
            for normal in (STEP[0][0], STEP[1][0])
        )
        more.append(np.median((wall - twig)[10:-10, middle]))
    assert more[1] > more[0] + 0.4


def test_planes_of_sources_mend_what_does_not_match():
    views = [draw(cam, SLANTED) for cam in CAMERAS]
    exact = [exact_planes(cam, SLANTED[0][0]) for cam in CAMERAS]
    assert exact[1].depth_m == pytest.approx(views[1].depth_m, rel=1e-5)
    spoilt = exact[0].planes.copy()
    spoilt[20:40, 30:50, 0] *= 1.3
    start = MatchedPlanes(camera=CAMERAS[0], planes=spoilt, cost=exact[0].cost)
    mended = match_view(views[0], views[1:], RANGE_M, 0, 3, SETTINGS, start=start, source_planes=exact[1:])
    error = np.abs(mended.depth_m / views[0].depth_m - 1)[inside()]
    assert np.mean(error < 0.005) > 0.98

    # What is off by many pixels costs the whole limit; what is right nothing but its match.
    none = match_view(views[0], views[1:], RANGE_M, 0, 0, SETTINGS, start=start, source_planes=exact[1:])
    limit = SETTINGS.geometric_weight * SETTINGS.geometric_limit_px
    assert np.median(none.cost[25:35, 35:45]) > limit > 5 * np.median(none.cost[50:60, 60:70])


def test_a_segments_plane_is_tried_and_what_leaves_it_pays_where_there_is_no_texture():
    views = [draw(cam, SLANTED) for cam in CAMERAS]
    exact = exact_planes(CAMERAS[0], SLANTED[0][0])
    far = exact.planes.copy()
    far[..., 0] *= 0.7
    start = MatchedPlanes(camera=CAMERAS[0], planes=far, cost=exact.cost)
    sources = views[1:]
    strict = replace(SETTINGS, segment_texture=1e5)
    found = match_view(views[0], sources, RANGE_M, 0, 1, strict, start=start, segment_planes=exact.planes)
    assert np.mean(np.abs(found.depth_m / views[0].depth_m - 1)[inside(14)] < 0.003) > 0.97

    free = match_view(views[0], sources, RANGE_M, 0, 0, SETTINGS, start=start)
    with_planes = match_view(views[0], sources, RANGE_M, 0, 0, strict, start=start, segment_planes=exact.planes)
    assert (with_planes.cost - free.cost)[inside()] == pytest.approx(SETTINGS.segment_weight, abs=1e-5)
    textured = match_view(views[0], sources, RANGE_M, 0, 0, SETTINGS, start=start, segment_planes=exact.planes)
    pays = (textured.cost - free.cost)[inside()]
    assert 0 < np.median(pays) < 0.5 * SETTINGS.segment_weight
    without = np.zeros_like(exact.planes)  # inverse depth 0: no plane is known
    none = match_view(views[0], sources, RANGE_M, 0, 0, SETTINGS, start=start, segment_planes=without)
    assert np.array_equal(none.cost, free.cost)


def test_threads_and_runs_give_the_same_and_seeds_hardly_matter():
    views = [draw(cam, SLANTED) for cam in CAMERAS]
    one, three = (match(views, threads=threads) for threads in (1, 3))
    assert np.array_equal(one.planes, three.planes)
    assert np.array_equal(one.cost, three.cost)
    other = match(views, seed=5)
    assert not np.array_equal(one.planes, other.planes)
    assert np.median(np.abs(one.depth_m / other.depth_m - 1)) < 0.005


def test_what_is_masked_has_no_plane():
    views = [draw(cam, SLANTED) for cam in CAMERAS]
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[20:50, 20:60] = True
    planes = match([replace(views[0], mask=mask), *views[1:]])
    assert not planes.planes[~mask].any()
    assert not planes.normals()[~mask].any()
    assert (planes.depth_m[mask] > 0).all()


def test_depths_stay_in_their_range():
    views = [draw(cam, SLANTED) for cam in CAMERAS]
    depth_m = match(views, range_m=(0.6, 1.0)).depth_m
    assert depth_m.min() >= 0.6 - 1e-5
    assert depth_m.max() <= 1.0 + 1e-5


def window_cost(reference, source, plane, row, column, settings):
    """The cost of a plane at a pixel in one source, one sample after the other."""
    offsets = settings.window_offsets()
    gray = np.array([0.299, 0.587, 0.114])
    own = reference.srgb[row + offsets[:, 1], column + offsets[:, 0]].astype(float)
    middle = reference.srgb[row, column].astype(float)
    away = np.hypot(*offsets.T) / settings.distance_scale_px
    weight = np.exp(-away - np.abs(own - middle).sum(axis=1) / settings.color_scale)
    weight /= weight.sum()
    inverse = plane[0] + plane[1] * offsets[:, 0] + plane[2] * offsets[:, 1]
    pixels = np.column_stack([column + offsets[:, 0], row + offsets[:, 1], np.ones(len(offsets))])
    warp = warps(reference.camera, source.camera)[0]
    seen = pixels @ warp[:, :3].T + inverse[:, None] * warp[:, 3]
    x, y = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    p, q = x - i, y - j
    bright = np.rint(source.srgb @ gray)
    there = (bright[j, i] * (1 - p) + bright[j, i + 1] * p) * (1 - q) + (
        bright[j + 1, i] * (1 - p) + bright[j + 1, i + 1] * p
    ) * q
    here = own @ gray
    mean, other = weight @ here, weight @ there
    common = weight @ ((here - mean) * (there - other))
    noise = settings.noise**2
    spread = np.sqrt((weight @ (here - mean) ** 2 + noise) * (weight @ (there - other) ** 2 + noise))
    return 1 - common / spread + settings.brightness_weight * min(1, abs(mean - other) / settings.brightness_scale)


def test_the_cost_is_that_of_the_plain_formula():
    settings = PatchMatchSettings(best_sources=1, tint_weight=0.0)
    views = [draw(cam, STEP) for cam in CAMERAS[:2]]
    start = exact_planes(CAMERAS[0], np.array([0.02, 0.01, 1.0]))
    cost = match_view(views[0], views[1:], RANGE_M, 0, 0, settings, start=start).cost
    rng = np.random.default_rng(2)
    for row, column in zip(rng.integers(10, HEIGHT - 10, 40), rng.integers(25, WIDTH - 10, 40), strict=True):
        plain = window_cost(views[0], views[1], start.planes[row, column], row, column, settings)
        assert cost[row, column] == pytest.approx(plain, abs=0.02)


def test_agreement_counts_views_that_lead_back():
    planes = [exact_planes(cam, SLANTED[0][0]) for cam in CAMERAS]
    depths = [each.depth_m for each in planes]
    depths[3] = depths[3] * 1.1
    to = [warps(CAMERAS[0], cam) for cam in CAMERAS[1:]]
    others = [_native.DepthSource(depth_m=each, warps=warp) for each, warp in zip(depths[1:], to, strict=True)]
    settings = _native.AgreementSettings(agree_px=1.0, agree_share=0.01)
    counts = _native.count_agreeing(depths[0], others, settings=settings, threads=0)
    assert np.mean(counts.agreeing[inside(16)] == 2) > 0.95
    assert counts.agreeing.max() == 2
    # The third puts its surface farther away: it sees through this one.
    assert np.mean(counts.through[inside(16)] == 1) > 0.95
    none = _native.count_agreeing(np.zeros_like(depths[0]), others, settings=settings, threads=0)
    assert not none.agreeing.any()
    assert not none.through.any()


def test_planes_of_another_view_are_the_same_planes():
    planes = [exact_planes(cam, SLANTED[0][0]) for cam in CAMERAS]
    (layer, other) = propose_planes(CAMERAS[0], [planes[1], planes[2], None])
    for seen in (layer, other):
        has_depth = seen[..., 0] > 0
        assert has_depth[inside(20)].mean() > 0.9
        assert seen[has_depth] == pytest.approx(planes[0].planes[has_depth], rel=1e-3, abs=1e-5)
    assert propose_planes(CAMERAS[0], [None]) is None


def test_what_others_see_the_sky_at_is_not_there():
    views = [draw(cam, SLANTED) for cam in CAMERAS]
    start = exact_planes(CAMERAS[0], SLANTED[0][0])
    free = match_view(views[0], views[1:], RANGE_M, 0, 0, SETTINGS, start=start)
    masked = [replace(view, mask=np.zeros((HEIGHT, WIDTH), bool)) for view in views[1:]]
    barred = match_view(views[0], masked, RANGE_M, 0, 0, SETTINGS, start=start)
    assert (barred.cost - free.cost)[inside(16)].min() > 3 * SETTINGS.open_weight


def test_wrong_arguments():
    views = [draw(cam, SLANTED) for cam in CAMERAS]
    for range_m in ((0.0, 1.0), (2.0, 1.0), (np.nan, 1.0)):
        with pytest.raises(ValueError, match="near < far"):
            match_view(views[0], views[1:], range_m, 0, 1)
    for sources in ([], views * 5):
        with pytest.raises(ValueError, match="1 to 16"):
            match_view(views[0], sources, RANGE_M, 0, 1)
    with pytest.raises(ValueError, match="as many planes"):
        match_view(views[0], views[1:], RANGE_M, 0, 1, source_planes=[None])
    for wrong in (
        {"window_px": 0},
        {"window_px": 4, "window_step_px": 3},
        {"color_scale": 0.0},
        {"noise": np.nan},
        {"max_slant_deg": 90.0},
        {"tint_weight": -1.0},
    ):
        with pytest.raises(ValueError, match="must"):
            PatchMatchSettings(**wrong)
    with pytest.raises(ValueError, match="64 pixels"):
        PatchMatchSettings(window_px=9, window_step_px=1)
    assert CAMERAS[0].pixel_from_ray()[0, 0] == FOCAL
