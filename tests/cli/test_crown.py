"""The main job from the command line: good input, bad input, and what is left on disk."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.__main__ import main
from usdfoliage.asset.materials.cubemap_exr import read_cubemap
from usdfoliage.geometry.color import encode_srgb

from tests.support.commands.json_output import read_output
from tests.support.crown_shapes import disc_mask, foliage
from tests.support.leaves.drawn import drawn_leaf, write_leaf

SMALL = ("--size", "32", "--mesh-size", "17", "--no-preview")


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """A photograph and its mask, in a folder with a space."""
    folder = tmp_path_factory.mktemp("my capture")
    photo = np.rint(np.clip(encode_srgb(foliage((120, 140))), 0, 1) * 255).astype(np.uint8)
    mask = np.zeros((120, 140), np.uint8)
    mask[:, :120][disc_mask(48, size_px=120)] = 255
    cv2.imwrite(str(folder / "oak.png"), photo[..., ::-1])
    cv2.imwrite(str(folder / "mask.png"), mask)
    return folder


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def refused(capsys, *arguments) -> str:
    """The one line of an error of exit 2."""
    assert main(["crown", *map(str, arguments)]) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    lines = streams.err.strip().splitlines()
    assert lines[-1].startswith("error: ")
    assert "Traceback" not in streams.err
    return lines[-1]


def test_a_photograph_becomes_an_asset_with_report(capture, tmp_path, capsys):
    out = tmp_path / "assets of today" / "oak"

    assert main(["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(out), *SMALL]) == 0

    printed = capsys.readouterr().out
    assert f"asset: {out / 'oak.usda'}" in printed
    assert f"report: {out / 'report' / 'index.html'}" in printed
    assert "centre: " in printed
    assert "star-shaped bound: " in printed
    stage = Usd.Stage.Open(str(out / "oak.usda"))
    crown = UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/proxy/Crown"))
    assert len(crown.GetPointsAttr().Get()) == 6 * 16**2 + 2
    assert read_cubemap(out / "maps" / "oak_crown_radius.exr").pixels.shape[:3] == (6, 32, 32)
    page = (out / "report" / "index.html").read_text()
    for picture in ("input.jpg", "color_faces.jpg", "radius_faces.png"):
        assert f'src="{picture}"' in page
        assert cv2.imread(str(out / "report" / picture)) is not None
    assert sorted(p.name for p in out.parent.iterdir()) == ["oak"]


def test_the_same_run_gives_the_same_asset(capture, tmp_path, capsys):
    for name, words in (("one", ()), ("two", ("--json",))):
        arguments = ["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "--name", "oak"]
        capsys.readouterr()
        assert main([*arguments, "-o", str(tmp_path / name), *SMALL, *words]) == 0
    assert Path(read_output("crown", capsys.readouterr().out)["asset"]).is_file()

    one, two = (
        {name: data for name, data in files(tmp_path / folder).items() if name != "report/timings.js"}
        for folder in ("one", "two")
    )
    assert one == two


def test_without_a_mask_one_is_proposed_and_kept(capture, tmp_path, capsys):
    photo = np.full((240, 240, 3), (0.9, 0.75, 0.6), np.float32)  # sky, blue first
    photo[200:] = (0.05, 0.15, 0.12)
    crown = disc_mask(70, size_px=240, center_px=(120.0, 110.0))
    photo[crown] = np.clip(encode_srgb(foliage((240, 240))), 0, 1)[..., ::-1][crown]
    cv2.imwrite(str(tmp_path / "tree.png"), np.rint(photo * 255).astype(np.uint8))
    out = tmp_path / "tree"

    assert main(["crown", str(tmp_path / "tree.png"), "-o", str(out), *SMALL]) == 0

    assert "the mask is a proposal" in capsys.readouterr().out
    proposed = cv2.imread(str(out / "tree_mask_proposal.png"), cv2.IMREAD_GRAYSCALE) > 127
    assert (proposed & crown).sum() / (proposed | crown).sum() > 0.85
    assert "proposal" in (out / "report" / "index.html").read_text()

    # The artist corrects the proposal: it is neither lost nor silently replaced.
    proposed[:60] = False
    cv2.imwrite(str(out / "tree_mask_proposal.png"), proposed.astype(np.uint8) * 255)
    corrected = (out / "tree_mask_proposal.png").read_bytes()
    capsys.readouterr()
    assert "--mask" in refused(capsys, tmp_path / "tree.png", "-o", out, *SMALL)
    again = ["crown", str(tmp_path / "tree.png"), "--mask", str(out / "tree_mask_proposal.png"), "-o", str(out), *SMALL]
    assert main(again) == 0
    assert (out / "tree_mask_proposal.png").read_bytes() == corrected


def test_a_dry_run_prints_its_plan_and_writes_nothing(capture, tmp_path, capsys):
    out = tmp_path / "oak"

    assert (
        main(["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(out), "--dry-run"]) == 0
    )

    printed = capsys.readouterr().out
    assert f"would write: {out / 'oak.usda'}" in printed
    assert "140 x 120 px" in printed
    assert not out.exists()


def test_notes_on_the_mask_are_printed(capture, tmp_path, capsys):
    mask = cv2.imread(str(capture / "mask.png"), cv2.IMREAD_GRAYSCALE)
    mask[5:9, 130:136] = 255
    mask[55:65, 0:30] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), mask)

    arguments = [str(capture / "oak.png"), "--mask", str(tmp_path / "mask.png"), "-o", str(tmp_path / "oak"), *SMALL]
    assert main(["crown", *arguments]) == 0

    printed = capsys.readouterr().out
    assert "2 components" in printed
    assert "touches the image border (left)" in printed


def test_a_picture_of_a_leaf_is_that_of_the_crowns_leaves(capture, tmp_path, capsys):
    leaf = write_leaf(tmp_path / "oak_leaf.png", drawn_leaf(30, 100))
    out = tmp_path / "oak"
    words = [str(capture / "oak.png"), "--mask", str(capture / "mask.png"), *SMALL, "--reproducible"]
    assert main(["crown", *words, "-o", str(out), "--leaf", str(leaf)]) == 0
    written = cv2.imread(str(out / "maps" / "oak_crown_leaf.png"), cv2.IMREAD_UNCHANGED)
    assert written.shape[1] / written.shape[0] == pytest.approx(0.3, abs=0.05)
    red, green = written[-20, written.shape[1] // 2, 2], written[20, written.shape[1] // 2, 1]
    assert red > written[20, written.shape[1] // 2, 2]  # the base is below
    assert green > written[-20, written.shape[1] // 2, 1]
    assert "oak_leaf.png" in (out / "report" / "index.html").read_text()
    assert main(["crown", *words, "-o", str(tmp_path / "plain" / "oak")]) == 0
    texts = [(folder / "oak.usda").read_text() for folder in (out, tmp_path / "plain" / "oak")]
    digests = [re.search(r"[0-9a-f]{64}", text) for text in texts]
    assert digests[0] is not None
    assert digests[1] is not None
    assert digests[0].group() != digests[1].group()
    assert main(["crown", *words, "-o", str(tmp_path / "dry"), "--leaf", str(leaf), "--dry-run"]) == 0
    assert "leaf oak_leaf.png" in capsys.readouterr().out


class TestBadInput:
    """Exit 2, one line that names the file, and nothing written."""

    def refuse(self, capture, tmp_path, capsys, photo=None, mask=None, options=()) -> str:
        out = tmp_path / "never" / "oak"
        line = refused(
            capsys, photo or capture / "oak.png", "--mask", mask or capture / "mask.png", "-o", out, *SMALL, *options
        )
        assert not out.parent.exists()
        return line

    def test_missing(self, capture, tmp_path, capsys):
        assert "absent.jpg" in self.refuse(capture, tmp_path, capsys, photo=tmp_path / "absent.jpg")

    def test_not_an_image(self, capture, tmp_path, capsys):
        path = tmp_path / "notes.jpg"
        path.write_text("no picture")
        assert "notes.jpg" in self.refuse(capture, tmp_path, capsys, photo=path)

    def test_truncated(self, capture, tmp_path, capsys):
        path = tmp_path / "half.png"
        whole = (capture / "oak.png").read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
        assert "half.png" in self.refuse(capture, tmp_path, capsys, photo=path)

    @pytest.mark.parametrize("options", [(), ("--dry-run",)])
    def test_a_leaf_that_is_none(self, capture, tmp_path, capsys, options):
        clear = write_leaf(tmp_path / "clear.png", drawn_leaf() * [1, 1, 1, 0])
        for leaf in (clear, capture / "oak.png", tmp_path / "absent.png"):
            assert leaf.name in self.refuse(capture, tmp_path, capsys, options=("--leaf", leaf, *options))

    def test_one_pixel(self, capture, tmp_path, capsys):
        path = tmp_path / "dot.png"
        cv2.imwrite(str(path), np.zeros((1, 1, 3), np.uint8))
        assert "dot.png" in self.refuse(capture, tmp_path, capsys, photo=path)

    @pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
    def test_impossible_exr_pixels(self, capture, tmp_path, capsys, value):
        path = tmp_path / "render.exr"
        pixels = foliage((120, 140)).copy()
        pixels[7, 9, 1] = value
        OpenEXR.File({}, {"RGB": pixels}).write(str(path))
        assert "render.exr" in self.refuse(capture, tmp_path, capsys, photo=path)

    def test_mask_of_another_size(self, capture, tmp_path, capsys):
        path = tmp_path / "small.png"
        cv2.imwrite(str(path), np.full((60, 70), 255, np.uint8))
        line = self.refuse(capture, tmp_path, capsys, mask=path)
        assert "small.png" in line
        assert "70×60" in line

    def test_empty_mask(self, capture, tmp_path, capsys):
        path = tmp_path / "empty.png"
        cv2.imwrite(str(path), np.zeros((120, 140), np.uint8))
        assert "empty.png" in self.refuse(capture, tmp_path, capsys, mask=path)

    def test_mask_of_a_dot(self, capture, tmp_path, capsys):
        path = tmp_path / "dot.png"
        mask = np.zeros((120, 140), np.uint8)
        mask[50:56, 50:56] = 255
        cv2.imwrite(str(path), mask)
        line = self.refuse(capture, tmp_path, capsys, mask=path)
        assert "6×6" in line
        assert "dot.png" in line

    @pytest.mark.parametrize(
        "options",
        [
            ("--size", "0"),
            ("--size", "-5"),
            ("--size", "100000"),
            ("--height", "0"),
            ("--height", "nan"),
            ("--relief", "7"),
            ("--copies", "9"),
            ("--tangent", "os.remove('x')"),
            ("--mesh-size", "1"),
            ("--seed", "-1"),
            ("--color-space", "no such space"),
        ],
    )
    def test_impossible_settings(self, capture, tmp_path, capsys, options):
        self.refuse(capture, tmp_path, capsys, options=options)

    def test_somebody_elses_folder(self, capture, tmp_path, capsys):
        theirs = tmp_path / "theirs"
        theirs.mkdir()
        (theirs / "thesis.txt").write_text("years of work")

        line = refused(capsys, capture / "oak.png", "--mask", capture / "mask.png", "-o", theirs, *SMALL)

        assert "theirs" in line
        assert "--force" in line
        assert files(theirs) == {"thesis.txt": b"years of work"}

    def test_a_file_as_output(self, capture, tmp_path, capsys):
        (tmp_path / "oak").write_text("")
        refused(capsys, capture / "oak.png", "--mask", capture / "mask.png", "-o", tmp_path / "oak", *SMALL)


def test_a_bad_rerun_leaves_the_old_asset_whole(capture, tmp_path, capsys):
    out = tmp_path / "oak"
    assert main(["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(out), *SMALL]) == 0
    before = files(out)
    capsys.readouterr()

    refused(capsys, tmp_path / "absent.png", "-o", out, *SMALL)

    assert files(out) == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["oak"]


@pytest.mark.parametrize("after_s", [0.3, 1.2, 2.0])
def test_a_kill_leaves_the_old_asset_whole(capture, tmp_path, after_s):
    out = tmp_path / "oak"
    arguments = ["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(out), "--no-preview"]
    assert main([*arguments, "--size", "32", "--mesh-size", "17"]) == 0
    before = files(out)

    process = subprocess.Popen(
        [sys.executable, "-m", "usdfoliage", *arguments, "--size", "256"],
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    time.sleep(after_s)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()

    assert files(out) == before
    assert main([*arguments, "--size", "32", "--mesh-size", "17"]) == 0  # the next run cleans up
    assert sorted(p.name for p in tmp_path.iterdir()) == ["oak"]


def test_a_missing_preview_is_reported_and_the_asset_made(capture, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(tmp_path / "no python"))
    out = tmp_path / "oak"
    arguments = ["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(out), *SMALL[:-1]]

    assert main(arguments) == 0

    assert "no pictures of the asset" in capsys.readouterr().out
    assert (out / "oak.usda").exists()


def test_paths_with_dots_and_other_folders(capture, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    shutil.copy(capture / "oak.png", tmp_path)
    shutil.copy(capture / "mask.png", tmp_path)

    assert main(["crown", "../oak.png", "--mask", "../here/../mask.png", "-o", "../there/./5 oaks", *SMALL]) == 0

    assert (tmp_path / "there" / "5 oaks" / "_5_oaks.usda").exists()


def test_files_that_are_not_the_assets_are_not_lost(capture, tmp_path, capsys):
    out = tmp_path / "oak"
    arguments = ["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(out), *SMALL]
    assert main(arguments) == 0
    (out / "work").mkdir()
    (out / "work" / "notes.txt").write_text("years of work")
    before = files(out)
    capsys.readouterr()

    assert "work/notes.txt" in refused(capsys, *arguments[1:])

    assert files(out) == before
    assert main([*arguments, "--force"]) == 0
    assert (out / "work" / "notes.txt").read_text() == "years of work"


@pytest.mark.parametrize("after_s", [0.1, 0.3, 0.5, 0.8, 1.2])
def test_an_interrupt_at_any_moment_ends_the_run_and_leaves_the_old_asset(capture, tmp_path, after_s):
    out = tmp_path / "oak"
    arguments = ["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(out), "--no-preview"]
    assert main([*arguments, "--size", "32", "--mesh-size", "17"]) == 0
    before = files(out)

    command = [sys.executable, "-m", "usdfoliage", *arguments, "--size", "256"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    time.sleep(after_s)
    process.send_signal(signal.SIGINT)
    _, complaint = process.communicate(timeout=60)

    assert process.returncode in (130, -signal.SIGINT)
    # On a slow machine Python itself may still be starting, and prints a traceback of its own.
    assert "Traceback" not in complaint or not any(
        f"usdfoliage/{part}/" in complaint for part in ("cli", "jobs", "asset")
    )
    assert files(out) == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["oak"]


def test_a_farm_that_ends_the_job_leaves_nothing_behind(capture, tmp_path):
    arguments = ["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(tmp_path / "oak")]
    command = [sys.executable, "-m", "usdfoliage", *arguments, "--size", "512", "--no-preview"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    while process.poll() is None and not any(tmp_path.glob(".oak.*-new")):
        time.sleep(0.05)
    process.terminate()
    _, complaint = process.communicate(timeout=60)

    assert process.returncode == 130
    assert "interrupted" in complaint
    assert list(tmp_path.iterdir()) == []


def test_a_full_stdout_is_reported_and_the_asset_made(capture, tmp_path):
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    arguments = ["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(tmp_path / "oak")]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "usdfoliage", *arguments, *SMALL],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )

    assert done.returncode == 1
    assert (
        done.stderr.strip()
        == "error: the result could not be printed: No space left on device; redirect stdout elsewhere"
    )
    assert (tmp_path / "oak" / "oak.usda").exists()


def test_closed_streams_do_no_harm(capture, tmp_path):
    arguments = ["crown", str(capture / "oak.png"), "--mask", str(capture / "mask.png"), "-o", str(tmp_path / "oak")]
    words = " ".join(f"'{word}'" for word in [sys.executable, "-m", "usdfoliage", *arguments, *SMALL])
    assert subprocess.run(["sh", "-c", f"{words} >&- 2>&-"], check=False).returncode == 0
    assert (tmp_path / "oak" / "oak.usda").exists()


def test_a_cut_out_photograph_is_its_own_mask(capture, tmp_path, capsys):
    photo, mask = (cv2.imread(str(capture / name)) for name in ("oak.png", "mask.png"))
    cv2.imwrite(str(tmp_path / "cut out.png"), np.dstack([photo, mask[..., 0]]))

    assert main(["crown", str(tmp_path / "cut out.png"), "-o", str(tmp_path / "oak"), *SMALL]) == 0

    assert "the mask is the photograph's alpha channel" in capsys.readouterr().out
    assert not list((tmp_path / "oak").glob("*_mask_proposal.png"))


def test_the_asset_names_no_folder_of_this_machine(capture, tmp_path):
    cv2.imwrite(str(tmp_path / "tangent map.png"), np.full((20, 20), 128, np.uint8))
    out = tmp_path / "oak"
    arguments = ["--mask", str(capture / "mask.png"), "--tangent", str(tmp_path / "tangent map.png"), "-o", str(out)]
    assert main(["crown", str(capture / "oak.png"), *arguments, *SMALL]) == 0

    for name, data in files(out).items():
        assert str(tmp_path).encode() not in data, name
        assert str(capture).encode() not in data, name
