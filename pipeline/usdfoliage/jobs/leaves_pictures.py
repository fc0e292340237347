"""What a run found, drawn over its photographs."""

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
    strength = np.concatenate([[0.0], FILL * (0.1 + 0.9 * np.clip(confidence, 0, 1))])
    return _fill(view.srgb, labels - 1, leaf_palette(len(confidence)), strength[labels])


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


def _sizes_m(points: LeafPoints) -> NDArray[np.float64]:
    """About how long leaves (M,) are: four standard deviations of their points."""
    sizes = np.zeros(len(points))
    for leaf, (start, end) in enumerate(zip(points.offsets[:-1], points.offsets[1:], strict=True)):
        if end > start:
            sizes[leaf] = 4 * np.sqrt(points.points_m[start:end].var(axis=0).max())
    return sizes


def _spacing_px(places: NDArray[np.float64], leaf: NDArray[np.int32]) -> float:
    """How far apart points of a leaf are seen, as the median of leaves."""
    order = np.argsort(leaf, kind="stable")
    parts = np.split(places[order], np.flatnonzero(np.diff(leaf[order])) + 1)
    areas = [cv2.contourArea(cv2.convexHull(part.astype(np.float32))) for part in parts]
    return float(np.median([np.sqrt(area / len(part)) for area, part in zip(areas, parts, strict=True)]))


def draw_refined(view: View, view_number: int, points: LeafPoints) -> NDArray[np.uint8]:
    """The photograph (H, W, 3) with the points of leaves that it shows, a leaf in the same colour in every view."""
    labels = label_points(points, view, view_number)
    return _fill(view.srgb, labels, leaf_palette(len(points)), np.full(labels.shape, FILL))


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
    picture = _fill(view.srgb, ids, palette, np.full(ids.shape, FILL))
    bits = 4
    for leaf, axis in enumerate(project_axes(leaves, view.camera)):
        for line in _runs(axis, _shown_there(ids, axis, leaf)):
            fixed = np.rint((line - 0.5) * (1 << bits)).astype(np.int32)
            cv2.polylines(picture, [fixed], False, EDGE, 1, cv2.LINE_AA, bits)
            if np.array_equal(line[0], axis[0]):
                cv2.circle(picture, fixed[0].tolist(), 3 << bits, BASE, -1, cv2.LINE_AA, bits)
    return picture


def _shown_there(ids: NDArray[np.int32], places: NDArray[np.float64], leaf: int) -> NDArray[np.bool_]:
    """(P,), whether a pixel beside each place shows the leaf: base and apex are the leaf's corners."""
    shown = np.zeros(len(places), np.bool_)
    for number in np.flatnonzero(np.isfinite(places).all(axis=1)):
        column, row = (int(np.clip(place, -9, 1 << 20)) for place in places[number])
        around = ids[max(row - BESIDE_PX, 0) : row + BESIDE_PX + 1, max(column - BESIDE_PX, 0) : column + BESIDE_PX + 1]
        shown[number] = bool((around == leaf).any()) if row >= -BESIDE_PX and column >= -BESIDE_PX else False
    return shown


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
    """The photograph with areas (ids (H, W), -1 for none) in their colours, edged, and shaded where there are none."""
    inside = ids >= 0
    picture = srgb.astype(np.float32)
    picture[~inside] *= SHADE
    share = strength[inside][:, None]
    picture[inside] = (1 - share) * picture[inside] + share * palette[ids[inside]]
    filled = np.rint(picture).astype(np.uint8)
    filled[_edges(ids) & inside] = EDGE
    return filled


def _edges(ids: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Pixels whose right or lower neighbour is another's."""
    edges = np.zeros(ids.shape, np.bool_)
    edges[:, :-1] |= ids[:, :-1] != ids[:, 1:]
    edges[:-1] |= ids[:-1] != ids[1:]
    return edges
