"""What photographs show of their own faults: wrong masks, depth that is lost on the plant, a plant that is cut.

What is green is taken for plants, which every photograph shows by itself; of plants of other colours nothing is known,
and no remark is made. Our own.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.listing import named
from usdfoliage.capture.mask_place import describe_moves, measure_move
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.picture_agreement import find_vegetation
from usdfoliage.remarks import Remark, Setting, remark

_SOME_GREEN = 0.02  # share of a picture, from which what is green is judged
_GREEN_OUTSIDE = 0.8  # share of the green outside of a mask that may be inverted
_BORDER_INSIDE = 0.7  # share of the picture's border within such a mask
_POINTS = 1000  # of the plant, evenly chosen of each view
_WRONG_MASK = 0.25  # share of the plant outside of a mask that is of something else
LOST = 0.35  # share of what is green without depth, in the median photograph; 0.12 to 0.38 of still plants
_CUT_SIDE = 0.35  # green length of one side of the picture, in roots of the plant's area


def refuse_inverted_masks(views: Sequence[View]) -> None:
    """See that masks show the plant, and not all but the plant.

    Raises:
        CaptureError: Most masks cover the border of the picture and leave out what is green in it.
    """
    judged = [view for view in views if view.mask is not None]
    inverted = [view.name for view in judged if view.mask is not None and _is_inverted(view.srgb, view.mask)]
    if len(inverted) > len(judged) / 2:
        raise CaptureError(
            f"{len(inverted)} of {len(judged)} masks leave out what is green in their photographs, and show all around "
            "it: they seem to be inverted",
            ("write them again, white on the plant, or set ", Setting(name="capture.mask", value='"none"')),
        )


def check_views(views: Sequence[View]) -> tuple[Remark, ...]:
    """Remarks on views with depth, where they have any."""
    green = [_green_in_mask(view) for view in views]
    moves = [measure_move(view.srgb, view.mask) for view in views if view.mask is not None]
    return (*describe_moves(moves), *_check_masks(views, green), *_check_depth(views, green), *_check_border(green))


def share_outside_masks(views: Sequence[View], green: Sequence[NDArray[np.bool_]]) -> NDArray[np.float64]:
    """(V,), the share of what other views show of the plant that each view's mask leaves out; NaN without a mask.

    A point of the plant lies within every mask, whether it is hidden there or not.

    Args:
        views: V, with depth.
        green: (H, W) of each, pixels of the plant within its mask.
    """
    points_m = []
    for view, plant in zip(views, green, strict=True):
        chosen = np.flatnonzero(plant & (view.depth_m > 0))
        chosen = chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), _POINTS)).astype(np.intp)]
        points_m.append(view.points().reshape(-1, 3)[chosen])
    outside = np.full(len(views), np.nan)
    for number, view in enumerate(views):
        others_m = np.concatenate([np.zeros((0, 3)), *points_m[:number], *points_m[number + 1 :]])
        if view.mask is None or not len(others_m):
            continue
        places, distance_m = view.camera.project(others_m)
        column, row = np.floor(np.nan_to_num(places, nan=-1.0)).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < view.camera.width_px) & (row < view.camera.height_px)
        inside &= distance_m > 0
        if inside.any():
            outside[number] = float(np.mean(~view.mask[row[inside], column[inside]]))
    return outside


def _is_inverted(srgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> bool:
    green = find_vegetation(srgb)
    if green.mean() < _SOME_GREEN:
        return False
    return bool((green & ~mask).sum() > _GREEN_OUTSIDE * green.sum() and _border(mask).mean() > _BORDER_INSIDE)


def _green_in_mask(view: View) -> NDArray[np.bool_]:
    green = find_vegetation(view.srgb)
    return green if view.mask is None else green & view.mask


def _check_masks(views: Sequence[View], green: Sequence[NDArray[np.bool_]]) -> tuple[Remark, ...]:
    outside = share_outside_masks(views, green)
    wrong = outside > _WRONG_MASK  # which no NaN is
    if not wrong.any():
        return ()
    names = named([view.name for view, is_wrong in zip(views, wrong, strict=True) if is_wrong])
    text = f"{names}: masks cut off {np.median(outside[wrong]):.0%} of what other photographs show of the plant"
    return (remark("masks-disagree", text, subject=names),)


def _check_depth(views: Sequence[View], green: Sequence[NDArray[np.bool_]]) -> tuple[Remark, ...]:
    lost = [
        float(np.mean(view.depth_m[plant] <= 0))
        for view, plant in zip(views, green, strict=True)
        if view.has_depth and plant.mean() > _SOME_GREEN
    ]
    if not lost or np.median(lost) <= LOST:
        return ()
    text = f"{np.median(lost):.0%} of what is green has no depth in the median photograph; no leaf is found there"
    return (remark("plant-without-depth", text),)


def _check_border(green: Sequence[NDArray[np.bool_]]) -> tuple[Remark, ...]:
    cut = [
        max(int(side.sum()) for side in (plant[0], plant[-1], plant[:, 0], plant[:, -1])) / np.sqrt(plant.sum())
        for plant in green
        if plant.mean() > _SOME_GREEN
    ]
    if not cut or np.median(cut) <= _CUT_SIDE:
        return ()
    count = int(np.count_nonzero(np.array(cut) > _CUT_SIDE))
    text = f"the plant goes on beyond the border of {count} of {len(green)} photographs"
    return (remark("plant-at-border", text),)


def _border(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
