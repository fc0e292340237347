"""Planes that photographs of known, textured surfaces are matched by."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.capture.patch_match import (
    UNMATCHED,
    MatchedPicture,
    MatchedPlanes,
    PatchMatchSettings,
    match_coherently,
    match_picture,
)
from usdfoliage.geometry.pinhole import Pinhole

WIDTH, HEIGHT, FOCAL = 96, 72, 110.0
FAST = PatchMatchSettings(iterations=(4, 3))


def camera(x=0.0, y=0.0, turn=(0.0, 0.0, 0.0)):
    rotation = Rotation.from_rotvec(turn).as_matrix()
    return Pinhole(
        width_px=WIDTH,
        height_px=HEIGHT,
        focal_px=(FOCAL, FOCAL),
        center_px=(WIDTH / 2, HEIGHT / 2),
        cam_from_world=np.column_stack([rotation, -rotation @ (x, y, 0.0)]),
    )


CAMERAS = (camera(), camera(0.1), camera(-0.1, 0.02, (0, 0.05, 0)), camera(0, 0.1, (-0.04, 0, 0.02)))


def texture(points):
    """Brightness (..., 0 to 1) of points of the world: waves in many directions."""
    rng = np.random.default_rng(4)
    waves, phases = rng.normal(size=(24, 3)) * 45, rng.uniform(0, 2 * np.pi, 24)
    return 0.5 + np.sin(points @ waves.T + phases).mean(axis=-1)


def draw(cam, surfaces, plain=False):
    """A picture of planes n X = 1 of the world, the nearest before the others, and its depth; each with its extent."""
    rays = cam.rays() @ cam.cam_from_world[:, :3]
    origin = cam.position_m
    depth = np.full((HEIGHT, WIDTH), np.inf)
    for normal, shown in surfaces:
        away = (1 - origin @ normal) / (rays @ normal)
        hit = (away > 0) & shown(origin + away[..., None] * rays) & (away < depth)
        depth = np.where(hit, away, depth)
    points = origin + np.where(np.isfinite(depth), depth, 0)[..., None] * rays
    grey = np.where(np.isfinite(depth), 0.5 if plain else texture(points), 0.5)
    return MatchedPicture(camera=cam, grey=grey.astype(np.float32)), np.where(np.isfinite(depth), depth, 0)


def everywhere(points):
    return np.ones(points.shape[:-1], bool)


SLANTED = [(np.array([0.35, -0.2, 0.9]) / 1.0, everywhere)]
STEP = [(np.array([0, 0, 1 / 1.4]), everywhere), (np.array([0, 0, 1.0]), lambda points: points[..., 0] < 0)]


def inside(shape, border=8):
    mask = np.zeros(shape, bool)
    mask[border:-border, border:-border] = True
    return mask


def test_a_slanted_plane_is_found_with_its_slope():
    drawn = [draw(cam, SLANTED) for cam in CAMERAS]
    planes = match_picture(drawn[0][0], [picture for picture, _ in drawn[1:]], 0.6, 2.5, FAST)

    true, interior = drawn[0][1], inside((HEIGHT, WIDTH))
    error = np.abs(planes.depth_m(1.0) / true - 1)[interior]
    assert np.median(error) < 0.002
    assert np.mean(error < 0.01) > 0.97
    slopes = np.median(planes.slopes[interior], axis=0)
    normal = np.array([slopes[0] * FOCAL, slopes[1] * FOCAL])
    assert normal == pytest.approx(SLANTED[0][0][:2], abs=0.05)
    assert np.median(planes.cost[interior]) < 0.05


def test_a_step_stays_a_step():
    drawn = [draw(cam, STEP) for cam in CAMERAS]
    planes = match_picture(drawn[0][0], [picture for picture, _ in drawn[1:]], 0.6, 2.5, FAST)

    true, interior = drawn[0][1], inside((HEIGHT, WIDTH))
    error = np.abs(planes.depth_m(2.0) / true - 1)
    assert np.mean(error[interior] < 0.01) > 0.85
    beside = np.abs(np.arange(WIDTH) + 0.5 - WIDTH / 2) > 6
    assert np.mean(error[:, beside][interior[:, beside]] < 0.01) > 0.95


def test_what_sources_say_mends_what_does_not_match():
    drawn = [draw(cam, SLANTED) for cam in CAMERAS]
    pictures = [picture for picture, _ in drawn]
    exact = []
    for cam in CAMERAS:
        turned = cam.cam_from_world[:, :3] @ SLANTED[0][0]
        rate = 1 - SLANTED[0][0] @ cam.position_m
        m = turned / rate
        slopes = np.zeros((HEIGHT, WIDTH, 3), np.float32)
        slopes[..., 0], slopes[..., 1] = m[0] / FOCAL, m[1] / FOCAL
        slopes[..., 2] = cam.rays() @ m
        exact.append(MatchedPlanes(slopes=slopes, cost=np.zeros((HEIGHT, WIDTH), np.float32)))
    assert 1 / exact[1].slopes[..., 2] == pytest.approx(drawn[1][1], rel=1e-5)

    spoilt = exact[0].slopes.copy()
    spoilt[20:40, 30:50, 2] *= 1.3
    start = MatchedPlanes(slopes=spoilt, cost=exact[0].cost)
    mended = match_coherently(pictures[0], pictures[1:], start, exact[1:], 0.6, 2.5, FAST)

    true, interior = drawn[0][1], inside((HEIGHT, WIDTH))
    assert np.mean(np.abs(mended.depth_m(9) / true - 1)[interior] < 0.005) > 0.98
    # What is right costs nothing for coherence; what is off by pixels costs up to the most.
    none = match_coherently(
        pictures[0], pictures[1:], start, exact[1:], 0.6, 2.5, PatchMatchSettings(coherent_iterations=0)
    )
    settings = PatchMatchSettings()
    most = settings.coherence_weight * settings.coherence_most_px
    assert np.median(none.cost[25:35, 35:45]) > most > 5 * np.median(none.cost[50:60, 60:80])


def test_threads_and_runs_give_the_same_and_seeds_hardly_matter():
    drawn = [draw(cam, SLANTED)[0] for cam in CAMERAS]
    one, three = (match_picture(drawn[0], drawn[1:], 0.6, 2.5, FAST, threads=threads) for threads in (1, 3))
    assert np.array_equal(one.slopes, three.slopes)
    assert np.array_equal(one.cost, three.cost)
    other = match_picture(drawn[0], drawn[1:], 0.6, 2.5, FAST, seed=5)
    assert not np.array_equal(one.slopes, other.slopes)
    assert np.median(np.abs(one.slopes[..., 2] / other.slopes[..., 2] - 1)) < 0.002


def test_what_has_no_texture_or_is_not_wanted_has_no_depth():
    drawn = [draw(cam, SLANTED, plain=True)[0] for cam in CAMERAS]
    planes = match_picture(drawn[0], drawn[1:], 0.6, 2.5, FAST)
    assert np.isfinite(planes.slopes).all()
    assert not planes.depth_m(1.0).any()

    drawn = [draw(cam, SLANTED)[0] for cam in CAMERAS]
    valid = np.zeros((HEIGHT, WIDTH), bool)
    valid[20:50, 20:60] = True
    masked = MatchedPicture(camera=drawn[0].camera, grey=drawn[0].grey, valid=valid)
    planes = match_picture(masked, drawn[1:], 0.6, 2.5, FAST)
    assert not planes.slopes[~valid].any()
    assert (planes.cost[~valid] == UNMATCHED).all()
    assert (planes.depth_m(1.0)[valid] > 0).mean() > 0.9


def test_depths_stay_in_their_range():
    drawn = [draw(cam, SLANTED)[0] for cam in CAMERAS]
    planes = match_picture(drawn[0], drawn[1:], 0.6, 1.0, FAST)
    value = planes.slopes[..., 2]
    assert value.min() >= 1 / 1.0 - 1e-6
    assert value.max() <= 1 / 0.6 + 1e-6


def test_wrong_arguments():
    drawn = [draw(cam, SLANTED)[0] for cam in CAMERAS]
    for near, far in ((0.0, 1.0), (2.0, 1.0), (np.nan, 1.0)):
        with pytest.raises(ValueError, match="depths must rise"):
            match_picture(drawn[0], drawn[1:], near, far)
    for sources in ([], drawn * 5):
        with pytest.raises(ValueError, match="1 to 16"):
            match_picture(drawn[0], sources, 0.6, 2.5)
    with pytest.raises(ValueError, match="must be"):
        MatchedPicture(camera=camera(), grey=np.zeros((3, 3), np.float32))
    for wrong in ({"radius_px": 0}, {"iterations": ()}, {"steepest": np.nan}, {"color_sigma": 0.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            PatchMatchSettings(**wrong)
