"""The native planes, pieces and edges of depth maps against the same written plainly in numpy."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from usdfoliage import _native

FOCAL = np.array([200.0, 210.0])
MEAN_FOCAL = float(np.sqrt(FOCAL.prod()))


def camera(depth):
    height, width = depth.shape
    intrinsics = np.array([*FOCAL, width / 2 + 1.5, height / 2 - 0.5])
    return _native.DepthView(np.ascontiguousarray(depth, np.float32), intrinsics, np.eye(3, 4))


def fit_planes(depth, noise_m, pixels=None, threads=0):
    found = _native.fit_local_planes(camera(depth), pixels, radius_px=3, steepest=4.0, noise_m=noise_m, threads=threads)
    return found.slopes, found.support


def measure_gaps(depth, planes, threads=0):
    gaps = _native.measure_gaps(camera(depth), planes, threads=threads)
    return gaps.right, gaps.down


def join_pixels(depth, right, down, valid, noise_m, min_px):
    joined = _native.join_pixels(
        camera(depth), right=right, down=down, valid=valid, max_gap=1.5, noise_m=noise_m, min_px=min_px
    )
    return joined.labels, joined.count


def classify_edges(depth, labels, noise_m, pixels=None, threads=0):
    return _native.classify_edges(camera(depth), labels, pixels, footprints=3.0, noise_m=noise_m, threads=threads)


def place_edges(depth, labels, planes, pixels, kinds, beside_px):
    ends = _native.place_edges(
        camera(depth), labels, planes, pixels=pixels, kinds=kinds, beside_px=beside_px, threads=0
    )
    return ends.places_px, ends.depth_m


def foliage(seed=0, shape=(30, 44)):
    """Overlapping tilted rectangles before a wall, with noise and holes."""
    rng = np.random.default_rng(seed)
    height, width = shape
    rows, columns = np.indices(shape)
    depth = np.full(shape, 1.4)
    for _ in range(8):
        y, x, h, w = rng.integers(0, height), rng.integers(0, width), rng.integers(4, 14), rng.integers(4, 14)
        surface = rng.uniform(0.9, 1.3) + (rows - y) * rng.normal(0, 0.004) + (columns - x) * rng.normal(0, 0.004)
        there = (abs(rows - y) <= h) & (abs(columns - x) <= w) & (surface < depth)
        depth = np.where(there, surface, depth)
    depth += rng.normal(0, 0.0005, shape)
    depth[rng.random(shape) < 0.1] = 0
    return depth.astype(np.float32)


def plane_at(depth, row, column, radius, steepest, noise):
    """Slopes, value and support of one pixel, by weighted least squares in double precision."""
    height, width = depth.shape
    own = float(depth[row, column])
    footprint = own / MEAN_FOCAL
    plane, support = np.array([0.0, 0.0, 1 / own]), 0.0
    for first in (True, False):
        design, target, weights = [], [], []
        for down in range(-radius, radius + 1):
            for right in range(-radius, radius + 1):
                r, c = row + down, column + right
                if right**2 + down**2 > radius**2 + 1 or not (0 <= r < height and 0 <= c < width) or depth[r, c] <= 0:
                    continue
                other = float(depth[r, c])
                if first:
                    away = abs(other - own)
                    tolerance = (0.75 * steepest * np.hypot(right, down) + 1) * footprint + 3 * noise
                else:
                    away = abs(other * (plane @ [right, down, 1]) - 1) * other
                    tolerance = 0.5 * steepest * footprint + 3 * noise
                if away < tolerance:
                    design.append([right, down, 1])
                    target.append(1 / other)
                    weights.append(1 / (1 + 4 * (away / tolerance) ** 2))
        design, target, weights = np.array(design, float), np.array(target), np.array(weights)
        support = weights.sum()
        plane = np.array([0.0, 0.0, 1 / own])
        if support >= 4:
            centred = design[:, :2] - weights @ design[:, :2] / support
            normal = (centred * weights[:, None]).T @ centred + 1e-3 * np.eye(2)
            if np.linalg.det(normal) > 1e-6 * support**2:
                mean = weights @ target / support
                plane[:2] = np.linalg.solve(normal, (centred * weights[:, None]).T @ (target - mean))
                plane[2] = mean - plane[:2] @ (weights @ design[:, :2]) / support
    return plane, support


@pytest.mark.parametrize("seed", range(2))
def test_planes_are_those_of_a_weighted_fit(seed):
    depth = foliage(seed)
    planes, support = fit_planes(depth, 0.0005)
    planes, support = planes.reshape(*depth.shape, 3), support.reshape(depth.shape)

    for row, column in zip(*np.nonzero(depth > 0), strict=True):
        plane, weight = plane_at(depth, row, column, 3, 4.0, 0.0005)
        assert support[row, column] == pytest.approx(weight, rel=2e-3, abs=1e-3)
        assert planes[row, column] == pytest.approx(plane, rel=2e-3, abs=3e-5)
    assert not planes[depth == 0].any()
    assert not support[depth == 0].any()


def test_planes_of_some_pixels_are_those_of_all():
    depth = foliage(3)
    whole, support = fit_planes(depth, 0.0, threads=1)
    pixels = np.random.default_rng(0).permutation(depth.size)[:500]

    some, its_support = fit_planes(depth, 0.0, pixels, 2)

    assert np.array_equal(some, whole[pixels])
    assert np.array_equal(its_support, support[pixels])


def test_any_number_of_threads_gives_the_same():
    depth = foliage(4, (90, 120))
    one, three = (fit_planes(depth, 0.001, threads=threads) for threads in (1, 3))
    assert np.array_equal(one[0], three[0])
    assert np.array_equal(one[1], three[1])
    gaps = [measure_gaps(depth, one[0], threads) for threads in (1, 3)]
    assert np.array_equal(gaps[0], gaps[1])
    labels, _ = join_pixels(depth, *gaps[0], np.ones(depth.shape, np.uint8), 0.0, 5)
    kinds = [classify_edges(depth, labels, 0.0, threads=threads) for threads in (1, 3)]
    assert np.array_equal(kinds[0], kinds[1])


def test_gaps_are_measured_at_either_pixel():
    depth = foliage(5)
    planes, _ = fit_planes(depth, 0.0005)
    right, down = measure_gaps(depth, planes)

    p, d = planes.reshape(*depth.shape, 3).astype(float), depth.astype(float)
    for gap, slope, here, there in (
        (right[:, :-1], 0, np.s_[:, :-1], np.s_[:, 1:]),
        (down[:-1], 1, np.s_[:-1], np.s_[1:]),
    ):
        apart = np.maximum(
            abs(p[here][..., 2] + p[here][..., slope] - p[there][..., 2]),
            abs(p[there][..., 2] - p[there][..., slope] - p[here][..., 2]),
        )
        both = (d[here] > 0) & (d[there] > 0)
        expected = (apart * np.sqrt(d[here] * d[there]) * MEAN_FOCAL)[both]
        assert gap[both] == pytest.approx(expected, rel=1e-3, abs=1e-3)
        assert (gap[~both] > 1e29).all()
    assert (right[:, -1] > 1e29).all()
    assert (down[-1] > 1e29).all()


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_pieces_are_the_connected_components(noise):
    depth = foliage(6, (60, 70))
    planes, _ = fit_planes(depth, 0.0005)
    right, down = measure_gaps(depth, planes)
    valid = np.random.default_rng(1).random(depth.shape) < 0.95

    labels, count = join_pixels(depth, right, down, valid.astype(np.uint8), noise, 10)

    known, index = valid & (depth > 0), np.arange(depth.size).reshape(depth.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = 1.5 + noise * MEAN_FOCAL / depth
    across = (right < limit)[:, :-1] & known[:, :-1] & known[:, 1:]
    below = (down < limit)[:-1] & known[:-1] & known[1:]
    a = np.concatenate([index[:, :-1][across], index[:-1][below]])
    b = np.concatenate([index[:, 1:][across], index[1:][below]])
    _, component = connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(depth.size,) * 2), directed=False)
    component = np.where(known.ravel(), component, -1)
    expected = np.zeros(depth.size, np.int32)
    numbers, first, size = np.unique(component, return_index=True, return_counts=True)
    large = [number for _, number, s in sorted(zip(first, numbers, size, strict=True)) if number >= 0 and s >= 10]
    for k, number in enumerate(large):
        expected[component == number] = k + 1
    assert count == len(large)
    assert np.array_equal(labels, expected.reshape(depth.shape))


def test_edges_are_labelled_by_what_lies_beside_them():
    depth = foliage(7, (60, 70))
    rng = np.random.default_rng(2)
    labels = (np.kron(rng.integers(0, 4, (12, 14)), np.ones((5, 5))) * (depth > 0)).astype(np.int32)

    kinds = classify_edges(depth, labels, 0.002).reshape(depth.shape)
    some = rng.choice(depth.size, 50)
    assert np.array_equal(classify_edges(depth, labels, 0.002, some), kinds.ravel()[some])

    wide_labels, wide_depth = np.pad(labels, 1, constant_values=-1), np.pad(depth, 1)
    free, hidden, unknown = (np.zeros(depth.shape, bool) for _ in range(3))
    tolerance = 3.0 * depth / MEAN_FOCAL + 0.002
    for down, right in ((0, 1), (2, 1), (1, 0), (1, 2)):
        there = np.s_[down : down + depth.shape[0], right : right + depth.shape[1]]
        border = wide_labels[there] == -1
        other = (labels > 0) & (wide_labels[there] != labels)
        d = wide_depth[there]
        hidden |= other & (border | ((d > 0) & (d < depth - tolerance)))
        free |= other & ~border & (d > depth + tolerance)
        unknown |= other & ~border & (d == 0)
    expected = np.where(hidden, 2, np.where(free, 1, np.where(unknown, 3, 0)))
    assert np.array_equal(kinds, expected)
    assert set(np.unique(kinds)) == {0, 1, 2, 3}


def test_sums_and_extents_are_those_of_the_points():
    depth = foliage(8)
    seen = camera(depth)
    labels = (np.random.default_rng(3).integers(0, 4, depth.shape) * (depth > 0)).astype(np.int32)
    axes = np.linalg.qr(np.random.default_rng(4).normal(size=(4, 3, 3)))[0]

    sums = _native.sum_points(seen, labels, count=4)  # the fourth has no pixel
    extents = _native.measure_extents(seen, labels, axes=axes, min_cosine=0.1)

    rows, columns = np.indices(depth.shape) + 0.5
    rays = np.stack(
        [(columns - seen.intrinsics[2]) / FOCAL[0], (rows - seen.intrinsics[3]) / FOCAL[1], np.ones(depth.shape)],
        axis=-1,
    )
    for k in range(3):
        points = (rays * depth[..., None])[labels == k + 1]
        local = points - points[0]
        squares = (local.T @ local)[np.triu_indices(3)]
        assert sums.first_m[k] == pytest.approx(points[0])
        assert sums.pixels[k] == len(points)
        assert sums.sums[k] == pytest.approx(local.sum(axis=0))
        assert sums.products[k] == pytest.approx(squares)
        assert [extents.length_m[k], extents.width_m[k]] == pytest.approx(np.ptp(points @ axes[k, :2].T, axis=0))
        slant = np.maximum(abs(rays[labels == k + 1] @ axes[k, 2]), 0.1)
        assert extents.area_m2[k] == pytest.approx(
            np.sum(depth[labels == k + 1].astype(float) ** 2 / slant) / FOCAL.prod()
        )
    for empty in (sums.pixels, sums.sums, sums.products, extents.length_m, extents.width_m, extents.area_m2):
        assert not empty[3].any()


@pytest.mark.parametrize("missing", [0, 2])
@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_edges_are_placed_between_what_ends_and_what_is_behind(missing, tilt):
    radius, shape = 17.3, (60, 70)
    row, column = np.indices(shape) + 0.5
    away = np.hypot(column - 33.2, row - 29.6)
    inverse = 1 + tilt * (column - 33.2) / MEAN_FOCAL
    depth = np.where(away < radius, 1 / inverse, 3.0).astype(np.float32)
    depth[(away >= radius - missing) & (away < radius + missing)] = 0
    labels = ((away < radius) & (depth > 0)).astype(np.int32)
    planes, _ = fit_planes(depth, 0.0)
    kinds = classify_edges(depth, labels, 0.0)
    kinds[kinds == 3] = 1  # what misses depth beside it ends too, here
    pixels = np.flatnonzero(labels)

    places, depths = place_edges(depth, labels, planes[pixels], pixels, kinds[pixels], 2 * missing + 2)

    edge = kinds[pixels] == 1
    found = np.hypot(places[:, 0] - 33.2, places[:, 1] - 29.6)
    assert edge.sum() > 80
    assert abs(np.mean(found[edge]) - radius) < 0.2
    centers = np.column_stack([column.ravel(), row.ravel()])[pixels]
    assert np.array_equal(places[~edge], centers[~edge])
    assert depths == pytest.approx(1 / (1 + tilt * (places[:, 0] - 33.2) / MEAN_FOCAL), rel=2e-3)


def test_a_pixel_by_itself_stays_where_it_is():
    depth = np.full((5, 6), 3.0, np.float32)
    depth[2, 3] = 1.0
    labels = (depth < 2).astype(np.int32)
    places, depths = place_edges(depth, labels, np.zeros((1, 3), np.float32), np.array([15]), np.ones(1, np.uint8), 4)
    assert places.tolist() == [[3.5, 2.5]]
    assert depths.tolist() == [1.0]
