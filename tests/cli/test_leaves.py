"""Leaves of a capture from the command line: good input, bad input, and what is left on disk.

The segmentation knows the truth, so that a run takes a second; those of the product have their own tests.
"""

import argparse
import json
import logging
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.cli import leaves as command
from usdfoliage.jobs.leaves.settings import LeavesRunSettings
from usdfoliage.jobs.work.settings_file import format_settings
from usdfoliage.leaf import reconstruct

from tests.support.captures import write_depth
from tests.support.commands.json_output import read_output
from tests.support.leaves.captures import known_foliage
from tests.support.leaves.commands import files, patch_count, printed, read, refused, run
from tests.support.leaves.true_segmentation import segment_truly
from tools.synthetic_foliage import write_capture

FAST = "[texture]\nwidth_px = 16\nheight_px = 32\nmost_pictures = 4\n"


@pytest.fixture(scope="module")
def bed():
    return known_foliage(up_axis="Z")


@pytest.fixture(scope="module")
def written(tmp_path_factory, bed):
    folder = tmp_path_factory.mktemp("captures of today") / "bed 1"
    write_capture(folder, bed.capture)
    (folder / "fast.toml").write_text(FAST)
    return folder


@pytest.fixture(autouse=True)
def segmented(monkeypatch, bed):
    """The views that were segmented last."""
    ids = {view.name: ids for view, ids in zip(bed.views, bed.leaf_ids, strict=True)}
    seen = []

    def segment(views, settings, progress, threads=0):
        seen[:] = views
        return segment_truly(views, ids)

    for method in ("dense", "paper"):
        monkeypatch.setattr(reconstruct, f"segment_{method}", segment)
    return seen


def words(capture, out, *more):
    return ("leaves", capture, "-o", out, "--settings", capture / "fast.toml", "--no-preview", *more)


def capture_to_asset(asset):
    """(4, 4) for column vectors."""
    stage = open_asset(asset)
    return np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get()).T


class Page(HTMLParser):
    """What a report refers to, and whether its tags close."""

    VOID = ("meta", "img", "input", "br", "line", "rect", "polyline")

    def __init__(self, text):
        super().__init__()
        self.open, self.files = [], set()
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.files.add(dict(attributes)["src"])
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


def test_the_asset_has_the_leaves_of_the_capture(written, tmp_path, capsys, bed):
    out = tmp_path / "assets of today" / "bed 1"
    lines = printed(capsys, *words(written, out, "--species", "Passiflora alata"))

    asset = out / "bed_1.usda"
    assert f"asset: {asset}" in lines
    assert f"report: {out / 'report' / 'index.html'}" in lines
    assert "representations: bezier, nurbs, subdiv, mesh" in lines
    leaves = read(out).leaves
    assert f"kept leaves: {len(leaves)}" in lines
    assert patch_count(out) == len(leaves) > 0.6 * len(bed.leaves)
    # It stands on the ground, Y up, and can be laid back over its capture, which is Z up.
    silhouettes = leaves.base_m + leaves.asset_from_leaf()[:, :, 1]
    low = np.minimum(leaves.base_m, silhouettes).min(axis=0)
    assert -1e-6 <= low[1] < 0.1
    matrix = capture_to_asset(out)
    np.testing.assert_allclose(matrix[:3, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    true = bed.leaves.base_m + bed.leaves.asset_from_leaf()[:, :, 1] / 2
    middles = leaves.base_m + leaves.asset_from_leaf()[:, :, 1] / 2
    back = (middles - matrix[:3, 3]) @ matrix[:3, :3]
    away = np.linalg.norm(back[:, None] - true, axis=2).min(axis=1)
    assert np.median(away / leaves.length_m) < 0.15
    for facts in (leaves.color, leaves.confidence, leaves.residual_m):
        assert facts is not None
        assert np.ptp(facts) > 0
    assert set(leaves.view) <= set(range(4))
    texture = cv2.imread(str(out / "maps" / "bed_1_leaf.png"), cv2.IMREAD_UNCHANGED)
    assert texture.shape == (32, 16, 4)
    assert run("validate", out) == 0
    capsys.readouterr()
    stage = open_asset(out)
    root = stage.GetDefaultPrim()
    assert root.GetAttribute("foliage:species").Get() == "Passiflora alata"
    assert root.GetAttribute("foliage:capture").Get() == "bed 1"
    assert sorted(p.name for p in out.parent.iterdir()) == ["bed 1"]


def test_photographs_that_are_withheld_measure_the_asset(written, tmp_path, capsys, segmented):
    lines = printed(capsys, *words(written, tmp_path / "a", "--hold-back", 2))
    assert [view.name for view in segmented] == ["000.jpg", "001.jpg", "003.jpg"]
    assert any(line.startswith("withheld photographs: IoU 0.") for line in lines)
    assert any(line.startswith("002.jpg: IoU 0.") and line.endswith("(by its green)") for line in lines)
    folder = tmp_path / "a" / "report"
    text = (folder / "index.html").read_text()
    page = Page(text)
    assert all((folder / name).is_file() for name in page.files)
    assert "withheld_000.jpg" in page.files
    assert "Withheld photographs" in text
    assert json.loads((folder / "withheld.json").read_text())["views"][0]["name"] == "002.jpg"
    assert set(read(tmp_path / "a").leaves.view) <= {0, 1, 3}
    text = "\n".join(printed(capsys, *words(written, tmp_path / "b", "--hold-back", 2, "--json")))
    stated = read_output("leaves", text)
    assert stated["withheld"]["hold_back"] == 2
    assert 0 < stated["withheld"]["mean"]["iou"] <= 1


def test_holding_back_what_cannot_be_is_refused(written, tmp_path, capsys):
    assert "hold_back must be 0 or at least 2, not 1" in refused(
        capsys, *words(written, tmp_path / "a", "--hold-back", 1)
    )
    left = refused(capsys, *words(written, tmp_path / "a", "--hold-back", 2, "--views", "2"))
    assert "no photograph is left of 1 photograph: they are all withheld; withhold fewer with --hold-back" in left


def test_the_report_shows_every_photograph(written, tmp_path):
    assert run(*words(written, tmp_path / "a", "--report-views", 3)) == 0
    folder = tmp_path / "a" / "report"
    text = (folder / "index.html").read_text()
    page = Page(text)
    assert all((folder / name).is_file() for name in page.files)
    pictures = {name for name in page.files if "/" not in name}
    assert {path.name for path in folder.iterdir()} == pictures | {"index.html", "files.json", "timings.js"}
    assert "3 of 4 photographs are shown" in text
    assert re.findall(r"<h3>\d+: (.*)</h3>", text) == ["000.jpg", "002.jpg", "003.jpg"]
    for step in ("candidates in single views", "leaves of the scene", "fitted leaves", "kept leaves"):
        assert step in text
    assert '"segmentation"' in (folder / "timings.js").read_text()
    assert str(tmp_path) not in text


def test_the_same_run_gives_the_same_bytes(written, tmp_path):
    for folder in ("one", "two"):
        assert run(*words(written, tmp_path / folder, "--name", "bed", "--threads", 1 if folder == "one" else 2)) == 0
    one, two = (files(tmp_path / folder) for folder in ("one", "two"))
    one.pop("report/timings.js")
    two.pop("report/timings.js")
    assert one == two


def test_only_some_photographs(written, tmp_path, segmented):
    assert run(*words(written, tmp_path / "a", "--views", "1,003.jpg")) == 0
    assert [view.name for view in segmented] == ["001.jpg", "003.jpg"]
    assert set(read(tmp_path / "a").leaves.view) == {1, 3}


def test_one_photograph(written, tmp_path, capsys):
    lines = printed(capsys, *words(written, tmp_path / "a", "--views", 2))
    assert any(line.startswith("note: there is one view only") for line in lines)
    assert set(read(tmp_path / "a").leaves.view) == {2}


def test_unsure_leaves_are_left_out(written, tmp_path, capsys):
    assert run(*words(written, tmp_path / "all", "--representation", "bezier")) == 0
    found = read(tmp_path / "all").leaves
    min_confidence = round(float(np.median(found.confidence)), 2)
    lines = printed(capsys, *words(written, tmp_path / "a", "--min-confidence", min_confidence))
    kept = read(tmp_path / "a").leaves
    assert 0 < len(kept) < len(found)
    assert f"kept leaves: {len(kept)}" in lines
    assert kept.confidence.min() >= min_confidence - 1e-6
    assert f"of less confidence than {min_confidence:g}" in (tmp_path / "a" / "report" / "index.html").read_text()


def test_no_leaf_is_an_empty_asset_and_a_warning(written, tmp_path, capsys, caplog, monkeypatch):
    nothing = reconstruct.find_nothing

    def segment(views, settings, progress, threads=0):
        return replace(nothing(views), dropped={"superpixels without a plane": 31})

    monkeypatch.setattr(reconstruct, "segment_dense", segment)
    with caplog.at_level(logging.WARNING):
        lines = printed(capsys, *words(written, tmp_path / "a"))
    assert f"no leaf was found ({written})" in caplog.messages
    assert any(line.startswith("warning: no leaf was found, ") for line in lines)
    assert not any(line.startswith("note: no leaf was found") for line in lines)
    assert len(read(tmp_path / "a").leaves) == 0
    assert run("validate", tmp_path / "a") == 0
    text = (tmp_path / "a" / "report" / "index.html").read_text()
    Page(text)
    assert "no leaf was found" in text
    assert "31 superpixels without a plane" in text


def test_representations_that_are_asked_for(written, tmp_path, capsys):
    lines = printed(capsys, *words(written, tmp_path / "a", "--representation", "mesh"))
    assert "representations: bezier, mesh" in lines


def test_a_dry_run_reads_the_capture_and_writes_nothing(written, tmp_path, capsys):
    lines = printed(capsys, *words(written, tmp_path / "a", "--dry-run", "--method", "paper"))
    assert lines[0] == f"capture: {written}, 4 photographs, the first 480 x 360 px"
    assert lines[1] == "depth: of 4 of them; masks: of 0"
    assert "method paper" in lines[-3]
    assert "texture.width_px 16" in lines[-3]
    assert "threads" not in lines[-3]
    assert lines[-1] == f"would write: {tmp_path / 'a' / 'a.usda'}"
    assert list(tmp_path.iterdir()) == []


def test_without_depth_it_is_computed_from_the_photographs(written, tmp_path, capsys):
    capture = tmp_path / "bare"
    shutil.copytree(written, capture, ignore=shutil.ignore_patterns("depth*", "truth"))
    lines = printed(capsys, *words(capture, tmp_path / "a", "--dry-run"))
    assert lines[1].startswith(
        "depth: from the photographs, at 1200 px at most, in 5 rounds, each with 9 others at most"
    )
    assert any(line.startswith("steps: capture, depth, segmentation") for line in lines)
    assert "it takes two to compute it" in refused(capsys, *words(capture, tmp_path / "a", "--views", 0))


def test_depth_that_lacks_for_some_is_counted(written, tmp_path, capsys):
    capture = tmp_path / "a capture"
    shutil.copytree(written, capture, ignore=shutil.ignore_patterns("truth"))
    (capture / "depth" / "001.exr").unlink()
    lines = printed(capsys, *words(capture, tmp_path / "a"))
    assert any("1 of 4 views without a depth map: 001.jpg" in line for line in lines)


@pytest.mark.parametrize("depth", ["nothing", "not finite", "another shape"])
def test_depth_maps_that_hold_nothing_are_not_replaced_unasked(written, tmp_path, capsys, depth):
    capture = tmp_path / "a capture"
    shutil.copytree(written, capture, ignore=shutil.ignore_patterns("truth"))
    height_px = 100 if depth == "another shape" else 360
    for path in (capture / "depth").iterdir():
        write_depth(path, np.full((height_px, 480), np.nan if depth == "not finite" else 0, np.float32))
    lines = printed(capsys, *words(capture, tmp_path / "a"))
    assert [line[:9] for line in lines if "--depth estimated computes it" in line] == ["warning: "]
    assert len(read(tmp_path / "a").leaves) == 0
    assert "--depth estimated computes it" in (tmp_path / "a" / "report" / "index.html").read_text()


def test_depth_in_another_unit_is_a_warning(written, tmp_path, capsys):
    capture = tmp_path / "a capture"
    shutil.copytree(written, capture, ignore=shutil.ignore_patterns("truth"))
    for path in (capture / "depth").iterdir():
        write_depth(path, np.full((360, 480), 2000, np.float32))
    lines = printed(capsys, *words(capture, tmp_path / "a"))
    assert [line[:9] for line in lines if "probably in millimetres" in line] == ["warning: "]


class TestSettings:
    def test_printed_settings_are_settings(self, tmp_path, capsys, written):
        text = "\n".join(printed(capsys, "leaves", "--print-settings"))
        assert text.strip() == format_settings(LeavesRunSettings()).strip()
        (tmp_path / "all of them.toml").write_text(text)
        again = printed(capsys, "leaves", "--print-settings", "--settings", tmp_path / "all of them.toml")
        assert "\n".join(again) == text

    def test_options_override_the_file(self, tmp_path, capsys):
        (tmp_path / "a.toml").write_text('method = "paper"\nmin_confidence = 0.25\n[paper]\nseed = 3\n')
        given = ("leaves", "--print-settings", "--settings", tmp_path / "a.toml")
        lines = printed(capsys, *given)
        assert {'method = "paper"', "min_confidence = 0.25", "seed = 3"} <= set(lines)
        lines = printed(capsys, *given, "--method", "dense", "--min-confidence", 0, "--seed", 0)
        assert {'method = "dense"', "min_confidence = 0.0"} <= set(lines)
        assert "seed = 3" not in lines

    def test_the_plane_threshold(self, capsys):
        lines = printed(capsys, "leaves", "--print-settings", "--plane-threshold", 0.02)
        assert "plane_threshold_m = 0.02" in lines
        lines = printed(capsys, "leaves", "--print-settings", "--plane-threshold", "auto")
        assert 'plane_threshold_m = "auto"' in lines

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            (
                ("--min-confidence", 2),
                "min_confidence must be from 0 to 1, not 2.0; give another number with --min-confidence",
            ),
            (("--min-confidence", "nan"), "give another number with --min-confidence"),
            (("--plane-threshold", "-1"), "--plane-threshold must be"),
            (("--plane-threshold", "much"), "--plane-threshold must be"),
            (("--seed", -1), "seed"),
            (("--threads", -1), "--threads"),
            (("--report-views", -1), "--report-views"),
            (("--representation", "voxels"), "voxels"),
            (("--settings", "absent.toml"), "absent.toml"),
            (("--views", "7"), "view"),
            (("--depth", "absent"), "absent"),
        ],
    )
    def test_impossible_values(self, written, tmp_path, capsys, given, message):
        assert message in refused(capsys, "leaves", written, "-o", tmp_path / "never" / "a", *given)
        assert list(tmp_path.iterdir()) == []

    def test_a_mistake_in_the_file_names_file_and_key(self, tmp_path, capsys):
        file = tmp_path / "my settings.toml"
        file.write_text("[texture]\nwidht_px = 32\n")
        line = refused(capsys, "leaves", "--print-settings", "--settings", file)
        assert "texture.widht_px" in line
        assert str(file) in line

    def test_the_help_states_the_defaults_of_the_settings(self):
        parser = argparse.ArgumentParser()
        command.add_arguments(parser)
        help_text = " ".join(parser.format_help().split())
        assert f"The default is {LeavesRunSettings().method}." in help_text
        assert f"from 0 to 1; the default is {LeavesRunSettings().min_confidence:g}." in help_text
        assert "in metres, above 0; the default is auto." in help_text
        for name in ("method", "min_confidence", "plane_threshold", "seed", "threads"):
            assert parser.get_default(name) is None, name  # the settings' own


class TestBadInput:
    """Exit 2, one line, nothing written."""

    def test_nothing_named(self, tmp_path, capsys, written):
        assert "give its folder" in refused(capsys, "leaves")
        assert "-o OUT" in refused(capsys, "leaves", written)

    def test_no_capture(self, tmp_path, capsys):
        assert "nowhere" in refused(capsys, "leaves", tmp_path / "nowhere", "-o", tmp_path / "a")
        (tmp_path / "empty").mkdir()
        assert "empty" in refused(capsys, "leaves", tmp_path / "empty", "-o", tmp_path / "a")
        assert sorted(p.name for p in tmp_path.iterdir()) == ["empty"]

    def test_somebody_elses_folder(self, tmp_path, capsys, written):
        theirs = tmp_path / "theirs"
        theirs.mkdir()
        (theirs / "thesis.txt").write_text("years of work")
        assert "--force" in refused(capsys, *words(written, theirs))
        assert files(theirs) == {"thesis.txt": b"years of work"}

    def test_a_full_disk(self, capsys, written, small_disk):
        assert "bed" in refused(capsys, *words(written, small_disk / "bed"))
        assert list(small_disk.iterdir()) == []
