"""The texture of a lobed leaf: its whole picture, transparent beside the leaf.

Source:
    L. Mündermann et al., Modeling lobed leaves, section 3.4. That colours go on beside the leaf is our own.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

LONGEST_PX = 4096  # of a texture; a larger picture is shrunk
_EDGE_PX = 1.5  # within the leaf, where pixels show what was behind it too
_BESIDE_PX = 32  # around the leaf, where colours go on; farther off there is one colour, which a file holds in little


def build_texture(
    linear: NDArray[np.float32], mask: NDArray[np.bool_], longest_px: int = LONGEST_PX
) -> NDArray[np.float32]:
    """(h, w, 4) linear colours, not multiplied by opacity, and opacity, of a picture (H, W, 3) and a mask (H, W).

    Beside the leaf each pixel has the colour of the nearest one well within it, so that no filter of a renderer brings
    the background into its edge.

    Raises:
        ValueError: The mask is empty.
    """
    if not mask.any():
        raise ValueError("the mask is empty")
    height, width = mask.shape
    scale = min(1.0, longest_px / max(height, width))
    opacity = mask.astype(np.float32)
    if scale < 1:
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        weight = cv2.resize(opacity, size, interpolation=cv2.INTER_AREA)
        inside = cv2.resize(linear * opacity[..., None], size, interpolation=cv2.INTER_AREA)
        linear = (inside / np.maximum(weight, 1e-6)[..., None]).astype(np.float32)
        opacity = weight
    within = opacity >= 0.5
    deep = cv2.distanceTransform(within.astype(np.uint8), cv2.DIST_L2, 5) > _EDGE_PX
    if not deep.any():
        deep = within if within.any() else opacity > 0
    away, labels = cv2.distanceTransformWithLabels(
        (~deep).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    own = np.flatnonzero(deep)
    pixel = np.zeros(int(labels.max()) + 1, np.int64)  # of each label
    pixel[labels.ravel()[own]] = own
    colors = linear.reshape(-1, 3)
    texture = np.empty((*opacity.shape, 4), np.float32)
    texture[..., :3] = colors[own].mean(axis=0, dtype=np.float64)
    near = np.flatnonzero(away.ravel() <= _BESIDE_PX)
    texture.reshape(-1, 4)[near, :3] = colors[pixel[labels.ravel()[near]]]
    texture[..., 3] = opacity
    return texture
