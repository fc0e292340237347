"""Patches of surfaces with known edges, sizes and normals."""

import numpy as np
import pytest
from usdfoliage.capture.view import View
from usdfoliage.leaf.points import FREE_EDGE, HIDDEN_EDGE, INTERIOR
from usdfoliage.leaf.segmentation.dense.patches import UNKNOWN_EDGE, PatchSettings, find_patches, fit_planes_of_view

from tests.support.leaves.views import Disc, camera, draw_view

NORMAL = np.array([0.4, -0.3, 1.0]) / np.linalg.norm([0.4, -0.3, 1.0])


def tilted(cam, scale=1.0):
    return ((scale * NORMAL[2] - cam.position_m @ NORMAL) / (cam.rays() @ NORMAL)).astype(np.float32)


def view(cam, depth):
    return View(
        name="drawn.png", camera=cam, srgb=np.zeros((*depth.shape, 3), np.uint8), depth_m=depth.astype(np.float32)
    )


def before_wall(one: View, z: float = 1.5) -> np.ndarray:
    """The depth of a view of leaves with a wall behind them."""
    return np.where(one.depth_m > 0, one.depth_m, np.float32(z))


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_a_tilted_plane_is_found_exactly(scale):
    cam = camera(80, 60, x=0.2, scale=scale)
    one = view(cam, tilted(cam, scale))
    planes = fit_planes_of_view(one, one.depth_m, 0.0)
    gaps = np.concatenate([planes.gap_right[:, :-1].ravel(), planes.gap_down[:-1].ravel()])
    assert gaps.max() < 0.01
    normals = planes.normals(cam)
    assert normals @ -NORMAL == pytest.approx(np.ones((60, 80)), abs=1e-4)
    patches = find_patches(one, one.depth_m, 0.0, with_normals=True)
    assert len(patches) == 1
    assert (patches.labels == 1).all()
    assert np.array_equal(patches.normals, normals)


def test_a_step_parts_two_patches():
    cam = camera(80, 60)
    depth = np.full((60, 80), 1.0)
    depth[:, 40:] = 1.008  # eight footprints
    patches = find_patches(view(cam, depth), depth, 0.0)
    assert patches.labels[:, :40].min() == patches.labels[:, :40].max() == 1
    assert patches.labels[:, 40:].min() == patches.labels[:, 40:].max() == 2
    assert find_patches(view(cam, depth), depth, 0.0, PatchSettings(gap=12.0)).pixels.tolist() == [4800]


def test_kinds_follow_what_lies_beside():
    cam = camera(80, 60)
    depth = np.full((60, 80), 1.2)
    depth[:, 20:60] = 1.0
    depth[:, 60:] = 0.8
    depth[20:40, 30:40] = 0
    patches = find_patches(view(cam, depth), depth, 0.0)
    middle = patches.labels[5, 30]
    kind = np.where(patches.labels == middle, patches.kind, 255)
    assert (kind[1:-1, 20] == FREE_EDGE).all()
    assert (kind[1:-1, 59] == HIDDEN_EDGE).all()
    assert (kind[0, 20:60] == HIDDEN_EDGE).all()
    assert (kind[20:40, 29] == UNKNOWN_EDGE).all()
    assert (kind[1:-1, 22:28] == INTERIOR).all()
    k = middle - 1
    assert (patches.free_px[k], patches.unknown_px[k]) == (58, 60)
    assert patches.hidden_px[k] == 60 + 2 * 39
    assert patches.pixels[k] == (kind < 255).sum() == 60 * 40 - 200


@pytest.mark.parametrize("tilt", [0.0, 0.8])
@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_a_leaf_is_measured(tilt, scale):
    disc = Disc(center=(0, 0, 1), half=(0.05, 0.025), turn=0.3, tilt=tilt)
    one, _ = draw_view([disc], camera(scale=scale), scale=scale)
    patches = find_patches(one, before_wall(one, 2 * scale), 0.0)
    k = patches.labels[90, 120] - 1
    assert patches.length_m[k] == pytest.approx(0.1 * scale, rel=0.04)
    assert patches.width_m[k] == pytest.approx(0.05 * scale, rel=0.06)
    assert patches.area_m2[k] == pytest.approx(np.pi * 0.05 * 0.025 * scale**2, rel=0.03)
    assert patches.fill[k] == pytest.approx(1, abs=0.06)
    assert patches.thickness_m[k] < 1e-4 * scale
    assert patches.hidden_px[k] == patches.unknown_px[k] == 0
    assert patches.free_px[k] > 150


def test_what_is_not_valid_bounds_patches_but_belongs_to_none():
    discs = [Disc(center=(-0.02, 0, 1)), Disc(center=(0.02, 0, 0.9), turn=1.2)]
    one, owner = draw_view(discs)
    depth = before_wall(one)
    rest = find_patches(one, depth, 0.0, valid=owner != 1)
    k = rest.labels[90, 80]
    assert k > 0
    assert not rest.labels[owner == 1].any()
    assert rest.hidden_px[k - 1] > 10
    assert rest.free_px[k - 1] > 50


def test_planes_may_be_given_and_threads_do_not_matter():
    one, _ = draw_view([Disc(center=(0, 0, 1), tilt=0.5)], noise_m=0.0005)
    depth = before_wall(one)
    planes = fit_planes_of_view(one, depth, 0.0005, threads=3)
    with_planes = find_patches(one, depth, 0.0005, planes=planes, threads=1)
    without = find_patches(one, depth, 0.0005, threads=3)
    for name in ("labels", "kind", "area_m2", "length_m", "thickness_m"):
        assert np.array_equal(getattr(with_planes, name), getattr(without, name))


def test_noise_does_not_break_a_leaf():
    disc = Disc(center=(0, 0, 1), half=(0.05, 0.025), tilt=0.5)
    one, owner = draw_view([disc], noise_m=0.0007)
    patches = find_patches(one, before_wall(one), 0.0007)
    on_leaf = patches.labels[owner == 0]
    assert (on_leaf == np.bincount(on_leaf).argmax()).mean() > 0.95


def test_nothing_is_found_where_nothing_is():
    cam = camera(40, 30)
    nothing = find_patches(view(cam, np.zeros((30, 40))), np.zeros((30, 40)), 0.0, with_normals=True)
    assert len(nothing) == 0
    assert not nothing.labels.any()
    assert not nothing.normals.any()
    crumbs = np.zeros((30, 40))
    crumbs[5:10, 5:10] = 1
    assert len(find_patches(view(cam, crumbs), crumbs, 0.0)) == 0
    assert len(find_patches(view(cam, crumbs), crumbs, 0.0, PatchSettings(min_px=25))) == 1


def test_wrong_arguments_are_refused():
    cam = camera(40, 30)
    one = view(cam, np.ones((30, 40)))
    with pytest.raises(ValueError, match="depth must be"):
        find_patches(one, np.ones((40, 30)), 0.0)
    with pytest.raises(ValueError, match="valid must be"):
        find_patches(one, one.depth_m, 0.0, valid=np.ones((40, 30), bool))
    for wrong in ({"radius_px": 0}, {"gap": 0.0}, {"min_cosine": 0.0}, {"edge_noises": -1.0}):
        with pytest.raises(ValueError, match="not"):
            PatchSettings(**wrong)
