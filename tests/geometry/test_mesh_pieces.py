import numpy as np
import pytest
from usdfoliage.geometry.mesh_pieces import find_pieces, label_pieces

from tests.support.branch_shapes import BOX, QUADS


def boxes(*offsets):
    return np.concatenate([BOX + offset for offset in offsets]), np.concatenate(
        [QUADS + 8 * k for k in range(len(offsets))]
    )


def test_boxes_that_touch_nothing_are_afloat():
    points, faces = boxes([0, 0, 0], [0, 1.2, 0], [0.5, -0.5, 0.5], [9, 9, 9])
    pieces = find_pieces(points, faces, np.array([[0.1, 0, 0]]))
    assert pieces.rooted.tolist() == [True, False, False, False]
    assert pieces.gap_m[:3] == pytest.approx([0, 0.2, 0])
    assert pieces.afloat(0.1).tolist() == [1, 3]
    assert pieces.afloat(0.6).tolist() == [3]
    assert find_pieces(points, faces, points[::8]).afloat(0.0).tolist() == []


def test_points_without_faces_are_no_pieces_that_could_be_afloat():
    points, faces = boxes([0, 0, 0])
    pieces = find_pieces(np.concatenate([points, [[5, 5, 5]]]), faces, points[:1])
    assert pieces.afloat(0.0).tolist() == []
    assert label_pieces(9, faces)[1] == 2
