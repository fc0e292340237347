"""Pipes, devices, links in a circle and forbidden folders, given to commands: one line, exit code 2, and no wait."""

import os
import shutil
import subprocess
import sys

import pytest

from tests.support.capture_photos import write_posed_photos
from tests.support.leaves.commands import refused, run
from tools.fuzz.hardship import obey_permissions


def end(*words, **more):
    return subprocess.run(
        [sys.executable, "-m", "usdfoliage", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        **more,
    )


def assert_refused(ended, *parts):
    assert ended.returncode == 2, ended.stderr
    lines = ended.stderr.splitlines()
    assert [line for line in lines if line.startswith("error: ")] == lines[-1:], ended.stderr
    for part in parts:
        assert str(part) in lines[-1]


@pytest.mark.parametrize("command", ["crown", "branches", "leaves", "capture", "build"])
def test_a_pipe_in_place_of_the_input(tmp_path, capsys, command):
    os.mkfifo(tmp_path / "pipe.jpg")
    assert "pipe.jpg" in refused(capsys, command, tmp_path / "pipe.jpg", "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["info", "validate"])
def test_a_pipe_in_place_of_an_asset(tmp_path, command):
    os.mkfifo(tmp_path / "pipe.jpg")
    assert_refused(end(command, tmp_path / "pipe.jpg"), "pipe.jpg")


def test_a_folder_that_may_not_be_read(tmp_path):
    bed = tmp_path / "bed"
    write_posed_photos(bed)
    for forbidden in (bed / "cameras", bed):
        forbidden.chmod(0)
        try:
            ended = end("leaves", bed, "-o", tmp_path / "out", preexec_fn=obey_permissions)
        finally:
            forbidden.chmod(0o755)
        assert_refused(ended, forbidden.name)
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("closed", ["ash", "ash/images"])
@pytest.mark.parametrize("library", ["list.txt", "beds"])
def test_a_plant_that_may_not_be_read_does_not_stop_the_others(tmp_path, closed, library):
    for name in ("ash", "oak"):
        write_posed_photos(tmp_path / "beds" / name)
    (tmp_path / "list.txt").write_text("beds/ash\nbeds/oak\n")
    folder = tmp_path / "beds" / closed
    folder.chmod(0)
    try:
        ended = end("batch", tmp_path / library, "-o", tmp_path / "out", "--dry-run", preexec_fn=obey_permissions)
    finally:
        folder.chmod(0o755)
    assert ended.returncode == 2
    ash, oak = (next(line for line in ended.stdout.splitlines() if line.startswith(name)) for name in ("ash", "oak"))
    assert f"error: {folder}" in ash
    assert "its permissions do not allow it" in ash
    assert "error" not in oak
    assert ended.stderr == ""


def test_an_output_in_a_circle_of_links(tmp_path, capsys):
    (tmp_path / "loop").symlink_to("loop")
    for words in (("scatter", "-n", 1), ("crown", tmp_path / "loop"), ("branches", tmp_path / "loop")):
        assert "loop" in refused(capsys, *words, "-o", tmp_path / "loop" / "out")


@pytest.fixture(scope="module")
def spray(tmp_path_factory):
    import cv2
    import numpy as np

    folder = tmp_path_factory.mktemp("assets")
    cv2.imwrite(str(folder / "leaf.png"), np.full((32, 32, 4), 200, np.uint8))
    assert run("scatter", "-n", 2, "-o", folder / "spray", "--texture", folder / "leaf.png") == 0
    return folder / "spray"


@pytest.mark.parametrize("command", ["validate", "bake", "export", "preview"])
def test_a_pipe_in_place_of_a_texture(tmp_path, spray, command):
    asset = tmp_path / "spray"
    shutil.copytree(spray, asset)
    (texture,) = (asset / "maps").iterdir()
    texture.unlink()
    os.mkfifo(texture)
    words = {
        "validate": (),
        "bake": ("-o", tmp_path / "out"),
        "export": ("--profile", "usdz", "-o", tmp_path / "out.usdz"),
        "preview": ("-o", tmp_path / "out.png"),
    }[command]
    ended = end(command, asset, *words)
    if command == "validate":
        assert ended.returncode == 3, ended.stderr
        assert "usdfoliage:FileReadable" in ended.stdout
        assert texture.name in ended.stdout
        assert "a pipe" in ended.stdout
    else:
        assert_refused(ended, texture.name)


def test_files_outside_the_asset_are_listed_and_an_error(tmp_path, spray):
    asset = tmp_path / "spray"
    shutil.copytree(spray, asset)
    (tmp_path / "secret.png").write_bytes(next((asset / "maps").iterdir()).read_bytes())
    for layer in (asset / "payload").glob("*.usda"):
        layer.write_text(layer.read_text().replace("../maps/spray_leaf.png", "../../secret.png"))
    described = end("info", asset)
    assert described.returncode == 0
    assert [line for line in described.stdout.splitlines() if line.startswith("outside ") and "secret.png" in line]
    validated = end("validate", asset)
    assert validated.returncode == 3
    assert [line for line in validated.stdout.splitlines() if "PathOutside" in line and "secret.png" in line]


def test_a_texture_that_may_not_be_read(tmp_path, spray):
    shutil.copytree(spray, tmp_path / "spray")
    assert run("edit", tmp_path / "spray", "--width", 2, "-o", tmp_path / "look.usda") == 0
    maps = tmp_path / "spray" / "maps"
    maps.chmod(0)
    try:
        for given in (tmp_path / "spray", tmp_path / "look.usda"):
            ended = end("bake", given, "-o", tmp_path / "out", preexec_fn=obey_permissions)
            assert_refused(ended, maps / "spray_leaf.png", "permissions", "<")
            assert "anon:" not in ended.stderr
    finally:
        maps.chmod(0o755)


def test_no_name_steers_a_terminal(tmp_path, capsys):
    name = "a\x1b[31m\x07b"
    ended = end("info", tmp_path / name)
    assert_refused(ended, "\\x1b")
    assert "\x1b" not in ended.stderr + ended.stdout
    for words in (
        ("crown", tmp_path / f"{name}.png", "-o", tmp_path / "out"),
        ("branches", tmp_path / f"{name}.ply", "-o", tmp_path / "out"),
        ("leaves", tmp_path / name, "-o", tmp_path / "out"),
        ("build", tmp_path / name, "-o", tmp_path / "out"),
    ):
        line = refused(capsys, *words)
        assert "\\x1b" in line
        assert "\x1b" not in line
