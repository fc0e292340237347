"""Subdivision cages of leaves: their limit, as OpenSubdiv has it, is the leaf."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from usdfoliage._native import refine_catmull_clark
from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.cage import LeafCageSettings, build_leaf_cage, midrib_angles
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.leaf.shape.variation import VariationSettings, default_leaf, vary_leaves

SMOOTH = np.array(
    [[0, 1 / 3, 0], [0, 2 / 3, 0], [0.2, 0.2, 0.1], [0.5, 0.3, 0.1], [0.8, 0.2, 0.1], [0, 0, 0], [0.03, 0.03, 0.03]]
)
PLACES = grid_places(np.linspace(-1, 1, 33), (1 - np.cos(np.pi * np.linspace(0, 1, 81))) / 2)


def placed(parameters, rng=None):
    n = len(parameters)
    turn = np.tile([0.0, 0, 0, 1], (n, 1)) if rng is None else rng.normal(size=(n, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    return Leaves(
        parameters=np.asarray(parameters, np.float64),
        base_m=np.zeros((n, 3)) if rng is None else rng.uniform(-1, 1, (n, 3)),
        orientation=turn,
        length_m=np.ones(n) if rng is None else rng.uniform(0.05, 0.1, n),
        phase=np.arange(n) * 0.7,
    )


def creases_of(cage):
    """Edges of the creases, (E, 2)."""
    chains = np.split(cage.crease_indices, np.cumsum(cage.crease_lengths)[:-1])
    return np.concatenate([np.zeros((0, 2), np.int32), *(np.column_stack([c[:-1], c[1:]]) for c in chains)])


def limit_of(cage, values=None, levels=4):
    """Points on the limit surface and its quads, through OpenSubdiv."""
    creases = creases_of(cage).astype(np.int32)
    refined = refine_catmull_clark(
        np.ascontiguousarray(cage.points_m if values is None else values, np.float64),
        cage.face_counts,
        cage.face_vertices,
        crease_edges=creases,
        crease_sharpness=np.full(len(creases), 10, np.float32),
        corner_vertices=cage.corner_indices,
        corner_sharpness=cage.corner_sharpnesses,
        levels=levels,
        limit=True,
    )
    return refined.points, refined.faces


def to_segment(points, a, b):
    along = b - a
    share = np.sum((points - a) * along, axis=-1) / np.maximum(np.sum(along**2, axis=-1), 1e-300)
    return np.linalg.norm(points - a - share.clip(0, 1)[..., None] * along, axis=-1)


def distances(points, vertices, quads):
    """From points to the triangles of a mesh nearby."""
    triangles = vertices[np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])]
    a, b, c = (triangles[cKDTree(triangles.mean(axis=1)).query(points, k=8)[1], k] for k in range(3))
    p = points[:, None]
    normal = np.cross(b - a, c - a)
    area = np.maximum(np.sum(normal**2, axis=-1), 1e-300)
    s = np.sum(np.cross(p - a, c - a) * normal, axis=-1) / area
    t = np.sum(np.cross(b - a, p - a) * normal, axis=-1) / area
    inside = (s >= 0) & (t >= 0) & (s + t <= 1)
    height = np.abs(np.sum((p - a) * normal, axis=-1)) / np.sqrt(area)
    beside = np.minimum(np.minimum(to_segment(p, a, b), to_segment(p, b, c)), to_segment(p, c, a))
    return np.where(inside, height, beside).min(axis=1)


def grid_quads(rows, columns):
    index = np.arange(rows * columns).reshape(rows, columns)
    return np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)


def two_sided(parameters, numbers=LeafCageSettings()):
    """Largest distance, both ways, between the leaf and the limit of its cage, in leaf lengths."""
    limit, quads = limit_of(build_leaf_cage(placed(parameters[None]), numbers))
    leaf = evaluate_points(parameters[None], PLACES)[0]
    return max(distances(limit, leaf, grid_quads(81, 33)).max(), distances(leaf, limit, quads).max())


@pytest.mark.parametrize(("amount", "bound"), [(0, 0.002), (1, 0.0025), (2, 0.004), (3, 0.005)])
def test_the_limit_is_the_leaf(amount, bound):
    leaves = vary_leaves(1 if amount == 0 else 4, np.random.default_rng(11), VariationSettings(amount=amount))
    assert max(two_sided(leaf) for leaf in leaves) < bound


def test_the_limit_is_the_leaf_however_it_is_bent():
    rng = np.random.default_rng(5)
    leaves = np.zeros((6, 7, 3))
    leaves[:, :2] = [[0, 1 / 3, 0], [0, 2 / 3, 0]] + rng.uniform(-1, 1, (6, 2, 3)) * (0.25, 0.12, 0.3)
    leaves[:, 2:5, 0] = rng.uniform((0.08, 0.38, 0.68), (0.32, 0.62, 0.92), (6, 3))
    leaves[:, 2:5, 1] = rng.uniform(0.08, 0.5, (6, 3))
    leaves[:, 2:5, 2] = rng.uniform(-0.25, 0.25, (6, 3))
    leaves[:, 5], leaves[:, 6] = rng.uniform(-0.1, 0.1, (6, 3)), rng.uniform(-0.2, 0.2, (6, 3))
    assert max(two_sided(leaf) for leaf in leaves) < 0.005


def test_a_smooth_leaf_has_no_crease_and_is_met_too():
    assert two_sided(SMOOTH) < 0.0025
    cage = build_leaf_cage(placed(SMOOTH[None]))
    assert len(cage.crease_indices) == len(cage.crease_lengths) == len(cage.crease_sharpnesses) == 0


def test_the_midrib_is_creased_as_the_leaf_is():
    tent = SMOOTH.copy()
    tent[2:5, 1] = 0.3
    tent[2:5, 2], tent[5], tent[6] = 0.3, 0.1, 0.2  # both halves rise at 45 degrees, as wide as high
    np.testing.assert_allclose(midrib_angles(np.stack([SMOOTH, tent])), [0, np.pi / 2], atol=1e-6)
    leaves = placed(np.stack([SMOOTH, tent, SMOOTH, tent]))
    cage = build_leaf_cage(leaves, LeafCageSettings(across=4, along=6))
    np.testing.assert_array_equal(cage.crease_lengths, [7, 7])
    np.testing.assert_array_equal(cage.crease_sharpnesses, [10, 10])
    per_leaf = len(cage.points_m) // 4
    first, second = cage.crease_indices.reshape(2, 7)
    np.testing.assert_array_equal(second - first, 2 * per_leaf)
    np.testing.assert_allclose(cage.st[first, 0], 0.5)
    assert (np.diff(cage.st[first, 1]) > 0).all()
    assert first[0] == per_leaf
    assert first[-1] == per_leaf + 1
    everywhere = build_leaf_cage(leaves, LeafCageSettings(smooth_below_deg=0))
    assert len(everywhere.crease_lengths) == 4


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), amount=st.floats(0, 3), jitter=st.sampled_from([0.0, 0.02]))
def test_base_and_apex_are_met_exactly_and_the_topology_is_sound(seed, amount, jitter):
    rng = np.random.default_rng(seed)
    leaves = placed(vary_leaves(3, rng, VariationSettings(amount=amount)), rng)
    cage = build_leaf_cage(leaves, jitter=Jitter(amplitude=jitter, frequency=3))
    limit, _ = limit_of(cage, levels=2)
    apex_m = leaves.base_m + leaves.asset_from_leaf()[:, :, 1]
    assert cKDTree(limit).query(np.concatenate([leaves.base_m, apex_m]))[0].max() < 2e-7
    np.testing.assert_array_equal(cage.corner_indices.reshape(3, 2) % (len(cage.points_m) // 3), [[0, 1]] * 3)
    assert np.isfinite(cage.points_m).all()
    assert len(np.unique(cage.face_vertices)) == len(cage.points_m)
    starts = np.cumsum(cage.face_counts) - cage.face_counts
    a, b, c = (cage.points_m[cage.face_vertices[starts + k]].astype(np.float64) for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert areas.min() > 1e-6 * areas.max()


def test_cages_move_with_their_leaves():
    rng = np.random.default_rng(3)
    parameters = vary_leaves(5, rng)
    leaves = placed(parameters, rng)
    in_leaf = build_leaf_cage(placed(parameters)).points_m.reshape(5, -1, 3)
    matrix = leaves.asset_from_leaf()
    expected = np.einsum("nij,npj->npi", matrix[:, :, :3], in_leaf) + matrix[:, None, :, 3]
    np.testing.assert_allclose(build_leaf_cage(leaves).points_m.reshape(expected.shape), expected, atol=2e-7)


def test_texture_coordinates_give_the_places_of_the_limit():
    cage = build_leaf_cage(placed(default_leaf()[None]))
    limit, _ = limit_of(cage)
    st_limit, _ = limit_of(cage, np.column_stack([cage.st, np.zeros(len(cage.st))]))
    away = (st_limit[:, 1] > 0.3) & (st_limit[:, 1] < 0.7)  # towards base and apex all s run together
    leaf = evaluate_points(default_leaf()[None], st_limit[away, :2] * (2, 1) - (1, 0))[0]
    assert (
        np.linalg.norm(limit[away] - leaf, axis=1).max() < 0.02
    )  # the fit slides along the surface where that costs nothing
    assert st_limit.min() > -1e-6
    assert st_limit.max() < 1 + 1e-6


def test_slow_jitter_is_followed_nearly():
    leaf, numbers = placed(default_leaf()[None]), LeafCageSettings(across=6, along=16)
    jitter = Jitter(amplitude=0.02, frequency=2)
    silhouette = np.column_stack([np.ones(101), np.linspace(0, 1, 101)])
    jittered = evaluate_points(leaf.parameters, silhouette, jitter, leaf.phase)[0]
    with_jitter, without = (
        cKDTree(limit_of(build_leaf_cage(leaf, numbers, used))[0]).query(jittered)[0].max()
        for used in (jitter, NO_JITTER)
    )
    assert with_jitter < 0.005
    assert with_jitter < without / 2


def test_no_leaves_are_an_empty_cage():
    cage = build_leaf_cage(placed(np.zeros((0, 7, 3))))
    assert cage.points_m.shape == (0, 3)
    assert cage.st.shape == (0, 2)
    assert not any(len(array) for array in (cage.face_counts, cage.face_vertices, cage.crease_indices))
    assert len(cage.corner_indices) == 0


def test_wrong_numbers_are_refused():
    with pytest.raises(ValueError, match="across must be even"):
        LeafCageSettings(across=5)
    with pytest.raises(ValueError, match="smooth_below_deg must be 0 or more"):
        LeafCageSettings(smooth_below_deg=-1)


def test_more_than_a_mesh_can_number_is_refused():
    many = np.broadcast_to(SMOOTH, (30_000_000, 7, 3))
    ones = np.broadcast_to(np.float64(1), (30_000_000, 4))
    leaves = Leaves(parameters=many, base_m=ones[:, :3], orientation=ones, length_m=ones[:, 0], phase=ones[:, 0])
    with pytest.raises(AssetError, match="30000000 leaves of 37 control points"):
        build_leaf_cage(leaves)
