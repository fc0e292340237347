"""Clouds in PLY: what is written comes back, and what others write is read or refused."""

import errno
import os
import struct
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.capture.cloud_files import ply as ply_files
from usdfoliage.capture.cloud_files.ply import fits_single, read_cloud, read_cloud_file, write_cloud
from usdfoliage.errors import CaptureError, WriteError

SCAN = Path(__file__).parents[4] / "shared/data/synthetic/tree_leaf_on/scan.ply"


def some_cloud(count: int = 50, seed: int = 0, away_m: float = 0.0) -> Cloud:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    return Cloud(
        points_m=rng.uniform(-1, 1, (count, 3)) + away_m,
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        srgb=rng.integers(0, 256, (count, 3), dtype=np.uint8),
        confidence=rng.uniform(0, 1, count).astype(np.float32),
        views=rng.integers(1, 90_000, count, dtype=np.int32),
    )


def ply(path: Path, header: str, data: bytes = b"", ending: str = "\n") -> Path:
    lines = ["ply", *header.strip().splitlines(), "end_header"]
    path.write_bytes("".join(line.strip() + ending for line in lines).encode("latin-1") + data)
    return path


# Ours


@given(count=st.integers(0, 40), seed=st.integers(0, 2**32 - 1), away_m=st.sampled_from([0.0, 3.0, 5e5, -4e6]))
def test_what_is_written_comes_back(tmp_path_factory, count, seed, away_m):
    cloud = some_cloud(count, seed, away_m)
    path = tmp_path_factory.mktemp("ply") / "cloud.ply"
    write_cloud(path, cloud)
    content = read_cloud_file(path)
    assert content.has_normals
    assert content.has_colors
    assert content.has_confidence
    assert content.has_views
    assert not content.not_finite
    np.testing.assert_allclose(content.cloud.points_m, cloud.points_m, rtol=0, atol=1e-3 * 4 / max(count, 1) ** 0.5)
    np.testing.assert_allclose(content.cloud.normals, cloud.normals, atol=1e-6)
    for name in ("srgb", "confidence", "views"):
        np.testing.assert_array_equal(getattr(content.cloud, name), getattr(cloud, name))


def test_the_bytes_are_those_of_the_format(tmp_path):
    cloud = some_cloud(3)
    write_cloud(tmp_path / "a.ply", cloud, ["metres, Z up"])
    header, data = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")
    assert header.startswith(b"ply\nformat binary_little_endian 1.0\ncomment metres, Z up\nelement vertex 3\n")
    assert b"property float x\n" in header
    rows = [struct.unpack_from("<6f3Bfi", data, 35 * row) for row in range(3)]
    assert len(data) == 3 * 35
    assert rows[2] == (
        *(float(np.float32(value)) for value in cloud.points_m[2]),
        *cloud.normals[2].tolist(),
        *cloud.srgb[2].tolist(),
        float(cloud.confidence[2]),
        int(cloud.views[2]),
    )


def test_the_same_cloud_gives_the_same_bytes_in_parts_of_any_size(tmp_path, monkeypatch):
    cloud = some_cloud(50)
    write_cloud(tmp_path / "whole.ply", cloud)
    monkeypatch.setattr(ply_files, "_CHUNK", 7)
    write_cloud(tmp_path / "parts.ply", cloud)
    assert (tmp_path / "whole.ply").read_bytes() == (tmp_path / "parts.ply").read_bytes()


def test_places_far_from_the_origin_are_double(tmp_path):
    assert fits_single(some_cloud().points_m)
    assert not fits_single(some_cloud(away_m=5e5).points_m)
    cloud = some_cloud(away_m=5e5)
    write_cloud(tmp_path / "a.ply", cloud)
    assert b"property double x\n" in (tmp_path / "a.ply").read_bytes()
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply").points_m, cloud.points_m)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((1, 3), 1e9), np.full((4, 3), 7.0)])
def test_few_places_fit(points):
    assert fits_single(points)


def test_a_single_place_is_kept_exactly(tmp_path):
    cloud = some_cloud(1, away_m=5e5)
    assert not fits_single(cloud.points_m)
    write_cloud(tmp_path / "a.ply", cloud)
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply").points_m, cloud.points_m)


def test_the_unit_of_the_file_may_be_another(tmp_path):
    cloud = some_cloud()
    write_cloud(tmp_path / "a.ply", cloud, metres_per_unit=0.01)
    np.testing.assert_allclose(read_cloud(tmp_path / "a.ply").points_m, 100 * cloud.points_m, atol=1e-4)
    np.testing.assert_allclose(read_cloud(tmp_path / "a.ply", 0.01).points_m, cloud.points_m, atol=1e-6)
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="metres_per_unit"):
            write_cloud(tmp_path / "a.ply", cloud, metres_per_unit=wrong)
        with pytest.raises(ValueError, match="metres_per_unit"):
            read_cloud(tmp_path / "a.ply", wrong)


@pytest.mark.parametrize("comment", ["two\nlines", "caf\u00e9", "bell\a"])
def test_comments_are_lines_of_ascii(tmp_path, comment):
    with pytest.raises(ValueError, match="comment"):
        write_cloud(tmp_path / "a.ply", some_cloud(), [comment])


def test_a_cloud_that_is_not_finite_is_not_written(tmp_path):
    cloud = some_cloud()
    cloud.points_m[3, 1] = np.nan
    with pytest.raises(ValueError, match="1 points are not finite"):
        write_cloud(tmp_path / "a.ply", cloud)


def test_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "cloud.ply"
    write_cloud(path, some_cloud(5))
    before = path.read_bytes()

    def full(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        WriteError,
        match=r"No space left on device, [\d,]+ MB are free there; what was there is unchanged",
    ):
        write_cloud(path, some_cloud(9))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_a_file_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="was not written"):
        write_cloud(tmp_path / "file" / "cloud.ply", some_cloud(5))


# Others'

XYZ = "property float x\nproperty float y\nproperty float z"


@pytest.mark.parametrize(("order", "sign"), [("little", "<"), ("big", ">")])
def test_any_order_type_and_extra(tmp_path, order, sign):
    path = ply(
        tmp_path / "a.ply",
        f"""format binary_{order}_endian 1.0
        obj_info made by hand
        comment
        element camera 2
        property double focal
        element vertex 2
        property uchar blue
        property int16 label
        property double z
        property float32 y
        property short x
        property uint8 green
        property uchar red
        element face 1
        property list uchar int vertex_indices""",
        struct.pack(f"{sign}2d", 1, 2)
        + struct.pack(f"{sign}BhdfhBB", 1, -5, 0.25, 0.5, -3, 2, 3)
        + struct.pack(f"{sign}BhdfhBB", 4, 6, 1e-3, 0.125, 7, 5, 6)
        + b"whatever",
    )
    content = read_cloud_file(path)
    np.testing.assert_array_equal(content.cloud.points_m, [[-3, 0.5, 0.25], [7, 0.125, 1e-3]])
    np.testing.assert_array_equal(content.cloud.srgb, [[3, 2, 1], [6, 5, 4]])
    assert not content.has_normals
    assert not content.has_confidence
    assert not content.has_views
    assert not content.cloud.normals.any()
    assert content.cloud.confidence.tolist() == content.cloud.views.tolist() == [1, 1]


@pytest.mark.parametrize("lengths", [(2, 2, 2), (0, 3, 1)])
def test_lists_are_skipped(tmp_path, lengths):
    data = b""
    for number, length in enumerate(lengths):
        data += struct.pack(
            f"<fI{length}dffB{length}h", number, length, *[9.0] * length, 0.5, 0.25, length, *[8] * length
        )
    path = ply(
        tmp_path / "a.ply",
        """format binary_little_endian 1.0
        element vertex 3
        property float x
        property list uint double weights
        property float y
        property float z
        property list uchar short more""",
        data,
    )
    np.testing.assert_array_equal(read_cloud(path).points_m, [[0, 0.5, 0.25], [1, 0.5, 0.25], [2, 0.5, 0.25]])


def test_lists_of_other_elements_are_skipped(tmp_path):
    path = ply(
        tmp_path / "a.ply",
        f"""format binary_little_endian 1.0
        element face 2
        property list uchar int vertex_indices
        element none 0
        property list uchar int nothing
        element vertex 1
        {XYZ}""",
        struct.pack("<B3iB4i3f", 3, 0, 1, 2, 4, 0, 1, 2, 3, 1.0, 2.0, 3.0),
    )
    np.testing.assert_array_equal(read_cloud(path).points_m, [[1, 2, 3]])


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_text(tmp_path, ending):
    path = ply(
        tmp_path / "a.ply",
        f"""format ascii 1.0
        element face 1
        property list uchar int vertex_indices
        element vertex 3
        {XYZ}
        property list int int seen_by
        property uchar red
        property uchar green
        property uchar blue""",
        ending.join(["3 0 1 2", "1 2 3 2 7 7 9 8 7", "1e-3 -.5 nan 0 1 2 3", "4 5 6 0 1 2 300", ""]).encode(),
        ending,
    )
    content = read_cloud_file(path)
    np.testing.assert_array_equal(content.cloud.points_m, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(content.cloud.srgb, [[9, 8, 7], [1, 2, 255]])
    assert content.not_finite == 1


def test_points_that_are_not_finite_are_left_out_with_a_warning(tmp_path, caplog):
    rows = np.zeros((5, 3), "<f4")
    rows[1, 0], rows[3, 2], rows[4, 1] = np.nan, np.inf, -np.inf
    path = ply(tmp_path / "a.ply", f"format binary_little_endian 1.0\nelement vertex 5\n{XYZ}", rows.tobytes())
    assert read_cloud_file(path).not_finite == 3
    assert len(read_cloud(path)) == 2
    assert "3 points are not finite" in caplog.text
    assert "has no normals and no colours" in caplog.text


@pytest.mark.parametrize(
    ("kind", "code", "values", "expected"),
    [
        ("ushort", "H", (0, 32896, 65535), (0, 128, 255)),
        ("float", "f", (0.0, 0.5, 1.0), (0, 128, 255)),
        ("float", "f", (0.0, 128.0, 255.0), (0, 128, 255)),
        ("double", "d", (np.nan, np.inf, 1.0), (0, 0, 255)),
        ("int", "i", (-5, 1000, 1), (0, 255, 1)),
    ],
)
def test_colors_of_other_types(tmp_path, kind, code, values, expected):
    colors = "\n".join(f"property {kind} {name}" for name in ("r", "diffuse_green", "blue"))
    header = f"format binary_little_endian 1.0\nelement vertex 1\n{XYZ}\n{colors}"
    path = ply(tmp_path / "a.ply", header, struct.pack(f"<3f3{code}", 0, 0, 0, *values))
    assert read_cloud(path).srgb.tolist() == [list(expected)]


def test_what_is_not_as_it_should_be_is_mended(tmp_path):
    names = ("nx", "ny", "nz", "confidence", "views")
    more = "\n".join(f"property double {name}" for name in names)
    rows = np.array([[0, 0, 0, 0, 0, 1e300, 7, -4], [0, 0, 0, np.nan, 0, 1, np.nan, 1e20], [0, 0, 0, 0, 3, 4, -1, 2]])
    path = ply(
        tmp_path / "a.ply",
        f"format binary_little_endian 1.0\nelement vertex 3\n{XYZ}\n{more}".replace("float", "double"),
        rows.tobytes(),
    )
    cloud = read_cloud(path)
    np.testing.assert_allclose(cloud.normals, [[0, 0, 1], [0, 0, 0], [0, 0.6, 0.8]], atol=1e-7)
    assert cloud.confidence.tolist() == [1, 0, 0]
    assert cloud.views.tolist() == [0, 2**31 - 1, 2]


def binary(rows: int, more: str) -> bytes:
    return f"ply\nformat binary_little_endian 1.0\nelement vertex {rows}\n{XYZ}\n{more}\nend_header\n".encode()


HOSTILE = {
    "nothing": b"",
    "no ply": b"solid cube\n",
    "no end": b"ply\nformat ascii 1.0\n",
    "no format": b"ply\nelement vertex 0\nend_header\n",
    "unknown format": b"ply\nformat binary_middle_endian 1.0\nend_header\n",
    "property before element": b"ply\nformat ascii 1.0\nproperty float x\nend_header\n",
    "unknown type": b"ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\nend_header\n",
    "count of floats": b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list float int x\nend_header\n",
    "negative count": b"ply\nformat ascii 1.0\nelement vertex -1\nend_header\n",
    "count of words": b"ply\nformat ascii 1.0\nelement vertex many\nend_header\n",
    "no vertices": b"ply\nformat ascii 1.0\nelement face 0\nend_header\n",
    "no places": b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nend_header\n",
    "a place that is a list": binary(0, "").replace(b"float z", b"list int int z"),
    "huge": f"ply\nformat binary_little_endian 1.0\nelement vertex 999999999999999999\n{XYZ}\nend_header\n".encode(),
    "huge text": f"ply\nformat ascii 1.0\nelement vertex 999999999999999999\n{XYZ}\nend_header\n1 2 3\n".encode(),
    "huge list": binary(2, "property list uint int l") + b"\xff" * 64,
    "negative list": binary(1, "property list int int l") + b"\xff" * 64,
    "short list": binary(1, "property list uchar int l") + b"\x05" * 13,
    "a line too short": f"ply\nformat ascii 1.0\nelement vertex 2\n{XYZ}\nend_header\n1 2 3\n1 2 \n  ".encode(),
    "a line of words": f"ply\nformat ascii 1.0\nelement vertex 1\n{XYZ}\nend_header\none two three\n".encode(),
    "a line too few": f"ply\nformat ascii 1.0\nelement vertex 2\n{XYZ}\nend_header\n1.00000 2.00000 3.00000\n".encode(),
    "many properties": b"ply\nformat ascii 1.0\nelement vertex 0\n" + b"property float x\n" * 2000 + b"end_header\n",
}  # fmt: skip


@pytest.mark.parametrize("content", HOSTILE.values(), ids=HOSTILE.keys())
def test_what_is_no_cloud_is_refused(tmp_path, content):
    path = tmp_path / "a.ply"
    path.write_bytes(content)
    with pytest.raises(CaptureError, match=r"a\.ply"):
        read_cloud(path)


@pytest.mark.parametrize("place", ["absent.ply", "."])
def test_a_file_that_is_none_is_refused(tmp_path, place):
    with pytest.raises(CaptureError, match="does not exist or is no file"):
        read_cloud(tmp_path / place)


@given(cut=st.integers(0, 5000), flips=st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 255)), max_size=4))
def test_damage_ends_in_a_cloud_or_an_error(tmp_path_factory, cut, flips):
    path = tmp_path_factory.mktemp("ply") / "a.ply"
    write_cloud(path, some_cloud(20))
    data = bytearray(path.read_bytes())
    for at, value in flips:
        data[at % len(data)] = value
    path.write_bytes(data[: cut % (len(data) + 1)])
    try:
        cloud = read_cloud(path)
    except CaptureError:
        return
    assert np.isfinite(cloud.points_m).all()
    assert np.isfinite(cloud.confidence).all()
    length = np.linalg.norm(cloud.normals, axis=1)
    assert ((length == 0) | (np.abs(length - 1) < 1e-5)).all()


def test_a_cloud_of_another_program():
    if not SCAN.is_file():
        pytest.skip(f"{SCAN} is absent")
    content = read_cloud_file(SCAN)
    assert len(content.cloud) == 160_000
    assert not content.has_normals
    assert not content.has_colors
    assert not content.not_finite
    assert 4 < np.ptp(content.cloud.points_m[:, 2]) < 6  # a tree of 5 m, in metres


def test_numbers_that_are_none_make_no_noise(tmp_path):
    places = np.zeros((3, 3), "<f4")
    places[:, 0] = range(3)
    places.view("<u4")[1, 2] = 0x7F800001  # which complains when it is converted
    header = "format binary_little_endian 1.0\nelement vertex 3\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    cloud = read_cloud(ply(tmp_path / "a.ply", header, places.tobytes()))
    assert cloud.points_m[:, 0].tolist() == [0, 2]
