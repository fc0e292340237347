"""The silhouette of a leaf as a closed B-spline: boundary following, then reverse subdivision.

Source:
    L. Mündermann et al., Modeling lobed leaves, CGI 2003, section 3.1.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.geometry.lines import arc_lengths, points_at, polygon_area
from usdfoliage.leaf.lobed.spline import evaluate_closed, reverse_closed

Floats = NDArray[np.float64]

_FINER = 4  # pixels of the enlarged mask, across a pixel, so that the boundary lies between pixels
_BORDER = 2  # pixels of nothing around the mask
_SOFTEN = np.array([1, 2, 3, 2, 1]) / 9  # along the boundary, whose steps are those of the enlarged pixels
_PLACES = 4096  # of the boundary, where errors are measured
_FINE = 1024  # control points at least, from which reverse subdivision begins
_CORNERS = 4.0  # times as many control points a length where the boundary turns by one radian

_PETIOLE_PX = 400  # longer side of the mask in which a petiole is looked for
_PETIOLE_RADII = (0.012, 0.018, 0.027, 0.04)  # of the discs, as parts of the root of the leaf's area
_SHORTEST = 0.035  # length of a petiole, likewise
_SLENDER = 1.2  # its length, in its widths


@dataclass(frozen=True, kw_only=True)
class SilhouetteSettings:
    """How near the spline is to the boundary, and by how many control points."""

    tolerance_px: float = 0.6  # of the boundary from the spline, in 99.5 % of its length
    controls: tuple[int, ...] = (24, 32, 48, 64, 96, 128, 160, 200, 256, 320, 400)  # the first that is near enough

    def __post_init__(self) -> None:
        if not self.tolerance_px > 0:
            raise ValueError(f"tolerance_px must be above 0, not {self.tolerance_px:g}")
        if not self.controls or min(self.controls) < 4:
            raise ValueError("controls must be one or more numbers of at least 4")


@dataclass(frozen=True, kw_only=True, eq=False)
class Silhouette:
    """A closed cubic B-spline, counter-clockwise with y up."""

    control_px: Floats  # (N, 2), x to the right and y up, from the upper left corner of the picture
    error_px: float  # of the boundary from the spline, in 99.5 % of its length

    def sample(self, step_px: float) -> Floats:
        """(K, 2) points of it, about so far apart."""
        fine = evaluate_closed(self.control_px, 20)
        closed = np.concatenate([fine, fine[:1]])
        length = float(arc_lengths(closed)[-1])
        count = max(16, int(np.ceil(length / step_px)))
        return points_at(closed, np.arange(count) / count * length)


def follow_boundary(mask: NDArray[np.bool_]) -> Floats:
    """(K, 2) the outer boundary of the largest piece of a mask (H, W), in pixels with y up, between pixels.

    Raises:
        ValueError: The mask is empty.
    """
    pieces, labels, measures, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if pieces < 2:
        raise ValueError("the mask shows no leaf")
    largest = (labels == 1 + int(np.argmax(measures[1:, cv2.CC_STAT_AREA]))).astype(np.float32)
    framed = np.pad(largest, _BORDER)
    height, width = framed.shape
    enlarged = cv2.resize(framed, (width * _FINER, height * _FINER), interpolation=cv2.INTER_LINEAR)
    soft = cv2.GaussianBlur(enlarged, (0, 0), _FINER / 2) > 0.5
    found, _ = cv2.findContours(soft.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not found:
        raise ValueError("the mask shows no leaf")
    steps = max(found, key=cv2.contourArea)[:, 0, :].astype(np.float64)
    points = (steps + 0.5) / _FINER - _BORDER
    points = np.asarray(sum(part * np.roll(points, 2 - place, axis=0) for place, part in enumerate(_SOFTEN)))
    upright = points * [1.0, -1.0]
    return upright if polygon_area(upright) > 0 else upright[::-1]


def fit_silhouette(boundary_px: Floats, settings: SilhouetteSettings = SilhouetteSettings()) -> Silhouette:
    """The spline of the fewest control points that is near a boundary (K, 2), or that of most of them.

    Control points are nearer to each other where the boundary turns.
    """
    closed = np.concatenate([boundary_px, boundary_px[:1]])
    length = float(arc_lengths(closed)[-1])
    places = points_at(closed, np.arange(_PLACES) / _PLACES * length)
    dense = 1 + _CORNERS * _turning(places, max(1, round(2.0 * _PLACES / length)))
    ring = np.concatenate([places, places[:1]])
    share = np.concatenate([[0], np.cumsum(dense)]) / dense.sum()
    tree = cKDTree(places)
    best = None
    for count in settings.controls:
        steps = max(0, int(np.ceil(np.log2(_FINE / count))))
        fine = count << steps
        at = np.interp(np.arange(fine) / fine, share, np.arange(_PLACES + 1))
        control = np.stack([np.interp(at, np.arange(_PLACES + 1), ring[:, axis]) for axis in (0, 1)], axis=-1)
        for _ in range(steps):
            control = reverse_closed(control)
        spline = evaluate_closed(control, max(4, _PLACES // count))
        away = (cKDTree(spline).query(places)[0], tree.query(spline)[0])
        error_px = max(float(np.percentile(each, 99.5)) for each in away)
        if best is None or error_px < best.error_px:
            best = Silhouette(control_px=control, error_px=error_px)
        if error_px <= settings.tolerance_px:
            break
    assert best is not None
    return best


def find_petiole_end(outline_px: Floats) -> Floats | None:
    """(2,) the end of the petiole in an outline (K, 2): of a thin limb that is as thick at its end as where it begins.

    An opening by a disc takes such a limb away. The tips of lobes that it takes too end in a point. Of several limbs
    the lower ones are likelier, since leaves lie with their petioles down; None where there is no limb.
    """
    low, extent = outline_px.min(axis=0), np.ptp(outline_px, axis=0)
    scale = min(1.0, _PETIOLE_PX / float(extent.max()))
    size_px = np.sqrt(abs(polygon_area(outline_px))) * scale
    width, height = np.ceil(extent * scale).astype(int) + 8
    # Rows go down.
    drawn = np.column_stack([outline_px[:, 0] - low[0], low[1] + extent[1] - outline_px[:, 1]]) * scale + 4
    mask = np.zeros((height, width), np.uint8)
    cv2.fillPoly(mask, [np.round((drawn - 0.5) * 16).astype(np.int32)], 1, shift=4)
    best: tuple[float, Floats] | None = None
    for share in _PETIOLE_RADII:
        reach = max(1, round(share * size_px))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        pieces, labels, measures, _ = cv2.connectedComponentsWithStats(cv2.morphologyEx(mask, cv2.MORPH_OPEN, disc))
        if pieces < 2:
            continue
        blade = (labels == 1 + int(np.argmax(measures[1:, cv2.CC_STAT_AREA]))).astype(np.uint8)
        rest = mask & ~cv2.dilate(blade, np.ones((3, 3), np.uint8))
        away = cv2.distanceTransform(1 - blade, cv2.DIST_L2, 5)
        limbs, labels = cv2.connectedComponents(rest, connectivity=8)
        for limb in range(1, limbs):
            row, column = np.nonzero(labels == limb)
            along = away[row, column]
            long_px = float(along.max())
            widths = np.histogram(along, bins=4, range=(0, long_px))[0] / (long_px / 4)
            slender = long_px / max(float(widths.mean()), 1e-6)
            if long_px < _SHORTEST * size_px or slender < _SLENDER:
                continue
            end = int(np.argmax(along))
            even = min(float(widths[3]) / max(float(widths[:2].mean()), 1e-6), 1.0)
            down = (row[end] - 4) / (extent[1] * scale)
            score = even**2 * np.sqrt(min(slender, 4.0)) * min(long_px / size_px, 0.3) * (0.25 + 0.75 * down)
            if best is None or score > best[0]:
                place = (np.array([column[end], row[end]]) + 0.5 - 4) / scale
                best = score, np.array([low[0] + place[0], low[1] + extent[1] - place[1]])
    return None if best is None else best[1]


def _turning(places: Floats, reach: int) -> Floats:
    """(K,) by how much a closed line turns within so many places around each, radians, averaged over as many."""
    ahead, behind = np.roll(places, -2 * reach, axis=0) - places, places - np.roll(places, 2 * reach, axis=0)
    cross = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    turn = np.abs(np.arctan2(cross, (behind * ahead).sum(axis=1)))
    wide = 2 * reach + 1
    wrapped = np.concatenate([turn[-wide:], turn, turn[:wide]])
    return np.convolve(wrapped, np.full(wide, 1 / wide), "same")[wide:-wide]
