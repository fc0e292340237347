"""Points of leaves that are known: what fits are tested with."""

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.points import LeafPoints
from usdfoliage.leaf.shape.surface import evaluate_area_elements, evaluate_normals, evaluate_points, grid_places

GRID = grid_places(np.linspace(-1, 1, 41), np.linspace(0, 1, 41))


def surface_points(leaf, count, rng, keep=None, noise=0.0):
    """Points and normals (count, 3) spread evenly over a leaf (7, 3), where keep(u, v) holds, in leaf space."""
    uv = rng.uniform((-1, 0), (1, 1), (20 * count, 2))
    areas = evaluate_area_elements(leaf[None], uv)[0]
    uv = uv[rng.random(len(uv)) < areas / areas.max()]
    if keep is not None:
        uv = uv[keep(*uv.T)]
    assert len(uv) >= count
    points, normals = (each[0] for each in evaluate_normals(leaf[None], uv[:count]))
    return points + noise * rng.normal(size=points.shape), normals


def leaf_points(points, normals=None):
    """LeafPoints of these sets of points (n, 3) and normals, of full confidence."""
    sizes = [len(each) for each in points]
    total = sum(sizes)
    up = np.tile((0.0, 0.0, 1.0), (total, 1))
    return LeafPoints(
        points_m=np.concatenate([*points, np.empty((0, 3))]),
        normals=up if normals is None else np.concatenate([*normals, np.empty((0, 3))]),
        kind=np.zeros(total, np.uint8),
        point_view=np.zeros(total, np.int32),
        offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        confidence=np.ones(len(sizes)),
        view=np.arange(len(sizes), dtype=np.int32),
    )


def surface_distances(truth, leaves: Leaves):
    """Mean symmetric distance (N,) of the surfaces of leaves (N, 7, 3) of length 1 and fitted ones."""
    ours = evaluate_points(leaves.parameters, GRID, placements=leaves.asset_from_leaf())
    pairs = zip(evaluate_points(truth, GRID), ours, strict=True)
    return np.array([(KDTree(a).query(b)[0].mean() + KDTree(b).query(a)[0].mean()) / 2 for a, b in pairs])


def moved(points, normals, seed, scale):
    """The same points turned, scaled and moved, with the (3, 3) turn and the (3,) shift."""
    turn = Rotation.random(random_state=seed).as_matrix()
    shift = scale * np.random.default_rng(seed).normal(size=3)
    return scale * points @ turn.T + shift, normals @ turn.T, turn, shift
