"""Features that match along epipolar lines: points in space that two known cameras see, whose descriptors repeat."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.capture.poses.guided_matches import GuidedMatchSettings, SeenFeatures, match_near_lines
from usdfoliage.capture.poses.pairs import match_descriptors

MOTION = np.column_stack([Rotation.from_euler("y", 20, degrees=True).as_matrix(), [0.8, 0.05, 0.1]])


def descriptors(rng, count):
    found = np.abs(rng.normal(size=(count, 128)))
    return np.round(512 * found / np.linalg.norm(found, axis=1, keepdims=True)).clip(0, 255).astype(np.uint8)


def two_views(seed: int, count: int = 60, repeated: int = 1) -> tuple[SeenFeatures, SeenFeatures, np.ndarray]:
    """What both cameras see, in other orders, and which feature of the second each of the first is."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-1, 1, (count * repeated, 2)), rng.uniform(3, 5, count * repeated)])
    other = points @ MOTION[:, :3].T + MOTION[:, 3]
    order = rng.permutation(len(points))
    each = np.tile(descriptors(rng, count), (repeated, 1))
    size = rng.uniform(2, 3, len(points))
    first = SeenFeatures(rays=points[:, :2] / points[:, 2:], size_px=size, descriptors=each)
    second = SeenFeatures(rays=(other[:, :2] / other[:, 2:])[order], size_px=size[order], descriptors=each[order])
    return first, second, np.argsort(order)


def lines_apart(first: SeenFeatures, second: SeenFeatures) -> np.ndarray:
    """(N, M), the smaller distance of two features from each other's line, one pair after the other."""
    x, y, z = MOTION[:, 3]
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ MOTION[:, :3]
    found = np.zeros((len(first.rays), len(second.rays)))
    for row, ray in enumerate(first.rays):
        for column, other in enumerate(second.rays):
            line, back = essential @ [*ray, 1], essential.T @ [*other, 1]
            off = abs(np.dot(line, [*other, 1]))
            found[row, column] = max(off / np.hypot(*line[:2]), off / np.hypot(*back[:2]))
    return found


@given(seed=st.integers(0, 10_000))
def test_all_that_both_see_match(seed):
    first, second, place = two_views(seed, count=20)
    np.testing.assert_array_equal(match_near_lines(first, second, MOTION), np.column_stack([np.arange(20), place]))


def test_repeated_features_match_where_none_did():
    """Each descriptor is there three times: without cameras none differs from the others."""
    first, second, place = two_views(1, repeated=3)
    assert not len(match_descriptors(first.descriptors, second.descriptors))
    matches = match_near_lines(first, second, MOTION)
    assert len(matches) > 150
    np.testing.assert_array_equal(place[matches[:, 0]], matches[:, 1])


def test_the_same_as_one_pair_after_the_other():
    first, second, _ = two_views(2, repeated=2)
    settings = GuidedMatchSettings(max_line=0.1)
    allowed = lines_apart(first, second) < settings.max_line
    angle = np.arccos(np.clip(first.descriptors.astype(float) @ second.descriptors.T.astype(float) / 512**2, -1, 1))
    angle[~allowed] = np.inf
    expected = []
    for row, angles in enumerate(angle):
        best, *others = np.argsort(angles, kind="stable")
        if np.isfinite(angles[best]) and angle[:, best].argmin() == row:
            second_angle = min(angles[others[0]], np.pi)
            if angles[best] <= settings.max_angle_rad and angles[best] < settings.max_ratio * second_angle:
                expected.append((row, best))
    assert 0 < len(expected) < len(first.rays)
    np.testing.assert_array_equal(match_near_lines(first, second, MOTION, settings), expected)


def test_what_has_another_size_or_lies_far_from_the_line_does_not_match():
    first, second, place = two_views(3)
    size, rays = second.size_px.copy(), second.rays.copy()
    size[place[0]] *= 5
    rays[place[1]] += [0, 0.5]
    matches = match_near_lines(first, SeenFeatures(rays=rays, size_px=size, descriptors=second.descriptors), MOTION)
    assert set(matches[:, 0]) == set(range(2, 60))


def test_photographs_without_features():
    first, _, _ = two_views(4)
    none = SeenFeatures(rays=np.zeros((0, 2)), size_px=np.zeros(0), descriptors=np.zeros((0, 128), np.uint8))
    assert match_near_lines(first, none, MOTION).shape == (0, 2)
    assert match_near_lines(none, first, MOTION).shape == (0, 2)


def test_settings_that_cannot_be():
    with pytest.raises(ValueError, match="max_size_ratio 1 or more"):
        GuidedMatchSettings(max_size_ratio=0.5)
