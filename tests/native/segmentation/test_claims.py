"""Native claims of pixels and states of points against the same written plainly in numpy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage import _native

SHAPE = (36, 44)
INTRINSICS = np.array([50.0, 52.0, 22.5, 17.0])
FOCAL = float(np.sqrt(50.0 * 52.0))


def view(seed=0):
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec([0.1, -0.05, 0.2]).as_matrix()
    cam_from_world = np.column_stack([rotation, [0.02, -0.01, 0.1]])
    depth = rng.uniform(0.9, 1.3, SHAPE)
    depth[rng.random(SHAPE) < 0.1] = 0
    return depth.astype(np.float32), INTRINSICS, cam_from_world


def grids(count=6, rows=4, columns=5, seed=0):
    rng = np.random.default_rng(seed)
    v, u = np.meshgrid(np.linspace(-0.2, 0.2, rows), np.linspace(-0.15, 0.15, columns), indexing="ij")
    flat = np.stack([u, v, 0.05 * np.sin(8 * u)], axis=-1)
    turns = Rotation.random(count, random_state=1).as_matrix()
    at = np.column_stack([rng.uniform(-0.2, 0.2, (count, 2)), rng.uniform(0.85, 1.15, count)])
    return np.ascontiguousarray(np.einsum("nij,vuj->nvui", turns, flat) + at[:, None, None])


def claim_plainly(leaves, penalty, seen, footprints, noise, min_cosine):
    depth, (fx, fy, cx, cy), m = seen
    labels, best = np.zeros(SHAPE, int), np.full(SHAPE, np.inf)
    rows, columns = np.indices(SHAPE) + 0.5
    allowed = noise + footprints * depth.astype(float) / FOCAL
    for number, grid in enumerate(leaves):
        cam = grid @ m[:, :3].T + m[:, 3]
        place = cam[..., :2] / cam[..., 2:] * (fx, fy) + (cx, cy)
        for r, c in np.ndindex(grid.shape[0] - 1, grid.shape[1] - 1):
            for corners in (((r, c), (r, c + 1), (r + 1, c + 1)), ((r, c), (r + 1, c + 1), (r + 1, c))):
                a, b, d = (place[k] for k in corners)
                area = (b[0] - a[0]) * (d[1] - a[1]) - (d[0] - a[0]) * (b[1] - a[1])
                if abs(area) <= 1e-9:
                    continue
                wa = ((b[0] - columns) * (d[1] - rows) - (d[0] - columns) * (b[1] - rows)) / area
                wb = ((d[0] - columns) * (a[1] - rows) - (a[0] - columns) * (d[1] - rows)) / area
                weights = np.stack([wa, wb, 1 - wa - wb])
                z = 1 / sum(w / cam[k][2] for w, k in zip(weights, corners, strict=True))
                p, q, s = (cam[k] for k in corners)
                normal = np.cross(q - p, s - p)
                cosine = max(min_cosine, abs(normal[2]) / np.linalg.norm(normal))
                away = abs(z - depth) * cosine
                cost = away + allowed * sum(w * penalty[k] for w, k in zip(weights, corners, strict=True))
                take = (weights >= -1e-9).all(axis=0) & (depth > 0) & (away <= allowed) & (cost < best)
                labels[take], best[take] = number + 1, cost[take]
    return labels


def claim(leaves, penalty, seen, noise_m=0.05, threads=0):
    return _native.claim_pixels(
        _native.DepthView(*seen),
        leaves,
        penalty=penalty,
        footprints=4.0,
        noise_m=noise_m,
        min_cosine=0.15,
        threads=threads,
    )


def classify(points, seen, threads=0):
    view = _native.DepthView(*seen)
    return _native.classify_points(points, view, footprints=2.0, noise_m=0.02, threads=threads)


def test_claims_are_those_of_the_plain_form():
    leaves, seen = grids(), view()
    penalty = np.zeros((4, 5), np.float32)
    penalty[[0, -1]] = 0.6
    labels = claim(leaves, penalty, seen)

    expected = claim_plainly(leaves, penalty, seen, 4.0, 0.05, 0.15)
    assert (labels != expected).sum() <= 1  # two leaves may be as near to within the last digit
    assert len(np.unique(labels)) > 4


def test_claims_do_not_depend_on_threads():
    leaves, seen, penalty = grids(20, seed=2), view(1), np.zeros((4, 5), np.float32)
    one, three = (claim(leaves, penalty, seen, threads=n) for n in (1, 3))
    assert np.array_equal(one, three)


def test_leaves_behind_the_camera_claim_nothing():
    leaves, seen, penalty = grids(), view(), np.zeros((4, 5), np.float32)
    leaves[..., 2] -= 3
    assert not claim(leaves, penalty, seen, 9.0).any()


def test_states_of_points_follow_the_depth():
    seen = view(2)
    depth, (fx, fy, cx, cy), m = seen
    points = np.random.default_rng(3).uniform((-0.6, -0.6, -0.5), (0.6, 0.6, 1.4), (3000, 3))

    states = classify(points, seen)

    cam = points @ m[:, :3].T + m[:, 3]
    x, y = np.floor(cam[:, 0] / cam[:, 2] * fx + cx), np.floor(cam[:, 1] / cam[:, 2] * fy + cy)
    inside = (cam[:, 2] > 0) & (x >= 0) & (x < SHAPE[1]) & (y >= 0) & (y < SHAPE[0])
    there = np.where(inside, depth[np.where(inside, y, 0).astype(int), np.where(inside, x, 0).astype(int)], 0)
    tolerance = 0.02 + 2.0 * cam[:, 2] / FOCAL
    expected = np.where(there > cam[:, 2] + tolerance, 2, np.where(there < cam[:, 2] - tolerance, 3, 1))
    expected[~inside | (there <= 0)] = 0
    assert np.array_equal(states, expected)
    assert set(np.unique(states)) == {0, 1, 2, 3}
    assert np.array_equal(states, classify(points, seen, 3))


@pytest.mark.parametrize("max_per_leaf", [1, 7, 1000])
def test_pixels_are_picked_evenly_over_all_views(max_per_leaf):
    rng = np.random.default_rng(4)
    labels = [rng.integers(0, 4, (20, 30)).astype(np.int32) for _ in range(3)]
    depths = [(rng.random((20, 30)) < 0.9).astype(np.float32) for _ in range(3)]
    views = [_native.DepthView(depth, np.array([20.0, 20, 15, 10]), np.eye(3, 4)) for depth in depths]
    total = sum(_native.count_labels(view, one, count=3) for view, one in zip(views, labels, strict=True))
    labels = [one * (depth > 0) for one, depth in zip(labels, depths, strict=True)]
    assert np.array_equal(total, np.bincount(np.concatenate([one.ravel() for one in labels]), minlength=4)[1:])
    kept = np.minimum(total, max_per_leaf)
    offsets, seen = np.concatenate([[0], np.cumsum(kept)]), np.zeros(3, np.int64)

    picked = [
        _native.pick_pixels(view, one, total=total, kept=kept, offsets=offsets, seen=seen)
        for view, one in zip(views, labels, strict=True)
    ]

    assert np.array_equal(seen, total)
    places = np.concatenate([each.places for each in picked])
    assert np.array_equal(np.sort(places), np.arange(kept.sum()))
    for each, one in zip(picked, labels, strict=True):
        pixels, leaf = each.pixels, np.searchsorted(offsets, each.places, side="right")
        assert np.array_equal(one.ravel()[pixels], leaf)
        assert (np.diff(pixels) > 0).all()
        shares = np.bincount(leaf, minlength=4)[1:]
        own = np.bincount(one.ravel(), minlength=4)[1:]
        assert (abs(shares - own * kept / total) <= 1).all()
