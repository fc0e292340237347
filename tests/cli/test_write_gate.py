"""Every command declares what it reads and writes, and no option lets one replace what it reads."""

import importlib
import os
import shutil
import subprocess
import sys

import cv2
import numpy as np
import pytest
from usdfoliage.__main__ import COMMANDS
from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.publish import publish_folder

from tests.support.leaves.commands import files, refused, run
from tests.support.plant_assets import write_whole_plant


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_declares_what_it_writes(command):
    assert callable(importlib.import_module(f"usdfoliage.cli.{command}").declare)


@pytest.fixture
def studio(tmp_path):
    """A capture, a cloud, a photograph with its mask, and an asset with a look."""
    folder = tmp_path / "studio"
    (folder / "capture" / "images").mkdir(parents=True)
    picture = np.random.default_rng(0).integers(0, 255, (32, 32, 3), np.uint8)
    for name in ("capture/images/a.png", "capture/images/b.png", "trees/oak.png", "trees/mask.png"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name), picture)
    (folder / "link").symlink_to("capture")
    (folder / "hard").mkdir()
    os.link(folder / "capture" / "images" / "a.png", folder / "hard" / "a.png")
    (folder / "clouds").mkdir()
    (folder / "clouds" / "t.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n")
    assert run("scatter", "-n", 3, "-o", folder / "spray", "--texture", folder / "trees" / "oak.png") == 0
    assert run("edit", folder / "spray", "--width", 2, "-o", folder / "looks" / "wide.usda") == 0
    return folder


CASES = (
    ("leaves", "capture", "-o", "capture"),
    ("leaves", "capture", "-o", "."),
    ("leaves", "capture", "-o", "capture/images"),
    ("leaves", "capture", "-o", "capture/images/new"),
    ("leaves", "capture", "-o", "capture/../capture/images"),
    ("leaves", "link", "-o", "capture"),
    ("leaves", "capture", "-o", "link"),
    ("leaves", "capture", "-o", "link/images"),
    ("build", "link", "-o", "capture/images"),
    ("leaves", "capture", "-o", "hard"),
    ("leaves", "clouds/t.xyz", "-o", "clouds"),
    ("branches", "clouds/t.xyz", "-o", "clouds"),
    ("branches", "clouds/t.xyz", "-o", "spray", "--leaves", "spray"),
    ("crown", "trees/oak.png", "-o", "trees"),
    ("crown", "trees/oak.png", "--mask", "trees/mask.png", "-o", "trees"),
    ("crown", "capture", "-o", "capture"),
    ("scatter", "-n", 3, "--texture", "trees/oak.png", "-o", "trees"),
    ("scatter", "-n", 3, "--texture", "spray/maps/spray_leaf.png", "-o", "spray"),
    ("build", "capture", "-o", "capture"),
    ("build", "capture", "-o", "."),
    ("build", "capture", "-o", "spray", "--work", "spray/work"),
    ("batch", ".", "-o", "."),
    ("bake", "looks/wide.usda", "-o", "looks"),
    ("bake", "spray", "-o", "."),
    ("edit", "spray", "--width", 2, "-o", "spray/look.usda"),
    ("edit", "spray", "--width", 2, "--jitter-map", "trees/oak.png", "-o", "trees/oak.png"),
)


@pytest.mark.parametrize("dry", [False, True])
@pytest.mark.parametrize("case", CASES, ids=lambda case: " ".join(map(str, case)))
def test_no_command_replaces_its_input(studio, monkeypatch, capsys, case, dry):
    monkeypatch.chdir(studio)
    before = files(studio)
    line = refused(capsys, *case, "--force", *(["--dry-run"] if dry else []))
    assert "replaced" in line or "lies in the asset" in line
    assert files(studio) == before


@pytest.mark.parametrize("place", ["maps/x.png", "maps/spray_leaf.png", "new/x.png", "x.png"])
def test_a_picture_is_not_drawn_into_an_asset(studio, capsys, place):
    before = files(studio)
    for asset in (studio / "spray", studio / "looks" / "wide.usda"):
        line = refused(capsys, "preview", asset, "-o", studio / "spray" / place)
        assert "lies in the asset" in line
    assert files(studio) == before


def test_a_command_in_the_box_passes_the_gate_too(studio):
    before = files(studio)
    for words in (
        ("preview", "spray", "-o", "spray/maps/spray_leaf.png"),
        ("bake", "spray", "-o", ".", "--force"),
        ("edit", "spray", "--width", "2", "-o", "spray/look.usda", "--force"),
    ):
        command = [sys.executable, "-m", "usdfoliage", *words]
        done = subprocess.run(command, cwd=studio, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
        assert done.stderr.startswith("error: ")
    assert files(studio) == before


def test_a_sheet_with_a_frame_on_an_input_is_refused(studio, capsys):
    layer = studio / "t_001.png"
    layer.touch()
    line = refused(capsys, "preview", studio / "spray", "--mute", layer, "-o", studio / "t.png", "--turntable", 3)
    assert "t_001.png" in line


def test_a_job_is_not_written_into_an_asset_or_onto_an_input(studio, capsys):
    before = files(studio)
    refused(capsys, "submit", studio / "capture", "--template", studio / "spray" / "job.yaml", "--force")
    plan = studio / "job.parameters.yaml"
    plan.write_text("")
    refused(capsys, "submit", studio / "capture", "--plan", plan, "--template", studio / "job.yaml", "--force")
    plan.unlink()
    assert files(studio) == before


def test_no_other_asset_is_replaced_without_force(studio, capsys, tmp_path):
    plant = tmp_path / "plant"
    assert run("scatter", "-n", 5, "-o", plant) == 0
    before = files(plant)
    for words in ((), ("--dry-run",)):
        assert "--force" in refused(capsys, "bake", studio / "looks" / "wide.usda", "-o", plant, *words)
        assert "made by `scatter`" in refused(capsys, "bake", studio / "spray", "-o", plant, "--name", "plant", *words)
    assert files(plant) == before
    assert run("scatter", "-n", 6, "-o", plant) == 0  # of the same name and origin
    (plant / "maps").mkdir()
    (plant / "maps" / "notes.txt").write_text("precious")
    assert "notes.txt" in refused(capsys, "scatter", "-n", 7, "-o", plant)
    assert run("bake", studio / "looks" / "wide.usda", "-o", plant, "--force", "--keep-old") == 0
    assert (plant / "maps" / "notes.txt").read_text() == "precious"
    kept = plant.with_name("plant.old-1")
    assert (kept / "plant.usda").is_file()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plant", "plant.old-1", "studio"]


@pytest.mark.parametrize("dry", [False, True])
@pytest.mark.parametrize("origin", [None, AssetOrigin(name="oak", command="build", source="capture")])
@pytest.mark.parametrize("what", ["looks/wide.usda", "spray"])
def test_leaves_that_are_baked_do_not_replace_a_plant_without_force(studio, tmp_path, capsys, dry, origin, what):
    plant = tmp_path / "oak"
    write_whole_plant(studio / "plants" / "oak")
    with publish_folder(plant, origin=origin) as folder:
        shutil.copytree(studio / "plants" / "oak", folder, dirs_exist_ok=True)
    before = files(plant)
    for words in ((), ("--name", "oak"), ("--name", "oak", "--keep-old")):
        line = refused(capsys, "bake", studio / what, "-o", plant, *words, *(["--dry-run"] if dry else []))
        assert "use --force to replace it" in line
    assert files(plant) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["oak", "studio"]


def test_an_asset_that_is_baked_in_place_is_built_again_without_force(studio):
    spray = studio / "spray"
    words = ("scatter", "-n", 3, "-o", spray)
    assert run("bake", spray, "-o", spray) == 0
    assert run(*words) == 0
