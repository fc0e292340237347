import numpy as np
import pytest
from usdfoliage.geometry.cube_field import blur_cubemap, close_pits, limit_falloff, solve_dirichlet, weighted_blurs
from usdfoliage.geometry.cubemap import face_directions, share_borders, texel_identity


def random_field(size, seed=0):
    return share_borders(np.random.default_rng(seed).random((6, size, size)))


def distinct_mean(field):
    _, first = np.unique(texel_identity(field.shape[1]), return_index=True)
    return field.ravel()[first].mean()


@pytest.mark.parametrize("sigma", [0.0, 0.5, 2.0, 7.0])
def test_blur_keeps_a_constant_and_the_range(sigma):
    assert blur_cubemap(np.full((6, 33, 33), 0.7), sigma) == pytest.approx(np.full((6, 33, 33), 0.7))
    blurred = blur_cubemap(random_field(33), sigma)
    assert blurred.min() >= 0
    assert blurred.max() <= 1
    assert distinct_mean(blurred) == pytest.approx(distinct_mean(random_field(33)), rel=1e-9)  # diffusion loses nothing


@pytest.mark.parametrize("sigma", [1.0, 3.0, 6.0])
def test_blur_of_a_point_has_the_variance_of_the_gaussian(sigma):
    size = 97
    field = np.zeros((6, size, size))
    field[4, 48, 48] = 1.0

    face = blur_cubemap(field, sigma)[4]

    offset = np.arange(size) - 48
    weight = face.sum()
    assert (face.sum(axis=0) @ offset**2) / weight == pytest.approx(sigma**2, rel=0.06)
    assert (face.sum(axis=1) @ offset**2) / weight == pytest.approx(sigma**2, rel=0.06)


def test_wide_blurs_on_reduced_cubemaps_agree_with_plain_diffusion():
    size = 128
    field = np.cos(9 * (face_directions(size) @ [0.3, 0.5, 0.8]))
    plain = field
    for _ in range(16):  # sixteen blurs of 2 make one of 8, and 2 stays below the reduction
        plain = blur_cubemap(plain, 2.0)

    assert blur_cubemap(field, 8.0) == pytest.approx(plain, abs=0.03)


def test_weighted_blurs_add_up():
    field = blur_cubemap(random_field(40), 1.0)
    together = weighted_blurs(field, (0.5, 1.0, 2.0), (1.0, 2.0, -0.5))
    apart = blur_cubemap(field, 0.5) + 2 * blur_cubemap(field, 1.0) - 0.5 * blur_cubemap(field, 2.0)

    assert together == pytest.approx(apart, abs=2e-3)


def test_blur_shows_no_face_border():
    blurred = blur_cubemap(random_field(64), 3.0)

    assert np.abs(share_borders(blurred) - blurred).max() < 1e-12
    inner = np.abs(np.diff(blurred, axis=2)).mean()
    assert np.abs(blurred[:, :, 0] - blurred[:, :, 1]).mean() < 1.2 * inner


def test_a_harmonic_field_keeps_within_what_is_fixed_and_meets_it():
    size = 96
    directions = face_directions(size)
    fixed = np.abs(directions[..., 2]) <= 1.01 / (size - 1)
    value = np.cos(np.arctan2(directions[..., 1], directions[..., 0]))

    field = solve_dirichlet(np.zeros((6, size, size)), fixed, value)

    assert field[fixed] == pytest.approx(value[fixed])
    assert np.abs(field).max() <= 1 + 1e-6
    # On a sphere the solution is tan(θ/2) cos φ; texels of a cube bend it by a few percent.
    theta = np.arccos(np.abs(directions[..., 2]))
    assert field == pytest.approx(np.tan(theta / 2) * value, abs=0.06)


def test_a_linear_problem_is_solved_like_a_dense_one():
    size = 8
    identity = texel_identity(size)
    count = identity.max() + 1
    laplacian = np.zeros((count, count))
    for a, b in {
        tuple(sorted(pair))
        for first, second in ((identity[:, :, :-1], identity[:, :, 1:]), (identity[:, :-1], identity[:, 1:]))
        for pair in zip(first.ravel().tolist(), second.ravel().tolist(), strict=True)
    }:
        laplacian[[a, b], [a, b]] += 1
        laplacian[[a, b], [b, a]] -= 1
    source = share_borders(np.random.default_rng(2).normal(size=(6, size, size)))
    fixed = np.zeros((6, size, size), bool)
    fixed[0, 3, 3] = fixed[5, 0, 0] = True

    field = solve_dirichlet(source, fixed, np.ones((6, size, size)))

    values, right = np.empty(count), np.empty(count)
    values[identity], right[identity] = field, source
    free = ~np.isin(np.arange(count), identity[fixed])
    assert (laplacian @ values)[free] == pytest.approx(right[free], abs=1e-8)
    assert field[fixed] == pytest.approx(1.0)


def test_nothing_fixed_is_refused():
    with pytest.raises(ValueError, match="at least one fixed"):
        solve_dirichlet(np.zeros((6, 8, 8)), np.zeros((6, 8, 8), bool), np.zeros((6, 8, 8)))


@pytest.mark.parametrize("sigma", [-1.0, np.nan])
def test_a_blur_must_be_positive(sigma):
    with pytest.raises(ValueError, match="sigma"):
        blur_cubemap(random_field(8), sigma)


def test_a_closing_takes_pits_away_and_leaves_what_is_wide():
    directions = face_directions(48)
    angle = np.arccos(np.clip(directions @ unit([1.0, 0.8, 0.6]), -1, 1))  # near a corner of the cube
    narrow, wide = np.where(angle < 0.05, 0.2, 1.0), np.where(angle < 0.5, 0.2, 1.0)

    assert (close_pits(narrow, 0.25) == 1.0).all()
    assert (close_pits(wide, 0.25)[angle < 0.3] == 0.2).all()
    np.testing.assert_array_equal(close_pits(wide, 0.0), wide)
    assert (-close_pits(-(2 - narrow), 0.25) == 1.0).all()  # a peak, opened


def test_a_field_falls_off_no_faster_than_it_may():
    directions = face_directions(48)
    angle = np.arccos(np.clip(directions @ unit([0.2, 1.0, -0.9]), -1, 1))
    peak = np.where(angle < 0.04, 2.0, 0.5)

    limited = limit_falloff(peak, 1.5)

    assert (limited >= peak).all()
    # Steps go along rows and columns, so that ways are longer than angles, by at most a half and more at corners.
    assert (limited >= np.maximum(0.5, 2.0 * np.exp(-1.5 * 1.7 * angle)) - 1e-9).all()
    assert (limited <= np.maximum(0.5, 2.0 * np.exp(-1.5 * (angle - 0.05))) + 1e-9).all()


def unit(direction):
    return np.array(direction) / np.linalg.norm(direction)
