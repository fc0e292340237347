"""Cameras that were found are laid over the true ones by name and by a similarity."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.support.captures import ring
from tools.bench.without_poses import find_stem, lay_over


def test_a_known_similarity_is_found():
    found = ring(8)
    scale, turn, move = 3.0, Rotation.from_rotvec([0.3, -0.5, 1.1]).as_matrix(), np.array([0.2, -4.0, 1.0])
    true = {}
    for name, pose in found.items():
        rotation = pose[:, :3] @ turn.T
        center = scale * turn @ (-pose[:, :3].T @ pose[:, 3]) + move
        true[name] = np.column_stack([rotation, -rotation @ center])
    laid = lay_over(found, true)
    np.testing.assert_allclose(laid.true_from_found[:3, :3], scale * turn, atol=1e-9)
    np.testing.assert_allclose(laid.true_from_found[:3, 3], move, atol=1e-9)
    assert laid.cameras == 8
    assert laid.apart < 1e-9


def test_places_that_are_off_are_measured_by_the_spread_of_the_true_ones():
    true = ring(8)
    turned = {name: pose.copy() for name, pose in true.items()}
    moved = next(iter(turned))
    turned[moved][:, 3] += [0.05, 0.0, 0.0]
    assert 0.001 < lay_over(turned, true).apart < 0.05


def test_two_cameras_determine_no_frame():
    with pytest.raises(ValueError, match="three are needed"):
        lay_over(ring(2), ring(8))


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("007.jpg", "007"),
        ("IMG_012.HEIC", "012"),
        ("frame_00m00.300s.png", "001"),
        ("frame_00m00.500s.png", "001"),
        ("frame_00m00.599s.png", "002"),
        ("frame_00m09.000s.png", None),
        ("other.jpg", None),
    ],
)
def test_photographs_are_known_by_their_names(name, stem):
    stems = [f"{number:03d}" for number in range(20)]
    assert find_stem(name, stems) == stem
