"""Clouds in E57 files."""

import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from usdfoliage.capture.cloud_files import e57
from usdfoliage.capture.cloud_files.e57 import open_e57_parts
from usdfoliage.capture.cloud_files.read import (
    CloudInputSettings,
    find_cloud,
    is_cloud_input,
    iterate_points,
    read_cloud_input,
)
from usdfoliage.errors import CaptureError

pye57 = pytest.importorskip("pye57")
COUNT = 400


def some_points(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (COUNT, 3))


def some_colors(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed + 100).integers(0, 256, (COUNT, 3)).astype(np.uint8)


def write_scans(path: Path, *scans: dict) -> Path:
    """Each with points, and optional colors, invalid, rotation and translation."""
    with pye57.E57(str(path), mode="w") as file:
        for scan in scans:
            data = {f"cartesian{axis}": scan["points"][:, k].copy() for k, axis in enumerate("XYZ")}
            if "colors" in scan:
                data |= {f"color{name}": scan["colors"][:, k].copy() for k, name in enumerate(("Red", "Green", "Blue"))}
            if "invalid" in scan:
                data["cartesianInvalidState"] = scan["invalid"]
            file.write_scan_raw(data, rotation=scan.get("rotation"), translation=scan.get("translation"))
    return path


def write_node_scan(path: Path, fields: dict[str, np.ndarray], limits: dict[str, int] | None = None) -> Path:
    """One scan with any fields of numbers, by the library below pye57's own writer."""
    lib = pye57.libe57
    with pye57.E57(str(path), mode="w") as file:
        image = file.image_file
        scan = lib.StructureNode(image)
        scan.set("guid", lib.StringNode(image, "{1}"))
        if limits:
            stated = lib.StructureNode(image)
            for name, value in limits.items():
                stated.set(name, lib.IntegerNode(image, value))
            scan.set("colorLimits", stated)
        prototype = lib.StructureNode(image)
        buffers = lib.VectorSourceDestBuffer()
        for name, values in fields.items():
            if values.dtype == np.float64:
                prototype.set(name, lib.FloatNode(image, 0.0, lib.E57_DOUBLE))
            else:
                prototype.set(name, lib.IntegerNode(image, 0, 0, 65535))
            buffers.append(lib.SourceDestBuffer(image, name, values, len(values), True, True))
        points = lib.CompressedVectorNode(image, prototype, lib.VectorNode(image, True))
        scan.set("points", points)
        file.data3d.append(scan)
        writer = points.writer(buffers)
        writer.write(len(next(iter(fields.values()))))
        writer.close()
    return path


def world(cloud) -> np.ndarray:
    return cloud.points_m + cloud.origin_m


def test_scans_are_joined_by_their_poses(tmp_path):
    turn = 0.6
    rotation = np.array([np.cos(turn / 2), 0, 0, np.sin(turn / 2)])
    matrix = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    first, second = some_points(0), some_points(1)
    path = write_scans(
        tmp_path / "a.e57",
        {"points": first, "colors": some_colors(), "rotation": rotation, "translation": np.array([5.0, 1, 0])},
        {"points": second},
    )
    cloud = read_cloud_input(path)
    np.testing.assert_allclose(world(cloud), np.vstack([first @ matrix.T + [5, 1, 0], second]), atol=1e-6)
    assert cloud.total == 2 * COUNT
    assert (cloud.metres_per_unit, cloud.format_up) == (1.0, "+Z")
    np.testing.assert_array_equal(cloud.colors[:COUNT], some_colors())
    assert not cloud.colors[COUNT:].any()  # that scan has none


def test_points_without_a_place_are_left_out(tmp_path):
    invalid = np.zeros(COUNT, np.int8)
    invalid[:30], invalid[30:50] = 1, 2
    cloud = read_cloud_input(write_scans(tmp_path / "a.e57", {"points": some_points(), "invalid": invalid}))
    np.testing.assert_allclose(world(cloud), some_points()[50:], atol=1e-6)
    assert [(each.code, each.text) for each in cloud.remarks] == [
        ("cloud-points-left-out", "50 points that the file marks as invalid left out")
    ]
    assert cloud.total == COUNT
    (every,) = iterate_points(cloud.path)
    np.testing.assert_allclose(every.points, some_points(), atol=1e-6)
    np.testing.assert_array_equal(every.used, invalid == 0)


def test_spherical_coordinates(tmp_path):
    points = some_points() + np.array([0, 0, 3])
    ranges = np.linalg.norm(points, axis=1)
    fields = {
        "sphericalRange": ranges,
        "sphericalAzimuth": np.arctan2(points[:, 1], points[:, 0]),
        "sphericalElevation": np.arcsin(points[:, 2] / ranges),
    }
    np.testing.assert_allclose(world(read_cloud_input(write_node_scan(tmp_path / "a.e57", fields))), points, atol=1e-9)


@pytest.mark.parametrize("limits", [{"colorRedMaximum": 1023, "colorGreenMaximum": 1023, "colorBlueMaximum": 1023}, {}])
def test_colours_of_more_bits_are_scaled(tmp_path, limits):
    highest = 1023 if limits else 65535
    points = some_points()
    fields = {f"cartesian{axis}": points[:, k].copy() for k, axis in enumerate("XYZ")}
    colors = some_colors().astype(np.int64) * highest // 255
    fields |= {f"color{name}": colors[:, k].astype(np.uint16) for k, name in enumerate(("Red", "Green", "Blue"))}
    cloud = read_cloud_input(write_node_scan(tmp_path / "a.e57", fields, limits))
    np.testing.assert_allclose(cloud.colors.astype(int), some_colors().astype(int), atol=1)


def test_a_scan_is_read_in_parts_and_thinned(tmp_path, monkeypatch):
    monkeypatch.setattr(e57, "PART_POINTS", 64)
    path = write_scans(tmp_path / "a.e57", {"points": some_points()}, {"points": some_points(1)})
    parts = list(open_e57_parts(path).parts)
    assert [len(part.points) for part in parts] == [64] * 6 + [16] + [64] * 6 + [16]
    assert len(read_cloud_input(path, CloudInputSettings(max_points=200)).points_m) <= 200


def test_a_scan_without_coordinates_and_a_file_without_scans(tmp_path):
    path = write_node_scan(tmp_path / "a.e57", {"intensity": np.ones(COUNT)})
    with pytest.raises(
        CaptureError, match=r"scan 1 of .* has neither Cartesian nor spherical coordinates, only intensity"
    ):
        read_cloud_input(path)
    with pye57.E57(str(tmp_path / "b.e57"), mode="w"):
        pass
    with pytest.raises(CaptureError, match="has no scan with points"):
        read_cloud_input(tmp_path / "b.e57")


def test_a_capture_may_hold_one_and_it_is_known_by_its_bytes(tmp_path):
    path = write_scans(tmp_path / "cloud.e57", {"points": some_points()})
    assert find_cloud(tmp_path) == path
    other = path.rename(tmp_path / "scan.bin")
    assert is_cloud_input(other)
    assert len(read_cloud_input(other).points_m) == COUNT


@pytest.mark.parametrize("kept", [10, 48, 1000, -20])
def test_a_truncated_file_is_refused(tmp_path, capfd, kept):
    stored = write_scans(tmp_path / "a.e57", {"points": some_points()}).read_bytes()
    (tmp_path / "b.e57").write_bytes(stored[:kept])
    with pytest.raises(CaptureError, match=r"b\.e57 is (truncated|no E57 file)"):
        read_cloud_input(tmp_path / "b.e57")
    assert capfd.readouterr() == ("", "")


def test_any_changed_bit_is_found_or_does_no_harm(tmp_path, capfd):
    stored = write_scans(tmp_path / "a.e57", {"points": some_points()}).read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(40):
        changed = bytearray(stored)
        changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
        (tmp_path / "b.e57").write_bytes(changed)
        with suppress(CaptureError):
            read_cloud_input(tmp_path / "b.e57")
    assert capfd.readouterr() == ("", "")


def test_a_description_that_defines_entities_is_refused(tmp_path):
    """A few lines of XML can stand for gigabytes."""
    path = write_scans(tmp_path / "a.e57", {"points": some_points()})
    stored = bytearray(path.read_bytes())
    start = struct.unpack_from("<Q", stored, 24)[0]
    stored[start : start + 60] = b'<!DOCTYPE a [<!ENTITY b "cccccccccccccccc">]>'.ljust(60)
    path.write_bytes(stored)
    with pytest.raises(CaptureError, match="defines entities"):
        read_cloud_input(path)


def test_without_the_package_the_error_names_it(tmp_path, monkeypatch):
    path = write_scans(tmp_path / "a.e57", {"points": some_points()})
    monkeypatch.setattr(e57.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        CaptureError, match=r"pye57.* is not installed; install it with 'pip install pye57', or convert"
    ):
        read_cloud_input(path)
