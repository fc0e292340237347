"""`usdfoliage preview` from its words to its files and its one-line errors."""

import argparse
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from usdfoliage.__main__ import main
from usdfoliage.cli import preview
from usdfoliage.errors import AssetError, PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter

from tests.support.leaves.assets import random_leaves, write_spray
from tests.support.preview_stages import write_square


@pytest.fixture
def drawn(_interpreter):
    """Tests that draw need the preview interpreter."""


@pytest.fixture(scope="module")
def _interpreter():
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")


@pytest.fixture
def asset(tmp_path):
    """An asset folder with spaces in its path."""
    folder = tmp_path / "my assets" / "a square"
    folder.mkdir(parents=True)
    write_square(folder / "square.usda")
    return folder


def run(*words: object) -> int:
    parser = argparse.ArgumentParser()
    preview.add_arguments(parser)
    return preview.run(parser.parse_args([str(word) for word in words]))


def read(path: Path):
    return cv2.cvtColor(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), cv2.COLOR_BGR2RGB)


@pytest.mark.preview
def test_a_turntable_writes_its_frames_and_a_contact_sheet(drawn, asset, tmp_path, capsys):
    output = tmp_path / "pictures" / "turn table.png"
    assert run(asset, "-o", output, "--turntable", 4, "--size", 48, 32, "--background", 1, 0, 0.5) == 0
    assert capsys.readouterr().out.strip() == str(output)
    frames = [output.with_name(f"turn table_00{number}.png") for number in range(4)]
    assert sorted(output.parent.iterdir()) == sorted([output, *frames])
    pictures = [read(frame) for frame in frames]
    assert {picture.shape for picture in pictures} == {(32, 48, 3)}
    assert read(output).shape == (64, 96, 3)
    np.testing.assert_array_equal(read(output)[32:, :48], pictures[2])
    for picture in pictures:
        np.testing.assert_array_equal(picture[0, 0], [255, 0, 128])

    def seen(picture):
        return int(np.sum(np.any(picture != [255, 0, 128], axis=2)))

    # A square seen from the front, edge-on, from behind, edge-on.
    assert seen(pictures[0]) == seen(pictures[2]) > 200
    assert seen(pictures[1]) < 40
    assert seen(pictures[3]) < 40


@pytest.mark.preview
def test_a_transparent_picture_has_alpha(drawn, asset, tmp_path):
    output = tmp_path / "a.png"
    run(asset / "square.usda", "-o", output, "--size", 40, 30, "--background", "transparent", "--view", "front")
    picture = cv2.imread(str(output), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (30, 40, 4)
    assert picture[15, 20, 3] == 255
    assert picture[0, 0, 3] == 0


@pytest.mark.preview
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--camera", "/Thing/Lens"], r"no camera at /Thing/Lens; it has none \(.*square\.usda\)"),
        (["--purpose", "guide"], r"no geometry of purpose guide; it has geometry of purpose default"),
    ],
)
def test_what_a_file_lacks_is_named(drawn, asset, tmp_path, words, message):
    with pytest.raises(PreviewError, match=message):
        run(asset, "-o", tmp_path / "a.png", *words)
    assert not (tmp_path / "a.png").exists()


@pytest.mark.preview
def test_a_file_that_is_not_usd_inside(drawn, tmp_path):
    fake = tmp_path / "fake.usda"
    fake.write_text("this is no USD")
    with pytest.raises(AssetError, match=r"fake\.usda cannot be read as USD") as caught:
        run(fake, "-o", tmp_path / "a.png")
    assert "\n" not in str(caught.value)


@pytest.mark.preview
def test_without_opengl_the_packages_are_named(drawn, asset, tmp_path, monkeypatch):
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nonexistent")
    with pytest.raises(PreviewError, match=r"Debian: apt-get install libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri"):
        run(asset, "-o", tmp_path / "a.png")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "a.jpg"], r"must end in \.png"),
        (["-o", "a.png", "--size", "0", "100"], r"not 0 x 100"),
        (["-o", "a.png", "--size", "100", "99999"], r"16 to 8192 pixels"),
        (["-o", "a.png", "--turntable", "1"], r"at least 2 frames, not 1"),
        (["-o", "a.png", "--turntable", "4", "--camera", "/a"], r"leave out --camera"),
        (["-o", "a.png", "--background", "green"], r"R G B from 0 to 1, or transparent, not 'green'"),
        (["-o", "a.png", "--background", "0", "0", "2"], r"from 0 to 1, not \(0\.0, 0\.0, 2\.0\)"),
    ],
)
def test_words_that_make_no_sense_are_refused_before_anything_starts(asset, words, message, monkeypatch):
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", "/nonexistent/python")
    with pytest.raises(PreviewError, match=message):
        run(asset, *words)


def test_a_missing_interpreter_and_a_missing_asset_are_named(asset, tmp_path, monkeypatch):
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", "/nonexistent/python")
    with pytest.raises(PreviewError, match=r"USDFOLIAGE_HYDRA_PYTHON.*/nonexistent/python"):
        run(asset, "-o", tmp_path / "a.png")
    with pytest.raises(AssetError, match=r"gone does not exist"):
        run(tmp_path / "gone", "-o", tmp_path / "a.png")


def test_importing_the_command_loads_nothing_heavy():
    script = "import sys, usdfoliage.cli.preview; print([m for m in ('cv2', 'OpenEXR', 'tqdm') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.preview
@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize(("keep", "reason"), [(None, "no such file"), (3000, "corrupt")])
def test_lost_payload_layer_is_named(tmp_path, capsys, keep, reason):
    write_spray(tmp_path / "spray", random_leaves(20))
    layer = tmp_path / "spray" / "payload" / "leaves.usdc"
    data = layer.read_bytes()
    layer.unlink()
    if keep is not None:
        layer.write_bytes(data[:keep])
    assert main(["preview", str(tmp_path / "spray"), "-o", str(tmp_path / "a.png")]) == 2
    message = capsys.readouterr().err
    assert f"it needs {layer}, which cannot be read: " in message
    assert reason in message
    assert not (tmp_path / "a.png").exists()
