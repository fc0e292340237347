"""Leaves of a capture without depth: the matching of a capture, in one command and in two."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from usdfoliage.jobs.leaves.request import LeavesRequest
from usdfoliage.jobs.leaves.run import ESTIMATED, read_leaves_input
from usdfoliage.jobs.leaves.settings import LeavesRunSettings
from usdfoliage.jobs.work.settings_file import read_settings_file

from tests.support.capture_photos import FAST, LENS, poses, write_posed_photos
from tests.support.captures import write_text_model
from tests.support.leaves.commands import files, printed, read, refused, run

SEEN = "[texture]\nwidth_px = 16\nheight_px = 32\n"
FAST_CAPTURE = FAST.replace("[depth", "[capture.depth")


@pytest.fixture(scope="module")
def bed(tmp_path_factory):
    """Photographs with cameras, and settings of both commands."""
    folder = tmp_path_factory.mktemp("photographs of today") / "bed 1"
    write_posed_photos(folder)
    (folder / "leaves.toml").write_text(SEEN + FAST_CAPTURE)
    return folder


@pytest.fixture(scope="module")
def with_depth(bed, tmp_path_factory):
    """The same after usdfoliage capture."""
    folder = tmp_path_factory.mktemp("with depth") / "bed 1"
    shutil.copytree(bed, folder)
    assert run("capture", folder, "--settings", folder / "fast.toml", "--no-report") == 0
    return folder


def words(capture, out, *more):
    settings = capture / "leaves.toml"
    return ("leaves", capture, "-o", out, "--settings", settings, "--no-preview", "--report-views", 0, *more)


def views_of(capture, depth):
    settings = read_settings_file(capture / "leaves.toml", LeavesRunSettings())
    request = LeavesRequest(capture=capture, output=Path("none"), name="none", settings=settings, depth=depth)
    return read_leaves_input(request)


def test_depth_is_that_of_usdfoliage_capture(bed, with_depth):
    given, estimated = views_of(with_depth, "depth"), views_of(bed, "auto")
    assert (given.estimated, estimated.estimated) == (False, True)
    for one, other in zip(given.views, estimated.views, strict=True):
        assert one.name == other.name
        assert one.has_depth
        np.testing.assert_array_equal(one.depth_m, other.depth_m)


def test_leaves_by_one_command_and_by_two_agree(bed, with_depth, tmp_path, capsys):
    assert run(*words(with_depth, tmp_path / "two")) == 0
    lines = printed(capsys, *words(bed, tmp_path / "one"))
    one, two = (read(tmp_path / folder).leaves for folder in ("one", "two"))
    assert len(one) == len(two) > 2
    for name in ("parameters", "base_m", "length_m", "confidence"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert any(line.startswith("note: depth was computed from the photographs") for line in lines)


def test_given_depth_is_not_used_where_depth_of_photographs_is_asked_for(bed, with_depth):
    again = views_of(with_depth, ESTIMATED)
    for one, other in zip(again.views, views_of(bed, "auto").views, strict=True):
        np.testing.assert_array_equal(one.depth_m, other.depth_m)


def test_threads_change_no_byte(bed, tmp_path):
    for threads in (1, 2):
        output = tmp_path / str(threads)
        assert run(*words(bed, output, "--name", "bed", "--threads", threads, "--reproducible")) == 0
    one, two = (files(tmp_path / str(threads)) for threads in (1, 2))
    assert one == two


def test_the_settings_of_depth_are_those_of_a_plan(bed, tmp_path, capsys):
    lines = printed(capsys, *words(bed, tmp_path / "a", "--dry-run", "--seed", 5))
    assert lines[1].startswith(
        "depth: from the photographs, at 128 px at most, in 2 rounds, each with 3 others at most"
    )
    assert any("capture.depth.sources 3" in line and "capture.depth.seed 5" in line for line in lines)
    given = printed(capsys, *words(bed, tmp_path / "a", "--dry-run", "--print-settings"))
    assert "[capture.depth]" in given


def test_settings_of_depth_are_not_stated_where_depth_is_given(with_depth, tmp_path, capsys):
    lines = printed(capsys, *words(with_depth, tmp_path / "a", "--dry-run"))
    assert not any("capture.depth.sources" in line for line in lines)


def test_the_old_word_for_it_counts_with_a_warning(bed, tmp_path, capsys, caplog):
    lines = printed(capsys, *words(bed, tmp_path / "a", "--dry-run", "--depth", "sweep"))
    assert any(line.startswith("depth: from the photographs") for line in lines)
    assert "--depth sweep is called estimated now" in caplog.text


def test_photographs_from_one_place_are_refused(bed, tmp_path, capsys):
    capture = tmp_path / "turned"
    shutil.copytree(bed, capture)
    write_text_model(capture / "cameras", dict.fromkeys(poses(), poses()["leaf 2.png"]), [LENS], np.zeros((0, 3)))
    complaint = refused(capsys, *words(capture, tmp_path / "a"))
    assert "depth cannot be computed from the photographs: no two of 5 photographs look at the same place" in complaint
    assert f"or put depth maps into {capture / 'depth'}" in complaint
