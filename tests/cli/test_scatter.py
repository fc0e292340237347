"""Random sprays from the command line: good input, bad input, and what is left on disk."""

import argparse
import os
import signal
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest
from usdfoliage.cli import scatter
from usdfoliage.leaf.shape.mesh import LeafMeshSettings
from usdfoliage.leaf.shape.spray import SpraySettings

from tests.support.leaves.commands import attribute, files, patch_count, printed, read, refused, run


def test_every_representation_has_every_leaf(tmp_path, capsys):
    out = tmp_path / "assets of today" / "spray 1"

    lines = printed(capsys, "scatter", "-n", 30, "-o", out, "--seed", 3)

    assert f"asset: {out / 'spray_1.usda'}" in lines
    assert "leaves: 30" in lines
    assert "representations: bezier, nurbs, subdiv, mesh" in lines
    assert len(read(out).leaves) == 30
    assert patch_count(out) == 30
    cells = LeafMeshSettings().across * LeafMeshSettings().along
    assert len(attribute(out, "mesh", "faceVertexCounts")) >= 30 * cells
    assert len(attribute(out, "subdiv", "points")) % 30 == 0
    assert sorted(p.name for p in out.parent.iterdir()) == ["spray 1"]


def test_the_same_run_gives_the_same_bytes_another_seed_others(tmp_path):
    for folder, seed in (("one", 5), ("two", 5), ("three", 6)):
        assert run("scatter", "-n", 12, "-o", tmp_path / folder, "--name", "spray", "--seed", seed) == 0
    one, two, three = (files(tmp_path / folder) for folder in ("one", "two", "three"))
    assert one == two
    assert one["payload/leaves.usdc"] != three["payload/leaves.usdc"]


def test_no_leaves_are_a_valid_asset(tmp_path, capsys):
    assert "leaves: 0" in printed(capsys, "scatter", "-n", 0, "-o", tmp_path / "bare")
    assert len(read(tmp_path / "bare").leaves) == 0
    for representation in ("nurbs", "subdiv", "mesh"):
        assert patch_count(tmp_path / "bare", representation) == 0
    assert run("info", tmp_path / "bare") == 0
    assert run("edit", tmp_path / "bare", "--width", 2, "-o", tmp_path / "look.usda") == 0
    assert run("bake", tmp_path / "look.usda", "-o", tmp_path / "baked") == 0
    assert run("validate", tmp_path / "bare") == 0


def test_many_leaves_are_bezier_alone_with_a_note(tmp_path, capsys):
    lines = printed(capsys, "scatter", "-n", 2001, "-o", tmp_path / "bush")
    assert "representations: bezier" in lines
    assert any(line.startswith("note: beyond 2,000 leaves only bezier") for line in lines)
    assert not (tmp_path / "bush" / "payload" / "leaves_nurbs.usdc").exists()


def test_representations_are_in_the_assets_order_and_bezier_is_among_them(tmp_path, capsys):
    lines = printed(capsys, "scatter", "-n", 3, "-o", tmp_path / "a", "--representation", "mesh", "subdiv")
    assert "representations: bezier, subdiv, mesh" in lines
    assert not (tmp_path / "a" / "payload" / "leaves_nurbs.usdc").exists()


def test_resolution_length_and_variation(tmp_path):
    words = ("--representation", "mesh", "--resolution", 4, 6, "--length", 0.5, "--variation", 0)
    assert run("scatter", "-n", 4, "-o", tmp_path / "a", *words) == 0
    leaves = read(tmp_path / "a").leaves
    np.testing.assert_allclose(leaves.parameters, np.broadcast_to(leaves.parameters[:1], (4, 7, 3)))
    assert 0.3 < leaves.length_m.min() <= leaves.length_m.max() < 0.7
    fine = tmp_path / "fine"
    assert run("scatter", "-n", 4, "-o", fine, *words[:2], "--resolution", 16, 32, *words[5:]) == 0
    coarse, many = (len(attribute(folder, "mesh", "faceVertexCounts")) for folder in (tmp_path / "a", fine))
    assert many > 10 * coarse


def test_pictures_travel_into_the_asset(tmp_path):
    cv2.imwrite(str(tmp_path / "my leaf.png"), np.full((8, 8, 4), 128, np.uint8))
    cv2.imwrite(str(tmp_path / "wave.png"), np.linspace(0, 255, 16).astype(np.uint8)[None])
    out = tmp_path / "a"
    words = ("--texture", tmp_path / "my leaf.png", "--jitter-map", tmp_path / "wave.png", "--color", 0.2, 0.3, 0.1)
    assert run("scatter", "-n", 2, "-o", out, "--variation", 0, *words) == 0

    assert len(list((out / "maps").iterdir())) == 2
    spray = read(out)
    assert spray.jitter_map is not None
    assert spray.jitter_map.read_bytes() == (tmp_path / "wave.png").read_bytes()
    np.testing.assert_allclose(attribute(out, "mesh", "primvars:displayColor")[0], (0.2, 0.3, 0.1), atol=1e-6)
    for name, data in files(out).items():
        assert str(tmp_path).encode() not in data, name


def test_a_dry_run_writes_nothing(tmp_path, capsys):
    lines = printed(capsys, "scatter", "-n", 9, "-o", tmp_path / "a", "--dry-run")
    assert f"would write: {tmp_path / 'a' / 'a.usda'}" in lines
    assert list(tmp_path.iterdir()) == []


def test_a_dry_run_refuses_what_a_run_refuses(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    words = ("scatter", "-n", 9, "-o", tmp_path)
    assert refused(capsys, *words, "--dry-run") == refused(capsys, *words)


def test_the_help_states_the_defaults_of_the_settings():
    parser = argparse.ArgumentParser()
    scatter.add_arguments(parser)
    assert parser.get_default("length") == SpraySettings().length_m
    help_text = " ".join(parser.format_help().split())
    assert f"The default is {LeafMeshSettings().across} {LeafMeshSettings().along}." in help_text
    assert parser.get_default("variation") == SpraySettings().variation.amount


class TestBadInput:
    """Exit 2, one line, nothing written."""

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("-n", -1), "not -1"),
            (("-n", 20_000_000), "GiB of memory"),
            (("-n", 3, "--length", 0), "--length"),
            (("-n", 3, "--length", "nan"), "--length"),
            (("-n", 3, "--variation", -1), "--variation"),
            (("-n", 3, "--variation", "nan"), "variation"),
            (("-n", 3, "--seed", -1), "seed"),
            (("-n", 3, "--resolution", 3, 5), "across"),
            (("-n", 3, "--resolution", 0, 0), "across"),
            (("-n", 3, "--resolution", 8, 100_000), "512 cells"),
            (
                ("-n", 5_000_000, "--representation", "mesh", "--resolution", 512, 512),
                "GiB of memory, this machine has",
            ),
            (("-n", 3, "--representation", "voxels"), "bezier, nurbs, subdiv, mesh"),
            (("-n", 3, "--color", 1, 2, 3), "0 to 1"),
            (("-n", 3, "--color", "nan", 0, 0), "0 to 1"),
            (("-n", 3, "--texture", "absent.png"), "absent.png"),
            (("-n", 3, "--jitter-map", "absent.png"), "absent.png"),
        ],
    )
    def test_impossible_settings(self, tmp_path, capsys, words, message):
        assert message in refused(capsys, "scatter", *words, "-o", tmp_path / "never" / "a")
        assert list(tmp_path.iterdir()) == []

    def test_pictures_that_are_none(self, tmp_path, capsys):
        (tmp_path / "notes.png").write_text("no picture")
        for option in ("--texture", "--jitter-map"):
            assert "notes.png" in refused(
                capsys, "scatter", "-n", 3, option, tmp_path / "notes.png", "-o", tmp_path / "a"
            )
        assert sorted(p.name for p in tmp_path.iterdir()) == ["notes.png"]

    def test_somebody_elses_folder(self, tmp_path, capsys):
        theirs = tmp_path / "theirs"
        theirs.mkdir()
        (theirs / "thesis.txt").write_text("years of work")
        assert "--force" in refused(capsys, "scatter", "-n", 3, "-o", theirs)
        assert files(theirs) == {"thesis.txt": b"years of work"}
        assert "never replaced" in refused(capsys, "scatter", "-n", 3, "-o", theirs, "--force")
        assert files(theirs) == {"thesis.txt": b"years of work"}

    def test_a_file_as_output(self, tmp_path, capsys):
        (tmp_path / "a").write_text("")
        assert "is a file" in refused(capsys, "scatter", "-n", 3, "-o", tmp_path / "a")

    def test_a_full_disk(self, tmp_path, capsys, small_disk):
        line = refused(capsys, "scatter", "-n", 100_000, "-o", small_disk / "spray")
        assert "spray" in line
        assert list(small_disk.iterdir()) == []


def test_paths_with_dots(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert run("scatter", "-n", 2, "-o", "../there/./5 sprays") == 0
    assert (tmp_path / "there" / "5 sprays" / "_5_sprays.usda").exists()


@pytest.mark.parametrize("after_s", [0.4, 0.9, 1.4])
def test_a_kill_leaves_the_old_asset_whole(tmp_path, after_s):
    out = tmp_path / "spray"
    assert run("scatter", "-n", 20, "-o", out) == 0
    before = files(out)
    command = [sys.executable, "-m", "usdfoliage", "scatter", "-n", "400000", "-o", str(out)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
    time.sleep(after_s)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()

    assert files(out) == before
    assert run("scatter", "-n", 20, "-o", out) == 0  # the next run cleans up
    assert sorted(p.name for p in tmp_path.iterdir()) == ["spray"]


def test_a_farm_that_ends_the_job_leaves_nothing_behind(tmp_path):
    command = [sys.executable, "-m", "usdfoliage", "scatter", "-n", "400000", "-o", str(tmp_path / "spray")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    while process.poll() is None and not any(tmp_path.glob(".spray.*-new")):
        time.sleep(0.02)
    process.terminate()
    _, complaint = process.communicate(timeout=60)
    assert process.returncode == 130, complaint
    assert "interrupted" in complaint
    assert list(tmp_path.iterdir()) == []
