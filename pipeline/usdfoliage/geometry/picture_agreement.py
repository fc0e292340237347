"""How far a drawing of things agrees with a photograph of them: silhouettes, and outlines on edges."""

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from numpy.typing import NDArray

_NEAR_PX = 2  # an outline and an edge this near to each other are one
_APART_PX = 12  # outlines moved by so much find edges by chance
_BLUR_PX = 1  # standard deviation, before edges are looked for
_WEAK, _STRONG = 0.25, 0.5  # thresholds of edges, in shares of the plant's median brightness
_NO_PLANT_THRESHOLDS = (20.0, 40.0)  # where there is nothing to measure brightness by
_EXCESS = 24  # levels of 255 by which twice the green exceeds red and blue in vegetation
NOTHING = -1


@dataclass(frozen=True, kw_only=True)
class PictureAgreement:
    """Shares from 0 to 1, but edge_precision, which is -1 to 1.

    Attributes:
        iou: Of what the two silhouettes cover together, what both cover.
        precision: Of the drawn silhouette, what is in the photograph's.
        recall: Of the photograph's silhouette, what is in the drawn one.
        edge_precision: Of the drawn outlines, what lies within 2 pixels of an edge of the photograph; less what the
            same outlines find by chance, moved by 12 pixels.
        edge_recall: Of the photograph's edges on the plant, what lies within 2 pixels of a drawn outline.
        mask_share: Of the photograph, what is plant.
    """

    iou: float
    precision: float
    recall: float
    edge_precision: float
    edge_recall: float
    mask_share: float


def find_vegetation(srgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(H, W), where a photograph (H, W, 3) is greener than grey by 24 levels, single pixels left out.

    The rule leaves out brown twigs, and takes every plant in the picture for the one that is meant.
    """
    red, green, blue = np.moveaxis(srgb.astype(np.int16), -1, 0)
    green_enough = (2 * green - red - blue > _EXCESS).astype(np.uint8)
    return np.asarray(cv2.morphologyEx(green_enough, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0)


def find_outlines(ids: NDArray[np.integer]) -> NDArray[np.bool_]:
    """(H, W), pixels of a drawing (H, W) whose left or upper neighbour shows another thing."""
    outlines = np.zeros(ids.shape, np.bool_)
    outlines[:, 1:] |= ids[:, 1:] != ids[:, :-1]
    outlines[1:] |= ids[1:] != ids[:-1]
    return outlines


def silhouette_iou(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Intersection over union of two masks of one size; 0 where both are empty."""
    union = int(np.count_nonzero(first | second))
    return int(np.count_nonzero(first & second)) / max(union, 1)


def measure_agreement(ids: NDArray[np.integer], srgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> PictureAgreement:
    """Compare a drawing with a photograph of the same camera and size.

    Args:
        ids: (H, W), the number of the thing that a pixel shows, NOTHING for none.
        srgb: (H, W, 3), the photograph.
        mask: (H, W), where it shows the plant.

    Raises:
        ValueError: The sizes differ.

    Source:
        Edges: J. Canny, A computational approach to edge detection, 1986. The measures are our own.
    """
    if srgb.shape != (*ids.shape, 3) or mask.shape != ids.shape:
        raise ValueError(
            f"drawing, photograph and mask must be of one size, not {ids.shape}, {srgb.shape}, {mask.shape}"
        )
    drawn = ids != NOTHING
    both = int(np.count_nonzero(drawn & mask))
    outlines = find_outlines(ids)
    edges = _find_edges(srgb, mask)
    near_edge, near_outline = _grow(edges), _grow(outlines)
    moves = ((_APART_PX, 0), (-_APART_PX, 0), (0, _APART_PX), (0, -_APART_PX))
    chance = float(np.mean([_share(near_edge, np.roll(outlines, move, (0, 1))) for move in moves]))
    return PictureAgreement(
        iou=silhouette_iou(drawn, mask),
        precision=both / max(int(np.count_nonzero(drawn)), 1),
        recall=both / max(int(np.count_nonzero(mask)), 1),
        edge_precision=_share(near_edge, outlines) - chance,
        edge_recall=_share(near_outline, edges & mask),
        mask_share=float(mask.mean()),
    )


def mean_agreement(agreements: list[PictureAgreement]) -> PictureAgreement:
    """The mean of each figure over pictures; ValueError without any."""
    if not agreements:
        raise ValueError("the mean of no pictures is unknown")
    names = [field.name for field in fields(PictureAgreement)]
    means = {name: float(np.mean([getattr(each, name) for each in agreements])) for name in names}
    return replace(agreements[0], **means)


def _find_edges(srgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    gray = cv2.GaussianBlur(cv2.cvtColor(srgb, cv2.COLOR_RGB2GRAY), (0, 0), _BLUR_PX)
    weak, strong = _NO_PLANT_THRESHOLDS
    if mask.any():
        middle = float(np.median(gray[mask]))
        weak, strong = middle * _WEAK, middle * _STRONG
    return np.asarray(cv2.Canny(gray, weak, strong) > 0)


def _grow(chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where a chosen pixel is near; nowhere without one."""
    if not chosen.any():
        return np.zeros(chosen.shape, np.bool_)
    return np.asarray(cv2.distanceTransform((~chosen).astype(np.uint8), cv2.DIST_L2, 5) <= _NEAR_PX)


def _share(true: NDArray[np.bool_], among: NDArray[np.bool_]) -> float:
    return float(true[among].mean()) if among.any() else 0.0
