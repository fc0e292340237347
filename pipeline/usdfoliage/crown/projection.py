"""The photograph at the scale of the cubemap, and projected onto the crown it shows.

Frames: photograph in pixels (x right, y down); crown x right, y up, z towards the camera, lengths in pixels of the
photograph, origin at the crown's centre. The camera is taken to be orthographic, as in the thesis.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from usdfoliage.geometry.cubemap import face_directions

MENDED_TEXELS = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Exemplar:
    """The masked photograph, resampled so that one pixel is one texel in the middle of the front face."""

    color: NDArray[np.float32]  # (h, w, 3), linear Rec.709, the crown's own colours beyond its silhouette too
    mask: NDArray[np.bool_]  # (h, w), wholly inside the crown
    scale_px: float  # pixels of the photograph per pixel of the exemplar
    corner_px: NDArray[np.float64]  # (2,), x and y of the exemplar's upper left corner in the photograph


def make_exemplar(
    color: NDArray[np.floating],
    mask: NDArray[np.bool_],
    texel_px: float,
    foliage: NDArray[np.bool_] | None = None,
) -> Exemplar:
    """Cut out the crown and resample it to texels of texel_px pixels.

    Sky that shows through gaps, and the light of it at the silhouette, give way to the nearest foliage.

    Args:
        color: (H, W, 3), linear Rec.709.
        mask: (H, W), True inside the crown's silhouette.
        texel_px: size of a texel in pixels.
        foliage: (H, W), True where the picture shows foliage; None: wherever mask is.
    """
    rows, columns = np.nonzero(mask)
    margin = int(np.ceil(2 * texel_px)) + 1
    top, left = max(rows.min() - margin, 0), max(columns.min() - margin, 0)
    bottom, right = min(rows.max() + 1 + margin, mask.shape[0]), min(columns.max() + 1 + margin, mask.shape[1])
    inside = mask[top:bottom, left:right]
    leaves = inside if foliage is None else foliage[top:bottom, left:right] & inside
    # The outermost pixels hold light of the sky behind; colours there come from the nearest pixel farther in.
    pure = cv2.erode(leaves.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    if not pure.any():
        pure = leaves
    distance, nearest = distance_transform_edt(~pure, return_indices=True)
    filled = np.asarray(color[top:bottom, left:right], dtype=np.float32)[tuple(nearest)]
    height = max(round((bottom - top) / texel_px), 4)
    width = max(round((right - left) / texel_px), 4)
    method = cv2.INTER_AREA if texel_px > 1 else cv2.INTER_CUBIC
    small = cv2.resize(filled, (width, height), interpolation=method)
    # A gap of a few texels is mended well enough to be copied from, a window in the crown is not.
    copied = (cv2.erode(inside.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0) & (
        distance <= MENDED_TEXELS * max(texel_px, 1.0)
    )
    share = cv2.resize(copied.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    return Exemplar(
        color=np.maximum(small, 0),
        mask=share > 0.99,
        scale_px=texel_px,
        corner_px=np.array([left, top], dtype=np.float64),
    )


def project_photo(
    exemplar: Exemplar, radius_px: NDArray[np.floating], center_px: NDArray[np.floating]
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """What the photograph shows at every texel of a radius cubemap, and how squarely.

    Args:
        exemplar: The photograph at the cubemap's scale.
        radius_px: (6, N, N), in pixels.
        center_px: (2,), x and y of the crown's centre in the photograph.

    Returns:
        color (6, N, N, 3), linear; on the back, which the photograph does not see, the mirror image of the front;
        weight (6, N, N): 0 where the photograph does not see the texel, else the cosine between the surface's normal
        and the direction to the camera.
    """
    size = radius_px.shape[1]
    points = face_directions(size) * radius_px[..., None]
    along_column, along_row = np.gradient(points, axis=1), np.gradient(points, axis=2)
    normal = np.cross(along_row, along_column)
    normal *= np.sign(np.sum(normal * points, axis=-1, keepdims=True))
    cosine = normal[..., 2] / np.maximum(np.linalg.norm(normal, axis=-1), 1e-12)
    seen = (points[..., 2] > 0) & (cosine > 0)
    photo = center_px + points[..., :2] * [1, -1]
    where = (photo - exemplar.corner_px) / exemplar.scale_px - 0.5
    flat = where.reshape(6 * size, size, 2).astype(np.float32)
    color = cv2.remap(
        exemplar.color, flat[..., 0], flat[..., 1], interpolation=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    ).reshape(6, size, size, 3)
    return np.maximum(color, 0), np.where(seen, cosine, 0.0)
