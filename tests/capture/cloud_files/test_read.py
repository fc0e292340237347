"""Clouds that studios hand over: every format gives the same points, and what is no cloud is refused with a reason."""

import os
import struct
from pathlib import Path

import hypothesis.strategies as st
import laspy
import numpy as np
import pytest
from hypothesis import given
from usdfoliage.capture.cloud_files import ply as ply_files
from usdfoliage.capture.cloud_files.read import CloudInputSettings, read_cloud_input
from usdfoliage.errors import CaptureError

from tests.support.cloud_files import some_colors, some_points, write_any, write_las, write_ply, write_text

SHARED = Path(__file__).parents[4] / "shared" / "data"
METRES = CloudInputSettings(metres_per_unit=1.0)


ALL = [".ply", ".las", ".laz", ".xyz", ".txt", ".pts", ".csv", ".asc"]


# What comes out


@pytest.mark.parametrize("suffix", ALL)
def test_every_format_gives_the_same_points(tmp_path, suffix):
    points, colors = some_points(), some_colors()
    cloud = read_cloud_input(write_any(tmp_path / f"tree{suffix}", points, colors), METRES)
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, points, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(cloud.colors, colors)
    assert cloud.points_m.dtype == np.float64
    assert cloud.colors.dtype == np.uint8
    assert cloud.total == 200
    assert cloud.metres_per_unit == 1
    assert cloud.remarks == ()


@given(
    x=st.floats(-7e6, 7e6), y=st.floats(-7e6, 7e6), z=st.floats(-500, 9000), seed=st.integers(0, 99),
    suffix=st.sampled_from([".ply", ".las", ".laz", ".xyz"]),
)  # fmt: skip
def test_far_from_the_origin_a_millimetre_counts(tmp_path_factory, x, y, z, seed, suffix):
    points = some_points(60, seed) + np.round([x, y, z], 3)
    cloud = read_cloud_input(write_any(tmp_path_factory.mktemp("far") / f"a{suffix}", points), METRES)
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, points, rtol=0, atol=1e-6)
    assert np.abs(cloud.points_m).max() < 3
    assert (cloud.origin_m == np.round(cloud.origin_m)).all()
    # float32 is enough afterwards.
    exact = cloud.points_m.astype(np.float32) + cloud.origin_m
    np.testing.assert_allclose(exact, points, rtol=0, atol=1e-6)


@given(data=st.data(), bad=st.sampled_from([np.nan, np.inf, -np.inf, 1e30]))
def test_points_that_are_nowhere_are_left_out_wherever_they_stand(tmp_path_factory, data, bad):
    points = some_points(100)
    rows = data.draw(st.sets(st.integers(0, 99), min_size=1, max_size=40))
    for row in rows:
        points[row, data.draw(st.integers(0, 2))] = bad
    path = tmp_path_factory.mktemp("nan") / data.draw(st.sampled_from(["a.ply", "a.xyz"]))
    cloud = read_cloud_input(write_ply(path, points) if path.suffix == ".ply" else write_text(path, points), METRES)
    np.testing.assert_allclose(
        cloud.points_m + cloud.origin_m, np.delete(points, sorted(rows), axis=0), rtol=0, atol=1e-9
    )
    assert cloud.total == 100
    what = "points more than 1e+11 from the origin" if bad == 1e30 else "points that are not finite"
    assert f"{len(rows)} {what} left out" in [each.text for each in cloud.remarks]


@pytest.mark.parametrize("suffix", ALL)
def test_exact_duplicates_are_left_out_and_counted(tmp_path, suffix):
    points = some_points()
    twice = np.concatenate([points, points[20:50][::-1]])
    cloud = read_cloud_input(write_any(tmp_path / f"tree{suffix}", twice), METRES)
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, points, rtol=0, atol=1e-9)
    assert [each.text for each in cloud.remarks] == ["30 exact duplicates left out"]
    assert cloud.total == 230


@pytest.mark.parametrize("order", ["<", ">", ""])
def test_ply_of_any_order_and_type(tmp_path, order):
    points = some_points()
    path = write_ply(tmp_path / "a.ply", points, some_colors(), "double" if order else "float", order)
    np.testing.assert_allclose(read_cloud_input(path, METRES).points_m, points - np.round(np.median(points, axis=0)))


def test_ply_is_recognized_by_its_first_bytes(tmp_path):
    cloud = read_cloud_input(write_ply(tmp_path / "scan.data", some_points()), METRES)
    assert len(cloud.points_m) == 200
    write_las(tmp_path / "scan.las", some_points()).rename(tmp_path / "scan.ptcloud")
    assert read_cloud_input(tmp_path / "scan.ptcloud", METRES).format_up == "+Z"


def test_vertices_with_lists_are_read(tmp_path):
    points = some_points()
    data = b"".join(struct.pack("<3fBi", *point, 1, 7) for point in points)
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 200\nproperty float x\nproperty float y\n"
        "property float z\nproperty list uchar int seen_by\nend_header\n"
    )
    (tmp_path / "a.ply").write_bytes(header.encode() + data)
    cloud = read_cloud_input(tmp_path / "a.ply", METRES)
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, points, atol=1e-6)


def test_float_coordinates_of_a_map_are_reported(tmp_path):
    path = write_ply(tmp_path / "a.ply", some_points() + np.array([121_000, 487_000, 0]), kind="float")
    (coarse,) = read_cloud_input(path, METRES).remarks
    assert coarse.code == "cloud-coordinates-coarse"
    assert "in steps of 0.031" in coarse.text


def test_progress_ends_at_the_total(tmp_path):
    for suffix in (".ply", ".laz", ".xyz"):
        calls: list[tuple[int, int]] = []
        path = write_any(tmp_path / f"a{suffix}", some_points())
        read_cloud_input(path, METRES, lambda done, total, calls=calls: calls.append((done, total)))
        assert calls
        assert calls[-1][0] == calls[-1][1]


# Capture folders


def test_a_capture_folder_gives_its_cloud_unit_and_up(tmp_path):
    write_text(tmp_path / "cloud.xyz", 1000 * some_points())
    write_text(tmp_path / "other.xyz", some_points())
    (tmp_path / "capture.toml").write_text('metres_per_unit = 0.001\nup_axis = "Z"\n')
    cloud = read_cloud_input(tmp_path)
    assert cloud.path == tmp_path / "cloud.xyz"
    assert cloud.metres_per_unit == 0.001
    assert cloud.stated_up == "+Z"
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, some_points(), atol=1e-9)
    assert read_cloud_input(tmp_path, METRES).metres_per_unit == 1


def test_a_capture_folder_may_state_any_direction(tmp_path):
    write_text(tmp_path / "cloud.xyz", some_points())
    (tmp_path / "capture.toml").write_text("up_vector = [0, 3, 4]\n")
    cloud = read_cloud_input(tmp_path)
    np.testing.assert_allclose(cloud.stated_vector, [0, 0.6, 0.8])
    (tmp_path / "capture.toml").write_text('up_axis = "auto"\n')
    cloud = read_cloud_input(tmp_path)
    assert (cloud.stated_vector, cloud.stated_up) == (None, None)


def test_a_folder_with_one_cloud_of_any_name_is_enough(tmp_path):
    write_las(tmp_path / "Scan 7.LAZ", some_points())
    (tmp_path / "notes.txt").write_text("oak")
    cloud = read_cloud_input(tmp_path)
    assert cloud.remarks[0].text == "the capture's cloud is Scan 7.LAZ"
    assert cloud.stated_up is None


def test_folders_without_a_cloud_or_with_several_are_refused(tmp_path):
    with pytest.raises(CaptureError, match=r"has no cloud; put one there as cloud.ply"):
        read_cloud_input(tmp_path)
    write_text(tmp_path / "a.xyz", some_points())
    write_text(tmp_path / "b.xyz", some_points())
    with pytest.raises(CaptureError, match=r"2 clouds: a.xyz, b.xyz; give one"):
        read_cloud_input(tmp_path)


# What is refused


@pytest.mark.parametrize("suffix", [".ply", ".las", ".laz", ".xyz", ".pts"])
def test_missing_and_empty_files_are_refused(tmp_path, suffix):
    path = tmp_path / f"tree{suffix}"
    with pytest.raises(CaptureError, match=r"tree.* does not exist; give a cloud \(.ply, .las"):
        read_cloud_input(path)
    path.write_bytes(b"")
    with pytest.raises(CaptureError, match="is empty"):
        read_cloud_input(path)


@pytest.mark.parametrize("suffix", [".ply", ".las", ".laz"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.99])
def test_truncated_files_are_refused(tmp_path, suffix, share):
    path = write_any(tmp_path / f"tree{suffix}", some_points())
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(CaptureError, match=r"tree\.\w+ (is truncated|is damaged|has no end_header)"):
        read_cloud_input(path)


def test_the_error_of_ascii_ply_that_ends_early_counts_its_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(ply_files, "PART_POINTS", 64)
    path = write_ply(tmp_path / "a.ply", some_points(), order="")
    np.testing.assert_allclose(len(read_cloud_input(path, METRES).points_m), 200)
    path.write_text("\n".join(path.read_text().split("\n")[:-60]) + "\n")
    with pytest.raises(CaptureError, match="states 200 rows of vertex, there are at most 1"):
        read_cloud_input(path)


@pytest.mark.parametrize("suffix", [".ply", ".las", ".laz"])
def test_files_of_holes_are_refused(tmp_path, suffix):
    """A file of 25 GB that takes none would be read for minutes."""
    path = write_any(tmp_path / f"tree{suffix}", some_points())
    whole = path.stat().st_size
    os.truncate(path, whole + 4_800)
    assert read_cloud_input(path, METRES).total == 200
    os.truncate(path, whole + 48_000_000_000)
    with pytest.raises(CaptureError, match="the others are holes; copy it again"):
        read_cloud_input(path)


@pytest.mark.parametrize("suffix", [".ply", ".las", ".laz"])
def test_files_without_points_are_refused(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".ply":
        write_ply(path, np.zeros((0, 3)))
    else:
        laspy.LasData(laspy.LasHeader(point_format=6, version="1.4")).write(path)
    with pytest.raises(CaptureError, match="has no points; export it again"):
        read_cloud_input(path)


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.full((80, 3), np.nan), "has no usable point: 80 points that are not finite"),
        (np.full((80, 3), 7.5), "all 80 points of .* are in one place"),
        (some_points(49), "49 usable points in different places, 50 are needed"),
        (np.repeat(some_points(10), 10, axis=0), "10 usable points in different places"),
        (np.linspace(0, 1, 80)[:, None] * [1.0, 2.0, 3.0] + 1e5, "are on a line"),
    ],
)
@pytest.mark.parametrize("order", ["<", ""])
def test_what_can_be_no_plant_is_refused(tmp_path, points, reason, order):
    path = write_ply(tmp_path / "a.ply", points, order=order)
    with pytest.raises(CaptureError, match=reason):
        read_cloud_input(path, METRES)


def test_the_errors_of_damaged_and_unknown_files_give_a_remedy(tmp_path):
    (tmp_path / "a.e57").write_bytes(b"no E57")
    with pytest.raises(CaptureError, match=r"a\.e57 is no E57 file: it lacks the header of one; export it again"):
        read_cloud_input(tmp_path / "a.e57")
    (tmp_path / "a.npz").write_bytes(b"PK\3\4")
    with pytest.raises(CaptureError, match=r"\.npz; give one of .ply, .las, .laz, .e57, .xyz, .txt, .pts, .csv, .asc"):
        read_cloud_input(tmp_path / "a.npz")
    (tmp_path / "a.ply").write_bytes(b"PK\3\4 no ply")
    with pytest.raises(CaptureError, match="is no PLY file"):
        read_cloud_input(tmp_path / "a.ply")


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, np.inf])
def test_settings_are_checked(wrong):
    with pytest.raises(ValueError, match="metres_per_unit"):
        CloudInputSettings(metres_per_unit=wrong)
    with pytest.raises(ValueError, match="max_points"):
        CloudInputSettings(max_points=7)


@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/data is absent")
def test_scans_of_trees_are_metres():
    paths = sorted(SHARED.glob("cloud-*/*.ply"))
    if not paths:
        pytest.skip("../shared/data has no cloud-*/*.ply")
    for path in paths:
        cloud = read_cloud_input(path)
        assert cloud.metres_per_unit == 1, path
        assert 1 < np.ptp(cloud.points_m, axis=0).max() < 30
