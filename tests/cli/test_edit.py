"""Looks from the command line: their opinions, what they do to the leaves, and what is refused."""

import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Usd
from usdfoliage.__main__ import build_parser
from usdfoliage.asset.locate import find_leaves
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.cli.options.edit import EDIT_OPTIONS, parse_edits
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter
from usdfoliage.leaf.shape.edits import LeafEdits, apply_edits

from tests.support.leaves.commands import files, printed, refused, run


@pytest.fixture(scope="module")
def spray(tmp_path_factory):
    """An asset in a folder with a space."""
    out = tmp_path_factory.mktemp("my assets") / "spray"
    assert run("scatter", "-n", 6, "-o", out) == 0
    return out


def edits_of(path: Path) -> LeafEdits:
    stage = open_asset(path)
    (leaves,) = find_leaves(stage)
    return read_leaves(leaves).edits


def parse(*words: object) -> LeafEdits:
    return parse_edits(build_parser().parse_args(["edit", "asset", "-o", "a.usda", *map(str, words)]))


@pytest.mark.parametrize(
    ("words", "edits"),
    [
        (("--width", 1.5), LeafEdits(width=1.5)),
        (("--asymmetry", -0.1, 0), LeafEdits(axis1=(-0.1, 0, 0), axis2=(-0.1, 0, 0))),
        (("--asymmetry", "-1e-1", "-.05"), LeafEdits(axis1=(-0.1, -0.05, 0), axis2=(-0.1, -0.05, 0))),
        (("--axis1", 0.1, 0.2, -0.3), LeafEdits(axis1=(0.1, 0.2, -0.3))),
        (("--axis2", -1, -2, -3), LeafEdits(axis2=(-1, -2, -3))),
        (("--bend", -0.2), LeafEdits(axis1=(0, 0, -0.2), axis2=(0, 0, -0.2))),
        (("--bend", 0.2, -0.1), LeafEdits(axis1=(0, 0, 0.2), axis2=(0, 0, -0.1))),
        (("--bend", 0.5, "--axis1", 1, 0, 0.25), LeafEdits(axis1=(1, 0, 0.75), axis2=(0, 0, 0.5))),
        (("--silhouette", 2, -0.1, 0.2), LeafEdits(silhouette2=(-0.1, 0.2, 0))),
        (
            ("--silhouette", 1, 0, 0.1, -0.2, "--silhouette", 3, 0.1, 0),
            LeafEdits(silhouette1=(0, 0.1, -0.2), silhouette3=(0.1, 0, 0)),
        ),
        (("--curl", -0.1, 0.2, -0.3), LeafEdits(curl=(-0.1, 0.2, -0.3))),
        (("--jitter", 0.02, 12), LeafEdits(jitter_amplitude=0.02, jitter_frequency=12)),
    ],
)
def test_an_option_is_an_edit(words, edits):
    assert parse(*words) == edits


@settings(max_examples=60, deadline=None)
@given(st.floats(-1e3, 1e3), st.floats(-1e-6, 1e-6))
def test_any_number_is_a_value_and_never_an_option(x, y):
    assert parse("--asymmetry", repr(x), repr(y)).axis1 == (x, y, 0.0)


def test_a_look_authors_only_the_named_edits_and_the_asset_keeps_its_bytes(spray, tmp_path, capsys):
    before = files(spray)
    look = tmp_path / "my looks" / "wide.usda"

    lines = printed(capsys, "edit", spray, "--width", 1.5, "--bend", -0.1, "-o", look)

    assert "width: 1.5 (was 1)" in lines
    assert "axis1: 0 0 -0.1 (was 0 0 0)" in lines
    assert f"look: {look}" in lines
    assert any("sublayer it into a scene" in line for line in lines)
    assert files(spray) == before
    text = look.read_text()
    assert "edit:width" in text
    assert "edit:curl" not in text
    assert edits_of(look) == LeafEdits(
        width=1.5, axis1=tuple(np.float32([0, 0, -0.1]).tolist()), axis2=tuple(np.float32([0, 0, -0.1]).tolist())
    )
    assert sorted(p.name for p in look.parent.iterdir()) == ["wide.usda"]


def test_a_sublayered_look_reaches_the_asset_in_a_scene(spray, tmp_path):
    look = tmp_path / "look.usda"
    assert run("edit", spray, "--width", 2, "-o", look) == 0
    scene = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    scene.DefinePrim("/World/a").GetReferences().AddReference(str(spray / "spray.usda"))
    scene.GetRootLayer().subLayerPaths.append("./look.usda")
    leaves = scene.GetPrimAtPath("/World/a/geo/render/Leaves")
    assert read_leaves(leaves).edits.width == 2
    scene.MuteLayer(str(look))
    assert read_leaves(scene.GetPrimAtPath("/World/a/geo/render/Leaves")).edits.width == 1


def test_a_look_of_a_look_acts_on_what_that_shows(spray, tmp_path):
    first, second = tmp_path / "first.usda", tmp_path / "second.usda"
    steps = (("--width", 1.5, "--silhouette", 2, 0, 0.1, "--jitter", 0.02, 9), ("--width", 2, "--curl", 0.25, 0, 0))
    assert run("edit", spray, *steps[0], "-o", first) == 0
    assert run("edit", first, *steps[1], "-o", second) == 0

    stage = open_asset(spray)
    (leaves,) = find_leaves(stage)
    start = read_leaves(leaves).leaves.parameters
    expected = apply_edits(apply_edits(start, parse(*steps[0])), parse(*steps[1]))
    edits = edits_of(second)
    np.testing.assert_allclose(apply_edits(start, edits), expected, atol=1e-7)
    assert edits.jitter_frequency == 9
    first.unlink()  # the second one does not need it
    assert edits_of(second) == edits

    assert run("edit", second, "--jitter", 0, 8, "-o", second) == 0  # in its own place
    assert edits_of(second).jitter_amplitude == 0
    assert edits_of(second).width == 3


def test_one_placement_alone(spray, tmp_path):
    look = tmp_path / "look.usda"
    assert run("edit", spray, "--width", 2, "--prim", "/World/b", "-o", look) == 0
    scene = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    for name in "ab":
        scene.DefinePrim(f"/World/{name}").GetReferences().AddReference(str(spray / "spray.usda"))
    scene.GetRootLayer().subLayerPaths.append("./look.usda")
    widths = [read_leaves(scene.GetPrimAtPath(f"/World/{name}/geo/render/Leaves")).edits.width for name in "ab"]
    assert widths == [1, 2]

    again = tmp_path / "again.usda"
    assert run("edit", look, "--bend", 0.1, "-o", again) == 0
    assert "/World/b" in again.read_text().replace('over "World"\n{\n    over "b"', "/World/b")


def test_a_jitter_map(spray, tmp_path, capsys):
    wave = tmp_path / "wave.png"
    cv2.imwrite(str(wave), np.linspace(0, 255, 16).astype(np.uint8)[None])
    lines = printed(capsys, "edit", spray, "--jitter-map", wave, "-o", tmp_path / "look.usda")
    assert any(line.startswith("note: the jitter map shows nothing") for line in lines)
    printed(capsys, "edit", spray, "--jitter-map", wave, "--jitter", 0.02, 5, "-o", tmp_path / "look.usda")
    stage = open_asset(tmp_path / "look.usda")
    (leaves,) = find_leaves(stage)
    assert read_leaves(leaves).jitter_map.samefile(wave)


def test_jitter_finer_than_the_prototype_is_noted_until_baked(spray, tmp_path, capsys):
    look = tmp_path / "look.usda"
    words = "note: bezier shows a coarser wave than 30 cycles until baked"
    assert not any("coarser" in line for line in printed(capsys, "edit", spray, "--jitter", 0.02, 16, "-o", look))
    lines = printed(capsys, "edit", spray, "--jitter", 0.02, 30, "-o", look)
    assert f"{words}: each silhouette of its prototype has 128 segments, enough for 16" in lines
    assert run("bake", look, "-o", tmp_path / "baked") == 0
    lines = printed(capsys, "edit", tmp_path / "baked", "--jitter", 0.03, 30, "-o", tmp_path / "again.usda")
    assert not any("coarser" in line for line in lines)
    lines = printed(capsys, "edit", tmp_path / "baked", "--jitter", 0.03, 70, "-o", tmp_path / "again.usda")
    assert any("coarser wave than 70 cycles until baked" in line and "480 segments" in line for line in lines)


def test_an_edit_that_changes_nothing_is_noted(spray, tmp_path, capsys):
    lines = printed(capsys, "edit", spray, "--width", 1, "-o", tmp_path / "look.usda")
    assert any(line.startswith("note: these edits change nothing") for line in lines)


def test_a_dry_run_writes_nothing(spray, tmp_path, capsys):
    lines = printed(capsys, "edit", spray, "--width", 2, "-o", tmp_path / "look.usda", "--dry-run")
    assert "width: 2 (was 1)" in lines
    assert f"would write: {tmp_path / 'look.usda'}" in lines
    assert list(tmp_path.iterdir()) == []


def test_a_dry_run_refuses_what_a_run_refuses(spray, tmp_path, capsys):
    (tmp_path / "mine.usda").write_text("#usda 1.0\n")
    for output in (tmp_path / "mine.usda", tmp_path, spray / "look.usda"):
        words = ("edit", spray, "--width", 2, "-o", output)
        assert refused(capsys, *words, "--dry-run") == refused(capsys, *words)


def test_paths_with_dots(spray, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert run("edit", os.path.relpath(spray), "--width", 2, "-o", "../here/../looks of today/./wide.usda") == 0
    assert edits_of(tmp_path / "looks of today" / "wide.usda").width == 2


@pytest.mark.preview
def test_a_look_is_drawn_over_its_asset(spray, tmp_path):
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    look, picture = tmp_path / "a look.usda", tmp_path / "a look.png"
    assert run("edit", spray, "--width", 0.5, "-o", look) == 0
    assert run("preview", look, "-o", picture, "--size", 64, 64, "--background", "transparent") == 0
    assert (cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)[..., 3] > 0).sum() > 50
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a look.png", "a look.usda"]


class TestBadInput:
    """Exit 2, one line, nothing written, the asset untouched."""

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            ((), "--width, --asymmetry"),
            (("--width", -1), "width must be 0 or more"),
            (("--width", "nan"), "width"),
            (("--asymmetry", "nan", 0), "axis1"),
            (("--bend", 1, 2, 3), "--bend takes"),
            (("--silhouette", 4, 0, 0), "1, 2 or 3"),
            (("--silhouette", 1.5, 0, 0), "1, 2 or 3"),
            (("--silhouette", 1, 0), "POINT V X"),
            (("--silhouette", 1, 0, 0, 0, 0), "POINT V X"),
            (("--silhouette", 1, 0, 0, "--silhouette", 1, 0, 1), "twice"),
            (("--width", 1e30), "width"),
            (("--bend", 5e300), "axis1"),
            (("--jitter", -1, 8), "jitter_amplitude"),
            (("--jitter", 0.1, 0), "jitter_frequency"),
            (("--jitter-map", "absent.png"), "absent.png"),
            (("--width", 2, "--prim", "no path"), "no path"),
        ],
    )
    def test_impossible_edits(self, spray, tmp_path, capsys, words, message):
        assert message in refused(capsys, "edit", spray, *words, "-o", tmp_path / "never" / "look.usda")
        assert list(tmp_path.iterdir()) == []

    def test_every_option_is_named_where_none_is_given(self, spray, tmp_path, capsys):
        line = refused(capsys, "edit", spray, "-o", tmp_path / "look.usda")
        for option in EDIT_OPTIONS:
            assert f"--{option.replace('_', '-')}" in line

    @pytest.mark.parametrize("word", ["x", "--oops"])
    def test_words_that_are_no_numbers(self, spray, tmp_path, word):
        with pytest.raises(SystemExit, match="2"):
            run("edit", spray, "--asymmetry", 0, word, "-o", tmp_path / "look.usda")

    def test_assets_that_are_none(self, spray, tmp_path, capsys):
        theirs = tmp_path / "theirs.usda"
        theirs.write_text('#usda 1.0\ndef Xform "World" {}\n')
        broken = tmp_path / "broken.usda"
        broken.write_text("no USD")
        (tmp_path / "empty").mkdir()
        for asset in (tmp_path / "absent", theirs, broken, tmp_path / "empty"):
            assert asset.name in refused(capsys, "edit", asset, "--width", 2, "-o", tmp_path / "look.usda")
        assert not (tmp_path / "look.usda").exists()

    def test_places_where_a_look_cannot_be(self, spray, tmp_path, capsys):
        before = files(spray)
        for place in (spray / "look.usda", spray / "spray.usda", spray / "payload" / "leaves.usda", spray):
            refused(capsys, "edit", spray, "--width", 2, "-o", place)
        assert files(spray) == before
        refused(capsys, "edit", spray, "--width", 2, "-o", tmp_path / "look.usdc")
        theirs = tmp_path / "scene.usda"
        theirs.write_text('#usda 1.0\ndef Xform "World" {}\n')
        assert "--force" in refused(capsys, "edit", spray, "--width", 2, "-o", theirs)
        assert "World" in theirs.read_text()
        assert run("edit", spray, "--width", 2, "-o", theirs, "--force") == 0
        assert "World" not in theirs.read_text()

    def test_a_look_whose_asset_is_gone(self, tmp_path, capsys):
        assert run("scatter", "-n", 1, "-o", tmp_path / "a") == 0
        assert run("edit", tmp_path / "a", "--width", 2, "-o", tmp_path / "look.usda") == 0
        (tmp_path / "a").rename(tmp_path / "b")
        for command in (("edit", "--width", 2), ("bake",)):
            line = refused(capsys, command[0], tmp_path / "look.usda", *command[1:], "-o", tmp_path / "c.usda")
            assert "look.usda" in line
        assert "look.usda" in refused(capsys, "info", tmp_path / "look.usda")
        assert "look.usda" in refused(capsys, "preview", tmp_path / "look.usda", "-o", tmp_path / "a.png")

    def test_a_full_disk(self, spray, small_disk, capsys):
        look = small_disk / "look.usda"
        assert run("edit", spray, "--width", 2, "-o", look) == 0
        before = files(small_disk)
        (small_disk / "filling").write_bytes(bytes(shutil.disk_usage(small_disk).free))
        line = refused(capsys, "edit", spray, "--width", 3, "--bend", 1, "-o", look)
        assert "look.usda" in line
        assert "No space left" in line
        (small_disk / "filling").unlink()
        assert files(small_disk) == before
