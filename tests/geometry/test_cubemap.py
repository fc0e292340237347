"""Cubemaps in OpenEXR's orientation, against ImfEnvmap.h and analytic fields."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.geometry.cubemap import (
    FACE_AXES,
    FACES,
    face_coordinates,
    face_directions,
    sample_cubemap,
    share_borders,
    texel_identity,
)

# ImfEnvmap.h draws every face with the numbers of its corners: top left, top right, bottom left, bottom right.
# Bit 0 of a number is x, bit 1 is y, bit 2 is z (1 = positive).
CORNERS = {
    "+X": (3, 7, 1, 5),
    "-X": (6, 2, 4, 0),
    "+Y": (6, 7, 2, 3),
    "-Y": (0, 1, 4, 5),
    "+Z": (7, 6, 5, 4),
    "-Z": (2, 3, 0, 1),
}


def corner_direction(number):
    return np.array([1 if number >> bit & 1 else -1 for bit in range(3)]) / np.sqrt(3)


@pytest.mark.parametrize("face", range(6))
def test_corners_are_those_drawn_in_the_header(face):
    directions = face_directions(5)[face]
    seen = [directions[0, 0], directions[0, -1], directions[-1, 0], directions[-1, -1]]
    np.testing.assert_allclose(seen, [corner_direction(number) for number in CORNERS[FACES[face]]], atol=1e-15)


def test_the_centre_of_a_face_is_its_axis_and_directions_have_length_one():
    directions = face_directions(7)
    np.testing.assert_allclose(directions[:, 3, 3], FACE_AXES[:, 0], atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, rtol=1e-14)


def test_faces_are_mirrored_as_seen_from_the_centre():
    normal, right, up = FACE_AXES[:, 0], FACE_AXES[:, 1], FACE_AXES[:, 2]
    np.testing.assert_array_equal(np.cross(up, right), normal)


def test_a_face_needs_two_texels():
    with pytest.raises(ValueError, match="at least 2 texels a side, not 1"):
        face_directions(1)


@settings(max_examples=20, deadline=None)
@given(size=st.integers(2, 40))
def test_coordinates_of_texel_directions_are_the_texels(size):
    directions = face_directions(size)
    face, row, column = face_coordinates(directions, size)
    expected = np.broadcast_to(np.arange(6)[:, None, None], face.shape)
    inside = np.zeros((size, size), bool)
    inside[1:-1, 1:-1] = True
    np.testing.assert_array_equal(face[:, inside], expected[:, inside])
    # On a border another face may answer; it must be the same texel.
    identity = texel_identity(size)
    nearest = identity[face, np.rint(row).astype(int), np.rint(column).astype(int)]
    np.testing.assert_array_equal(nearest, identity)
    np.testing.assert_allclose(row, np.rint(row), atol=1e-9)
    np.testing.assert_allclose(column, np.rint(column), atol=1e-9)


@settings(max_examples=50, deadline=None)
@given(
    face=st.integers(0, 5),
    across=st.floats(-0.999, 0.999),
    down=st.floats(-0.999, 0.999),
    length=st.floats(1e-3, 1e3),
    size=st.integers(2, 512),
)
def test_coordinates_do_not_depend_on_the_length_of_the_direction(face, across, down, length, size):
    normal, right, up = FACE_AXES[face]
    got_face, row, column = face_coordinates(length * (normal + across * right - down * up), size)
    assert got_face == face
    assert row == pytest.approx((1 + down) / 2 * (size - 1), abs=1e-9 * size)
    assert column == pytest.approx((1 + across) / 2 * (size - 1), abs=1e-9 * size)


@pytest.mark.parametrize(
    ("direction", "face"),
    [
        ((1, 1, 1), "+X"),
        ((-1, 1, 1), "-X"),
        ((1, 1, 0.5), "+X"),
        ((-1, -1, 0), "-X"),
        ((1, 0, -1), "+X"),
        ((0.5, 1, 1), "+Y"),
        ((0, -1, -1), "-Y"),
        ((0, 0, 1), "+Z"),
        ((0, 0, -1), "-Z"),
    ],
)
def test_ties_go_to_x_then_y(direction, face):
    assert FACES[int(face_coordinates(np.array(direction), 9)[0])] == face


def test_sampling_a_field_that_is_linear_on_the_cube_is_exact():
    size = 9
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(500, 3))
    on_cube = directions / np.abs(directions).max(axis=1, keepdims=True)
    texels = face_directions(size)
    texels = texels / np.abs(texels).max(axis=-1, keepdims=True)
    gradient = np.array([[1.0, 2.0, 3.0], [-0.5, 0.25, 4.0]])
    sampled = sample_cubemap(texels @ gradient.T, directions)
    np.testing.assert_allclose(sampled, on_cube @ gradient.T, atol=1e-12)


def test_sampling_a_smooth_field_is_close_and_works_without_channels():
    size = 65
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(4, 100, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    axis = np.array([1.0, 2.0, 3.0])
    sampled = sample_cubemap(face_directions(size) @ axis, directions)
    assert sampled.shape == (4, 100)
    np.testing.assert_allclose(sampled, directions @ axis, atol=2e-3)


@pytest.mark.parametrize("size", [2, 3, 8, 33])
def test_number_of_distinct_texels(size):
    identity = texel_identity(size)
    count = 6 * (size - 1) ** 2 + 2
    np.testing.assert_array_equal(np.unique(identity), np.arange(count))
    # Numbered in the order in which the faces first show them.
    _, first = np.unique(identity, return_index=True)
    assert np.all(np.diff(first) > 0)
    copies = np.bincount(identity.ravel())
    assert np.sum(copies == 3) == 8
    assert np.sum(copies == 2) == 12 * (size - 2)


def test_texels_of_one_identity_have_one_direction():
    identity = texel_identity(17).ravel()
    directions = face_directions(17).reshape(-1, 3)
    order = np.argsort(identity, kind="stable")
    same = identity[order][1:] == identity[order][:-1]
    np.testing.assert_allclose(directions[order][1:][same], directions[order][:-1][same], atol=1e-15)


@settings(max_examples=20, deadline=None)
@given(size=st.integers(2, 12), seed=st.integers(0, 100), channels=st.sampled_from([None, 1, 3]))
def test_sharing_borders_is_idempotent_and_leaves_the_inside(size, seed, channels):
    shape = (6, size, size) if channels is None else (6, size, size, channels)
    cubemap = np.random.default_rng(seed).random(shape, dtype=np.float32)
    shared = share_borders(cubemap)
    assert shared.dtype == np.float32
    assert shared.shape == shape
    np.testing.assert_array_equal(share_borders(shared), shared)
    np.testing.assert_array_equal(shared[:, 1:-1, 1:-1], cubemap[:, 1:-1, 1:-1])
    flat = shared.reshape(6 * size * size, -1)
    identity = texel_identity(size).ravel()
    representative = np.zeros((identity.max() + 1, flat.shape[1]), np.float32)
    representative[identity] = flat
    np.testing.assert_array_equal(representative[identity], flat)


def test_a_shared_border_is_the_mean_of_its_copies():
    cubemap = np.zeros((6, 3, 3))
    cubemap[0] = 6  # +X
    shared = share_borders(cubemap)
    assert shared[0, 1, 1] == 6
    assert shared[0, 0, 1] == 3  # an edge: +X and +Y
    assert shared[0, 0, 0] == 2  # a corner: three faces
