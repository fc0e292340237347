"""The surface against the plain one in numpy, against derivatives by differences, and against known shapes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape import surface
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter

from tests.support.leaves.reference import evaluate_grid as reference_grid
from tests.support.leaves.reference import evaluate_points as reference_points
from tests.support.leaves.reference import jitter_wave
from tests.support.leaves.reference import leaf_nets as reference_nets
from tests.support.leaves.shapes import flat_leaf, random_leaves, wild_leaves

U, V = np.linspace(-1, 1, 11), np.linspace(0, 1, 9)
MAP = np.array([0.1, -0.7, 1.0, 0.4, -1.0])
JITTERS = [NO_JITTER, Jitter(amplitude=0.05, frequency=11.0), Jitter(amplitude=0.05, frequency=3.0, map=MAP)]
FIELDS = ("points", "tangents_u", "tangents_v", "normals")


def random_placements(count, seed=3):
    return np.random.default_rng(seed).normal(size=(count, 3, 4))


@pytest.mark.parametrize("jitter", JITTERS, ids=["plain", "procedural", "map"])
def test_is_the_plain_leaf(jitter):
    leaves, phase = random_leaves(20, spread=0.5), np.random.default_rng(1).uniform(0, 64, 20)

    grid, expected = surface.evaluate_grid(leaves, U, V, jitter, phase), reference_grid(leaves, U, V, jitter, phase)

    for field in FIELDS:
        numbers, wanted = getattr(grid, field), getattr(expected, field)
        assert np.abs(numbers - wanted).max() <= 1e-12 * max(1.0, np.abs(wanted).max()), field


def test_nets_and_axes_are_the_plain_ones():
    leaves = random_leaves(20)

    assert np.abs(surface.leaf_nets(leaves) - reference_nets(leaves)).max() <= 1e-13
    middle = surface.evaluate_points(leaves, surface.grid_places(0.0, V))
    assert np.abs(surface.axis_points(leaves, V) - middle).max() <= 1e-13
    own = np.tile(V, (20, 1))
    assert np.array_equal(surface.axis_points(leaves, own), surface.axis_points(leaves, V))
    assert np.array_equal(surface.axis_normals(leaves, own), surface.axis_normals(leaves, V))


def test_places_of_each_leaf_and_shared_places():
    leaves, uv = random_leaves(6), np.random.default_rng(0).uniform(-1, 1, (6, 13, 2))

    points = surface.evaluate_points(leaves, uv)

    assert np.abs(points - reference_points(leaves, uv)).max() <= 1e-12
    assert np.array_equal(points[2:3], surface.evaluate_points(leaves[2:3], uv[2]))


@pytest.mark.parametrize("jitter", JITTERS[:2], ids=["plain", "procedural"])
def test_tangents_are_the_derivatives(jitter):
    leaves, step = random_leaves(8, spread=0.4), 1e-6
    u, v = np.array([-0.9, -0.35, 0.2, 0.8]), np.array([0.15, 0.5, 0.83])

    grid = surface.evaluate_grid(leaves, u, v, jitter)

    def points(du, dv):
        return surface.evaluate_grid(leaves, u + du, v + dv, jitter).points

    assert (points(step, 0) - points(-step, 0)) / (2 * step) == pytest.approx(grid.tangents_u, rel=1e-6, abs=1e-6)
    assert (points(0, step) - points(0, -step)) / (2 * step) == pytest.approx(grid.tangents_v, rel=1e-6, abs=1e-6)


def test_normals_at_the_ends_are_the_limit():
    leaves = np.abs(random_leaves(8, spread=0.3)) + flat_leaf()

    at_the_ends = surface.evaluate_grid(leaves, U, np.array([0.0, 1.0])).normals
    beside = surface.evaluate_grid(leaves, U, np.array([1e-7, 1 - 1e-7])).normals

    assert at_the_ends == pytest.approx(beside, abs=1e-5)


@settings(max_examples=40, deadline=None)
@given(leaves=wild_leaves(), amplitude=st.sampled_from([0.0, 0.2]), phase=st.floats(0, 64))
def test_wild_leaves_are_finite_and_keep_their_ends(leaves, amplitude, phase):
    grid = surface.evaluate_grid(leaves, U, V, Jitter(amplitude=amplitude), np.full(len(leaves), phase))

    for field in FIELDS:
        assert np.isfinite(getattr(grid, field)).all(), field
    assert np.abs(np.linalg.norm(grid.normals, axis=-1) - 1).max() < 1e-9
    assert (grid.points[:, 0] == (0, 0, 0)).all()
    assert (grid.points[:, -1] == (0, 1, 0)).all()


@settings(max_examples=40, deadline=None)
@given(leaves=wild_leaves(), map=st.sampled_from([None, MAP]))
def test_a_straight_axis_makes_a_symmetric_leaf(leaves, map):
    leaves[:, :2, 0] = 0

    points = surface.evaluate_grid(leaves, U, V, Jitter(amplitude=0.1, map=map)).points

    assert np.abs(points[:, :, ::-1] * (-1, 1, 1) - points).max() <= 1e-12


@settings(max_examples=20, deadline=None)
@given(leaves=wild_leaves(count=3))
def test_wild_leaves_are_the_plain_ones(leaves):
    points, expected = surface.evaluate_grid(leaves, U, V).points, reference_grid(leaves, U, V).points

    assert np.abs(points - expected).max() <= 1e-12 * max(1.0, np.abs(expected).max())


def test_placements_place_points_and_turn_what_hangs_on_them():
    leaves, placements = random_leaves(10, spread=0.5), random_placements(10)
    matrix, origin = placements[:, None, None, :, :3], placements[:, None, None, :, 3]

    here = surface.evaluate_grid(leaves, U, V, JITTERS[1])
    there = surface.evaluate_grid(leaves, U, V, JITTERS[1], placements=placements)

    for field in FIELDS[:3]:
        turned = (matrix @ getattr(here, field)[..., None])[..., 0] + (origin if field == "points" else 0)
        assert np.abs(getattr(there, field) - turned).max() <= 1e-12 * np.abs(turned).max(), field
    cross = np.cross(there.tangents_u, there.tangents_v)
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    inside = (length > 1e-6)[..., 0]
    assert np.abs((cross / np.where(length > 0, length, 1))[inside] - there.normals[inside]).max() <= 1e-9


def test_placements_of_leaves_keep_normals_perpendicular_to_the_surface():
    leaves = random_leaves(5, spread=0.3) + flat_leaf()
    rng = np.random.default_rng(4)
    orientation = rng.normal(size=(5, 4))
    placed = Leaves(
        parameters=leaves,
        base_m=rng.normal(size=(5, 3)),
        orientation=orientation / np.linalg.norm(orientation, axis=1, keepdims=True),
        length_m=np.full(5, 0.07),
        phase=np.zeros(5),
    )
    uv = surface.grid_places(U, V)

    points, normals = surface.evaluate_normals(leaves, uv, placements=placed.asset_from_leaf())

    matrix = placed.asset_from_leaf()
    expected = (matrix[:, None, :, :3] @ surface.evaluate_normals(leaves, uv)[1][..., None])[..., 0] / 0.07
    assert np.abs(normals - expected).max() <= 1e-12
    assert np.abs(points[:, 0] - placed.base_m).max() <= 1e-15


@pytest.mark.parametrize("jitter", JITTERS, ids=["plain", "procedural", "map"])
def test_any_number_of_threads_gives_the_same(jitter):
    leaves, placements = random_leaves(600), random_placements(600)
    one = surface.evaluate_grid(leaves, U, V, jitter, placements=placements, threads=1)

    for threads in (0, 2, 7):
        grid = surface.evaluate_grid(leaves, U, V, jitter, placements=placements, threads=threads)
        assert all(np.array_equal(getattr(grid, field), getattr(one, field)) for field in FIELDS)


def test_single_precision_is_double_precision_rounded():
    leaves, uv = random_leaves(50), surface.grid_places(U, V)

    points, normals = surface.evaluate_normals(leaves, uv, JITTERS[2], dtype=np.float32)

    wide_points, wide_normals = surface.evaluate_normals(leaves, uv, JITTERS[2])
    assert points.dtype == normals.dtype == np.float32
    assert np.array_equal(points, wide_points.astype(np.float32))
    assert np.array_equal(normals, wide_normals.astype(np.float32))
    assert np.array_equal(points, surface.evaluate_points(leaves, uv, JITTERS[2], dtype=np.float32))


def test_a_flat_leaf_follows_from_its_control_points():
    leaf = flat_leaf(width=0.4)
    v = np.linspace(0, 1, 21)

    grid = surface.evaluate_grid(leaf, U, v)

    half = 0.4 * (1 - v**4 - (1 - v) ** 4)  # the inner three Bernstein polynomials of a quartic
    assert grid.points[0, :, :, 0] == pytest.approx(half[:, None] * U, abs=1e-15)
    assert grid.points[0, :, :, 1] == pytest.approx(np.repeat(v[:, None], len(U), 1), abs=1e-15)
    assert np.array_equal(grid.normals, np.broadcast_to((0.0, 0.0, 1.0), grid.normals.shape))


def test_jitter_is_the_wave_on_the_silhouette_and_fades_at_the_ends():
    leaf, v, phase = flat_leaf(width=0.4), np.linspace(0, 1, 101), np.array([5.25])
    plain = surface.evaluate_points(leaf, surface.grid_places((-1.0, 1.0), v)).reshape(101, 2, 3)

    for jitter in JITTERS[1:]:
        moved = surface.evaluate_points(leaf, surface.grid_places((-1.0, 1.0), v), jitter, phase).reshape(101, 2, 3)
        wave = jitter_wave(jitter, jitter.frequency * v + phase)[0]
        expected = jitter.amplitude * wave * (1 - (2 * v - 1) ** 8)
        assert (moved - plain)[:, 1, 0] == pytest.approx(expected, abs=1e-15)
        assert (moved - plain)[:, 0, 0] == pytest.approx(-expected, abs=1e-15)
        assert (moved[[0, -1]] == plain[[0, -1]]).all()
        assert np.abs(expected).max() > 0.5 * jitter.amplitude


def test_a_map_is_periodic_and_linear_between_its_texels():
    leaf, at = flat_leaf(), 0.5  # where the fade is 1
    texels = np.arange(len(MAP))

    def moved(cycles):
        jitter, places = Jitter(amplitude=1.0, frequency=1.0, map=MAP), surface.grid_places(1.0, [at])
        return (surface.evaluate_points(leaf, places, jitter, [cycles - at]) - surface.evaluate_points(leaf, places))[
            0, 0, 0
        ]

    for texel, value in zip(texels, MAP, strict=True):
        centre = (texel + 0.5) / len(MAP)
        assert moved(centre) == pytest.approx(value, abs=1e-12)
        assert moved(centre + 7) == pytest.approx(value, abs=1e-12)
        assert moved(centre + 0.5 / len(MAP)) == pytest.approx((value + MAP[(texel + 1) % len(MAP)]) / 2, abs=1e-12)


def test_jitter_inside_a_half_is_the_silhouettes_share():
    leaves = random_leaves(4, spread=0.3)
    places = surface.grid_places(np.array([-1.0, -0.5, 0.0, 0.5, 1.0]), [0.3])

    moved = surface.evaluate_points(leaves, places, JITTERS[1]) - surface.evaluate_points(leaves, places)

    assert moved[:, 3] == pytest.approx(moved[:, 4] / 8, abs=1e-15)
    assert moved[:, 1] == pytest.approx(moved[:, 0] / 8, abs=1e-15)
    assert (moved[:, 2] == 0).all()


def test_an_upright_axis_has_no_side():
    leaf = flat_leaf()
    leaf[0, :2] = (0, 0, 0.4), (0, 1, 0.4)  # rises straight from the base and falls straight to the apex

    assert surface.axis_normals(leaf, [0.0, 0.5, 1.0])[0] == pytest.approx(np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0]]))
    assert np.isfinite(surface.evaluate_grid(leaf, U, V, JITTERS[1]).normals).all()


def test_no_leaves_and_no_places():
    none, uv = np.zeros((0, 7, 3)), surface.grid_places(U, V)

    assert surface.evaluate_grid(none, U, V, JITTERS[1], [], placements=np.zeros((0, 3, 4))).normals.shape == (
        0,
        9,
        11,
        3,
    )
    assert surface.evaluate_points(none, uv).shape == (0, 99, 3)
    assert surface.evaluate_points(none, np.zeros((0, 4, 2))).shape == (0, 4, 3)
    assert surface.evaluate_points(flat_leaf(), np.zeros((0, 2))).shape == (1, 0, 3)
    assert surface.leaf_nets(none).shape == (0, 5, 7, 3)
    assert surface.axis_points(none, V).shape == surface.axis_normals(none, np.zeros((0, 9))).shape == (0, 9, 3)


def test_inputs_of_any_layout():
    leaves, uv = random_leaves(6), surface.grid_places(U, V)
    phase, placements = np.linspace(0, 5, 6), random_placements(6)
    expected = surface.evaluate_points(leaves, uv, JITTERS[2], phase, placements=placements)
    read_only = [array.copy() for array in (leaves, uv, phase, placements)]
    for array in read_only:
        array.flags.writeable = False
    strided = [np.asfortranarray(leaves), uv[:, ::-1].copy()[:, ::-1], np.repeat(phase, 2)[::2], placements[::-1][::-1]]

    for inputs in (read_only, strided):
        points = surface.evaluate_points(inputs[0], inputs[1], JITTERS[2], inputs[2], placements=inputs[3])
        assert np.array_equal(points, expected)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: surface.leaf_nets(np.zeros((7, 3))), r"parameters must be \(N, 7, 3\), not \(7, 3\)"),
        (lambda: surface.evaluate_grid(np.zeros((2, 21)), U, V), r"parameters must be \(N, 7, 3\)"),
        (lambda: surface.evaluate_points(np.zeros((2, 7, 3)), U), r"uv must be \(P, 2\) or \(2, P, 2\), not \(11,\)"),
        (lambda: surface.evaluate_points(np.zeros((2, 7, 3)), np.zeros((3, 4, 2))), r"not \(3, 4, 2\)"),
        (lambda: surface.evaluate_grid(np.zeros((2, 7, 3)), U, V, phase=[0.0]), r"phase must be \(2,\), not \(1,\)"),
        (
            lambda: surface.evaluate_grid(np.zeros((2, 7, 3)), U, V, placements=np.zeros((2, 4, 4))),
            r"placements must be \(2, 3, 4\), not \(2, 4, 4\)",
        ),
        (lambda: surface.axis_points(np.zeros((2, 7, 3)), np.zeros((3, 4))), r"v must be \(P,\) or \(2, P\)"),
        (lambda: surface.evaluate_jacobian(np.zeros((2, 7, 3)), np.zeros((4, 3))), r"uv must be"),
    ],
)
def test_wrong_shapes_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
