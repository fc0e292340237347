"""The picture of a leaf from a file or an asset: good ones, bad ones, hostile ones."""

import struct
import zlib

import numpy as np
import pytest
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.errors import AssetError, CaptureError, FitError, FoliageError
from usdfoliage.jobs.leaf_picture import read_leaf_picture

from tests.support.leaves.assets import write_spray
from tests.support.leaves.drawn import drawn_leaf, write_leaf


def test_a_file_is_read_as_linear_light(tmp_path):
    picture = read_leaf_picture(write_leaf(tmp_path / "oak.png", drawn_leaf()), tmp_path / "out")
    assert picture.width == pytest.approx(0.6, abs=0.03)
    rows, columns = picture.rgba.shape[:2]
    base, apex = picture.rgba[-rows // 8, columns // 2], picture.rgba[rows // 8, columns // 2]
    assert base[0] / apex[0] == pytest.approx(0.269 / 0.081, rel=0.15)


def test_the_average_leaf_of_an_asset_has_its_texture_within_its_silhouette(tmp_path):
    texture = np.full((64, 32, 4), 0.2, np.float32)
    texture[..., 3] = 1
    texture[:32, :, 0] = 0.6  # towards the apex
    path = write_leaf(tmp_path / "leaf.png", texture)
    spray = write_spray(tmp_path / "spray", appearance=LeafAppearance(texture=path, texture_color=(0.4, 0.2, 0.2)))
    for source in (spray, spray.parent):
        picture = read_leaf_picture(source, tmp_path / "out")
        rows, columns = picture.rgba.shape[:2]
        assert 0.3 < picture.cover < 0.95
        assert picture.rgba[rows // 4, columns // 2, 0] > 1.8 * picture.rgba[-rows // 4, columns // 2, 0]
    plain = read_leaf_picture(write_spray(tmp_path / "plain" / "spray"), tmp_path / "out")
    np.testing.assert_allclose(plain.rgba[..., :3], 1, atol=1e-5)
    assert plain.rgba.shape == picture.rgba.shape
    with pytest.raises(AssetError, match="holds the leaves"):
        read_leaf_picture(spray, spray.parent)


def huge_png(width: int, height: int) -> bytes:
    """A header that states a size, and no pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


def test_bad_pictures_are_one_error_that_names_the_file(tmp_path):
    whole = write_leaf(tmp_path / "leaf.png", drawn_leaf()).read_bytes()
    bad = {
        "opaque": write_leaf(tmp_path / "opaque.png", drawn_leaf() * [1, 1, 1, 0] + [0, 0, 0, 1]).read_bytes(),
        "clear": write_leaf(tmp_path / "clear.png", drawn_leaf() * [1, 1, 1, 0]).read_bytes(),
        "black": write_leaf(tmp_path / "black.png", drawn_leaf() * [0, 0, 0, 1]).read_bytes(),
        "short": whole[: len(whole) // 2],
        "huge": huge_png(60_000, 60_000),
        "large": huge_png(9_000, 9_000),
        "text": b"no picture",
        "empty": b"",
    }
    for name, data in bad.items():
        path = tmp_path / f"{name}.png"
        path.write_bytes(data)
        with pytest.raises((CaptureError, FitError), match=f"{name}.png") as caught:
            read_leaf_picture(path, tmp_path / "out")
        assert caught.value.remedy or name in ("huge", "text", "empty", "short")
    with pytest.raises(FoliageError, match="absent"):
        read_leaf_picture(tmp_path / "absent.png", tmp_path / "out")
    (tmp_path / "folder").mkdir()
    with pytest.raises(FoliageError, match="folder"):
        read_leaf_picture(tmp_path / "folder", tmp_path / "out")
