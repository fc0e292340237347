"""A segmentation that knows the truth, for tests of what comes after one."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.view import View
from usdfoliage.leaf.points import FREE_EDGE, HIDDEN_EDGE, INTERIOR, LeafPoints
from usdfoliage.leaf.segmentation.model import Candidates, Segmentation

FEWEST_PX = 150  # of a leaf in its best view


def segment_truly(
    views: Sequence[View], leaf_ids: Mapping[str, NDArray[np.integer]], confidence: float = 0.9
) -> Segmentation:
    """Leaves in the view that shows max_pixels of them.

    Args:
        views: With depth.
        leaf_ids: (H, W) by the view's name, 0 for none.
        confidence: Of the leaf that is seen best; the others have less, half as much at least.
    """
    candidates, pixels = [], []
    for view in views:
        ids = np.where(view.depth_m > 0, leaf_ids[view.name], 0).astype(np.int64)
        found, places = np.unique(ids, return_inverse=True)
        labels = places.reshape(ids.shape).astype(np.int32) + (0 if found[0] == 0 else 1)
        candidates.append(Candidates(labels=labels, confidence=np.full(np.count_nonzero(found), confidence)))
        pixels.append(np.bincount(ids.ravel(), minlength=1 + max(int(ids.max()) for ids in leaf_ids.values())))
    best = np.argmax(pixels, axis=0)
    max_pixels = np.max(pixels, axis=0)
    leaves = [leaf for leaf in range(1, len(max_pixels)) if max_pixels[leaf] >= FEWEST_PX]
    kinds = {view.name: _kinds(view, leaf_ids[view.name]) for view in views}
    points, normals, seen_by = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0, np.int32)]
    kind = [np.zeros(0, np.uint8)]
    for leaf in leaves:
        view = views[best[leaf]]
        visible = (leaf_ids[view.name] == leaf) & (view.depth_m > 0)
        mine = view.points()[visible]
        kind.append(kinds[view.name][visible])
        _, _, axes = np.linalg.svd(mine - mine.mean(axis=0), full_matrices=False)
        normal = axes[2] * (1 if (view.camera.position_m - mine.mean(axis=0)) @ axes[2] > 0 else -1)
        points.append(mine)
        normals.append(np.tile(normal, (len(mine), 1)))
        seen_by.append(np.full(len(mine), best[leaf], np.int32))
    every = np.concatenate(points)
    return Segmentation(
        candidates=candidates,
        leaves=LeafPoints(
            points_m=every,
            normals=np.concatenate(normals),
            kind=np.concatenate(kind),
            point_view=np.concatenate(seen_by),
            offsets=np.cumsum([len(part) for part in points]).astype(np.int64),
            confidence=confidence * (0.5 + 0.5 * max_pixels[leaves] / max(max_pixels[1:].max(initial=1), 1)),
            view=best[leaves].astype(np.int32),
        ),
        dropped={"seen in few pixels": len(max_pixels) - 1 - len(leaves)},
    )


def _kinds(view: View, ids: NDArray[np.integer]) -> NDArray[np.uint8]:
    """(H, W), of the points that each pixel would be."""
    ids = np.pad(ids.astype(np.int64), 1, constant_values=-1)
    depth_m = np.pad(np.where(view.depth_m > 0, view.depth_m, np.inf), 1)  # 0 around: the picture hides what is there
    kinds = np.full(view.depth_m.shape, INTERIOR, np.uint8)
    inside = (slice(1, -1), slice(1, -1))
    for axis in (0, 1):
        for step in (-1, 1):
            other = np.roll(ids, step, axis)[inside] != ids[inside]
            nearer = np.roll(depth_m, step, axis)[inside] < depth_m[inside]
            kinds[other & ~nearer & (kinds == INTERIOR)] = FREE_EDGE
            kinds[other & nearer] = HIDDEN_EDGE
    return kinds
