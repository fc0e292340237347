"""What a run found, drawn over its photographs."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.report.pictures import leaf_palette
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.reprojection import draw_leaf_ids, project_axes
from usdfoliage.leaf.points import LeafPoints

EDGE = (255, 255, 255)
SUPERPIXEL_EDGE = (255, 210, 60)
BASE = (255, 60, 40)
SURE = 0.95  # certainty from which base and apex count as known; below, the dot at the base is hollow
DOT_PX = 3  # radius
FILL = 0.55  # of the colour over the photograph
SHADE = 0.45  # of the photograph where there is nothing to show
GAP = 1.5  # how wide gaps are, of the distance that points would have were they evenly spread
NEARLY_ALL = 0.9  # of the leaves
SPECK_PX = 3  # side of the square whose middle leaf is drawn
MAX_GROWN_PX = 7  # by which points are made larger to close the gaps between them
DRAWN_POINTS = 200_000  # of all leaves together
MIN_DRAWN = 300  # of them of each leaf, however many leaves there are
ELLIPSE = 4 * np.pi  # area of an even ellipse, in the root of its points' covariance's determinant
BESIDE_PX = 1  # how far from a leaf a place of its axis may lie to be drawn
NOISE_PX = 5  # side of the square whose majority decides whether a leaf is hidden there
BEHIND = 0.1  # leaf lengths by which a leaf may lie behind the depth that is seen and still count as seen
DEPTHS = 2**16 - 1  # nearer to each other than the range of all in so many parts, points are drawn as they come


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnPoints:
    """Some of the points of M leaves, and what is the same of them in every picture."""

    points_m: NDArray[np.float64]  # (P, 3), in the world
    point_view: NDArray[np.int32]  # (P,), number of the view that saw the point
    leaf: NDArray[np.int32]  # (P,)
    middle_m: NDArray[np.float64]  # (M, 3)
    size_m: NDArray[np.float64]  # (M,), about how long a leaf is: four standard deviations of its points
    spacing_m: NDArray[np.float64]  # (M,), about how far apart they lie

    def __len__(self) -> int:
        return len(self.size_m)


def draw_superpixels(view: View, labels: NDArray[np.int32]) -> NDArray[np.uint8]:
    """The photograph (H, W, 3), dark outside of superpixels (labels (H, W), -1 for none), with their edges."""
    picture = np.where((labels >= 0)[..., None], view.srgb, view.srgb * SHADE).astype(np.uint8)
    picture[_edges(labels)] = SUPERPIXEL_EDGE
    return picture


def draw_candidates(view: View, labels: NDArray[np.int32], confidence: NDArray[np.floating]) -> NDArray[np.uint8]:
    """The photograph (H, W, 3) with its candidates (labels (H, W), 0 for none), stronger where more is trusted."""
    strength = FILL * (0.1 + 0.9 * np.clip(confidence, 0, 1))
    return _fill(view.srgb, labels - 1, leaf_palette(len(confidence)), strength)


def prepare_points(points: LeafPoints, max_points: int = DRAWN_POINTS) -> DrawnPoints:
    """What is drawn of leaves in every view: about so many points at most, but MIN_DRAWN of each that has so many."""
    thinned = thin_points(points, max(MIN_DRAWN, max_points // max(len(points), 1)))
    count = np.diff(thinned.offsets)
    leaf = np.repeat(np.arange(len(thinned), dtype=np.int32), count)
    middle_m, covariance = _moments(thinned.points_m, leaf, len(thinned))
    variance = np.maximum(np.linalg.eigvalsh(covariance), 0)  # least first
    area = ELLIPSE * np.sqrt(variance[:, 1] * variance[:, 2])
    return DrawnPoints(
        points_m=thinned.points_m,
        point_view=thinned.point_view,
        leaf=leaf,
        middle_m=middle_m,
        size_m=4 * np.sqrt(variance[:, 2]),
        spacing_m=np.sqrt(area / np.maximum(count, 1)),
    )


def label_points(points: DrawnPoints, view: View, view_number: int) -> NDArray[np.int32]:
    """(H, W), the number of the leaf whose points are seen there, -1 for none; gaps between points are closed.

    Points that another view saw count where this one's depth does not stand before them.
    """
    camera = view.camera
    labels = np.full((camera.height_px, camera.width_px), -1, np.int32)
    places, depth_m = camera.project(points.points_m)
    with np.errstate(invalid="ignore"):
        inside = np.flatnonzero(np.all((places >= 0) & (places < (camera.width_px, camera.height_px)), axis=1))
    columns, rows = places[inside].astype(np.intp).T
    depth_m, leaf = depth_m[inside], points.leaf[inside]
    seen_m = view.depth_m[rows, columns]
    visible = (seen_m <= 0) | (depth_m <= seen_m + BEHIND * points.size_m[leaf])
    visible |= points.point_view[inside] == view_number
    if not visible.any():
        return labels
    rows, columns, depth_m, leaf = rows[visible], columns[visible], depth_m[visible], leaf[visible]
    # Small integers are sorted in linear time; the nearest is drawn last.
    away = (depth_m.max() - depth_m) * (DEPTHS / max(float(np.ptp(depth_m)), 1e-300))
    order = np.argsort(away.astype(np.uint16), kind="stable")
    labels[rows[order], columns[order]] = leaf[order]
    side = 2 * min(int(np.ceil(_gap_px(points, camera) / 2)), MAX_GROWN_PX) + 1
    square = np.ones((side, side), np.uint8)
    grown = cv2.dilate((labels + 1).astype(np.float32), square) - 1
    known = labels >= 0
    gap = (cv2.morphologyEx(known.astype(np.uint8), cv2.MORPH_CLOSE, square) > 0) & ~known
    # Of leaves that touch, single points of the one lie before the other.
    return cv2.medianBlur(np.where(gap, grown, labels.astype(np.float32)), SPECK_PX).astype(np.int32)


def thin_points(points: LeafPoints, max_points: int) -> LeafPoints:
    """The same leaves with so many points each at most, evenly chosen among them: enough for a picture."""
    counts = np.diff(points.offsets)
    kept = np.minimum(counts, max_points)
    offsets = np.concatenate([[0], np.cumsum(kept)])
    leaf = np.repeat(np.arange(len(points)), kept)
    number = np.arange(offsets[-1]) - offsets[leaf]
    chosen = points.offsets[leaf] + number * counts[leaf] // np.maximum(kept[leaf], 1)
    return replace(
        points,
        points_m=points.points_m[chosen],
        normals=points.normals[chosen],
        kind=points.kind[chosen],
        point_view=points.point_view[chosen],
        offsets=offsets,
    )


def _gap_px(points: DrawnPoints, camera: Pinhole) -> float:
    """How wide gaps between the points of nearly every leaf before the camera are, seen from its front."""
    _, depth_m = camera.project(points.middle_m)
    before = depth_m > points.size_m
    if not before.any():
        return 0.0
    spacing_px = points.spacing_m[before] / depth_m[before] * max(camera.focal_px)
    return GAP * float(np.quantile(spacing_px, NEARLY_ALL))


def _moments(
    points: NDArray[np.float64], group: NDArray[np.integer], groups: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean (G, D) and covariance (G, D, D) of points (P, D) by group (P,); 0 of groups that have none."""
    axes = range(points.shape[1])
    count = np.maximum(np.bincount(group, minlength=groups), 1)
    mean = np.column_stack([np.bincount(group, points[:, axis], groups) / count for axis in axes])
    away = points - mean[group]
    products = [[np.bincount(group, away[:, i] * away[:, j], groups) / count for j in axes] for i in axes]
    return mean, np.moveaxis(np.array(products), -1, 0)


def draw_refined(view: View, view_number: int, points: DrawnPoints) -> NDArray[np.uint8]:
    """The photograph (H, W, 3) with the points of leaves that it shows, a leaf in the same colour in every view."""
    labels = label_points(points, view, view_number)
    return _fill(view.srgb, labels, leaf_palette(len(points)), np.full(len(points), FILL))


def draw_fitted(
    view: View,
    leaves: Leaves,
    color_of: NDArray[np.integer],
    certainty: NDArray[np.floating],
    *,
    threads: int = 0,
) -> NDArray[np.uint8]:
    """The photograph (H, W, 3) with the fitted leaves that it can see, their axes, and a dot at each base.

    Args:
        leaves: In the world of the view.
        color_of: (N,), number in the palette of each, so that a leaf looks as its points do.
        certainty: (N,), that the base is the base; below SURE the dot is hollow.
        threads: 0: one per core; the picture is the same.
    """
    drawn = draw_leaf_ids(leaves, view.camera, threads=threads)
    ids = drawn.ids
    if len(leaves):
        allowed_m = (BEHIND * leaves.length_m).astype(np.float32)[ids]  # -1 is the last, and not used
        hidden = (view.depth_m > 0) & (drawn.depth_m > view.depth_m + allowed_m)
        # Single pixels of noisy depth hide nothing.
        ids = np.where(cv2.medianBlur(hidden.astype(np.uint8), NOISE_PX) > 0, -1, ids)
    palette = leaf_palette(int(color_of.max(initial=-1)) + 1)[color_of]
    picture = _fill(view.srgb, ids, palette, np.full(len(palette), FILL))
    bits = 4
    axes = project_axes(leaves, view.camera)
    visible = _visible_at(ids, axes)
    fixed = np.rint((np.where(visible[..., None], axes, 0) - 0.5) * (1 << bits)).astype(np.int32)
    lines = [fixed[leaf, start:end] for leaf, start, end in _find_runs(visible)]
    cv2.polylines(picture, lines, False, EDGE, 1, cv2.LINE_AA, bits)
    for leaf in np.flatnonzero(visible[:, :2].all(axis=1)):
        thickness = cv2.FILLED if certainty[leaf] >= SURE else 1
        cv2.circle(picture, fixed[leaf, 0].tolist(), DOT_PX << bits, BASE, thickness, cv2.LINE_AA, bits)
    return picture


def _visible_at(ids: NDArray[np.int32], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N, P), whether a pixel beside each place (N, P, 2) shows its leaf: base and apex are the leaf's corners."""
    height, width = ids.shape
    known = np.asarray(np.isfinite(places).all(axis=2))
    near = np.clip(np.where(known[:, :, None], places, -9), -9, max(ids.shape) + 9)
    column, row = np.floor(near).astype(np.intp).transpose(2, 0, 1)
    leaf = np.arange(len(places))[:, None]
    visible = np.zeros(known.shape, np.bool_)
    for down in range(-BESIDE_PX, BESIDE_PX + 1):
        for across in range(-BESIDE_PX, BESIDE_PX + 1):
            y, x = row + down, column + across
            inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
            visible |= inside & (ids[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)] == leaf)
    return visible & known


def _find_runs(chosen: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """(row, start, end) of every two or more places of a row of (N, P) that are chosen, one after another."""
    padded = np.zeros((len(chosen), chosen.shape[1] + 2), np.int8)
    padded[:, 1:-1] = chosen
    rows, ends = np.nonzero(np.diff(padded, axis=1))
    return [
        (row, start, end)
        for row, start, end in zip(rows[::2].tolist(), ends[::2].tolist(), ends[1::2].tolist(), strict=True)
        if end - start > 1
    ]


def _fill(
    srgb: NDArray[np.uint8], ids: NDArray[np.integer], palette: NDArray[np.uint8], strength: NDArray[np.floating]
) -> NDArray[np.uint8]:
    """The photograph with areas (ids (H, W), -1 for none) in their colours, edged, and shaded where there are none.

    Args:
        palette: (N, 3), of each area.
        strength: (N,), share of its colour.
    """
    left = np.repeat(np.concatenate([[SHADE], 1 - strength])[:, None], 4, axis=1)
    added = np.zeros((len(palette) + 1, 4))
    added[1:, :3] = strength[:, None] * palette
    place = ids + 1
    kept = cv2.multiply(cv2.cvtColor(srgb, cv2.COLOR_RGB2RGBA), _take(255 * left, place), scale=1 / 255)
    filled = np.asarray(cv2.cvtColor(cv2.add(kept, _take(added, place)), cv2.COLOR_RGBA2RGB), np.uint8)
    filled[_edges(ids) & (ids >= 0)] = EDGE
    return filled


def _take(table: NDArray[np.floating], place: NDArray[np.integer]) -> NDArray[np.uint8]:
    """(H, W, 4) of the rows of a table (K, 4), rounded; four bytes at once are as fast as one."""
    packed = np.rint(table).astype(np.uint8).view(np.uint32)[:, 0]
    return packed[place].view(np.uint8).reshape(*place.shape, 4)


def _edges(ids: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Pixels whose right or lower neighbour is another's."""
    edges = np.zeros(ids.shape, np.bool_)
    edges[:, :-1] |= ids[:, :-1] != ids[:, 1:]
    edges[:-1] |= ids[:-1] != ids[1:]
    return edges
