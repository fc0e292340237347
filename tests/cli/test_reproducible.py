"""Equal runs on two days, in two folders: every byte of every file, but of the one that has how long a run took."""

import shutil
from datetime import timedelta

import cv2
import numpy as np
import pytest
from usdfoliage.geometry.color import encode_srgb

from tests.support.branch_clouds import cloud_of, small_tree
from tests.support.capture_photos import write_posed_photos
from tests.support.clocks.other_days import compile_clock, date_seen, run_on
from tests.support.cloud_files import write_ply
from tests.support.crown_shapes import foliage
from tests.support.leaves.commands import files
from tests.support.leaves.scans import scanned_leaves
from tests.support.small_builds import write_quick_plan, write_small_capture

TIMES = "report/timings.js"
LIST = "report/files.json"  # of an asset's files, with the times where they are there
COMMANDS = {
    "crown of a photograph": ("crown", "in/oak.png", "-o", "out", "--size", "32", "--mesh-size", "9"),
    "crown of a cloud": ("crown", "in/tree.ply", "-o", "out", "--size", "32", "--mesh-size", "9", "--no-preview"),
    "branches": (
        *("branches", "in/tree.ply", "-o", "out", "--foliage", "template", "--most-leaves", "20", "--no-preview"),
        *("--rig", "--variations", "1"),
    ),
    "leaves of a cloud": ("leaves", "in/scan.ply", "-o", "out", "--up", "Z", "--unit", "m", "--no-preview"),
    "leaves of photographs": ("leaves", "in/bed", "-o", "out", "--hold-back", "4", "--no-preview"),
    "capture": ("capture", "in/photos", "-o", "out", "--settings", "in/photos/fast.toml"),
    "build": ("build", "in/bed", "-o", "out", "--plan", "in/plan.toml"),
}


@pytest.fixture(scope="module")
def clock(tmp_path_factory):
    return compile_clock(tmp_path_factory.mktemp("clock"))


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """A photograph, clouds and captures."""
    folder = tmp_path_factory.mktemp("given")
    photo = np.full((140, 140, 3), 1.0)
    photo[20:116, 22:118] = 0.5 * foliage((96, 96))
    cv2.imwrite(str(folder / "oak.png"), np.rint(encode_srgb(photo) * 255).astype(np.uint8)[..., ::-1])
    write_ply(folder / "tree.ply", cloud_of(small_tree(), per_m2=2000))
    points_m, _ = scanned_leaves(8, 60)
    write_ply(folder / "scan.ply", points_m, np.full(points_m.shape, (60, 140, 30)))
    write_small_capture(folder / "bed")
    write_posed_photos(folder / "photos")
    write_quick_plan(folder / "plan.toml")
    return folder


def test_the_clock_of_a_program_can_be_moved(clock):
    assert abs(date_seen(-4000, clock) + timedelta(days=4000)) < timedelta(minutes=2)


@pytest.mark.parametrize("name", list(COMMANDS))
def test_only_the_times_differ_and_reproducible_leaves_them_out(given, clock, tmp_path, name):
    made = []
    for folder, days, more in ((tmp_path / "one", 0, ()), (tmp_path / "other folder" / "2", 777, ("--reproducible",))):
        shutil.copytree(given, folder / "in")
        words = [folder / word if word.startswith(("in/", "out")) else word for word in COMMANDS[name]]
        run_on(days, clock, folder, *words, *more)
        made.append({path: data for path, data in files(folder / "out").items() if not path.startswith(".usdfoliage/")})
    one, two = made
    times = one.pop(TIMES)
    assert "alone differs between equal runs" in times.decode().splitlines()[1]
    assert sorted(two) == sorted(one)
    if LIST in one:
        one[LIST] = one[LIST].replace(f'  "{TIMES}",\n'.encode(), b"").replace(f',\n  "{TIMES}"'.encode(), b"")
    differing = [path for path, data in one.items() if two[path] != data]
    assert differing == []
