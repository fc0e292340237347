"""Clouds as text: whatever parts the columns, names them or stands above them."""

import numpy as np
import pytest
from usdfoliage.capture.cloud_files.read import CloudInputSettings, read_cloud_input
from usdfoliage.capture.cloud_files.units import find_stated_unit, find_stated_up, guess_unit
from usdfoliage.errors import CaptureError
from usdfoliage.remarks import Setting

from tests.support.cloud_files import some_colors, some_points, write_ply, write_text

METRES = CloudInputSettings(metres_per_unit=1.0)


@pytest.mark.parametrize("separator", [" ", "\t", ",", ";", "   ", ", "])
@pytest.mark.parametrize(
    "head", ["", "# scanned by hand\n", "x,y,z,r,g,b\n", "//X Y Z R G B\n", "200\n", "\ufeff", "\n\n"]
)
def test_separators_and_heads(tmp_path, separator, head):
    path = tmp_path / "a.txt"
    write_text(path, some_points(), some_colors(), separator, head)
    cloud = read_cloud_input(path, METRES)
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, some_points(), atol=1e-9)
    np.testing.assert_array_equal(cloud.colors, some_colors())
    assert cloud.remarks == ()


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("separator", [" ", ";"])
def test_decimal_commas_and_line_ends(tmp_path, ending, separator):
    lines = [separator.join(f"{value:.3f}".replace(".", ",") for value in point) for point in some_points()]
    (tmp_path / "a.csv").write_bytes(ending.join(lines).encode())
    cloud = read_cloud_input(tmp_path / "a.csv", METRES)
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, some_points(), atol=1e-9)


@pytest.mark.filterwarnings("error")
def test_a_colour_that_no_float32_holds(tmp_path):
    colors = some_colors().astype(object)
    colors[7, 1] = "1e300"
    write_text(tmp_path / "a.csv", some_points(), colors, ",")
    cloud = read_cloud_input(tmp_path / "a.csv", METRES)
    assert len(cloud.points_m) == 200


def test_columns_are_found_by_their_names(tmp_path):
    lines = ["id;Red;Z [m];Y [m];X [m];Blue;Green"]
    for number, ((x, y, z), (r, g, b)) in enumerate(zip(some_points(), some_colors(), strict=True)):
        lines.append(f"{number};{r};{z:.3f};{y:.3f};{x:.3f};{b};{g}")
    (tmp_path / "a.csv").write_text("\n".join(lines))
    cloud = read_cloud_input(tmp_path / "a.csv", METRES)
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, some_points(), atol=1e-9)
    np.testing.assert_array_equal(cloud.colors, some_colors())


def test_intensity_and_normals_are_no_colours(tmp_path):
    rng = np.random.default_rng(0)
    for width in (1, 3):
        rows = np.column_stack([some_points(), rng.normal(size=(200, width))])
        np.savetxt(tmp_path / "a.xyz", rows, fmt="%.4f")
        assert read_cloud_input(tmp_path / "a.xyz", METRES).colors is None
    rows = np.column_stack([some_points(), rng.integers(-2048, 2048, 200), some_colors()])
    np.savetxt(tmp_path / "a.pts", rows, fmt=["%.4f"] * 3 + ["%d"] * 4, header="200", comments="")
    np.testing.assert_array_equal(read_cloud_input(tmp_path / "a.pts", METRES).colors, some_colors())


def test_lines_that_are_no_points_are_counted_and_many_are_refused(tmp_path):
    lines = [" ".join(f"{value:.3f}" for value in point) for point in some_points()]
    lines[50:50] = ["# a comment", "1.0 2.0", "oak oak oak", ""]
    path = tmp_path / "a.xyz"
    path.write_text("\n".join(lines))
    cloud = read_cloud_input(path, METRES)
    assert len(cloud.points_m) == 200
    assert [each.text for each in cloud.remarks] == ["2 lines that are no points left out"]
    path.write_text("\n".join([*lines, *["no point"] * 90]))
    with pytest.raises(CaptureError, match=r"9\d of the first 29\d lines are not 3 numbers"):
        read_cloud_input(path)


def test_pts_that_end_early_and_of_two_scans(tmp_path):
    path = write_text(tmp_path / "a.pts", some_points(), head="201\n")
    with pytest.raises(CaptureError, match="states 201 points, there are 200"):
        read_cloud_input(path)
    rows = write_text(path, some_points()).read_text().splitlines()
    path.write_text("\n".join(["120", *rows[:120], "80", *rows[120:]]))
    assert len(read_cloud_input(path, METRES).points_m) == 200


@pytest.mark.parametrize("text", ["hello\n", "# only\n# comments\n", "1 2\n3 4\n", "a,b,c\n" * 600])
def test_what_has_no_points_is_refused(tmp_path, text):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(CaptureError, match="has no line 'x y z'"):
        read_cloud_input(tmp_path / "a.txt")


def test_utf16_is_refused(tmp_path):
    (tmp_path / "a.txt").write_text("1 2 3\n" * 60, encoding="utf-16")
    with pytest.raises(CaptureError, match="not plain text"):
        read_cloud_input(tmp_path / "a.txt")


# Units


@pytest.mark.parametrize(
    ("line", "metres"),
    [
        ("units metres, up axis +Z", 1.0), ("unit: mm", 0.001), ("UNITS = Feet", 0.3048), ("metres, Z up", 1.0),
        ("coordinates are in centimeters", 0.01), ("scanned from 12 metres", None), ("unit of measure", None),
        ("made by m", None),
    ],
)  # fmt: skip
def test_units_in_comments(line, metres, tmp_path):
    assert find_stated_unit(["other", line]) == metres
    if metres:
        path = write_ply(tmp_path / "a.ply", some_points(), comment=line)
        assert read_cloud_input(path).metres_per_unit == metres


@pytest.mark.parametrize(
    ("line", "axis"),
    [("units metres, up axis +Z", "+Z"), ("Y up", "+Y"), ("up_axis: -x", "-X"), ("z-up", "+Z"), ("set up", None)],
)
def test_up_in_comments(line, axis):
    assert find_stated_up([line]) == axis


def cloud_of(sides, count=4000, center=(0, 0, 0)):
    return np.random.default_rng(0).uniform(-0.5, 0.5, (count, 3)) * sides + center


@pytest.mark.parametrize(
    ("points", "metres", "words"),
    [
        (cloud_of((3, 3, 5)), 1.0, "metres are assumed, as it is 4.98 units wide"),
        (cloud_of((30, 30, 25)), 1.0, "metres"),
        (cloud_of((5000, 4000, 8000)), 0.001, "millimetres are assumed"),
        (cloud_of((250, 200, 300)), 0.001, "millimetres"),  # in a pot
        (cloud_of((6000, 700, 1500)), 0.001, "millimetres"),  # a hedge
        (cloud_of((250, 250, 30)), 1.0, "as flat as land"),  # a forest
        (cloud_of((5000, 5000, 60)), 1.0, "as flat as land"),
        (cloud_of((250, 250, 100), center=(121_000, 487_000, 0)), 1.0, "as on a map"),
        (cloud_of((90_000, 90_000, 90_000)), 1.0, "though it is"),
        (cloud_of((100, 80, 90)), 1.0, "though it is"),
    ],
)
def test_units_are_guessed_by_size_and_shape(points, metres, words):
    guessed = guess_unit(points)
    assert guessed.metres_per_unit == metres
    assert words in guessed.remark.text
    assert Setting(name="capture.toml:metres_per_unit") in guessed.remark.remedy


def test_millimetres_in_a_file(tmp_path):
    cloud = read_cloud_input(write_text(tmp_path / "a.xyz", 1000 * some_points()))
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, some_points(), atol=1e-9)
    assert cloud.remarks[0].code == "cloud-unit-assumed"
    assert "millimetres are assumed" in cloud.remarks[0].text
    assert read_cloud_input(tmp_path / "a.xyz", METRES).metres_per_unit == 1
