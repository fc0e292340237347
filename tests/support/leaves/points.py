"""Points of known leaves, as a segmentation gives them."""

import numpy as np
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.points import FREE_EDGE, HIDDEN_EDGE, INTERIOR, LeafPoints
from usdfoliage.leaf.shape.surface import evaluate_normals
from usdfoliage.leaf.shape.variation import VariationSettings, vary_leaves


def known_leaves(count, seed=0, length_m=0.1, amount=1.0):
    """Parameters, axes, bases and lengths of leaves here and there."""
    rng = np.random.default_rng(seed)
    parameters = vary_leaves(count, rng, VariationSettings(amount=amount))
    axes = Rotation.random(count, random_state=seed).as_matrix() if count else np.zeros((0, 3, 3))
    return parameters, axes, rng.normal(size=(count, 3)) * 3 * length_m, length_m * rng.uniform(0.85, 1.15, count)


def world_points(leaves, uv):
    parameters, axes, bases, lengths = leaves
    points, normals = evaluate_normals(parameters, uv)
    return np.einsum("nij,nkj->nki", axes, points) * lengths[:, None, None] + bases[:, None], np.einsum(
        "nij,nkj->nki", axes, normals
    )


def leaf_points(leaves, seed=0, v_range=(0.0, 1.0), interior=400, edge=120, noise_m=0.0, outliers=0.0, outlier_m=0.0):
    """Points of the leaves with v in v_range; v_range is one pair, or a row for each leaf."""
    rng = np.random.default_rng(seed)
    count = len(leaves[0])
    low, high = np.broadcast_to(v_range, (count, 2)).T
    uv = rng.uniform((-1, 0), (1, 1), (count, interior, 2))
    ends = np.stack([rng.choice([-1.0, 1.0], (count, edge)), rng.random((count, edge))], axis=-1)
    uv = np.concatenate([uv, ends], axis=1)
    kind = np.broadcast_to(np.repeat([INTERIOR, FREE_EDGE], [interior, edge]), uv.shape[:2]).copy()
    points, normals = world_points(leaves, uv)
    points = points + rng.normal(size=points.shape) * noise_m
    off = rng.random(points.shape[:2]) < outliers
    points[off] += normals[off] * rng.choice([-1, 1], off.sum())[:, None] * outlier_m
    kept = (uv[..., 1] >= low[:, None]) & (uv[..., 1] <= high[:, None])
    kind[(uv[..., 1] > high[:, None] - 0.03) & (high < 1)[:, None] & (kind == INTERIOR)] = HIDDEN_EDGE
    sizes = kept.sum(axis=1)
    return LeafPoints(
        points_m=points[kept],
        normals=normals[kept],
        kind=kind[kept].astype(np.uint8),
        point_view=np.zeros(sizes.sum(), np.int32),
        offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        confidence=np.ones(count),
        view=np.arange(count, dtype=np.int32),
    )
