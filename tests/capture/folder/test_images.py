import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest
from usdfoliage.capture.folder import raster
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.color import decode_srgb

HEIGHT, WIDTH = 40, 56


@pytest.fixture
def colors() -> np.ndarray:
    """(H, W, 3) uint8, smooth, with four different corners."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.dstack([4 * columns, 6 * rows, 2 * rows + 2 * columns]).astype(np.uint8)


def write_image(path: Path, pixels: np.ndarray, kind: str = "", **attributes: object) -> Path:
    """Write with OpenImageIO; in the names of attributes, __ stands for a colon."""
    pixels = np.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[..., None])
    spec = oiio.ImageSpec(
        pixels.shape[1],
        pixels.shape[0],
        pixels.shape[2],
        kind or oiio.TypeDesc(str(pixels.dtype).replace("float32", "float")),
    )
    for name, value in attributes.items():
        if name == "channelnames":
            spec.channelnames = value
        elif isinstance(value, np.ndarray):
            spec.attribute(
                name, oiio.TypeDesc(f"{'float' if value.dtype == np.float32 else 'uint8'}[{value.size}]"), value
            )
        else:
            spec.attribute(name.replace("__", ":"), value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(pixels), output.geterror()
    output.close()
    return path


def icc_profile(description: str) -> np.ndarray:
    """The smallest profile that has a name."""
    text = b"desc" + bytes(4) + struct.pack(">I", len(description) + 1) + description.encode() + bytes(79)
    tags = struct.pack(">I4sII", 1, b"desc", 144, len(text))
    header = struct.pack(">I4xI", 128 + len(tags) + len(text), 0x02400000) + b"mntrRGB XYZ " + bytes(12) + b"acsp"
    return np.frombuffer(header.ljust(128, b"\0") + tags + text, np.uint8)


def cmyk_jpeg(planes: np.ndarray) -> bytes:
    """A JPEG of four channels, out of four grey ones that share their tables: one scan a channel."""
    streams = []
    for channel in range(4):
        flags = [cv2.IMWRITE_JPEG_QUALITY, 100]
        ok, data = cv2.imencode(".jpg", planes[..., channel], flags)
        assert ok
        streams.append(data.tobytes())
    segments, position = {}, 2
    while True:
        marker, length = struct.unpack(">HH", streams[0][position : position + 4])
        segments.setdefault(marker, []).append(streams[0][position : position + 2 + length])
        position += 2 + length
        if marker == 0xFFDA:
            break
    height, width = planes.shape[:2]
    frame = struct.pack(">HHBHHB", 0xFFC0, 20, 8, height, width, 4)
    frame += b"".join(bytes([channel + 1, 0x11, 0]) for channel in range(4))
    adobe = struct.pack(">HH", 0xFFEE, 14) + b"Adobe" + bytes([0, 100, 0, 0, 0, 0, 0])
    scans = b"".join(
        struct.pack(">HHBBBBBB", 0xFFDA, 8, 1, channel + 1, 0, 0, 63, 0) + stream[position:-2]
        for channel, stream in enumerate(streams)
    )
    return b"\xff\xd8" + adobe + b"".join(segments[0xFFDB]) + frame + b"".join(segments[0xFFC4]) + scans + b"\xff\xd9"


# What is read


def test_png_of_8_bits_is_decoded_exactly(tmp_path, colors):
    photo = read_photo(write_image(tmp_path / "photo.png", colors))
    assert photo.linear.dtype == np.float32
    assert (photo.height_px, photo.width_px) == (HEIGHT, WIDTH)
    assert photo.color_space == "sRGB"
    assert photo.alpha is None
    np.testing.assert_array_equal(photo.linear, decode_srgb(colors / 255).astype(np.float32))


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_16_bits_keep_every_level(tmp_path, suffix):
    levels = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    pixels = np.dstack([levels, levels[::-1], levels.T])
    photo = read_photo(write_image(tmp_path / f"photo.{suffix}", pixels), color_space="linear")
    np.testing.assert_array_equal(np.rint(photo.linear.astype(np.float64) * 65535), pixels)
    encoded = read_photo(tmp_path / f"photo.{suffix}")
    assert len(np.unique(encoded.linear)) == 65536


@pytest.mark.parametrize(
    ("name", "bound"),
    [("photo.jpg", 0.05), ("photo.tif", 1e-6), ("photo.bmp", 1e-6), ("photo.webp", 0.15), ("PHOTO.PNG", 1e-6)],
)
def test_formats(tmp_path, colors, name, bound):
    photo = read_photo(write_image(tmp_path / name, colors))
    assert np.abs(photo.linear - decode_srgb(colors / 255)).max() < bound


def test_progressive_jpeg(tmp_path, colors):
    cv2.imwrite(str(tmp_path / "photo.jpg"), colors[..., ::-1], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    assert np.abs(read_photo(tmp_path / "photo.jpg").linear - decode_srgb(colors / 255)).max() < 0.05


def test_grey_is_three_equal_channels(tmp_path, colors):
    photo = read_photo(write_image(tmp_path / "grey.png", colors[..., 1]))
    assert photo.linear.shape == (HEIGHT, WIDTH, 3)
    np.testing.assert_array_equal(photo.linear[..., 0], decode_srgb(colors[..., 1] / 255).astype(np.float32))
    np.testing.assert_array_equal(photo.linear[..., 0], photo.linear[..., 2])


def test_palette_png(tmp_path):
    table = np.array([[0, 0, 0], [255, 0, 0], [40, 160, 30]], np.uint8)
    indices = (np.arange(32 * 32).reshape(32, 32) // 7 % 3).astype(np.uint8)
    write_palette_png(tmp_path / "palette.png", indices, table)
    photo = read_photo(tmp_path / "palette.png")
    np.testing.assert_array_equal(photo.linear, decode_srgb(table[indices] / 255).astype(np.float32))


def write_palette_png(path: Path, indices: np.ndarray, table: np.ndarray) -> None:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width = indices.shape
    rows = b"".join(b"\0" + row.tobytes() for row in indices)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0))
        + chunk(b"PLTE", table.tobytes())
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("kind", ["half", "float"])
def test_exr_is_linear_as_it_is(tmp_path, kind):
    values = np.linspace(0, 40, HEIGHT * WIDTH * 3).reshape(HEIGHT, WIDTH, 3).astype(np.float16).astype(np.float32)
    photo = read_photo(write_image(tmp_path / "photo.exr", values, kind))
    assert photo.color_space == "linear"
    np.testing.assert_array_equal(photo.linear, values)


def test_float_tiff_is_linear(tmp_path, colors):
    photo = read_photo(write_image(tmp_path / "photo.tif", (colors / 255).astype(np.float32)))
    assert photo.color_space == "linear"
    np.testing.assert_array_equal(photo.linear, (colors / 255).astype(np.float32))


def test_exr_channels_are_found_by_name(tmp_path, colors):
    values = (colors / 255).astype(np.float32)
    extra = np.full((HEIGHT, WIDTH, 1), -7, np.float32)  # a depth may be negative, or infinite
    names = ("Z", "B", "G", "R")
    write_image(tmp_path / "p.exr", np.concatenate([extra, values[..., ::-1]], axis=2), channelnames=names)
    np.testing.assert_array_equal(read_photo(tmp_path / "p.exr").linear, values)


def test_exr_shows_its_display_window(tmp_path):
    spec = oiio.ImageSpec(20, 30, 3, "float")
    spec.x, spec.y = 10, -5
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = 0, 0, 40, 35
    values = np.random.default_rng(0).random((30, 20, 3), np.float32)
    output = oiio.ImageOutput.create(str(tmp_path / "w.exr"))
    assert output.open(str(tmp_path / "w.exr"), spec)
    assert output.write_image(values)
    output.close()
    expected = np.zeros((35, 40, 3), np.float32)
    expected[:25, 10:30] = values[5:]
    np.testing.assert_array_equal(read_photo(tmp_path / "w.exr").linear, expected)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["jpg", "tif"])
def test_orientation(tmp_path, colors, orientation, suffix):
    # EXIF 2.32, tag 0x0112: which side of the picture the stored row 0 and column 0 are.
    upright_from_stored = {
        1: lambda a: a,
        2: np.fliplr,
        3: lambda a: np.rot90(a, 2),
        4: np.flipud,
        5: lambda a: a.transpose(1, 0, 2),
        6: lambda a: np.rot90(a, -1),
        7: lambda a: np.rot90(a, 2).transpose(1, 0, 2),
        8: lambda a: np.rot90(a, 1),
    }[orientation]
    photo = read_photo(write_image(tmp_path / f"turned.{suffix}", colors, Orientation=orientation))
    expected = decode_srgb(upright_from_stored(colors) / 255)
    assert photo.orientation == orientation
    assert photo.linear.shape == expected.shape
    assert np.abs(photo.linear - expected).max() < 0.05


def cmyk_planes() -> np.ndarray:
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.dstack([4 * columns, 6 * rows, 2 * rows + 2 * columns, 3 * rows]).astype(np.uint8)


def rgb_of_cmyk(planes: np.ndarray) -> np.ndarray:
    ink = planes / 255
    return decode_srgb((1 - ink[..., :3]) * (1 - ink[..., 3:]))


def test_cmyk_tiff(tmp_path, caplog):
    planes = cmyk_planes()
    path = write_image(
        tmp_path / "cmyk.tif",
        planes,
        channelnames=("C", "M", "Y", "K"),
        tiff__ColorSpace="CMYK",
        oiio__ColorSpace="CMYK",
    )
    with caplog.at_level("INFO"):
        photo = read_photo(path)
    assert np.abs(photo.linear - rgb_of_cmyk(planes)).max() < 0.01
    assert photo.alpha is None
    assert "CMYK" in caplog.text


def test_cmyk_jpeg(tmp_path, caplog):
    planes = cmyk_planes()
    (tmp_path / "cmyk.jpg").write_bytes(cmyk_jpeg(255 - planes))  # Adobe stores the ink inverted
    with caplog.at_level("INFO"):
        photo = read_photo(tmp_path / "cmyk.jpg")
    assert np.abs(photo.linear - rgb_of_cmyk(planes)).max() < 0.05
    assert "CMYK" in caplog.text


def test_straight_alpha_is_a_hint_and_leaves_the_colour(tmp_path, colors):
    alpha = np.linspace(0, 255, WIDTH).astype(np.uint8)[None, :].repeat(HEIGHT, axis=0)
    cv2.imwrite(str(tmp_path / "a.png"), np.dstack([colors[..., ::-1], alpha]))
    photo = read_photo(tmp_path / "a.png")
    np.testing.assert_array_equal(photo.linear, decode_srgb(colors / 255).astype(np.float32))
    np.testing.assert_allclose(photo.alpha, alpha / 255, atol=1e-6)


def test_premultiplied_alpha_is_divided_out(tmp_path, colors):
    straight = (colors / 255).astype(np.float32)
    alpha = np.linspace(0, 1, WIDTH, dtype=np.float32)[None, :, None].repeat(HEIGHT, axis=0)
    path = write_image(tmp_path / "a.exr", np.concatenate([straight * alpha, alpha], axis=2))
    photo = read_photo(path)
    np.testing.assert_allclose(photo.linear[:, 1:], straight[:, 1:], rtol=1e-5)
    assert not photo.linear[:, 0].any()


def test_constant_alpha_is_no_hint(tmp_path, colors):
    opaque = np.full((HEIGHT, WIDTH, 1), 255, np.uint8)
    assert read_photo(write_image(tmp_path / "a.png", np.concatenate([colors, opaque], axis=2))).alpha is None


def test_first_page_is_read(tmp_path, colors):
    cv2.imwritemulti(str(tmp_path / "pages.tif"), [colors[..., ::-1], colors])
    np.testing.assert_array_equal(
        read_photo(tmp_path / "pages.tif").linear, decode_srgb(colors / 255).astype(np.float32)
    )


@pytest.mark.parametrize("name", ["with space.png", "Bäume – 木.png", "50%d #1?.png"])
def test_names(tmp_path, colors, name):
    folder = tmp_path / "a b"
    folder.mkdir()
    write_image(tmp_path / "plain.png", colors).rename(folder / name)
    assert read_photo(folder / ".." / "a b" / name).height_px == HEIGHT


# Colour spaces


def test_override(tmp_path, colors):
    path = write_image(tmp_path / "p.png", colors)
    np.testing.assert_array_equal(read_photo(path, color_space="linear").linear, (colors / 255).astype(np.float32))


@pytest.mark.parametrize("suffix", ["jpg", "tif"])
def test_adobe_rgb_profile(tmp_path, suffix):
    pixels = np.full((HEIGHT, WIDTH, 3), (120, 140, 100), np.uint8)
    path = write_image(tmp_path / f"p.{suffix}", pixels, ICCProfile=icc_profile("Adobe RGB (1998)"))
    photo = read_photo(path)
    # Adobe RGB (1998), section 4.3.6, to XYZ, and IEC 61966-2-1 from there.
    xyz_from_adobe = np.array([[0.57667, 0.18556, 0.18823], [0.29734, 0.62736, 0.07529], [0.02703, 0.07069, 0.99134]])
    srgb_from_xyz = np.array(
        [
            [3.24096994, -1.53738318, -0.49861076],
            [-0.96924364, 1.8759675, 0.04155506],
            [0.05563008, -0.20397696, 1.05697151],
        ]
    )
    expected = srgb_from_xyz @ xyz_from_adobe @ (np.array([120, 140, 100]) / 255) ** 2.19921875
    assert photo.color_space == "Adobe RGB"
    np.testing.assert_allclose(photo.linear[20, 20], expected, atol=0.008)


def test_unknown_profile_is_read_as_srgb_with_a_warning(tmp_path, colors):
    path = write_image(tmp_path / "p.tif", colors, ICCProfile=icc_profile("Grandmother's scanner"))
    photo = read_photo(path)
    assert photo.color_space == "sRGB"
    (unknown,) = photo.remarks
    assert (unknown.code, unknown.severity, unknown.subject) == ("color-profile-unknown", "warning", "p.tif")
    assert "Grandmother's scanner" in unknown.text
    assert read_photo(path, color_space="sRGB").remarks == ()


def test_aces_exr_by_its_chromaticities(tmp_path):
    ap1 = np.array([0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767], np.float32)
    grey = np.full((HEIGHT, WIDTH, 3), 0.18, np.float32)
    photo = read_photo(write_image(tmp_path / "p.exr", grey, chromaticities=ap1))
    assert photo.color_space == "ACEScg"
    np.testing.assert_allclose(photo.linear, 0.18, atol=1e-4)  # grey stays grey


def test_strange_chromaticities_are_refused(tmp_path):
    strange = np.array([0.9, 0.1, 0.1, 0.9, 0.1, 0.1, 0.3, 0.3], np.float32)
    path = write_image(tmp_path / "p.exr", np.ones((HEIGHT, WIDTH, 3), np.float32), chromaticities=strange)
    with pytest.raises(CaptureError, match="chromaticities"):
        read_photo(path)
    assert read_photo(path, color_space="linear").color_space == "linear"


def test_unknown_color_space(tmp_path, colors):
    with pytest.raises(CaptureError, match=r"'mud' of .*p.png is unknown; use sRGB, linear"):
        read_photo(write_image(tmp_path / "p.png", colors), color_space="mud")


# What is refused


def refuse(path: Path, match: str) -> None:
    with pytest.raises(CaptureError, match=match) as caught:
        read_photo(path)
    message = str(caught.value)
    assert path.name in message
    assert "\n" not in message
    assert "; " in message  # what to do


def test_missing(tmp_path):
    refuse(tmp_path / "none.jpg", "does not exist")


def test_folder(tmp_path):
    refuse(tmp_path, "is a folder")


def test_pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe.jpg")
    refuse(tmp_path / "pipe.jpg", "not a regular file")


def test_empty_file(tmp_path):
    (tmp_path / "zero.jpg").touch()
    refuse(tmp_path / "zero.jpg", "0 bytes")


def test_impossible_names(tmp_path):
    for name in ("a\0b.png", "x" * 300 + ".png"):
        with pytest.raises(CaptureError):
            read_photo(tmp_path / name)


def test_name_that_is_not_unicode(tmp_path, colors):
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff.png"))
    write_image(tmp_path / "p.png", colors).rename(path)
    with pytest.raises(CaptureError, match="not valid Unicode"):
        read_photo(path)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_no_permission(tmp_path, colors):
    path = write_image(tmp_path / "secret.png", colors)
    path.chmod(0)
    os.seteuid(65534)
    try:
        refuse(path, "[Pp]ermission")
    finally:
        os.seteuid(0)


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif", "exr", "null", "tga", "txt", "webp", "hdr"])
def test_text_is_not_an_image(tmp_path, suffix):
    (tmp_path / f"letter.{suffix}").write_text("Dear photographer,\n" * 20)
    refuse(tmp_path / f"letter.{suffix}", "not an image")


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.995])
@pytest.mark.parametrize("suffix", ["jpg", "progressive.jpg", "png", "tif", "exr"])
def test_truncated(tmp_path, suffix, share):
    noise = np.random.default_rng(1).integers(0, 256, (200, 300, 3), dtype=np.uint8)
    path = tmp_path / f"cut.{suffix}"
    if suffix == "progressive.jpg":
        cv2.imwrite(str(path), noise, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    elif suffix == "exr":
        write_image(path, noise / np.float32(255), "half")
    else:
        write_image(path, noise)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refuse(path, "truncated|not an image")


def test_jpeg_without_its_last_marker(tmp_path, colors):
    path = write_image(tmp_path / "cut.jpg", colors)
    path.write_bytes(path.read_bytes()[:-2])
    refuse(path, "truncated")


def test_jpeg_cut_and_closed_again(tmp_path):
    noise = np.random.default_rng(1).integers(0, 256, (200, 300, 3), dtype=np.uint8)
    path = write_image(tmp_path / "cut.jpg", noise)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] + b"\xff\xd9")
    refuse(path, "truncated or damaged")


def test_png_without_its_end(tmp_path, colors):
    path = write_image(tmp_path / "cut.png", colors)
    path.write_bytes(path.read_bytes()[:-12])
    refuse(path, "truncated")


@pytest.mark.parametrize("size", [(1, 1), (15, 400), (400, 15)])
def test_too_small(tmp_path, size):
    refuse(
        write_image(tmp_path / "tiny.png", np.zeros((*size, 3), np.uint8)), f"{size[1]}×{size[0]} pixels; at least 16"
    )


def test_decompression_bomb(tmp_path):
    path = write_image(tmp_path / "bomb.png", np.zeros((64, 64, 3), np.uint8))
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", 40_000, 40_000)
    data[29:33] = struct.pack(">I", zlib.crc32(bytes(data[12:29])))
    path.write_bytes(data)
    refuse(path, "malicious")


def test_too_many_pixels(tmp_path, monkeypatch):
    path = write_image(tmp_path / "wide.png", np.zeros((100, 1000, 3), np.uint8))
    monkeypatch.setattr(raster, "MAX_PIXELS", 50_000)
    refuse(path, "states 1000×100 pixels")


@pytest.mark.parametrize(("bad", "kind"), [(np.nan, "not a number"), (np.inf, "infinite"), (-0.25, "negative")])
@pytest.mark.parametrize("name", ["p.exr", "p.tif"])
def test_bad_values(tmp_path, bad, kind, name):
    values = np.ones((HEIGHT, WIDTH, 3), np.float32)
    values[7, 11, 1] = bad
    values[30, 2, 0] = bad
    refuse(write_image(tmp_path / name, values), rf"2 values .*{kind}.* column 11, row 7, channel G: {bad:g}")


def test_channels_without_a_picture(tmp_path):
    values = np.ones((HEIGHT, WIDTH, 2), np.float32)
    refuse(write_image(tmp_path / "p.exr", values, channelnames=("N.x", "N.y")), r"2 channels \(N.x, N.y\)")


def test_nothing_is_printed(tmp_path, colors):
    """The decoders' own words would stand beside the one line of the error."""
    good = write_image(tmp_path / "p.png", colors).read_bytes()
    (tmp_path / "p.png").write_bytes(good[: len(good) // 2])
    jpeg = write_image(tmp_path / "p.jpg", colors).read_bytes()
    (tmp_path / "p.jpg").write_bytes(jpeg[: len(jpeg) // 2])
    program = (
        "import sys\nfrom usdfoliage.capture.folder.images import read_photo\n"
        "from usdfoliage.errors import CaptureError\n"
        "for name in sys.argv[1:]:\n"
        "    try: read_photo(name)\n    except CaptureError: pass\n    else: raise SystemExit('accepted')\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", program, tmp_path / "p.png", tmp_path / "p.jpg"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout + run.stderr == ""


def test_random_damage_never_raises_anything_else(tmp_path, colors):
    rng = np.random.default_rng(5)
    for suffix in ("jpg", "png", "tif", "exr"):
        pixels = colors / np.float32(255) if suffix == "exr" else colors
        whole = np.frombuffer(write_image(tmp_path / f"p.{suffix}", pixels).read_bytes(), np.uint8)
        for _ in range(12):
            damaged = whole.copy()
            damaged[rng.integers(0, min(len(whole), 600), 4)] = rng.integers(0, 256, 4)
            path = tmp_path / f"q.{suffix}"
            path.write_bytes(damaged.tobytes())
            try:
                photo = read_photo(path)
            except CaptureError:
                continue
            assert np.isfinite(photo.linear).all()
            assert photo.linear.size <= 3 * raster.MAX_PIXELS
