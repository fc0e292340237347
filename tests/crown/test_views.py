"""What photographs show of a crown, and what of it is surely leaves."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.crown.views import ReducedView
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.pinhole import Pinhole

SIDE, SKY, LEAF = 60, 0.8, 0.1  # pixels, and light
CAMERA = Pinhole(
    width_px=SIDE,
    height_px=SIDE,
    focal_px=(60.0, 60.0),
    center_px=(30.0, 30.0),
    cam_from_world=np.eye(4)[:3],
)


def picture(light: dict[tuple[int, int], float], *, with_mask: bool, with_sky: bool = True) -> ReducedView:
    """Sky on the left third, leaves on the right; light of single pixels (row, column)."""
    sky = np.zeros((SIDE, SIDE), bool)
    sky[:, :20] = True
    linear = np.where(sky, SKY, LEAF)
    for place, value in light.items():
        linear[place] = value
    encoded = np.rint(255 * encode_srgb(linear)).astype(np.uint8)
    return ReducedView(
        name="a",
        camera=CAMERA,
        srgb=np.repeat(encoded[..., None], 3, axis=-1),
        mask=~sky if with_mask else None,
        sky=sky if with_sky else None,
        depth_m=None,
    )


@pytest.mark.parametrize("with_mask", [True, False])
def test_pixels_beside_the_sky_that_hold_its_light_are_no_leaves(with_mask: bool) -> None:
    mixed = LEAF + 0.2 * (SKY - LEAF)
    view = picture({(10, 28): mixed, (30, 28): LEAF + 0.05 * (SKY - LEAF), (50, 50): mixed}, with_mask=with_mask)
    leaves = view.leaves
    assert not leaves[:, :22].any()  # sky, and what is beside it
    assert not leaves[10, 28]
    assert leaves[30, 28]  # some light is the leaf's own
    assert leaves[50, 50]  # as far from the sky it is a leaf in the sun
    assert leaves[:, 22:].sum() == SIDE * (SIDE - 22) - 1


def test_a_mask_alone_decides_what_the_plant_is() -> None:
    view = picture({(10, 28): 0.5}, with_mask=True, with_sky=False)
    assert (view.leaves == view.mask).all()


def test_the_silhouette_is_that_of_the_mask() -> None:
    """Light between leaves is no way through them: sky is left out of the colours alone."""
    view = picture({}, with_mask=True)
    assert view.mask is not None
    assert view.sky is not None
    view.sky[30, 40] = True
    assert view.plant[30, 40]
    assert not view.leaves[30, 40]
    assert not picture({}, with_mask=False).plant[:, :20].any()


def test_before_a_dark_wall_bright_leaves_stay() -> None:
    view = picture({(row, column): 0.3 for row in range(SIDE) for column in range(22, 40)}, with_mask=True)
    dark = np.where(view.sky[..., None], 0, view.srgb).astype(np.uint8)  # type: ignore[index]
    assert replace(view, srgb=dark).leaves[:, 22:].all()
