"""Maps of photographs in OpenEXR: what is written comes back, and lies over the photograph as it was taken."""

import errno
import os

import cv2
import hypothesis.strategies as st
import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays
from usdfoliage.capture.folder.depth_map import read_depth
from usdfoliage.capture.folder.map_files import (
    read_confidence_map,
    read_normal_map,
    write_confidence_map,
    write_depth_map,
    write_normal_map,
)
from usdfoliage.capture.folder.read import read_capture, read_view
from usdfoliage.capture.lens import Lens, undistort, undistort_places
from usdfoliage.errors import CaptureError, WriteError

from tests.support.captures import LENS, look_at, sphere_depth, write_capture, write_depth

DISTORTED = [
    Lens(model="SIMPLE_RADIAL", width_px=120, height_px=90, parameters=(110.0, 61, 44, -0.1)),
    Lens(model="SIMPLE_RADIAL", width_px=120, height_px=90, parameters=(110.0, 61, 44, 0.1)),
    Lens(model="OPENCV", width_px=120, height_px=90, parameters=(118.0, 117, 61, 44, -0.2, 0.05, 0.001, -0.002)),
    Lens(model="OPENCV_FISHEYE", width_px=120, height_px=90, parameters=(90.0, 90, 61, 44, -0.02, 0.01, 0.001, -0.002)),
]


@given(
    depth_m=arrays(np.float32, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.floats(0, 1e5, width=32))
)
def test_depth_comes_back_exactly(tmp_path_factory, depth_m):
    path = tmp_path_factory.mktemp("exr") / "a.exr"
    write_depth_map(path, depth_m)
    read = read_depth(path, depth_m.shape[1], depth_m.shape[0])
    np.testing.assert_array_equal(read.depth_m, depth_m)
    assert read.channel == "Z"


def some_normals(seed: int = 0, size: tuple[int, int] = (12, 17)):
    normals = np.random.default_rng(seed).normal(size=(*size, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    normals[:3] = 0
    return normals


def test_normals_come_back(tmp_path):
    normals = some_normals()
    write_normal_map(tmp_path / "n.exr", normals)
    np.testing.assert_allclose(read_normal_map(tmp_path / "n.exr"), normals, atol=5e-4)
    with OpenEXR.File(str(tmp_path / "n.exr"), separate_channels=True) as file:
        assert sorted(file.channels()) == ["N.X", "N.Y", "N.Z"]
        assert file.channels()["N.X"].pixels.dtype == np.float16
    with pytest.raises(CaptureError, match="depth needs one called Z"):  # not taken for a depth map
        read_depth(tmp_path / "n.exr", 17, 12)


def test_confidence_comes_back(tmp_path):
    confidence = np.random.default_rng(0).uniform(0, 1, (12, 17))
    write_confidence_map(tmp_path / "c.exr", confidence)
    np.testing.assert_allclose(read_confidence_map(tmp_path / "c.exr"), confidence, atol=3e-4)


def test_maps_of_others_are_read(tmp_path):
    write_depth(tmp_path / "c.exr", np.array([[0.5, 2.0, -1.0, np.nan]]), "confidence")
    assert read_confidence_map(tmp_path / "c.exr").tolist() == [[0.5, 1, 0, 0]]
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {name: np.full((2, 2), value, np.float32) for name, value in (("X", 0), ("Y", 3), ("Z", 4))}
    OpenEXR.File(header, planes).write(str(tmp_path / "n.exr"))
    np.testing.assert_allclose(read_normal_map(tmp_path / "n.exr"), np.broadcast_to([0, 0.6, 0.8], (2, 2, 3)))


def test_other_channels_are_refused(tmp_path):
    write_depth(tmp_path / "a.exr", np.ones((2, 2)), "A")
    for read in (read_confidence_map, read_normal_map):
        with pytest.raises(CaptureError, match="has the channels A, not"):
            read(tmp_path / "a.exr")


@pytest.mark.parametrize("content", [None, b"", b"no exr", b"\x76\x2f\x31\x01" + b"\0" * 99])
def test_what_is_no_map_is_refused(tmp_path, content):
    if content is not None:
        (tmp_path / "a.exr").write_bytes(content)
    for read in (read_confidence_map, read_normal_map):
        with pytest.raises(CaptureError, match=r"a\.exr"):
            read(tmp_path / "a.exr")


def test_a_truncated_map_is_refused(tmp_path):
    write_normal_map(tmp_path / "a.exr", some_normals(size=(200, 200)))
    data = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "a.exr").write_bytes(data[: len(data) // 2])
    with pytest.raises(CaptureError, match=r"a\.exr"):
        read_normal_map(tmp_path / "a.exr")


def test_the_same_maps_give_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        write_depth_map(tmp_path / f"{name}.exr", np.linspace(0, 1, 4000).reshape(50, 80))
    data = (tmp_path / "a.exr").read_bytes()
    assert data == (tmp_path / "b.exr").read_bytes()
    assert b"Date" not in data
    assert b"owner" not in data


@pytest.mark.parametrize(
    ("write", "values"),
    [
        (write_depth_map, np.array([[np.nan]])),
        (write_depth_map, np.array([[-1.0]])),
        (write_depth_map, np.ones(3)),
        (write_depth_map, np.ones((0, 3))),
        (write_confidence_map, np.array([[1.5]])),
        (write_confidence_map, np.array([[-0.1]])),
        (write_normal_map, np.full((1, 1, 3), 0.3)),
        (write_normal_map, np.ones((1, 1, 1))),
    ],
)
def test_what_is_no_such_map_is_not_written(tmp_path, write, values):
    with pytest.raises(ValueError, match=r"depth|confidence|normals"):
        write(tmp_path / "a.exr", values)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_leaves_the_old_map(tmp_path, monkeypatch):
    write_depth_map(tmp_path / "a.exr", np.ones((4, 4)))
    before = (tmp_path / "a.exr").read_bytes()

    def full(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(WriteError, match="No space left"):
        write_depth_map(tmp_path / "a.exr", np.zeros((4, 4)))
    assert (tmp_path / "a.exr").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]


def test_a_map_that_was_not_written_whole_is_an_error(tmp_path, monkeypatch):
    """As on a disk that is full, where OpenEXR raises no error."""
    written = OpenEXR.File.write

    def write_less(file, name):
        written(file, name)
        OpenEXR.File(file.header(), {"Z": np.zeros((4, 4), np.float32)})
        written(OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Z": np.zeros((4, 4), np.float32)}), name)

    monkeypatch.setattr(OpenEXR.File, "write", write_less)
    with pytest.raises(WriteError, match="see whether the disk is full or its folder read-only"):
        write_depth_map(tmp_path / "a.exr", np.ones((4, 4)))
    assert not list(tmp_path.iterdir())


# Over the photograph


@pytest.mark.parametrize("lens", DISTORTED, ids=lambda lens: f"{lens.model}{lens.distortion[0]:+}")
def test_what_is_laid_over_the_photograph_comes_back(lens):
    undistortion = undistort(lens)
    number = np.arange(1, lens.width_px * lens.height_px + 1, dtype=np.float32).reshape(lens.height_px, lens.width_px)
    back = undistortion.nearest(undistortion.distorted(number))
    inside = undistortion.inside
    assert (back[inside] > 0).all()
    rows, columns = np.divmod(back.astype(int) - 1, lens.width_px)
    true_rows, true_columns = np.indices(number.shape)
    off = np.maximum(np.abs(rows - true_rows), np.abs(columns - true_columns))[inside]
    assert off.max() <= 1  # the next pixel, where two came from one
    # A picture that shrinks where its lens's is stretched cannot keep all.
    assert np.mean(off == 0) > (0.6 if lens.model == "OPENCV_FISHEYE" else 0.85)


def test_vectors_are_moved_as_their_pixels_are():
    undistortion = undistort(DISTORTED[2])
    normals = some_normals(size=undistortion.x.shape)
    moved = undistortion.distorted(normals)
    for axis in range(3):
        np.testing.assert_array_equal(moved[..., axis], undistortion.distorted(normals[..., axis]))


@pytest.mark.parametrize("lens", DISTORTED, ids=lambda lens: f"{lens.model}{lens.distortion[0]:+}")
def test_places_are_those_of_the_map(lens):
    undistortion = undistort(lens)
    grid = np.stack(np.meshgrid(np.linspace(30, 90, 7), np.linspace(20, 70, 6)), -1).reshape(-1, 2)
    x, y = (
        cv2.remap(undistorted, *(np.float32(grid - 0.5)[None, :, axis] for axis in (0, 1)), cv2.INTER_LINEAR)[0]
        for undistorted in (undistortion.x, undistortion.y)
    )
    np.testing.assert_allclose(undistort_places(lens, np.column_stack([x, y]) + 0.5), grid, atol=0.02)


def test_places_of_no_distortion_stay():
    places = np.array([[1.0, 2.0], [3.5, 4.0]])
    np.testing.assert_array_equal(undistort_places(LENS, places), places)
    assert undistort_places(DISTORTED[0], np.zeros((0, 2))).shape == (0, 2)


def test_places_past_where_a_lens_turns_back_are_none():
    lens = Lens(model="SIMPLE_RADIAL", width_px=100, height_px=100, parameters=(40.0, 50, 50, -0.4))
    places = undistort_places(lens, np.array([[50.0, 50.0], [0.0, 0.0]]))
    np.testing.assert_allclose(places[0], (50, 50))
    assert np.isnan(places[1]).all()


@pytest.mark.parametrize("lens", [LENS, *DISTORTED[:3]], ids=lambda lens: lens.model)
def test_a_capture_reads_the_depth_that_was_written(tmp_path, lens):
    pose = look_at((0, 0.3, 2), (0, 0, 0))
    write_capture(tmp_path, lens=lens, poses={"a.png": pose})
    camera = lens.pinhole(pose)
    depth_m = sphere_depth(camera, 0.5).astype(np.float32)
    over_photo = depth_m if lens.is_pinhole else undistort(lens).distorted(depth_m)
    write_depth_map(tmp_path / "depth" / "a.exr", over_photo)
    view = read_view(read_capture(tmp_path), 0)
    exact = view.depth_m == depth_m
    inside = np.ones(exact.shape, bool) if lens.is_pinhole else undistort(lens).inside
    assert view.has_depth
    assert np.mean(exact[inside]) > (0.9999 if lens.is_pinhole else 0.85)
    both = (view.depth_m > 0) & (depth_m > 0)
    assert np.median(np.abs(view.depth_m - depth_m)[both]) < 1e-6
