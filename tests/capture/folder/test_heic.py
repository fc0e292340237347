"""Pictures in HEIC files."""

import struct
from contextlib import suppress

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.capture.folder.photo_set import read_gray, read_photo_set
from usdfoliage.capture.folder.raster import read_image_spec, read_raster
from usdfoliage.capture.folder.read import read_capture, read_views
from usdfoliage.capture.lens import Lens
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.color import decode_srgb

from tests.support.captures import ring, write_text_model
from tests.support.heic_files import HEIGHT, WIDTH, box, exif_block, expected, full_box, nclx, write_heic

CLOSE = 6  # of 255, what coding, 10 bits and chroma of half the size change


def pixels(path) -> np.ndarray:
    raster = read_raster(path)
    assert raster.orientation == 1
    return raster.color


def same(first: np.ndarray, second: np.ndarray, within: float = CLOSE) -> None:
    assert first.shape == second.shape
    np.testing.assert_allclose(first.astype(float), second.astype(float), atol=within)


@pytest.mark.parametrize("bits", [8, 10])
def test_a_picture_of_8_and_of_10_bits(tmp_path, bits):
    same(pixels(write_heic(tmp_path / "a.heic", bits=bits)), expected())


def test_the_kind_is_known_by_the_first_bytes_whatever_the_name(tmp_path):
    same(pixels(write_heic(tmp_path / "a.jpg")), expected())


def test_tiles_are_put_together_and_cropped(tmp_path):
    """Phones code tiles of 512 × 512, and the last ones reach over the edge."""
    width, height = 3 * WIDTH - 20, 2 * HEIGHT - 10
    path = write_heic(tmp_path / "a.heic", grid=(3, 2, width, height))
    same(pixels(path), expected(3, 2)[:height, :width])
    spec = read_image_spec(path)
    assert (spec.width, spec.height) == (width, height)


TURNS = {0: lambda x: x, 1: np.rot90, 2: lambda x: np.rot90(x, 2), 3: lambda x: np.rot90(x, 3)}


@pytest.mark.parametrize("turn", TURNS)
def test_a_turn_is_against_the_clock(tmp_path, turn):
    path = write_heic(tmp_path / "a.heic", properties=[box("irot", bytes([turn]))])
    same(pixels(path), TURNS[turn](expected()))
    spec = read_image_spec(path)
    assert (spec.width, spec.height) == ((HEIGHT, WIDTH) if turn % 2 else (WIDTH, HEIGHT))


def test_mirrors_and_crops_are_applied_in_their_order(tmp_path):
    upside_down, left_right = box("imir", b"\0"), box("imir", b"\1")
    same(pixels(write_heic(tmp_path / "a.heic", properties=[upside_down])), expected()[::-1])
    same(pixels(write_heic(tmp_path / "b.heic", properties=[left_right])), expected()[:, ::-1])
    turned = write_heic(tmp_path / "c.heic", properties=[box("irot", b"\1"), left_right])
    same(pixels(turned), np.rot90(expected())[:, ::-1])
    # 40 × 30 in the middle, moved by 4 to the right and 3 up.
    crop = box("clap", struct.pack(">IIIIiIiI", 40, 1, 30, 1, 4, 1, -3, 1))
    same(pixels(write_heic(tmp_path / "d.heic", properties=[crop])), expected()[14:44, 32:72])


def test_exif_reaches_the_poses_and_its_orientation_is_not_applied_again(tmp_path):
    exif = exif_block({0x0112: (3, 6)}, {0xA405: (3, 26)})
    for number in range(2):
        write_heic(
            tmp_path / f"{number}.heic", exif=exif, properties=[box("irot", b"\3"), box("free", bytes([number]))]
        )
    photo, _ = read_photo_set(tmp_path).photos
    assert (photo.width_px, photo.height_px, photo.orientation) == (HEIGHT, WIDTH, 1)
    assert photo.focal_px == pytest.approx(26 / np.hypot(36, 24) * np.hypot(HEIGHT, WIDTH))
    assert read_gray(photo.path).shape == (WIDTH, HEIGHT)


def test_an_sRGB_picture_and_one_that_states_nothing(tmp_path):
    linear = decode_srgb(expected() / 255)
    for properties in ([], [nclx(1, 13)], [nclx(1, 1)], [nclx(2, 2)]):
        photo = read_photo(write_heic(tmp_path / "a.heic", properties=properties))
        assert photo.color_space == "sRGB"
        np.testing.assert_allclose(photo.linear, linear, atol=0.03)


def profile(description: str) -> bytes:
    """An ICC profile of version 4 that has no more than its name."""
    text = description.encode("utf-16-be")
    tag = b"mluc" + struct.pack(">4xII2s2sII", 1, 12, b"en", b"US", len(text), 28) + text
    return bytes(128) + struct.pack(">I4sII", 1, b"desc", 144, len(tag)) + tag


@pytest.mark.parametrize(
    "stated",
    [
        box("colr", b"prof" + profile("Display P3")),  # Apple
        box("colr", b"prof" + profile("DCI-P3 D65 Gamut with sRGB Transfer")),  # Samsung
        nclx(12, 13),
    ],
)
def test_display_p3_is_converted(tmp_path, stated):
    photo = read_photo(write_heic(tmp_path / "a.heic", properties=[stated]))
    assert photo.color_space == "Display P3"
    row, column = 4, WIDTH - 5  # red, of which Rec.709 has less
    red = decode_srgb(expected() / 255)[row, column]
    matrix = np.array([[1.2249, -0.2249, 0], [-0.0421, 1.0421, 0], [-0.0196, -0.0786, 1.0983]])  # P3 to Rec.709
    np.testing.assert_allclose(photo.linear[row, column], np.maximum(matrix @ red, 0), atol=0.03)


def test_hlg_and_pq_have_white_at_1(tmp_path):
    """75 % of HLG, and 203 cd/m² of PQ, are diffuse white (BT.2408): grey of that level is 1, in any primaries."""
    from usdfoliage.capture.folder.coded_color import CodedColor, linear_from_coded

    for transfer, level in ((18, 0.75), (16, 0.5806888810)):
        for primaries in (1, 9, 12):
            white = linear_from_coded(np.full((1, 3), level), CodedColor(primaries=primaries, transfer=transfer))
            np.testing.assert_allclose(white, 1, atol=2e-3)
    photo = read_photo(write_heic(tmp_path / "a.heic", bits=10, properties=[nclx(9, 18)]))
    assert photo.color_space == "linear"
    assert photo.linear.max() > 1.0  # above white


def test_a_capture_with_known_poses_may_hold_them(tmp_path):
    """What `leaves` and `crown` read: a view without distortion, in the colours of the photograph."""
    poses = {f"{name}.HEIC": pose for name, pose in ring(3).items()}
    for name in poses:
        (tmp_path / "images").mkdir(exist_ok=True)
        write_heic(tmp_path / "images" / name)
    lens = Lens(model="PINHOLE", width_px=WIDTH, height_px=HEIGHT, parameters=(90.0, 90.0, WIDTH / 2, HEIGHT / 2))
    write_text_model(tmp_path / "cameras", poses, [lens])
    capture = read_capture(tmp_path)
    assert len(capture.views) == 3
    view = read_views(capture).views[0]
    same(view.srgb, expected())


def test_an_opencv_without_ffmpeg_is_named(tmp_path, monkeypatch):
    path = write_heic(tmp_path / "a.heic")
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda which: False)
    with pytest.raises(CaptureError, match=r"a\.heic needs FFmpeg, and this OpenCV .* has none .*; install OpenCV"):
        read_raster(path)


def test_other_codecs_are_named(tmp_path):
    path = write_heic(tmp_path / "a.heic")
    path.write_bytes(path.read_bytes().replace(b"hvc1", b"av01"))
    with pytest.raises(CaptureError, match=r"a\.heic holds a picture coded as AV1"):
        read_raster(path)


@pytest.mark.parametrize("kept", [0.02, 0.3, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_refused(tmp_path, capfd, kept):
    whole = write_heic(tmp_path / "a.heic", grid=(2, 1, 2 * WIDTH, HEIGHT)).read_bytes()
    (tmp_path / "b.heic").write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(CaptureError, match=r"b\.heic"):
        read_raster(tmp_path / "b.heic")
    assert capfd.readouterr() == ("", "")


def test_what_states_too_much_is_refused(tmp_path):
    path = write_heic(tmp_path / "a.heic", grid=(2, 1, 60_000, 60_000))
    with pytest.raises(CaptureError, match="60000×60000 pixels, 3600 million"):
        read_raster(path)
    path = write_heic(tmp_path / "b.heic", grid=(1, 1, WIDTH + 1, HEIGHT))
    with pytest.raises(CaptureError, match="do not make"):
        read_raster(path)
    path = write_heic(tmp_path / "c.heic", properties=[full_box("free", b"")])
    stored = path.read_bytes()
    path.write_bytes(stored.replace(b"ipco", b"ipcx"))
    with pytest.raises(CaptureError, match="no properties"):
        read_raster(path)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_no_damage_ends_in_anything_but_a_picture_or_an_error(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("heic")
    stored = bytearray(write_heic(folder / "a.heic", grid=(2, 1, 100, 40), exif=exif_block({}, {})).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        stored[data.draw(st.integers(12, len(stored) - 1))] = data.draw(st.integers(0, 255))
    (folder / "b.heic").write_bytes(stored)
    with suppress(CaptureError):
        assert read_raster(folder / "b.heic").color.shape[2] == 3
