import cv2
import numpy as np
import OpenEXR
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from usdfoliage.capture.folder.depth_map import read_depth
from usdfoliage.errors import CaptureError

from tests.support import captures

WIDTH, HEIGHT = 40, 30
COMPRESSIONS = {
    "none": OpenEXR.NO_COMPRESSION,
    "zip": OpenEXR.ZIP_COMPRESSION,
    "zips": OpenEXR.ZIPS_COMPRESSION,
    "rle": OpenEXR.RLE_COMPRESSION,
    "piz": OpenEXR.PIZ_COMPRESSION,
    "pxr24": OpenEXR.PXR24_COMPRESSION,
}


@pytest.fixture
def depth_m() -> np.ndarray:
    return np.random.default_rng(0).uniform(0.5, 4, (HEIGHT, WIDTH)).astype(np.float32)


def test_metres(tmp_path, depth_m):
    depth_m[:5] = 0
    read = read_depth(captures.write_depth(tmp_path / "a.exr", depth_m), WIDTH, HEIGHT)
    np.testing.assert_array_equal(read.depth_m, depth_m)
    assert read.depth_m.dtype == np.float32
    assert (read.channel, read.not_finite, read.negative, read.far) == ("Z", 0, 0, 0)


def test_half_precision(tmp_path, depth_m):
    half = depth_m.astype(np.float16)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Z": half}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_depth(tmp_path / "a.exr", WIDTH, HEIGHT).depth_m, half.astype(np.float32))


def test_what_is_no_distance_is_none_and_counted(tmp_path, depth_m):
    depth_m[0, :3] = np.nan
    depth_m[1, :2] = np.inf, -np.inf
    depth_m[2, :4] = -1
    depth_m[3, :6] = 1e10
    read = read_depth(captures.write_depth(tmp_path / "a.exr", depth_m), WIDTH, HEIGHT)
    assert (read.not_finite, read.negative, read.far) == (5, 4, 6)
    assert np.count_nonzero(read.depth_m == 0) == 15
    assert np.isfinite(read.depth_m).all()
    assert (read.depth_m >= 0).all()


@pytest.mark.parametrize("channel", ["Y", "R", "depth", "Depth"])
def test_a_single_channel_of_another_name(tmp_path, depth_m, channel):
    read = read_depth(captures.write_depth(tmp_path / "a.exr", depth_m, channel), WIDTH, HEIGHT)
    np.testing.assert_array_equal(read.depth_m, depth_m)
    assert read.channel == channel


def test_z_among_others(tmp_path, depth_m):
    channels = {name: depth_m * factor for name, factor in {"R": 2, "G": 3, "B": 4, "Z": 1}.items()}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(tmp_path / "a.exr"))
    read = read_depth(tmp_path / "a.exr", WIDTH, HEIGHT)
    np.testing.assert_array_equal(read.depth_m, depth_m)
    assert read.channel == "Z"


def test_a_picture_is_no_depth(tmp_path, depth_m):
    OpenEXR.File({"type": OpenEXR.scanlineimage}, dict.fromkeys("RGB", depth_m)).write(str(tmp_path / "a.exr"))
    with pytest.raises(CaptureError, match="one called Z"):
        read_depth(tmp_path / "a.exr", WIDTH, HEIGHT)


def test_millimetres(tmp_path):
    values = np.random.default_rng(0).integers(0, 65536, (HEIGHT, WIDTH)).astype(np.uint16)
    assert cv2.imwrite(str(tmp_path / "a.png"), values)
    read = read_depth(tmp_path / "a.png", WIDTH, HEIGHT)
    np.testing.assert_allclose(read.depth_m, values / 1000, rtol=1e-6)
    assert read.channel == ""


@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)])
def test_eight_bits_are_no_depth(tmp_path, shape):
    assert cv2.imwrite(str(tmp_path / "a.png"), np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8))
    with pytest.raises(CaptureError, match=r"channels of uint8; depth in PNG must be grey of 16 bits"):
        read_depth(tmp_path / "a.png", WIDTH, HEIGHT)


@pytest.mark.parametrize("suffix", [".exr", ".png"])
def test_another_size_names_both(tmp_path, depth_m, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".exr":
        captures.write_depth(path, depth_m)
    else:
        assert cv2.imwrite(str(path), np.ones((HEIGHT, WIDTH), np.uint16))
    with pytest.raises(CaptureError, match=f"a{suffix} is 40×30 pixels, its photograph 80×60"):
        read_depth(path, 2 * WIDTH, 2 * HEIGHT)


def write_windows(path, values, data, display):
    def window(left, top, width, height):
        return np.array([left, top], np.int32), np.array([left + width - 1, top + height - 1], np.int32)

    header = {"type": OpenEXR.scanlineimage, "dataWindow": window(*data), "displayWindow": window(*display)}
    OpenEXR.File(header, {"Z": np.ascontiguousarray(values, np.float32)}).write(str(path))


def test_a_crop_is_put_in_its_place(tmp_path, depth_m):
    write_windows(tmp_path / "a.exr", depth_m[5:15, 10:30], (10, 5, 20, 10), (0, 0, WIDTH, HEIGHT))
    expected = np.zeros_like(depth_m)
    expected[5:15, 10:30] = depth_m[5:15, 10:30]
    np.testing.assert_array_equal(read_depth(tmp_path / "a.exr", WIDTH, HEIGHT).depth_m, expected)


def test_overscan_is_cut_off(tmp_path, depth_m):
    write_windows(tmp_path / "a.exr", depth_m, (-4, -3, WIDTH, HEIGHT), (0, 0, 30, 20))
    np.testing.assert_array_equal(read_depth(tmp_path / "a.exr", 30, 20).depth_m, depth_m[3:23, 4:34])


@pytest.mark.parametrize("content", [b"", b"no picture", b"\x76\x2f\x31\x01"])
def test_no_exr(tmp_path, content):
    (tmp_path / "a.exr").write_bytes(content)
    with pytest.raises(CaptureError, match=r"a\.exr is no OpenEXR file"):
        read_depth(tmp_path / "a.exr", WIDTH, HEIGHT)


def test_no_file(tmp_path):
    with pytest.raises(CaptureError, match="does not exist"):
        read_depth(tmp_path / "a.exr", WIDTH, HEIGHT)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_truncated(tmp_path, depth_m, compression):
    path = tmp_path / "a.exr"
    header = {"compression": COMPRESSIONS[compression], "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Z": depth_m}).write(str(path))
    data = path.read_bytes()
    for share in (0.05, 0.3, 0.7, 0.95):
        path.write_bytes(data[: int(share * len(data))])
        with pytest.raises(CaptureError, match=r"a\.exr"):
            read_depth(path, WIDTH, HEIGHT)


@pytest.mark.parametrize("compression", COMPRESSIONS)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_is_damaged_is_a_capture_error(tmp_path, depth_m, compression, data, capfd):
    path = tmp_path / "a.exr"
    header = {"compression": COMPRESSIONS[compression], "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Z": depth_m}).write(str(path))
    content = bytearray(path.read_bytes())
    last = data.draw(st.sampled_from([400, len(content)])) - 1  # half of them in the header
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, last))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    try:
        read = read_depth(path, WIDTH, HEIGHT)
    except CaptureError as error:
        assert "a.exr" in str(error)  # noqa: PT017 - some are still right
    else:
        assert read.depth_m.shape == (HEIGHT, WIDTH)
        assert np.isfinite(read.depth_m).all()
    assert capfd.readouterr() == ("", "")
