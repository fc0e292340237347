"""What photographs show of their own faults: a green disc before a grey wall, seen by cameras side by side."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.capture.view import View
from usdfoliage.capture.view_check import check_views, refuse_inverted_masks, share_outside_masks
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.pinhole import Pinhole

WIDTH, HEIGHT, FOCAL = 120, 90, 100.0
DISC_M, WALL_M = 1.0, 2.0


def view_at(x_m: float, radius_m: float = 0.25, middle_m: float = 0.0, name: str = "0.png") -> View:
    """A camera at (x_m, 0, 0) that looks along z at an upright disc, with a mask of the disc."""
    camera = Pinhole(
        width_px=WIDTH,
        height_px=HEIGHT,
        focal_px=(FOCAL, FOCAL),
        center_px=(WIDTH / 2, HEIGHT / 2),
        cam_from_world=np.column_stack([np.eye(3), [-x_m, 0, 0]]),
    )
    at_m = camera.rays()[..., :2] * DISC_M + [x_m - middle_m, 0]
    disc = np.hypot(at_m[..., 0], at_m[..., 1]) < radius_m
    srgb = np.where(disc[..., None], np.array([60, 140, 50], np.uint8), np.uint8(120))
    depth_m = np.where(disc, np.float32(DISC_M), np.float32(WALL_M))
    return View(name=name, camera=camera, srgb=srgb.astype(np.uint8), depth_m=depth_m, mask=disc)


def ring(count: int = 5, **options) -> list[View]:
    return [view_at(x_m, name=f"{number}.png", **options) for number, x_m in enumerate(np.linspace(-0.1, 0.1, count))]


def green_of(views: list[View]) -> list[np.ndarray]:
    return [view.mask & (view.srgb[..., 1] > 130) for view in views]


def codes(views: list[View]) -> list[str]:
    return [each.code for each in check_views(views)]


def test_a_good_capture_has_no_remark():
    views = ring()
    refuse_inverted_masks(views)
    assert codes(views) == []
    assert codes([replace(view, mask=None) for view in views]) == []
    np.testing.assert_allclose(share_outside_masks(views, green_of(views)), 0, atol=0.06)  # by half a pixel all around


def test_a_mask_of_something_else_is_named():
    views = ring()
    shifted = np.roll(views[2].mask, 40, axis=1)
    views[2] = replace(views[2], mask=shifted)
    (remark,) = check_views(views)
    assert (remark.code, remark.subject) == ("masks-disagree", "2.png")
    outside = share_outside_masks(views, green_of(views))
    points_m = np.concatenate([view.points()[view.mask] for view in (*views[:2], *views[3:])])
    columns, rows = np.floor(views[2].camera.project(points_m)[0]).astype(int).T
    assert outside[2] == pytest.approx(float(np.mean(~shifted[rows, columns])), abs=0.02)
    assert np.nanmax(np.delete(outside, 2)) < 0.06


def test_inverted_masks_are_refused():
    views = [replace(view, mask=~view.mask) for view in ring()]
    with pytest.raises(CaptureError, match=r"5 of 5 masks leave out what is green.*capture\.mask"):
        refuse_inverted_masks(views)
    refuse_inverted_masks([*ring()[:3], *views[3:]])  # most are right
    # A wall of leaves with a hole, and a plant that is not green beside a lawn, are what they are.
    hedge = [replace(view, srgb=np.full_like(view.srgb, (60, 140, 50)), mask=view.mask) for view in views]
    refuse_inverted_masks(hedge)
    refuse_inverted_masks([replace(view, srgb=np.full_like(view.srgb, 120)) for view in views])
    refuse_inverted_masks([replace(view, mask=None) for view in views])
    refuse_inverted_masks([])


@pytest.mark.parametrize(("kept", "expected"), [(0.8, []), (0.5, ["plant-without-depth"])])
def test_depth_that_is_lost_on_the_plant_is_reported(kept, expected):
    rng = np.random.default_rng(0)
    views = [
        replace(view, depth_m=np.where(rng.random(view.depth_m.shape) < kept, view.depth_m, np.float32(0)))
        for view in ring()
    ]
    assert codes(views) == expected


def test_a_plant_that_the_border_cuts_is_reported():
    assert codes(ring(middle_m=0.55, radius_m=0.3)) == ["plant-at-border"]
    assert codes(ring(middle_m=0.1, radius_m=0.3)) == []


def test_of_views_without_depth_or_green_nothing_is_known():
    bare = [replace(view, depth_m=np.zeros_like(view.depth_m)) for view in ring()]
    assert codes(bare) == []
    assert codes([replace(view, srgb=np.full_like(view.srgb, 120)) for view in ring()]) == []
    assert check_views([]) == ()
