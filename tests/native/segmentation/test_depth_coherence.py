"""Native fusing of depth against the same written plainly in numpy."""

import numpy as np
from scipy.spatial.transform import Rotation
from usdfoliage import _native

SHAPE = (40, 52)
FOCAL = 60.0


def views(count=5, seed=0, noise=0.002):
    """Depth of boxes before a wall from cameras around them, with noise, outliers and holes."""
    rng = np.random.default_rng(seed)
    result = []
    for k in range(count):
        rotation = Rotation.from_rotvec([0.02 * k, 0.1 * (k - count // 2), 0.01]).as_matrix()
        position = np.array([-0.12 * (k - count // 2), 0.02 * k, 0.0])
        cam_from_world = np.column_stack([rotation, -rotation @ position])
        rows, columns = np.indices(SHAPE) + 0.5
        rays = np.stack([(columns - 26) / FOCAL, (rows - 20) / FOCAL, np.ones(SHAPE)], axis=-1) @ rotation
        depth = np.full(SHAPE, np.inf)
        for z, x, y, half in ((1.6, 0, 0, 9), (1.2, -0.2, 0.1, 0.15), (1.0, 0.15, -0.1, 0.12)):
            t = (z - position[2]) / rays[..., 2]
            hit = position + rays * t[..., None]
            inside = (abs(hit[..., 0] - x) < half) & (abs(hit[..., 1] - y) < half) & (t > 0)
            depth = np.where(inside & (t < depth), t, depth)
        depth += rng.normal(0, noise, SHAPE)
        depth += np.where(rng.random(SHAPE) < 0.05, rng.normal(0, 0.2, SHAPE), 0)
        depth[rng.random(SHAPE) < 0.15] = 0
        result.append((depth.astype(np.float32), np.array([FOCAL, FOCAL, 26.0, 20.0]), cam_from_world))
    return result


def see(view, points):
    depth, (fx, fy, cx, cy), m = view
    p = points @ m[:, :3].T + m[:, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        column, row = np.floor(p[:, 0] / p[:, 2] * fx + cx), np.floor(p[:, 1] / p[:, 2] * fy + cy)
    inside = (p[:, 2] > 0) & (column >= 0) & (column < depth.shape[1]) & (row >= 0) & (row < depth.shape[0])
    return inside, np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int), p[:, 2]


def points(view):
    depth, (fx, fy, cx, cy), m = view
    rows, columns = np.nonzero(depth > 0)
    d = depth[rows, columns].astype(float)
    p = np.stack([(columns + 0.5 - cx) / fx * d, (rows + 0.5 - cy) / fy * d, d], axis=1)
    return rows, columns, (p - m[:, 3]) @ m[:, :3]


def fuse_plainly(view, others, footprints, noise, min_own, min_others):
    depth = view[0].astype(float)
    layers = []
    for other in others:
        inside, row, column, z = see(view, points(other)[2])
        layer = np.full(SHAPE, np.inf)
        np.minimum.at(layer, (row[inside], column[inside]), z[inside])
        layers.append(np.where(np.isfinite(layer), layer, 0))
    fused, kinds = np.zeros(SHAPE), np.zeros(SHAPE, int)
    own_rows, own_columns, own_points = points(view)
    where = {(r, c): p for r, c, p in zip(own_rows, own_columns, own_points, strict=True)}

    def cluster(values, d):
        near = values[abs(values - d) < noise + footprints * d / FOCAL]
        return len(near), near.mean() if len(near) else 0.0

    def settle(values, size, mean):
        again, better = cluster(values, mean)
        return better if again >= size else mean

    for r, c in np.ndindex(SHAPE):
        own = depth[r, c]
        values = np.array([d for d in (own, *(layer[r, c] for layer in layers)) if d > 0])
        if not len(values):
            continue
        if own > 0:
            size, mean = cluster(values, own)
            if size >= min_own:
                fused[r, c], kinds[r, c] = settle(values, size, mean), 2
                continue
            possible, confirmed = False, 1
            for other in others:
                (inside,), (row,), (column,), (z,) = see(other, where[r, c][None])
                theirs = other[0][row, column]
                near = noise + footprints * z / FOCAL
                if inside and theirs > 0 and theirs - z >= -near:
                    possible = True
                    confirmed += theirs - z < near
            if not possible or confirmed >= min_own:
                fused[r, c], kinds[r, c] = own, 2 if possible else 1
                continue
            kinds[r, c] = 5
        for d in np.sort(values):
            size, mean = cluster(values, d)
            if size >= min_others:
                fused[r, c], kinds[r, c] = settle(values, size, mean), 3 if own > 0 else 4
                break
    return fused, kinds


def fuse(view, others, threads=0):
    settings = _native.FuseSettings(footprints=1.0, noise_m=0.008, min_own=2, min_others=3)
    given = [_native.DepthView(*other) for other in others]
    fused = _native.fuse_depth(_native.DepthView(*view), given, settings=settings, threads=threads)
    return fused.depth_m, fused.kinds


def test_fused_depth_is_that_of_the_plain_form():
    seen = views()
    for k in (0, 2):
        others = seen[:k] + seen[k + 1 :]
        fused, kinds = fuse(seen[k], others)

        expected, expected_kinds = fuse_plainly(seen[k], others, 1.0, 0.008, 2, 3)
        same = (kinds == expected_kinds) & (abs(fused - expected) < 1e-5)
        assert same.mean() > 0.998  # a point may fall on a pixel's edge, or a depth on that of a tolerance
        assert {1, 2, 3, 4, 5} <= set(np.unique(kinds))


def test_any_number_of_threads_gives_the_same():
    seen = views(4, seed=1)
    one, three = (fuse(seen[1], [seen[0], seen[2], seen[3]], n) for n in (1, 3))
    assert np.array_equal(one[0], three[0])
    assert np.array_equal(one[1], three[1])


def test_without_others_all_stays():
    view = views(1)[0]
    fused, kinds = fuse(view, [])
    assert np.array_equal(fused, view[0])
    assert np.array_equal(kinds, view[0] > 0)
