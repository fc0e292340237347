"""A COLMAP model that was written is the one that is read."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation
from usdfoliage.capture.colmap.model import read_camera_model, read_model_points
from usdfoliage.capture.lens import Lens
from usdfoliage.capture.poses.colmap_writer import write_colmap_model
from usdfoliage.capture.poses.result import Registered, RegisteredPhoto
from usdfoliage.errors import CaptureError, WriteError

from tests.support.captures import look_at

LENSES = (
    Lens(model="SIMPLE_RADIAL", width_px=640, height_px=480, parameters=(500.125, 320.0, 240.0, -0.01)),
    Lens(model="PINHOLE", width_px=480, height_px=640, parameters=(500.0, 501.0, 240.0, 320.0)),
)


def registered(poses, lenses=LENSES, names=None, points=None) -> Registered:
    """Photographs that take turns with lenses; every point seen by all of them."""
    points = np.array([[0.1, 0.2, 0.3], [-1, 2e-7, 3]]) if points is None else points
    names = [f"a/{number:03d} b.jpg" for number in range(len(poses))] if names is None else names
    photos = tuple(
        RegisteredPhoto(
            name=name, lens=lenses[number % len(lenses)], cam_from_world=pose, error_px=0.5, points=len(points)
        )
        for number, (name, pose) in enumerate(zip(names, poses, strict=True))
    )
    seen = len(points) * len(photos)
    return Registered(
        photos=photos,
        points=points,
        srgb=np.tile(np.array([[1, 2, 255]], np.uint8), (len(points), 1)),
        error_px=np.full(len(points), 0.25),
        track_starts=np.arange(len(points) + 1) * len(photos),
        track_photos=np.tile(np.arange(len(photos)), len(points)),
        track_places_px=np.arange(2.0 * seen).reshape(-1, 2) / 3,
        names=tuple(names),
        matches=np.zeros((len(photos), len(photos)), np.int64),
        failures=(),
        remarks=(),
    )


def three_poses() -> list:
    return [look_at((x, 0.5, 2), (0, 0, 0)) for x in (-1.0, 0.3, 1.1)]


def test_what_is_written_is_read(tmp_path):
    model = registered(three_poses())
    write_colmap_model(tmp_path / "cameras", model)
    read = read_camera_model(tmp_path / "cameras")
    assert [image.name for image in read.images] == [photo.name for photo in model.photos]
    for image, photo in zip(read.images, model.photos, strict=True):
        assert read.lenses[image.camera_id] == photo.lens
        np.testing.assert_allclose(image.cam_from_world, photo.cam_from_world, atol=1e-14)
    np.testing.assert_array_equal(read_model_points(tmp_path / "cameras"), model.points)
    assert [path.name for path in tmp_path.iterdir()] == ["cameras"]


@given(
    vectors=hnp.arrays(np.float64, (2, 3), elements=st.floats(-3, 3)),
    translations=hnp.arrays(np.float64, (2, 3), elements=st.floats(-1e6, 1e6)),
)
def test_any_pose_comes_back(tmp_path_factory, vectors, translations):
    turns = Rotation.from_rotvec(vectors).as_matrix()
    model = registered([np.column_stack(pair) for pair in zip(turns, translations, strict=True)])
    folder = tmp_path_factory.mktemp("model") / "cameras"
    write_colmap_model(folder, model)
    for image, photo in zip(read_camera_model(folder).images, model.photos, strict=True):
        np.testing.assert_allclose(image.cam_from_world[:, :3], photo.cam_from_world[:, :3], atol=1e-14)
        np.testing.assert_array_equal(image.cam_from_world[:, 3], photo.cam_from_world[:, 3])


def test_tracks_and_features_point_at_each_other(tmp_path):
    model = registered(three_poses())
    write_colmap_model(tmp_path, model)
    images = [line for line in (tmp_path / "images.txt").read_text().splitlines() if not line.startswith("#")]
    points = [line.split() for line in (tmp_path / "points3D.txt").read_text().splitlines() if line[0] != "#"]
    for number, line in enumerate(points):
        assert line[0] == str(number + 1)
        assert line[4:8] == ["1", "2", "255", "0.25"]
        for place, (image, feature) in enumerate(zip(line[8::2], line[9::2], strict=True)):
            x, y, point = images[2 * int(image) - 1].split()[3 * int(feature) : 3 * int(feature) + 3]
            assert point == line[0]
            expected = model.track_places_px[model.track_starts[number] + place]
            np.testing.assert_array_equal([float(x), float(y)], expected)


def test_the_same_bytes_again_also_over_an_older_model(tmp_path):
    write_colmap_model(tmp_path / "a", registered(three_poses()))
    write_colmap_model(tmp_path / "b", registered(three_poses()[:1], points=np.zeros((0, 3))))
    write_colmap_model(tmp_path / "b", registered(three_poses()))
    for name in ("cameras.txt", "images.txt", "points3D.txt"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_colmap_reads_it(tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    names = [f"a/{number}.jpg" for number in range(3)]  # COLMAP itself ends names at a space
    write_colmap_model(tmp_path, registered(three_poses(), names=names))
    read = pycolmap.Reconstruction(str(tmp_path))
    assert read.num_reg_images() == 3
    assert read.num_points3D() == 2
    assert read.find_image_with_name("a/1.jpg").num_points3D == 2


@pytest.mark.parametrize("name", ["a\nb.jpg", " a.jpg", "a.jpg "])
def test_names_that_the_format_cannot_hold(tmp_path, name):
    with pytest.raises(CaptureError, match="rename"):
        write_colmap_model(tmp_path / "cameras", registered(three_poses()[:1], names=[name]))
    assert not (tmp_path / "cameras").exists()


def test_no_half_model_where_nothing_can_be_written(tmp_path, monkeypatch):
    def full(*arguments, **keywords):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(WriteError, match="No space left"):
        write_colmap_model(Path(tmp_path) / "cameras", registered(three_poses()))
    assert list(tmp_path.iterdir()) == []
