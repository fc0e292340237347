"""Raw files of cameras."""

import struct

import numpy as np
import pytest
from usdfoliage.capture.folder import camera_raw, raw_worker
from usdfoliage.capture.folder.camera_raw import read_raw_exif
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.capture.folder.photo_set import read_photo_set
from usdfoliage.errors import CaptureError

from tests.support.camera_raw_files import write_dng
from tests.support.heic_files import box, exif_block

HEIGHT, WIDTH = 48, 64


@pytest.fixture
def light() -> np.ndarray:
    """(H, W, 3), linear, smooth."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.dstack([0.1 + 0.5 * columns / WIDTH, 0.2 + 0.3 * rows / HEIGHT, np.full((HEIGHT, WIDTH), 0.15)])


def inside(pixels: np.ndarray) -> np.ndarray:
    return pixels[4:-4, 4:-4]  # of the edge the mosaic has but one side


def test_a_photograph_is_the_light_of_the_scene(tmp_path, light):
    photo = read_photo(write_dng(tmp_path / "a.dng", light))
    assert (photo.color_space, photo.orientation) == ("linear", 1)
    np.testing.assert_allclose(inside(photo.linear), inside(light), atol=2e-3)


def test_photographs_of_a_set_are_developed_with_the_same_settings(tmp_path, light):
    """Neither what the camera took for white nor the brightest pixel changes anything, and half the light is half."""
    first = read_photo(write_dng(tmp_path / "a.dng", light)).linear
    other_white = read_photo(write_dng(tmp_path / "b.dng", light, neutral=(0.5, 1.0, 0.7))).linear
    np.testing.assert_array_equal(first, other_white)
    dark = read_photo(write_dng(tmp_path / "c.dng", 0.5 * light)).linear
    np.testing.assert_allclose(inside(dark), 0.5 * inside(first), atol=1e-3)
    bright = light.copy()
    bright[20:28, 20:28] = 1.0
    lit = read_photo(write_dng(tmp_path / "d.dng", bright)).linear
    np.testing.assert_allclose(lit[4:12, 4:12], first[4:12, 4:12], atol=1e-4)
    assert lit.max() == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("orientation", "turn"), [(1, 0), (3, 2), (6, 3), (8, 1)])
def test_it_is_turned_upright_once(tmp_path, light, orientation, turn):
    path = write_dng(tmp_path / "a.dng", light, orientation=orientation, focal_35mm=28)
    upright = np.rot90(light, turn)
    np.testing.assert_allclose(inside(read_photo(path).linear), inside(upright), atol=2e-3)
    (photo,) = read_photo_set(tmp_path).photos
    assert (photo.height_px, photo.width_px, photo.orientation) == (*upright.shape[:2], 1)
    assert photo.camera == "Foliage One"
    assert photo.focal_px == pytest.approx(28 / np.hypot(36, 24) * np.hypot(WIDTH, HEIGHT))


@pytest.mark.parametrize("kept", [10, 100, 700, 3000])
def test_a_truncated_file_is_refused_without_noise(tmp_path, light, capfd, kept):
    stored = write_dng(tmp_path / "a.dng", light).read_bytes()
    (tmp_path / "b.dng").write_bytes(stored[:kept])
    with pytest.raises(CaptureError, match=r"b\.dng is not a raw file that can be read .*; copy it again"):
        read_photo(tmp_path / "b.dng")
    assert capfd.readouterr() == ("", "")


def test_a_crash_of_libraw_is_an_error_of_that_file(tmp_path, light, monkeypatch):
    crashing = tmp_path / "worker.py"
    crashing.write_text("import os\nos.abort()\n")
    monkeypatch.setattr(raw_worker, "__file__", str(crashing))
    with pytest.raises(CaptureError, match=r"a\.dng is not a raw file that can be read \(LibRaw ended with code -6\)"):
        read_photo(write_dng(tmp_path / "a.dng", light))


def test_more_pixels_than_are_read(tmp_path, light):
    path = write_dng(tmp_path / "a.dng", light)
    with pytest.raises(CaptureError, match=r"states 64×48 pixels, 0 million; at most 0 million"):
        camera_raw.develop_raw(path, WIDTH * HEIGHT - 1)


def test_without_the_package_the_error_names_it(tmp_path, light, monkeypatch):
    monkeypatch.setattr(camera_raw.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        CaptureError, match=r"the package rawpy.* is not installed; install it with 'pip install rawpy'"
    ):
        read_photo(write_dng(tmp_path / "a.dng", light))


def test_exif_of_raw_files_that_are_no_tiff(tmp_path):
    """Canon keeps it in boxes, Fujifilm in a JPEG."""
    block = exif_block({0x0112: (3, 8)}, {0xA405: (3, 35)})
    part = exif_block({0xA405: (3, 35)}, {})  # a folder of its own
    canon = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
    boxes = box("uuid", canon + box("CMT1", exif_block({0x0112: (3, 8)}, {})) + box("CMT2", part))
    (tmp_path / "a.cr3").write_bytes(box("ftyp", b"crx ") + box("moov", boxes) + box("mdat", bytes(9)))
    head = b"FUJIFILMCCD-RAW ".ljust(84, b"0") + struct.pack(">I", 100)
    (tmp_path / "a.raf").write_bytes(head.ljust(100, b"\0") + b"\xff\xd8\xff\xe1\0\0Exif\0\0" + block)
    for name in ("a.cr3", "a.raf"):
        found = read_raw_exif(tmp_path / name)
        assert (found["Orientation"], found["Exif:FocalLengthIn35mmFilm"]) == (8, 35)
    (tmp_path / "b.cr3").write_bytes((tmp_path / "a.cr3").read_bytes()[:60])
    assert read_raw_exif(tmp_path / "b.cr3") == {}


def test_a_raw_file_beside_its_jpeg_is_not_used(tmp_path, light):
    write_dng(tmp_path / "a.dng", light)
    write_dng(tmp_path / "b.DNG", 0.9 * light)
    write_dng(tmp_path / "c.dng", 0.8 * light).rename(tmp_path / "a.heic.dng")
    import cv2

    cv2.imwrite(str(tmp_path / "a.jpg"), np.rint(255 * light).astype(np.uint8))
    found = read_photo_set(tmp_path)
    assert [photo.name for photo in found.photos] == ["a.heic.dng", "a.jpg", "b.DNG"]
    assert ("raw-photographs-not-used", "a.dng") in [(each.code, each.subject) for each in found.remarks]
