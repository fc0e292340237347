"""Cubemap files: what is written comes back, and OpenEXR's own tools agree that it is a cubemap."""

import logging
import shutil
import subprocess

import numpy as np
import OpenEXR
import pytest
from usdfoliage.asset.materials.cubemap_exr import read_cubemap, write_color_cubemap, write_radius_cubemap
from usdfoliage.errors import AssetError
from usdfoliage.geometry.cubemap import face_directions, share_borders, texel_identity


@pytest.fixture
def radius_m():
    rng = np.random.default_rng(1)
    return share_borders((1 + rng.random((6, 9, 9))).astype(np.float32))


@pytest.fixture
def color():
    rng = np.random.default_rng(2)
    return share_borders(rng.random((6, 9, 9, 3)).astype(np.float32))


def run_tool(*arguments):
    if shutil.which(arguments[0]) is None:
        pytest.skip(f"{arguments[0]} is absent; on Debian: apt-get install openexr")
    return subprocess.run(arguments, capture_output=True, text=True, check=False)


def test_radius_comes_back_exactly(tmp_path, radius_m):
    path = tmp_path / "r.exr"
    write_radius_cubemap(path, radius_m, {"foliage:crown:center": "0 2 0"})
    found = read_cubemap(path)
    assert found.pixels.dtype == np.float32
    np.testing.assert_array_equal(found.pixels, radius_m)
    assert found.attributes == {
        "foliage:quantity": "radius",
        "foliage:unit": "m",
        "foliage:cube:sampling": "edge",
        "foliage:crown:center": "0 2 0",
    }
    with OpenEXR.File(str(path)) as file:
        assert list(file.channels()) == ["R"]
        assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION
        assert file.header()["envmap"] == OpenEXR.ENVMAP_CUBE
        np.testing.assert_array_equal(file.channels()["R"].pixels[18:27], radius_m[2])  # +Y is the third from the top


def test_color_comes_back_as_half_with_shared_borders(tmp_path, color):
    path = tmp_path / "c.exr"
    write_color_cubemap(path, color, {})
    found = read_cubemap(path)
    assert found.pixels.dtype == np.float16
    np.testing.assert_allclose(found.pixels, color, rtol=1e-3, atol=1e-7)
    identity = texel_identity(9).ravel()
    by_texel = found.pixels.reshape(-1, 3)[np.argsort(identity, kind="stable")]
    same = np.diff(np.sort(identity)) == 0
    assert same.sum() == 6 * 81 - (6 * 64 + 2)
    np.testing.assert_array_equal(by_texel[1:][same], by_texel[:-1][same])
    with OpenEXR.File(str(path)) as file:
        np.testing.assert_allclose(file.header()["chromaticities"][:6], (0.64, 0.33, 0.3, 0.6, 0.15, 0.06), atol=1e-6)


def test_bytes_depend_on_the_pixels_only(tmp_path, radius_m, color):
    for name in "ab":
        write_radius_cubemap(tmp_path / f"r{name}", radius_m, {})
        write_color_cubemap(tmp_path / f"c{name}", color, {})
    assert (tmp_path / "ra").read_bytes() == (tmp_path / "rb").read_bytes()
    assert (tmp_path / "ca").read_bytes() == (tmp_path / "cb").read_bytes()


def test_colors_beyond_half_are_clamped_with_a_warning(tmp_path, color, caplog):
    color[4, 4, 4] = (1e6, 0.5, -1e6)
    with caplog.at_level(logging.WARNING):
        write_color_cubemap(tmp_path / "c.exr", color, {})
    assert "1 of 486 texels" in caplog.text
    assert "65504" in caplog.text
    assert read_cubemap(tmp_path / "c.exr").pixels[4, 4, 4].tolist() == [65504.0, 0.5, -65504.0]


@pytest.mark.parametrize(
    ("value", "message"), [(np.nan, "not finite"), (np.inf, "not finite"), (0.0, "above 0"), (-1.0, "above 0")]
)
def test_impossible_radius_is_refused(tmp_path, radius_m, value, message):
    radius_m[1, 4, 4] = value
    with pytest.raises(ValueError, match=message):
        write_radius_cubemap(tmp_path / "r.exr", radius_m, {})
    assert not list(tmp_path.iterdir())


def test_borders_that_differ_are_refused(tmp_path, radius_m, color):
    radius_m[0, 0, 3] += 0.1
    color[5, 8, 8, 2] += 0.1
    with pytest.raises(ValueError, match="1 border texels"):
        write_radius_cubemap(tmp_path / "r.exr", radius_m, {})
    with pytest.raises(ValueError, match="border texels"):
        write_color_cubemap(tmp_path / "c.exr", color, {})


@pytest.mark.parametrize("shape", [(6, 8, 9), (5, 8, 8), (6, 1, 1), (6, 8), (6, 8, 8, 3)])
def test_radius_of_another_shape_is_refused(tmp_path, shape):
    with pytest.raises(ValueError, match="cubemap"):
        write_radius_cubemap(tmp_path / "r.exr", np.ones(shape, np.float32), {})


def test_attributes_are_ours_by_name(tmp_path, radius_m):
    with pytest.raises(ValueError, match="foliage:"):
        write_radius_cubemap(tmp_path / "r.exr", radius_m, {"center": "0 0 0"})


def test_unwritable_file_is_an_asset_error(tmp_path, radius_m):
    (tmp_path / "file").touch()
    with pytest.raises(AssetError, match="was not written"):
        write_radius_cubemap(tmp_path / "file" / "r.exr", radius_m, {})


def test_reading_what_is_no_cubemap(tmp_path):
    with pytest.raises(AssetError, match="cannot be read"):
        read_cubemap(tmp_path / "missing.exr")
    (tmp_path / "text.exr").write_text("not an image")
    with pytest.raises(AssetError, match="cannot be read"):
        read_cubemap(tmp_path / "text.exr")
    OpenEXR.File({}, {"R": np.ones((12, 2), np.float32)}).write(str(tmp_path / "plain.exr"))
    with pytest.raises(AssetError, match="ENVMAP_CUBE"):
        read_cubemap(tmp_path / "plain.exr")
    header = {"envmap": OpenEXR.ENVMAP_CUBE}
    OpenEXR.File(dict(header), {"R": np.ones((13, 2), np.float32)}).write(str(tmp_path / "high.exr"))
    with pytest.raises(AssetError, match="six times as high"):
        read_cubemap(tmp_path / "high.exr")
    OpenEXR.File(header, {"Z": np.ones((12, 2), np.float32)}).write(str(tmp_path / "depth.exr"))
    with pytest.raises(AssetError, match="channels Z"):
        read_cubemap(tmp_path / "depth.exr")


def test_exrheader_names_it_a_cubemap(tmp_path, radius_m):
    write_radius_cubemap(tmp_path / "r.exr", radius_m, {})
    header = run_tool("exrheader", str(tmp_path / "r.exr"))
    assert header.returncode == 0, header.stderr
    assert "cube-face map" in header.stdout
    assert "R, 32-bit floating-point" in header.stdout
    assert 'foliage:cube:sampling (type string): "edge"' in header.stdout


def test_exrenvmap_finds_each_colour_in_its_direction(tmp_path):
    """A colour that is its own direction, turned into a latitude-longitude map by OpenEXR's tool."""
    write_color_cubemap(tmp_path / "c.exr", 0.5 + 0.5 * face_directions(33), {})
    done = run_tool("exrenvmap", "-l", "-w", "64", str(tmp_path / "c.exr"), str(tmp_path / "latlong.exr"))
    assert done.returncode == 0, done.stderr
    with OpenEXR.File(str(tmp_path / "latlong.exr")) as file:
        channels = file.channels()
        name = next(iter(channels))
        pixels = np.asarray(channels[name].pixels, np.float64)[..., :3]
    height, width = pixels.shape[:2]
    # ImfEnvmap.h: latitude π/2 at the top, longitude π at the left; (sin lon cos lat, sin lat, cos lon cos lat).
    latitude = np.pi * (0.5 - np.arange(height) / (height - 1))[:, None]
    longitude = np.pi * (1 - 2 * np.arange(width) / (width - 1))[None, :]
    wanted = np.stack(
        np.broadcast_arrays(
            np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)
        ),
        axis=-1,
    )
    assert np.abs(2 * pixels - 1 - wanted).max() < 0.08
