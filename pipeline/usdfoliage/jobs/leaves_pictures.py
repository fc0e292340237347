"""What a run found, drawn over its photographs."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.reprojection import draw_leaf_ids, project_axes
from usdfoliage.leaf.segmentation.model import LeafPoints

EDGE = (255, 255, 255)
SUPERPIXEL_EDGE = (255, 210, 60)
BASE = (255, 60, 40)
FILL = 0.55  # of the colour over the photograph
SHADE = 0.45  # of the photograph where there is nothing to show
MOST_GROWN_PX = 7  # by which points are made larger to close the gaps between them
DRAWN_POINTS = 2000  # of a leaf
ELLIPSE = 4 * np.pi  # area of an even ellipse, in the root of its points' covariance's determinant
BESIDE_PX = 1  # how far from a leaf a place of its axis may lie to be drawn
NOISE_PX = 5  # side of the square whose majority tells whether a leaf is hidden there
BEHIND = 0.1  # leaf lengths by which a leaf may lie behind the depth that is seen and still count as seen


def leaf_palette(count: int) -> NDArray[np.uint8]:
    """(count, 3) bright sRGB colours of which neighbours differ."""
    number = np.arange(count)
    hue = (number * (5**0.5 - 1) / 2) % 1
    hsv = np.column_stack([hue * 179, 150 + 50 * (number % 3), 255 - 30 * (number // 3 % 3)])
    rgb = cv2.cvtColor(np.rint(hsv).astype(np.uint8)[None], cv2.COLOR_HSV2RGB)[0] if count else np.zeros((0, 3))
    return np.asarray(rgb, np.uint8).reshape(count, 3)


def draw_superpixels(view: View, labels: NDArray[np.int32]) -> NDArray[np.uint8]:
    """The photograph (H, W, 3), dark outside of superpixels (labels (H, W), -1 for none), with their edges."""
    picture = np.where((labels >= 0)[..., None], view.srgb, view.srgb * SHADE).astype(np.uint8)
    picture[_edges(labels)] = SUPERPIXEL_EDGE
    return picture


def draw_candidates(view: View, labels: NDArray[np.int32], confidence: NDArray[np.floating]) -> NDArray[np.uint8]:
    """The photograph (H, W, 3) with its candidates (labels (H, W), 0 for none), stronger where more is trusted."""
    strength = FILL * (0.1 + 0.9 * np.clip(confidence, 0, 1))
    return _fill(view.srgb, labels - 1, leaf_palette(len(confidence)), strength)


def label_points(points: LeafPoints, view: View, view_number: int) -> NDArray[np.int32]:
    """(H, W), the number of the leaf whose points are seen there, -1 for none; gaps between points are closed.

    Points that another view saw count where this one's depth does not stand before them.
    """
    camera = view.camera
    labels = np.full((camera.height_px, camera.width_px), -1, np.int32)
    leaf = np.repeat(np.arange(len(points), dtype=np.int32), np.diff(points.offsets))
    places, depth_m = camera.project(points.points_m)
    with np.errstate(invalid="ignore"):
        inside = np.all((places >= 0) & (places < (camera.width_px, camera.height_px)), axis=1)
    columns, rows = np.where(inside[:, None], places, 0).astype(np.intp).T
    seen_m = view.depth_m[rows, columns]
    limit_m = np.where(seen_m > 0, seen_m + BEHIND * _sizes_m(points)[leaf], np.inf)
    shown = np.flatnonzero(inside & ((depth_m <= limit_m) | (points.point_view == view_number)))
    if not len(shown):
        return labels
    shown = shown[np.argsort(-depth_m[shown], kind="stable")]  # the nearest is drawn last
    labels[rows[shown], columns[shown]] = leaf[shown]
    side = 2 * min(int(np.ceil(_spacing_px(places[shown], leaf[shown]) / 2)), MOST_GROWN_PX) + 1
    grown = cv2.dilate((labels + 1).astype(np.float32), np.ones((side, side), np.uint8)).astype(np.int32) - 1
    return np.where(labels >= 0, labels, grown)


def thin_points(points: LeafPoints, most: int = DRAWN_POINTS) -> LeafPoints:
    """The same leaves with so many points each at most, evenly chosen among them: enough for a picture."""
    counts = np.diff(points.offsets)
    kept = np.minimum(counts, most)
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


def _sizes_m(points: LeafPoints) -> NDArray[np.float64]:
    """About how long leaves (M,) are: four standard deviations of their points."""
    leaf = np.repeat(np.arange(len(points)), np.diff(points.offsets))
    return np.asarray(4 * np.sqrt(np.einsum("nii->ni", _covariances(points.points_m, leaf)).max(axis=1, initial=0.0)))


def _spacing_px(places: NDArray[np.float64], leaf: NDArray[np.int32]) -> float:
    """How far apart points of a leaf are seen, as the median of leaves."""
    leaves, counts = np.unique(leaf, return_counts=True)
    spread = np.linalg.det(_covariances(places, np.searchsorted(leaves, leaf)))
    areas = ELLIPSE * np.sqrt(np.maximum(spread, 0))
    return float(np.median(np.sqrt(areas / counts)))


def _covariances(points: NDArray[np.float64], group: NDArray[np.integer]) -> NDArray[np.float64]:
    """(G, D, D) of points (P, D) by group (P,); 0 of groups that have none."""
    groups, axes = int(group.max(initial=-1)) + 1, range(points.shape[1])
    count = np.maximum(np.bincount(group, minlength=groups), 1)
    mean = np.column_stack([np.bincount(group, points[:, axis], groups) / count for axis in axes])
    away = points - mean[group]
    products = [[np.bincount(group, away[:, i] * away[:, j], groups) / count for j in axes] for i in axes]
    return np.moveaxis(np.array(products), -1, 0)


def draw_refined(view: View, view_number: int, points: LeafPoints) -> NDArray[np.uint8]:
    """The photograph (H, W, 3) with the points of leaves that it shows, a leaf in the same colour in every view."""
    labels = label_points(points, view, view_number)
    return _fill(view.srgb, labels, leaf_palette(len(points)), np.full(len(points), FILL))


def draw_fitted(view: View, leaves: Leaves, color_of: NDArray[np.integer]) -> NDArray[np.uint8]:
    """The photograph (H, W, 3) with the fitted leaves that it can see, their axes, and a dot at each base.

    Args:
        leaves: In the world of the view.
        color_of: (N,), number in the palette of each, so that a leaf looks as its points do.
    """
    drawn = draw_leaf_ids(leaves, view.camera)
    ids = drawn.ids
    if len(leaves):
        allowed_m = BEHIND * leaves.length_m[ids]  # -1 is the last, and not used
        hidden = (view.depth_m > 0) & (drawn.depth_m > view.depth_m + allowed_m)
        # Single pixels of noisy depth hide nothing.
        ids = np.where(cv2.medianBlur(hidden.astype(np.uint8), NOISE_PX) > 0, -1, ids)
    palette = leaf_palette(int(color_of.max(initial=-1)) + 1)[color_of]
    picture = _fill(view.srgb, ids, palette, np.full(len(palette), FILL))
    bits = 4
    axes = project_axes(leaves, view.camera)
    for axis, shown in zip(axes, _shown_there(ids, axes), strict=True):
        for line in _runs(axis, shown):
            fixed = np.rint((line - 0.5) * (1 << bits)).astype(np.int32)
            cv2.polylines(picture, [fixed], False, EDGE, 1, cv2.LINE_AA, bits)
            if np.array_equal(line[0], axis[0]):
                cv2.circle(picture, fixed[0].tolist(), 3 << bits, BASE, -1, cv2.LINE_AA, bits)
    return picture


def _shown_there(ids: NDArray[np.int32], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N, P), whether a pixel beside each place (N, P, 2) shows its leaf: base and apex are the leaf's corners."""
    height, width = ids.shape
    known = np.asarray(np.isfinite(places).all(axis=2))
    near = np.clip(np.where(known[:, :, None], places, -9), -9, max(ids.shape) + 9)
    column, row = np.floor(near).astype(np.intp).transpose(2, 0, 1)
    leaf = np.arange(len(places))[:, None]
    shown = np.zeros(known.shape, np.bool_)
    for down in range(-BESIDE_PX, BESIDE_PX + 1):
        for across in range(-BESIDE_PX, BESIDE_PX + 1):
            y, x = row + down, column + across
            inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
            shown |= inside & (ids[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)] == leaf)
    return shown & known


def _runs(places: NDArray[np.float64], chosen: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """The parts of a polyline whose places are all chosen, two or more each."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(np.int8), [0]])))
    return [places[start:end] for start, end in ends.reshape(-1, 2) if end - start > 1]


def shrink_to(picture: NDArray[np.uint8], longest_px: int) -> NDArray[np.uint8]:
    """The picture with no side longer than this."""
    height, width = shrunk_size(picture.shape[:2], longest_px)
    if (height, width) == picture.shape[:2]:
        return picture
    return np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def shrink_camera(camera: Pinhole, longest_px: int, stage_from_world: NDArray[np.float64]) -> Pinhole:
    """The camera of a shrunk picture, in a frame (4, 4) that is turned and moved against its world."""
    height, width = shrunk_size((camera.height_px, camera.width_px), longest_px)
    across, down = width / camera.width_px, height / camera.height_px
    world_from_stage = np.linalg.inv(stage_from_world)
    cam_from_stage = camera.cam_from_world[:, :3] @ world_from_stage[:3]
    cam_from_stage[:, 3] += camera.cam_from_world[:, 3]
    return Pinhole(
        width_px=width,
        height_px=height,
        focal_px=(camera.focal_px[0] * across, camera.focal_px[1] * down),
        center_px=(camera.center_px[0] * across, camera.center_px[1] * down),
        cam_from_world=cam_from_stage,
    )


def shrunk_size(size: tuple[int, ...], longest_px: int) -> tuple[int, int]:
    """Height and width with no side longer than this."""
    scale = min(1.0, longest_px / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _fill(
    srgb: NDArray[np.uint8], ids: NDArray[np.integer], palette: NDArray[np.uint8], strength: NDArray[np.floating]
) -> NDArray[np.uint8]:
    """The photograph with areas (ids (H, W), -1 for none) in their colours, edged, and shaded where there are none.

    Args:
        palette: (N, 3), of each area.
        strength: (N,), share of its colour.
    """
    left = np.concatenate([[SHADE], 1 - strength]).astype(np.float32)
    added = np.concatenate([np.zeros((1, 3)), strength[:, None] * palette]).astype(np.float32)
    place = ids + 1
    filled = np.rint(srgb * left[place][..., None] + added[place]).astype(np.uint8)
    filled[_edges(ids) & (ids >= 0)] = EDGE
    return filled


def _edges(ids: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Pixels whose right or lower neighbour is another's."""
    edges = np.zeros(ids.shape, np.bool_)
    edges[:, :-1] |= ids[:, :-1] != ids[:, 1:]
    edges[:-1] |= ids[:-1] != ids[1:]
    return edges
