"""What isolation left out, as pictures."""

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.isolation.plant import IsolatedPlant, PointKind
from usdfoliage.jobs.report.cloud_pictures import PAPER

COLORS = {  # red, green and blue
    PointKind.PLANT: (46, 158, 62),
    PointKind.FLOOR: (176, 174, 168),
    PointKind.CONTAINER: (60, 98, 220),
    PointKind.OUTLIER: (214, 72, 52),
}
OUTLINE = (255, 48, 208)
OUTSIDE = 0.35  # of a photograph's light, where the plant is not
_LONGEST_PX, _DRAWN_POINTS = 900, 600_000
_AROUND = 0.6  # of the plant's size, that is shown around it


def draw_kinds(points_m: NDArray[np.float64], found: IsolatedPlant) -> list[tuple[str, NDArray[np.uint8]]]:
    """The cloud (N, 3), Y up, from the front and from above, in the colours of what its points are of."""
    if not len(points_m):
        return []
    drawn_m = points_m[found.plant] if found.plant.any() else points_m
    low_m, high_m = np.quantile(drawn_m, [0.001, 0.999], axis=0)
    around_m = _AROUND * float((high_m - low_m).max()) or 1.0
    low_m, high_m = low_m - around_m, high_m + around_m
    inside = np.flatnonzero(((points_m >= low_m) & (points_m <= high_m)).all(axis=1))
    some = inside[np.linspace(0, len(inside) - 1, min(len(inside), _DRAWN_POINTS)).astype(np.int64)]
    colors = np.array([COLORS[kind] for kind in PointKind], np.uint8)[found.kind[some]]
    pictures = []
    for name, right, up, towards, downwards in (("front", 0, 1, 2, False), ("top", 0, 2, 1, True)):
        order = np.argsort(points_m[some, towards], kind="stable")
        span_m = float(max(high_m[right] - low_m[right], high_m[up] - low_m[up]))
        scale = (_LONGEST_PX - 1) / span_m
        size = [int((high_m[axis] - low_m[axis]) * scale) + 2 for axis in (up, right)]
        column = ((points_m[some, right] - low_m[right]) * scale).astype(np.intp)[order]
        row = ((points_m[some, up] - low_m[up]) * scale).astype(np.intp)[order]
        row = row if downwards else size[0] - 2 - row
        picture = np.full((*size, 3), PAPER, np.uint8)
        for down, across in ((0, 0), (0, 1), (1, 0), (1, 1)):
            picture[row + down, column + across] = colors[order]
        pictures.append((name, picture))
    return pictures


def draw_outline(srgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """A smaller photograph (h, w, 3), darker where the plant is not, with the mask's outline."""
    scale = min(1.0, _LONGEST_PX / max(mask.shape))
    size = max(1, round(mask.shape[1] * scale)), max(1, round(mask.shape[0] * scale))
    small = np.asarray(cv2.resize(srgb, size, interpolation=cv2.INTER_AREA), np.uint8)
    inside = cv2.resize(mask.astype(np.uint8) * 255, size, interpolation=cv2.INTER_AREA) > 127
    picture = np.where(inside[..., None], small, (small * OUTSIDE).astype(np.uint8))
    edge = cv2.dilate(inside.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool) & ~inside
    picture[edge] = OUTLINE
    return np.asarray(picture, np.uint8)
