"""The pictures in an asset: its thumbnail, and its cards along the axes of its box, as UsdGeomModelAPI wants them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.asset.packages.cards import AssetPictures
from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.files.atomic import write_whole_files
from usdfoliage.jobs.plant.pages.pictures import PictureSettings, thumbnail_view
from usdfoliage.jobs.preview.pictures import MIN_SIDE_PX, PreviewView, draw_views, encode_png, finish_picture


@dataclass(frozen=True, kw_only=True)
class _Side:
    """How a picture of one side is taken, and how it lies on its card."""

    direction: str
    across: int  # axis that runs to the right of the picture, and whether it does so
    across_sign: int
    up: int  # likewise upwards
    up_sign: int
    quarter_turns: int  # counter-clockwise, from the picture with Y up to the one that USD takes, with Z up


SIDES: Mapping[str, _Side] = MappingProxyType(
    {
        "XPos": _Side(direction="right", across=2, across_sign=-1, up=1, up_sign=1, quarter_turns=3),
        "XNeg": _Side(direction="left", across=2, across_sign=1, up=1, up_sign=1, quarter_turns=1),
        "YPos": _Side(direction="top", across=0, across_sign=1, up=2, up_sign=-1, quarter_turns=2),
        "YNeg": _Side(direction="bottom", across=0, across_sign=1, up=2, up_sign=1, quarter_turns=0),
        "ZPos": _Side(direction="front", across=0, across_sign=1, up=1, up_sign=1, quarter_turns=0),
        "ZNeg": _Side(direction="back", across=0, across_sign=-1, up=1, up_sign=1, quarter_turns=2),
    }
)


def draw_asset_pictures(
    asset: Path, shape: AssetShape, folder: Path, settings: PictureSettings = PictureSettings()
) -> AssetPictures:
    """Draw thumbnail.png, and card_XPos.png … where they are asked for, into folder, all by one start of Storm.

    The thumbnail is a square, seen from a quarter. An asset of which nothing is drawn has no cards.

    Raises:
        PreviewError: As draw_views.
        AssetError: It is no asset.
    """
    interface, _ = interface_of(asset)
    box_m = shape.drawn_m if settings.cards else None
    views = [thumbnail_view(shape, folder / "thumbnail.png", settings)]
    if box_m is not None:
        views += [replace(view_side(side, box_m, settings.card_px), even_light=True) for side in SIDES.values()]
    preview = replace(settings.preview(settings.thumbnail_px), background=None)
    thumbnail, *sides = (finish_picture(picture, None) for picture in draw_views(interface, views, preview))
    finished = {views[0].output: thumbnail}
    cards = {}
    if box_m is not None:
        for (name, side), picture in zip(SIDES.items(), sides, strict=True):
            cards[name] = folder / f"card_{name}.png"
            finished[cards[name]] = np.rot90(_fill_ground(cut_to_box(picture, side, box_m)), side.quarter_turns)
    write_whole_files([(path, encode_png(np.ascontiguousarray(picture))) for path, picture in finished.items()])
    return AssetPictures(thumbnail=views[0].output, cards=cards)


def view_side(side: _Side, box_m: NDArray[np.float64], longest_px: int) -> PreviewView:
    """What sees a box (2, 3) along an axis, to its borders or beyond: in whole square pixels, 16 a side or more."""
    middle_m, length_m = _measure_side(side, box_m)
    scale = longest_px / length_m.max()
    size_px = [max(MIN_SIDE_PX, int(np.ceil(scale * length - 1e-6))) for length in length_m]
    half_m = np.array(size_px) / scale / 2
    low_m, high_m = middle_m - half_m, middle_m + half_m
    window = (float(low_m[0]), float(high_m[0]), float(low_m[1]), float(high_m[1]))
    return PreviewView(
        output=Path("card.png"),
        direction=side.direction,
        orthographic=True,
        window=window,
        size_px=(size_px[0], size_px[1]),
    )


def cut_to_box(picture: NDArray[np.uint8], side: _Side, box_m: NDArray[np.float64]) -> NDArray[np.uint8]:
    """What of a picture that view_side took lies in the box; at least a pixel."""
    _, length_m = _measure_side(side, box_m)
    height, width = picture.shape[:2]
    scale = max(width, height) / length_m.max()
    across, up = (max(1, round(scale * length)) for length in length_m)
    top, left = (height - min(up, height)) // 2, (width - min(across, width)) // 2
    return picture[top : top + up, left : left + across]


def _measure_side(side: _Side, box_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The middle of a box as one of its sides shows it, to the right and upwards, and its lengths; none is 0."""
    flat_m = box_m[:, [side.across, side.up]]
    middle_m = flat_m.mean(axis=0) * [side.across_sign, side.up_sign]
    length_m = flat_m[1] - flat_m[0]
    return middle_m, np.maximum(length_m, 1e-6 * max(float(length_m.max()), 1e-3))


def _fill_ground(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Give what is transparent the mean colour of the rest: filters of textures mix the two."""
    seen = picture[..., 3] > 0
    filled = picture.copy()
    if seen.any():
        filled[~seen, :3] = np.rint(picture[seen, :3].mean(axis=0))
    return filled
