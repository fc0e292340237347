"""The points of a cloud with the leaf of each, and other numbers for the leaves of a file."""

import os

import numpy as np
import pytest
from usdfoliage.capture.cloud_files.leaf_points import renumber_leaf_points, write_leaf_points
from usdfoliage.capture.cloud_files.read import FilePoints
from usdfoliage.errors import CaptureError

POINTS = np.random.default_rng(2).uniform(-1, 1, (50, 3))
LEAF = (np.arange(50) % 5 - 1).astype(np.int32)


def write(path, *, single):
    def parts():
        return iter([FilePoints(POINTS, np.ones(50, bool))])

    assert write_leaf_points(path, parts, lambda _: LEAF, single=single) == 50


@pytest.mark.parametrize("single", [True, False])
def test_leaves_get_their_numbers_and_other_links_keep_theirs(tmp_path, single):
    write(tmp_path / "points.ply", single=single)
    os.link(tmp_path / "points.ply", tmp_path / "other.ply")
    number_of = np.array([2, -1, 0, 1], np.int32)
    renumber_leaf_points(tmp_path / "points.ply", number_of)
    kind = "<f4" if single else "<f8"
    rows = []
    for name in ("points.ply", "other.ply"):
        body = (tmp_path / name).read_bytes().split(b"end_header\n", 1)[1]
        rows.append(np.frombuffer(body, [("p", kind, 3), ("leaf", "<i4")]))
    np.testing.assert_array_equal(rows[0]["p"], rows[1]["p"])
    np.testing.assert_array_equal(rows[1]["leaf"], LEAF)
    np.testing.assert_array_equal(rows[0]["leaf"], np.append(number_of, -1)[LEAF])


def test_a_file_with_other_leaves_or_none_is_refused_and_unchanged(tmp_path):
    path = tmp_path / "points.ply"
    write(path, single=True)
    before = path.read_bytes()
    with pytest.raises(CaptureError, match="has leaves that the plant has not"):
        renumber_leaf_points(path, np.zeros(2, np.int32))
    assert path.read_bytes() == before
    path.write_bytes(before[:-3])
    with pytest.raises(CaptureError, match="is truncated"):
        renumber_leaf_points(path, np.zeros(4, np.int32))
    assert path.read_bytes() == before[:-3]
    path.write_bytes(b"no such file" * 5000)
    with pytest.raises(CaptureError, match="is not a file of points"):
        renumber_leaf_points(path, np.zeros(4, np.int32))
    assert [each.name for each in tmp_path.iterdir()] == ["points.ply"]
