"""The native fit: what it minimises, written plainly in numpy, and that it does."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from usdfoliage import _native
from usdfoliage.leaf.fit.prior import generic_prior
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.surface import evaluate_grid

from tests.support.leaves.reference import evaluate_jacobian, evaluate_points

PRIOR = generic_prior(1.0, 0.4)
LEAF = PRIOR.mean[:21].reshape(1, 7, 3)
NOISE, CUTOFF = 0.02, 2.5


def points_beside(leaf, count=60, seed=0):
    rng = np.random.default_rng(seed)
    uv = rng.uniform((-0.9, 0.1), (0.9, 0.9), (count, 2))
    points = evaluate_points(leaf, uv)[0] + rng.normal(size=(count, 3)) * 0.01
    ends = evaluate_points(leaf, np.stack([np.tile([-1.0, 1.0], 10), np.linspace(0.1, 0.9, 20)], axis=-1))[0]
    return np.concatenate([points, ends]), np.repeat([0, 1], [count, 20]).astype(np.uint8)


def fit_surfaces(cloud, leaf, version, state, costs, iterations, first, fold_weight, threads):
    means, precisions = PRIOR.versions()
    parameters, axes, base_m, length_m = state
    _native.fit_leaf_surfaces(
        _native.SurfacePoints(**cloud),
        _native.SurfacePriors(means=means, precisions=np.ascontiguousarray(precisions)),
        _native.SurfaceFits(
            leaf=leaf,
            version=version,
            parameters=parameters,
            axes=axes,
            base_m=base_m,
            length_m=length_m,
            costs=costs,
        ),
        settings=_native.SurfaceFitSettings(
            iterations=iterations, first_cutoff=first, cutoff=CUTOFF, edge_noise=1.0, fold_weight=fold_weight
        ),
        threads=threads,
    )


def fit(points, edge, leaf, iterations=1, fold_weight=0.0, first=CUTOFF, length=1.0, weights=None):
    state = [leaf.copy(), np.eye(3)[None].copy(), np.zeros((1, 3)), np.array([length])]
    costs = np.empty((1, 3))
    zero, ends = np.zeros(1, np.int64), np.array([0, len(points)], np.int64)
    weights = np.ones(len(points)) if weights is None else weights
    cloud = {"points_m": points, "edge": edge, "weights": weights, "offsets": ends, "noise_m": np.array([NOISE])}
    fit_surfaces(cloud, zero, zero, state, costs, iterations, first, fold_weight, 1)
    return state, costs[0]


def project(points, edge, leaf):
    leaves = _native.PosedLeaves(
        parameters=leaf, axes=np.eye(3)[None].copy(), base_m=np.zeros((1, 3)), length_m=np.ones(1)
    )
    ends = np.array([0, len(points)], np.int64)
    closest = _native.project_to_leaves(points, leaves, edge=edge, offsets=ends, threads=1)
    return closest.uv, closest.distance_m


def test_places_are_the_closest():
    points, edge = points_beside(LEAF)

    uv, distance = project(points, edge, LEAF)

    dense = np.stack(np.meshgrid(np.linspace(-1, 1, 201), np.linspace(0, 1, 201)), axis=-1).reshape(-1, 2)
    for kind, places in ((0, dense), (1, dense[np.abs(dense[:, 0]) == 1])):
        surface = evaluate_points(LEAF, places)[0]
        mine = points[edge == kind]
        nearest = np.linalg.norm(mine[:, None] - surface, axis=-1).min(axis=1)
        assert distance[edge == kind] == pytest.approx(nearest, abs=4e-3)
        assert (distance[edge == kind] <= nearest + 1e-4).all()
    assert np.linalg.norm(points - evaluate_points(LEAF, uv)[0], axis=-1) == pytest.approx(distance)


def test_costs_are_those_of_the_objective():
    points, edge = points_beside(LEAF)
    (leaf, axes, base, length), costs = fit(points, edge, LEAF, iterations=12)

    local = (points - base) @ axes[0] / length
    uv, _ = project(np.ascontiguousarray(local), edge, leaf)
    grids = [evaluate_grid(leaf, [u], [v]) for u, v in uv]
    square = np.empty(len(points))
    for i, grid in enumerate(grids):
        offset = local[i] - grid.points[0, 0, 0]
        along = grid.tangents_v[0, 0, 0] / np.linalg.norm(grid.tangents_v[0, 0, 0])
        side = edge[i] or abs(uv[i, 0]) == 1
        square[i] = (offset @ offset - (offset @ along) ** 2) if side else (offset @ grid.normals[0, 0, 0]) ** 2
    square *= (length / NOISE) ** 2
    offset = np.append(leaf.ravel(), np.log(length)) - PRIOR.mean

    assert costs[0] == pytest.approx((CUTOFF**2 * square / (CUTOFF**2 + square)).sum() / 2, rel=0.02)
    assert costs[1] == pytest.approx(offset @ np.linalg.inv(PRIOR.covariance) @ offset / 2)
    assert costs[2] == 0


def test_without_points_it_finds_the_prior():
    none = np.zeros((0, 3))
    (leaf, _, _, length), costs = fit(none, np.zeros(0, np.uint8), LEAF + 0.02, iterations=40, length=1.4)

    assert leaf == pytest.approx(LEAF, abs=1e-3)
    assert length == pytest.approx(1, abs=1e-2)
    assert costs.sum() < 1e-2


def test_it_goes_as_low_as_a_library():
    """With the places fixed, on the parameters alone, where the objective is smooth."""
    target = LEAF.copy()
    target[0, 0, 2] = target[0, 1, 2] = 0.05
    points, edge = points_beside(target, count=120)
    points, edge = points[:120], edge[:120]
    (leaf, axes, base, length), costs = fit(points, edge, LEAF, iterations=40)
    local = np.ascontiguousarray((points - base) @ axes[0] / length)
    uv, _ = project(local, edge, leaf)
    normals = np.array([evaluate_grid(leaf, [u], [v]).normals[0, 0, 0] for u, v in uv])
    precision = np.linalg.inv(PRIOR.covariance)

    def cost(numbers):
        offset = local - evaluate_points(numbers.reshape(1, 7, 3), uv)[0]
        square = np.square(np.einsum("kc,kc->k", offset, normals) * length / NOISE)
        away = np.append(numbers, np.log(length)) - PRIOR.mean
        return (CUTOFF**2 * square / (CUTOFF**2 + square)).sum() / 2 + away @ precision @ away / 2

    better = minimize(cost, leaf.ravel(), method="BFGS").fun
    assert costs.sum() <= 1.1 * better + 0.5
    assert evaluate_jacobian(leaf, uv)[1].shape == (1, 120, 3, 21)


def test_a_step_is_that_of_the_normal_equations():
    """Points straight above places where the search looks, beside the silhouette and beyond the base."""
    us, vs = np.linspace(-1, 1, 9), np.linspace(0, 1, 15)
    heights = np.random.default_rng(6).normal(size=(15, 9)) * 0.005
    points, rows, wanted = [], [], []
    for k, i in [(k, i) for k in range(2, 13) for i in range(9) if i != 4]:
        uv = np.array([[us[i], vs[k]]])
        grid = evaluate_grid(LEAF, [us[i]], [vs[k]])
        normal, along = grid.normals[0, 0, 0], grid.tangents_v[0, 0, 0]
        outward = np.cross(along / np.linalg.norm(along), normal)
        on_side = abs(us[i]) == 1
        offset = heights[k, i] * normal + (0.01 * us[i] * outward if on_side else 0)
        place, jacobian = (each[0, 0] for each in evaluate_jacobian(LEAF, uv))
        points.append(place + offset)
        square = offset @ offset
        drop = CUTOFF**2 / (CUTOFF**2 + square / NOISE**2) / NOISE
        for direction in (normal, outward) if on_side else (normal,):
            row = direction @ jacobian, np.cross(place, direction), direction, [direction @ place]
            rows.append(np.concatenate(row) * drop)
            wanted.append(direction @ offset * drop)
    points.append([0.0, -0.02, 0.0])
    drop = CUTOFF**2 / (CUTOFF**2 + (0.02 / NOISE) ** 2) / NOISE
    rows.extend(np.eye(28)[24:27] * drop)
    wanted.extend(np.array(points[-1]) * drop)

    (leaf, axes, base, length), _ = fit(np.array(points), np.zeros(len(points), np.uint8), LEAF)

    rows = np.array(rows)
    matrix = rows.T @ rows
    known = np.r_[:21, 27]
    matrix[np.ix_(known, known)] += np.linalg.inv(PRIOR.covariance)
    matrix[np.diag_indices(28)] += 1e-2 * matrix.diagonal() + 1e-6
    step = np.linalg.solve(matrix, rows.T @ np.array(wanted))
    assert np.abs(step).max() < 0.3  # it is not cut short
    assert leaf.ravel() - LEAF.ravel() == pytest.approx(step[:21], abs=1e-9)
    assert Rotation.from_matrix(axes[0]).as_rotvec() == pytest.approx(step[21:24], abs=1e-9)
    assert base[0] == pytest.approx(step[24:27], abs=1e-9)
    assert np.log(length[0]) == pytest.approx(step[27], abs=1e-9)
    assert np.abs(step).max() > 1e-3


def test_points_without_weight_and_their_order_do_not_matter():
    points, edge = points_beside(LEAF, count=61)
    rng = np.random.default_rng(7)
    order = rng.permutation(len(points) + 9)
    weights = np.repeat([1.0, 0.0], [len(points), 9])[order]
    more = np.concatenate([points, rng.normal(size=(9, 3))])[order]
    more_edge = np.concatenate([edge, np.tile([0, 1, 0], 3)]).astype(np.uint8)[order]

    few, few_costs = fit(points, edge, LEAF, iterations=8)
    many, many_costs = fit(more, more_edge, LEAF, iterations=8, weights=weights)

    assert many_costs == pytest.approx(few_costs, rel=1e-9)
    for a, b in zip(few, many, strict=True):
        assert b == pytest.approx(a, abs=1e-9)


def test_leaves_are_fitted_each_for_itself():
    clouds = [points_beside(LEAF, count=count, seed=count) for count in (40, 57, 0, 133)]
    sizes = [len(points) for points, _ in clouds]
    leaf, version = np.array([3, 0, 2, 1, 3]), np.array([0, 0, 0, 0, 1])
    state = [np.tile(LEAF, (5, 1, 1)), np.tile(np.eye(3), (5, 1, 1)), np.zeros((5, 3)), np.ones(5)]
    costs = np.empty((5, 3))
    cloud = {
        "points_m": np.concatenate([points for points, _ in clouds]),
        "edge": np.concatenate([edge for _, edge in clouds]),
        "weights": np.ones(sum(sizes)),
        "offsets": np.cumsum([0, *sizes]),
        "noise_m": np.full(4, NOISE),
    }
    fit_surfaces(cloud, leaf, version, state, costs, 6, CUTOFF, 0.0, 3)

    for i in range(4):
        alone, alone_costs = fit(*clouds[leaf[i]], LEAF, iterations=6)
        assert all(np.array_equal(mine[0], all_of[i]) for mine, all_of in zip(alone, state, strict=True))
        assert np.array_equal(alone_costs, costs[i])


def test_folds_cost_and_are_opened():
    folded = LEAF.copy()
    folded[0, :2, 0] = 0.5, -0.5  # an axis too crooked for the width
    none, edge = np.zeros((0, 3)), np.zeros(0, np.uint8)

    assert find_folds(folded)[0]
    assert fit(none, edge, folded, iterations=0, fold_weight=100.0)[1][2] > 0
    assert fit(none, edge, folded, iterations=30, fold_weight=100.0)[1][2] < 1e-3
    assert fit(none, edge, LEAF, iterations=0, fold_weight=100.0)[1][2] == 0


def test_more_iterations_never_cost_more():
    points, edge = points_beside(LEAF, seed=4)
    start = LEAF + np.random.default_rng(5).normal(size=LEAF.shape) * 0.03

    costs = [fit(points, edge, start, iterations=n)[1].sum() for n in (0, 3, 10, 30)]

    assert costs[-1] < 0.3 * costs[0]
    assert all(after <= before * 1.02 for before, after in pairwise(costs))
