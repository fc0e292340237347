"""Pictures of how a lobed leaf was made: scan, silhouette, skeleton, ties, faces."""

import colorsys
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.color import encode_srgb
from usdfoliage.jobs.lobed.model import ModelledLeaf
from usdfoliage.leaf.lobed.spline import evaluate_closed

PICTURE_PX = 900  # longer side of the part of the scan that has the leaf
_MARGIN = 0.04  # of that side, around the leaf
_BITS = 4
_PALE = 0.65  # of white over the scan, where lines are drawn on it
_ORANGE, _GREY, _BLACK = (255, 140, 0), (110, 110, 110), (0, 0, 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Canvas:
    """The part of a scan that is drawn on."""

    picture: NDArray[np.uint8]  # (h, w, 3)
    corner_px: NDArray[np.float64]  # (2,) of the scan
    scale: float

    def to_drawn(self, leaf: ModelledLeaf, places: NDArray[np.float64]) -> NDArray[np.int32]:
        """Where places (..., 2) of the leaf's crop are drawn, in parts of a pixel for cv2."""
        crop = leaf.crop
        scan = np.array([crop.left_px, crop.top_px]) + crop.pixel * places * [1, -1]
        return np.rint(((scan - self.corner_px) * self.scale - 0.5) * (1 << _BITS)).astype(np.int32)


def draw_making(linear: NDArray[np.float32], leaf: ModelledLeaf) -> dict[str, NDArray[np.uint8]]:
    """Pictures (h, w, 3) by what they show: scan, silhouette, skeleton, ties, faces; of a scan (H, W, 3), linear."""
    canvas = _prepare(linear, leaf)
    pale = np.rint(255 * _PALE + canvas.picture * (1 - _PALE)).astype(np.uint8)
    drawn = {"scan": canvas.picture}
    flat, shape = leaf.flat, leaf.leaf.shape
    spline = canvas.to_drawn(leaf, evaluate_closed(flat.silhouette.control_px, 8))
    controls = canvas.to_drawn(leaf, flat.silhouette.control_px)
    drawn["silhouette"] = canvas.picture.copy()
    cv2.polylines(drawn["silhouette"], [spline], True, _ORANGE, 2, cv2.LINE_AA, _BITS)
    for place in controls:
        cv2.circle(drawn["silhouette"], place.tolist(), 2 << _BITS, _BLACK, cv2.FILLED, cv2.LINE_AA, _BITS)

    pixel_m = leaf.leaf.asset_from_picture[0, 0]
    in_crop = shape.places / pixel_m / leaf.crop.pixel + flat.ties.nodes[flat.ties.base]
    places = canvas.to_drawn(leaf, in_crop)
    nodes, feet = places[: len(shape.nodes)], places[len(shape.nodes) :]
    drawn["skeleton"] = pale.copy()
    cv2.polylines(drawn["skeleton"], [spline], True, _GREY, 1, cv2.LINE_AA, _BITS)
    _draw_skeleton(drawn["skeleton"], nodes, shape.parents, shape.branches, 3)
    drawn["ties"] = pale.copy()
    for tie, node in enumerate(shape.tie_nodes.tolist()):
        cv2.line(drawn["ties"], nodes[node].tolist(), feet[tie].tolist(), _GREY, 1, cv2.LINE_AA, _BITS)
    _draw_skeleton(drawn["ties"], nodes, shape.parents, shape.branches, 2)
    drawn["faces"] = np.full_like(pale, 255)
    for face in shape.faces:
        cv2.polylines(drawn["faces"], [places[face]], True, _BLACK, 1, cv2.LINE_AA, _BITS)
    return drawn


def _draw_skeleton(
    picture: NDArray[np.uint8],
    nodes: NDArray[np.int32],
    parents: NDArray[np.int64],
    branches: NDArray[np.int64],
    width: int,
) -> None:
    """Each branch in a colour of its own, the axis black."""
    for node in range(1, len(nodes)):
        hue = (int(branches[node]) * (5**0.5 - 1) / 2) % 1
        color = tuple(int(255 * part) for part in colorsys.hsv_to_rgb(hue, 1, 0.85)) if branches[node] else _BLACK
        begin, end = nodes[parents[node]].tolist(), nodes[node].tolist()
        cv2.line(picture, begin, end, color, width, cv2.LINE_AA, _BITS)


def _prepare(linear: NDArray[np.float32], leaf: ModelledLeaf) -> _Canvas:
    rows, columns = np.nonzero(leaf.mask)
    low, high = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()]) + 1
    margin = int(np.ceil(_MARGIN * (high - low).max()))
    left, top = np.maximum(low - margin, 0).tolist()
    right, bottom = np.minimum(high + margin, np.array(leaf.mask.shape)[::-1]).tolist()
    scale = PICTURE_PX / max(right - left, bottom - top)
    size = (max(1, round((right - left) * scale)), max(1, round((bottom - top) * scale)))
    part = np.clip(encode_srgb(linear[top:bottom, left:right]), 0, 1).astype(np.float32)
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    picture = np.rint(255 * np.clip(cv2.resize(part, size, interpolation=method), 0, 1)).astype(np.uint8)
    return _Canvas(picture=np.ascontiguousarray(picture), corner_px=np.array([left, top], float), scale=scale)
