from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.capture.folder.depth_scale import check_depth_scale, leave_out_other_units
from usdfoliage.capture.folder.read import read_capture, read_views

from tests.support.captures import write_capture

NO_POINTS = np.zeros((0, 3))


@pytest.fixture
def views(tmp_path):
    write_capture(tmp_path, count=3)
    return read_views(read_capture(tmp_path)).views


def scaled(views, *factors: float):
    return [replace(view, depth_m=view.depth_m * np.float32(by)) for view, by in zip(views, factors, strict=True)]


@pytest.mark.parametrize("odd", [0, 1, 2])
@pytest.mark.parametrize(
    ("factor", "words"),
    [(1000, "millimetres"), (100, "centimetres"), (0.001, "others is probably in millimetres")],
)
def test_one_view_in_another_unit_is_left_out(views, odd, factor, words):
    factors = [1.0, 1.0, 1.0]
    factors[odd] = factor
    kept, remarks = leave_out_other_units(scaled(views, *factors), NO_POINTS)
    assert len(remarks) == 1
    assert views[odd].name in remarks[0].text
    assert words in remarks[0].text
    for place, (before, after) in enumerate(zip(views, kept, strict=True)):
        np.testing.assert_array_equal(after.depth_m, 0 if place == odd else before.depth_m)


@pytest.mark.parametrize("factor", [1.0, 1000.0, 0.001])
def test_views_that_agree_are_kept(views, factor):
    before = scaled(views, factor, factor, factor)
    kept, remarks = leave_out_other_units(before, NO_POINTS)
    assert remarks == ()
    assert list(kept) == before
    assert len(check_depth_scale(kept, NO_POINTS, 1.0)) == (factor != 1)


def test_no_depth_is_no_reason_for_a_remark(views):
    before = scaled(views, 0, 0, 0)
    assert leave_out_other_units(before, NO_POINTS) == (tuple(before), ())


def test_of_two_views_neither_is_left_out(views):
    before = scaled(views[:2], 1, 1000)
    kept, remarks = leave_out_other_units(before, NO_POINTS)
    assert list(kept) == before
    assert "different units" in remarks[0].text


def test_a_view_with_much_background_is_kept(views):
    far = views[1].depth_m.copy()
    rows, columns = np.nonzero(far)
    behind = np.arange(len(rows)) % 4 != 0
    far[rows[behind], columns[behind]] *= 1000
    before = [views[0], replace(views[1], depth_m=far), views[2]]
    assert leave_out_other_units(before, NO_POINTS) == (tuple(before), ())


def test_a_folder_with_one_view_in_millimetres(tmp_path, views):
    write_capture(tmp_path / "millimetres", count=3, depth_scale=1000)
    odd = views[1].name
    path = read_capture(tmp_path).views[1].depth
    (tmp_path / "millimetres" / "depth" / path.name).replace(path)
    read = read_views(read_capture(tmp_path))
    assert [view.has_depth for view in read.views] == [True, False, True]
    (left_out,) = [each for each in read.remarks if each.code == "depth-of-other-unit-left-out"]
    assert left_out.subject == odd


def test_points_of_the_cameras_show_a_unit_too(views):
    before = scaled(views, 1, 1, 1000)
    rows, columns = np.nonzero(views[2].depth_m)
    points_m = views[2].camera.unproject(np.column_stack([columns, rows]) + 0.5, views[2].depth_m[rows, columns])
    kept, remarks = leave_out_other_units(before, points_m)
    assert [view.has_depth for view in kept] == [True, True, False]
    assert remarks[0].text.startswith(views[2].name)
    assert check_depth_scale(kept, points_m, 1.0) == ()
