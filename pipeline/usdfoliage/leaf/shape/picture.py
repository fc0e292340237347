"""A picture of a leaf from its surface: what its texture shows, within its silhouette. Ours."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

_FINER = 4  # pixels of the silhouette along one of the picture
_ALONG, _ACROSS = 65, 17  # places of the surface between which texture coordinates are linear
_BITS = 4  # of the fraction of a pixel, of the polygon's corners


def draw_leaf_picture(
    parameters: NDArray[np.floating], texture: NDArray[np.floating], height_px: int = 256
) -> NDArray[np.float32]:
    """A leaf from above, as it is laid out flat on a table: base below, apex above.

    Args:
        parameters: (7, 3), leaf lengths, as a row of Leaves.parameters. Heights do not count.
        texture: (h, w, 4), linear Rec.709 and opacity, over st = ((u + 1) / 2, v); the first row is at the apex.
        height_px: Of the picture.

    Returns:
        (height_px, W, 4), linear colour, not multiplied by opacity, and opacity.

    Raises:
        ValueError: A shape is wrong, or the leaf has no area from above.
    """
    if np.shape(parameters) != (7, 3) or texture.ndim != 3 or texture.shape[2] != 4:
        raise ValueError(f"a leaf is (7, 3) and its texture (h, w, 4), not {np.shape(parameters)}, {texture.shape}")
    v, u = np.linspace(0, 1, _ALONG), np.linspace(-1, 1, _ACROSS)
    uv = grid_places(u, v)
    place = evaluate_points(np.asarray(parameters, np.float64)[None], uv)[0, :, :2].reshape(_ALONG, _ACROSS, 2)
    low, high = place.reshape(-1, 2).min(axis=0), place.reshape(-1, 2).max(axis=0)
    reach = high - low
    if not (np.isfinite(reach).all() and reach.min() > 1e-3):
        raise ValueError(f"the leaf is {reach[0]:g} x {reach[1]:g} of its length, and has no area from above")
    to_px = height_px / reach[1]
    width_px = int(np.clip(np.ceil(reach[0] * to_px), 1, 8 * height_px))
    # From the left of the picture, and from its top.
    at_px = np.stack([place[..., 0] - low[0], high[1] - place[..., 1]], axis=-1) * to_px
    silhouette_px = np.concatenate([at_px[:, 0], at_px[::-1, -1]])
    fine = np.zeros((height_px * _FINER, width_px * _FINER), np.uint8)
    corners = np.rint((silhouette_px * _FINER - 0.5) * 2**_BITS).astype(np.int32)
    cv2.fillPoly(fine, [corners.reshape(-1, 1, 2)], (255,), shift=_BITS)
    inside = cv2.resize(fine, (width_px, height_px), interpolation=cv2.INTER_AREA).reshape(height_px, width_px) / 255
    # At base and apex all places are one.
    ends = [[*at_px[0, _ACROSS // 2], 0.0, 0.0], [*at_px[-1, _ACROSS // 2], 0.0, 1.0]]
    known = np.concatenate([np.dstack([at_px, uv.reshape(_ALONG, _ACROSS, 2)])[1:-1].reshape(-1, 4), ends])
    x, y = np.meshgrid(np.arange(width_px) + 0.5, np.arange(height_px) + 0.5)
    found = LinearNDInterpolator(known[:, :2], known[:, 2:])(x, y)
    beside = np.isnan(found[..., 0])  # where the silhouette covers a part of a pixel, and not its middle
    found[beside] = NearestNDInterpolator(known[:, :2], known[:, 2:])(x[beside], y[beside])
    st = found * [0.5, 1.0] + [0.5, 0.0]
    rows, columns = texture.shape[:2]
    drawn = cv2.remap(
        np.ascontiguousarray(texture, np.float32),
        (st[..., 0] * columns - 0.5).astype(np.float32),
        ((1 - st[..., 1]) * rows - 0.5).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    drawn[..., 3] *= inside
    return np.asarray(drawn, np.float32)
