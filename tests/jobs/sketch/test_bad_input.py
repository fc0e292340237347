"""Photographs and strokes that no tree can be made of: one line each, and nothing written."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from usdfoliage.jobs.sketch import run as run_of_sketch
from usdfoliage.sketch.strokes import MAX_BYTES

from tests.support.leaves.commands import refused, run
from tests.support.photographs.drawn_trees import draw_leafy, write_photograph
from tests.support.photographs.no_trees import road

RING = [[150 + 110 * np.cos(a), 150 + 110 * np.sin(a)] for a in np.linspace(0, 2 * np.pi, 40, endpoint=False)]
EIGHT = [[150 + 100 * np.sin(a), 150 + 90 * np.sin(2 * a)] for a in np.linspace(0, 2 * np.pi, 60, endpoint=False)]
STEM = [[150, 380], [150, 280], [150, 200]]
LOOP = [[150, 380], [150, 200], [220, 200], [220, 300], [120, 300]]


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    return write_photograph(tmp_path, draw_leafy(), "oak")


def complaint(capsys, photo: Path, *words: object) -> str:
    out = photo.parent / "out"
    line = refused(capsys, "sketch", photo, "-o", out, "--no-preview", *words)
    assert not out.exists()
    assert len(line) < 600
    return line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"crown": [[x + 400, y] for x, y in RING]}, "leaves the picture"),
        ({"branches": [[[150, 380], [150, -90]]]}, "leaves the picture"),
        ({"crown": EIGHT}, "the crown of tree 1 .* crosses itself"),
        ({"crown": RING + RING}, "the crown of tree 1 .* crosses itself"),
        ({"branches": [LOOP]}, "branch 1 of tree 1 .* crosses itself"),
        ({"width": 600}, "600 x 400 pixels, and the photograph has 300 x 400"),
        ({"crown": []}, "the crown has 0 points"),
        ({"crown": None}, "the crown must be a list"),
        ({"crown": [[5, 5]]}, "the crown has 1 point,"),
        ({"branches": [[[5, 5]]]}, "branch 1 has 1 point,"),
        ({"branches": [[]]}, "branch 1 has 0 points"),
        ({"branches": [[[150, 380], [150, 379.9]]]}, "0.1 pixels long, at least 6.6 are needed"),
        ({"crown": [[50, 50], [150, 50], [250, 50]]}, "encloses nothing"),
        ({"crown": [[50, 50], [150, 150], [250, 250], [150, 150]]}, "encloses nothing"),
        ({"branches": [[[20, 150], [100, 100]]]}, "begins in the sky, at x 20, y 150"),
        ({"branches": [STEM[::-1]]}, "goes down the picture, from y 200 to 380"),
        ({"crown": [[10, 10], [60, 10], [60, 60], [10, 60]]}, "no leaves"),
        ({"crown": [[10, 10], [float("nan"), 10], [60, 60]]}, "list of points"),
        ({"crown": [[10, 10], [10**400, 10], [60, 60]]}, "list of points"),
        ({"crown": [[10, 10], [True, 10], [60, 60]]}, "list of points"),
        ({"crown": "around"}, "list of points"),
        ({"width": "wide"}, "width must be"),
        ({"height": 10**4000}, "height must be"),
        ({"trees": {"crown": RING}}, "holds no strokes"),
        ({"trees": [None]}, "a tree is a table"),
    ],
)
def test_strokes_that_cannot_be_of_the_photograph(files, capsys, change, words):
    photo, strokes = files
    content = {**json.loads(strokes.read_text()), "crown": RING, "branches": [STEM], **change}
    strokes.write_text(json.dumps(content))
    assert re.search(words, complaint(capsys, photo))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no JSON"),
        (b"\xff\xfe", "no JSON"),
        (b"null", "holds no strokes"),
        (b'"crown"', "holds no strokes"),
        (b"[" * 100_000, "too deep"),
        (b'{"crown": ' * 50_000, "too deep"),
        (b" " * (MAX_BYTES + 1), "at most 20,000,000 are allowed"),
        (b'{"width": 300, "height": 400, "crown": [[1, 1e999], [2, 2], [3, 9]]}', "list of points"),
        (b'{"width": 300, "height": 400, "crown": [[1, ' + b"9" * 5000 + b"], [2, 2], [3, 9]]}", "no JSON"),
    ],
)
def test_a_file_that_is_no_file_of_strokes(files, capsys, content, words):
    photo, strokes = files
    strokes.write_bytes(content)
    assert words in complaint(capsys, photo)


def test_a_pipe_and_a_folder_are_no_strokes(files, capsys, tmp_path):
    photo, _ = files
    os.mkfifo(tmp_path / "pipe.json")
    assert "pipe.json" in complaint(capsys, photo, "--strokes", tmp_path / "pipe.json")
    (tmp_path / "folder.json").mkdir()
    assert "folder.json" in complaint(capsys, photo, "--strokes", tmp_path / "folder.json")


def test_a_stroke_that_ends_a_little_beyond_its_beginning_is_a_crown(files):
    photo, strokes = files
    content = json.loads(strokes.read_text())
    content["crown"] = [*RING, *([x + 6, y + 4] for x, y in RING[:3])]
    strokes.write_text(json.dumps(content))
    assert run("sketch", photo, "-o", photo.parent / "out", "--dry-run") == 0


@pytest.mark.parametrize("shade", [0, 128, 255])
def test_a_picture_of_one_colour_shows_no_tree(files, capsys, shade):
    photo, strokes = files
    cv2.imwrite(str(photo), np.full((400, 300, 3), shade, np.uint8))
    assert "shows nothing" in complaint(capsys, photo)
    strokes.unlink()
    assert "shows nothing" in complaint(capsys, photo)


def test_a_picture_of_a_wall_shows_no_tree(files, capsys):
    photo, _ = files
    rng = np.random.default_rng(0)
    wall = np.full((400, 300, 3), (150, 160, 175), np.uint8)
    wall[::20] = wall[:, ::40] = (110, 110, 115)
    cv2.imwrite(str(photo), np.clip(wall + rng.normal(0, 5, wall.shape), 0, 255).astype(np.uint8))
    assert "leaves" in complaint(capsys, photo)


def test_a_plant_before_no_sky_is_a_tree_only_where_its_crown_is_clear(files, capsys, monkeypatch):
    """As a road, a wall or a lawn, whose likeliest crown is anything."""
    photo, _ = files
    (photo.parent / "oak.strokes.json").unlink(missing_ok=True)
    real = run_of_sketch.propose_mask
    with monkeypatch.context() as patch:
        patch.setattr(run_of_sketch, "propose_mask", lambda *a, **k: replace(real(*a, **k), confidence=0.4))
        patch.setattr(run_of_sketch, "find_sky", lambda srgb, seed: np.zeros(srgb.shape[:2], bool))
        line = complaint(capsys, photo)
        assert re.search(r"shows no tree clearly: no sky is behind it, .* confidence of 0.40, 0.5 needed", line)
        assert "oak.strokes.json" in line
        patch.setattr(run_of_sketch, "find_sky", lambda srgb, seed: np.ones(srgb.shape[:2], bool))
        given = run_of_sketch.read_sketch_input(
            run_of_sketch.SketchRequest(photo=photo, output=photo.parent / "out", name="oak")
        )
    assert [each.code for each in given.remarks if each.code.startswith("strokes")] == ["strokes-uncertain"]
    assert [each.severity for each in given.remarks if each.code.startswith("strokes")] == ["warning"]


def test_a_photograph_that_cannot_be_read(files, capsys):
    photo, _ = files
    photo.write_bytes(photo.read_bytes()[:200])
    assert "oak.png" in complaint(capsys, photo)
    photo.unlink()
    assert "oak.png" in complaint(capsys, photo)


def test_a_folder_is_no_photograph(files, capsys, monkeypatch):
    photo, _ = files
    monkeypatch.chdir(photo.parent)
    assert "lies in" in refused(capsys, "sketch", ".", "-o", "out")
    assert not (photo.parent / "out").exists()


def test_of_several_trees_none_is_written_where_one_cannot_be_made(files, capsys):
    photo, strokes = files
    whole = {"crown": RING, "branches": [STEM]}
    of_sky = {"crown": [[10, 10], [60, 10], [60, 60], [10, 60]], "branches": [STEM]}
    head = {"image": "oak.png", "width": 300, "height": 400}
    strokes.write_text(json.dumps({**head, "trees": [whole, of_sky]}))
    assert "no leaves" in complaint(capsys, photo, "--most-leaves", "300", "--no-crown")


def test_a_mask_is_of_one_tree(files, capsys, tmp_path):
    photo, strokes = files
    content = json.loads(strokes.read_text())
    tree = {name: content.pop(name) for name in ("crown", "branches")}
    strokes.write_text(json.dumps({**content, "trees": [tree, tree]}))
    mask = np.zeros((400, 300), np.uint8)
    cv2.imwrite(str(tmp_path / "mask.png"), cv2.circle(mask, (150, 150), 100, 255, -1))
    assert "a mask is the crown of one tree" in complaint(capsys, photo, "--mask", tmp_path / "mask.png")


def test_a_tape_beyond_the_photograph_is_refused(files, capsys):
    photo, _ = files
    assert "x 10, y 9999 is outside" in complaint(capsys, photo, "--tape", 10, 10, 10, 9999, 2)


def test_a_grey_picture_is_a_tree_too(tmp_path):
    photo, _ = write_photograph(tmp_path, draw_leafy(120, 160), "oak")
    grey = cv2.cvtColor(cv2.imread(str(photo)), cv2.COLOR_BGR2GRAY)
    cv2.imwrite(str(photo), grey)
    words = ["--no-preview", "--most-leaves", "300", "--no-crown"]
    assert run("sketch", photo, "-o", photo.parent / "out", *words) == 0


def test_a_crown_over_a_road_is_no_tree(files, capsys):
    photo, strokes = files
    content = json.loads(strokes.read_text())
    content["crown"] = [[150 + (x - 150) * 0.8, 170 + (y - 150) * 0.8] for x, y in RING]
    strokes.write_text(json.dumps(content))
    cv2.imwrite(str(photo), road()[..., ::-1])
    line = complaint(capsys, photo)
    assert "holds no foliage" in line
    assert "--leaves on" in line


@pytest.mark.parametrize("seed", range(3))
def test_bark_from_near_is_no_tree_though_parts_of_it_are_grey_as_a_sky(files, capsys, seed):
    photo, strokes = files
    strokes.unlink()
    rng = np.random.default_rng(seed)
    furrows = cv2.resize(rng.uniform(0.35, 1.3, (14, 40)), (300, 400), interpolation=cv2.INTER_LINEAR)
    bark = np.array([70, 95, 120]) * furrows[..., None]
    bark[:, :90] = (178, 176, 174)
    for _ in range(8):
        cv2.circle(bark, tuple(map(int, rng.uniform(0, 300, 2))), int(rng.integers(10, 40)), (176, 175, 172), -1)
    cv2.imwrite(str(photo), np.clip(bark + rng.normal(0, 6, bark.shape), 0, 255).astype(np.uint8))
    line = complaint(capsys, photo)
    assert "shows no tree" in line or "no crown was found" in line
