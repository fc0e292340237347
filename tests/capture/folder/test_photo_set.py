"""Which files of a folder are photographs that can be used."""

import shutil

import cv2
import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from usdfoliage.capture.folder.photo_set import PhotoSetSettings, read_colors, read_gray, read_photo_set
from usdfoliage.errors import CaptureError
from usdfoliage.remarks import as_plan_setting


def noise(size=(80, 60), seed=0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)


def write(path, pixels, **attributes) -> None:
    """By OpenImageIO, which writes EXIF."""
    path.parent.mkdir(parents=True, exist_ok=True)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], str(pixels.dtype))
    for name, value in attributes.items():
        name = name.replace("__", ":")
        if isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(f"float[{len(value)}]"), value)
        else:
            spec.attribute(name, value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), out.geterror()
    assert out.write_image(pixels)
    out.close()


def test_good_ones_among_bad(tmp_path):
    for number in range(3):
        write(tmp_path / f"{number}.png", noise(seed=number))
    shutil.copy(tmp_path / "1.png", tmp_path / "z.png")
    (tmp_path / "empty.jpg").touch()
    (tmp_path / "text.jpg").write_text("no picture")
    (tmp_path / "torn.png").write_bytes((tmp_path / "0.png").read_bytes()[:900])
    (tmp_path / "notes.txt").write_text("not looked at")
    (tmp_path / "walk.MOV").touch()
    (tmp_path / "raw.CR2").touch()
    (tmp_path / "0.dng").touch()  # beside its photograph
    calls: list[tuple[int, int]] = []
    found = read_photo_set(tmp_path, progress=lambda *done: calls.append(done))
    assert [photo.name for photo in found.photos] == ["0.png", "1.png", "2.png"]
    reasons = {item.name: item.reason for item in found.dropped}
    assert list(reasons) == ["empty.jpg", "raw.CR2", "text.jpg", "torn.png", "z.png"]
    assert "0 bytes" in reasons["empty.jpg"]
    assert "truncated" in reasons["torn.png"]
    assert reasons["z.png"] == "a copy of 1.png"
    assert any("give the video itself, walk.MOV" in each.sentence(as_plan_setting) for each in found.remarks)
    assert ("raw-photographs-not-used", "0.dng") in [(each.code, each.subject) for each in found.remarks]
    assert calls[-1] == (8, 8)


def test_only_some(tmp_path):
    for number in range(3):
        write(tmp_path / "below" / f"{number}.png", noise(seed=number))
    assert [photo.name for photo in read_photo_set(tmp_path, ["below/1.png"]).photos] == ["below/1.png"]
    with pytest.raises(CaptureError, match=r"has no x\.png"):
        read_photo_set(tmp_path, ["x.png"])


@pytest.mark.parametrize(
    ("name", "message"),
    [("a.mp4", "a video, a.mp4; to use it"), ("a.dng", "none of 1 photograph"), ("a.txt", "no photographs")],
)
def test_no_photograph_at_all(tmp_path, name, message):
    (tmp_path / name).touch()
    with pytest.raises(CaptureError, match=message):
        read_photo_set(tmp_path)


def test_no_folder_and_none_readable(tmp_path):
    with pytest.raises(CaptureError, match="no folder"):
        read_photo_set(tmp_path / "none")
    (tmp_path / "a.jpg").touch()
    with pytest.raises(CaptureError, match="none of 1 photograph"):
        read_photo_set(tmp_path)


def scenery(seed: int) -> np.ndarray:
    """(300, 400, 3), as much detail at every size, as in pictures of the world."""
    rng = np.random.default_rng(seed)
    layers = [cv2.resize(rng.normal(0, 20, (300 // step, 400 // step, 3)), (400, 300)) for step in (1, 2, 4, 8, 16, 32)]
    return np.clip(128 + sum(layers), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("blur", ["focus", "shake"])
def test_blur_is_relative_to_the_set(tmp_path, blur):
    for number in range(5):
        pixels = scenery(number)
        if number == 3:
            shaken = cv2.blur(pixels, (9, 1))
            pixels = shaken if blur == "shake" else cv2.GaussianBlur(pixels, (0, 0), 3.0)
        write(tmp_path / f"{number}.png", np.ascontiguousarray(pixels))
    found = read_photo_set(tmp_path)
    assert found.blurred == ("3.png",)
    assert len(found.photos) == 5  # it is used all the same
    assert ("photographs-blurred", "3.png") in [(each.code, each.subject) for each in found.remarks]
    assert read_photo_set(tmp_path, settings=PhotoSetSettings(blurred_below=0)).blurred == ()


def test_sizes_and_orientations(tmp_path):
    write(tmp_path / "a.png", noise((80, 60)))
    write(tmp_path / "b.png", noise((60, 80)))
    write(tmp_path / "c.jpg", noise((80, 60), 3), Orientation=6)
    found = read_photo_set(tmp_path)
    assert [(photo.width_px, photo.height_px, photo.orientation) for photo in found.photos] == [
        (80, 60, 1), (60, 80, 1), (80, 60, 6),
    ]  # fmt: skip
    assert any("2 sizes (60×80, 80×60)" in each.text for each in found.remarks)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_pixels_are_as_stored_whatever_the_orientation(tmp_path, orientation):
    ramp = np.repeat(np.linspace(0, 255, 60, dtype=np.uint8)[:, None], 80, axis=1)
    write(tmp_path / "a.tif", np.ascontiguousarray(np.stack([ramp, ramp, ramp], axis=2)), Orientation=orientation)
    np.testing.assert_array_equal(read_gray(tmp_path / "a.tif"), ramp)
    np.testing.assert_array_equal(read_colors(tmp_path / "a.tif")[..., 1], ramp)


def test_16_bits_floats_and_gray(tmp_path):
    srgb = noise((80, 60))
    write(tmp_path / "a.png", srgb)
    write(tmp_path / "b.png", srgb.astype(np.uint16) * 257)
    write(tmp_path / "c.png", srgb[..., :1].copy())
    linear = ((srgb / 255 + 0.055) / 1.055) ** 2.4
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": np.where(srgb <= 10, srgb / 255 / 12.92, linear).astype(np.float32)}).write(
        str(tmp_path / "d.exr")
    )
    assert len(read_photo_set(tmp_path).photos) == 4
    gray = read_gray(tmp_path / "a.png").astype(int)
    assert np.abs(read_gray(tmp_path / "b.png") - gray).max() <= 1
    assert np.abs(read_gray(tmp_path / "d.exr") - gray).max() <= 3  # white is what the brightest are
    np.testing.assert_array_equal(read_gray(tmp_path / "c.png"), srgb[..., 0])
    np.testing.assert_array_equal(read_colors(tmp_path / "c.png"), np.repeat(srgb[..., :1], 3, axis=2))
    assert read_gray(tmp_path / "a.png", max_side_px=40).shape == (30, 40)


def test_exif_is_read(tmp_path):
    write(
        tmp_path / "a.jpg", noise((360, 240)), Make="Maker", Model="One", Exif__FocalLengthIn35mmFilm=50,
        GPS__Latitude=(46.0, 30.0, 36.0), GPS__LatitudeRef="S", GPS__Longitude=(8.0, 0.0, 0.0), GPS__LongitudeRef="E",
        GPS__Altitude=412.5,
    )  # fmt: skip
    write(tmp_path / "b.jpg", noise((360, 240), 1))
    first, second = read_photo_set(tmp_path).photos
    assert first.camera == "Maker One"
    assert first.focal_px == pytest.approx(500, rel=1e-6)  # 50 mm of 36
    assert first.gps is not None
    np.testing.assert_allclose(first.gps, (-46.51, 8, 412.5), atol=1e-4)
    assert (second.camera, second.focal_px, second.gps, second.elevation_deg) == ("", None, None, None)


@pytest.mark.parametrize("wrong", [-0.1, 1.0])
def test_wrong_settings(wrong):
    with pytest.raises(ValueError, match="blurred_below"):
        PhotoSetSettings(blurred_below=wrong)
