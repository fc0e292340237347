"""Folders for files that nobody keeps, on disks that are full."""

import errno
import json
import os
import shutil
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from usdfoliage.errors import AssetError, FoliageError, PreviewError, WriteError
from usdfoliage.files.atomic import whole_file
from usdfoliage.files.temporary_folder import remove_abandoned, temporary_folder
from usdfoliage.files.unwritten import describe_unwritten
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, render_views


@pytest.fixture
def full_disk(small_disk, monkeypatch):
    """A file system of 600 kB for temporary files, of which nothing is left."""
    monkeypatch.setattr(tempfile, "tempdir", str(small_disk))
    filling = small_disk / "filling"
    with filling.open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(4096))
    return filling


def test_a_folder_is_gone_afterwards_also_after_a_failure():
    with temporary_folder("leaf") as work:
        (work / "a.txt").write_text("a")
    assert not work.exists()
    with pytest.raises(KeyError), temporary_folder("leaf") as work:
        raise KeyError
    assert not work.exists()


def test_an_error_on_a_full_disk_states_the_free_space(full_disk):
    with (
        pytest.raises(PreviewError, match=r"No space left on device.*; 0 MB are free .*TMPDIR"),
        temporary_folder("preview", PreviewError) as work,
    ):
        (work / "a.txt").write_bytes(bytes(100_000))
    with (
        pytest.raises(FoliageError, match=r"Expecting value.*0 MB are free"),
        temporary_folder("preview") as work,
    ):
        json.loads("")
    with pytest.raises(AssetError, match="no leaves; 0 MB are free"), temporary_folder("preview") as work:
        raise AssetError("no leaves")


def test_a_folder_that_is_gone_hides_no_fault(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(AssetError, match=r"^no leaves$"), temporary_folder("preview") as work:
        fail_without(work)


def fail_without(work: Path) -> NoReturn:
    shutil.rmtree(work)
    raise AssetError("no leaves")


def test_a_missing_folder_for_temporary_files_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "absent"))
    with (
        pytest.raises(FoliageError, match="no place for temporary files: No such file or directory"),
        temporary_folder("a"),
    ):
        pass


@pytest.mark.parametrize("left_kb", [0, 4, 8, 12, 16])
def test_a_picture_without_room_on_the_disk_is_reported(full_disk, tmp_path, left_kb):
    """The disk is full after the request, with the words of Storm, in the picture."""
    with full_disk.open("r+b") as file:
        file.truncate(max(0, full_disk.stat().st_size - 1024 * left_kb))
    plane = tmp_path / "plane.usda"
    plane.write_text('#usda 1.0\n(upAxis = "Y")\ndef Sphere "ball" {}\n')
    view = PreviewView(output=tmp_path / "ball.png")
    with pytest.raises(PreviewError, match="are free for temporary files in"):
        render_views(plane, [view], PreviewSettings(width_px=256, height_px=256))
    assert not view.output.exists()
    full_disk.unlink()
    assert not np.any([path.name.startswith("usdfoliage-") for path in full_disk.parent.iterdir()])


def test_an_error_about_an_output_is_not_blamed_on_the_temporary_folder(full_disk, tmp_path):
    no_room = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(WriteError) as refusal, temporary_folder("leaf"):
        raise describe_unwritten(tmp_path / "oak", no_room)
    assert "TMPDIR" not in str(refusal.value)
    with pytest.raises(WriteError, match="TMPDIR"), temporary_folder("leaf") as work:
        raise describe_unwritten(work / "dome.exr", no_room)


LEFT = """
import os, signal
from usdfoliage.files.atomic import whole_file
from usdfoliage.files.temporary_folder import remove_abandoned, temporary_folder
with temporary_folder("leaf") as work:
    (work / "maps").mkdir()
    (work / "maps" / "a.exr").write_bytes(b"half")
    print(work, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def leave(place):
    """The folder that a killed process has left."""
    killed = subprocess.run([sys.executable, "-c", LEFT], stdout=subprocess.PIPE, text=True, check=False)
    left = Path(killed.stdout.strip())
    assert (left / "maps" / "a.exr").exists()
    assert left.parent == place
    return left


def test_what_a_killed_process_left_is_removed_by_the_next_folder(place):
    left = leave(place)
    with temporary_folder("preview") as work:
        assert list(place.iterdir()) == [work]
    assert not left.exists()
    assert list(place.iterdir()) == []


def test_what_a_killed_process_left_is_removed_by_the_next_command(place):
    leave(place)
    (place / "usdfoliage-leaf-mine").mkdir()
    subprocess.run([sys.executable, "-m", "usdfoliage", "env"], check=True, stdout=subprocess.DEVNULL)
    assert [path.name for path in place.iterdir()] == ["usdfoliage-leaf-mine"]


def test_a_folder_that_is_in_use_stays(place):
    with temporary_folder("leaf") as used:
        (used / "a").write_bytes(b"")
        with whole_file(used / "b") as new:
            new.write_bytes(b"")
        with temporary_folder("leaf"):
            remove_abandoned(place)
            assert (used / "a").exists()
        subprocess.run([sys.executable, "-m", "usdfoliage", "env"], check=True, stdout=subprocess.DEVNULL)
        assert (used / "a").exists()


def test_links_and_folders_of_others_stay(place, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "a").write_bytes(b"")
    with temporary_folder("leaf") as used:
        name = used.name
    (place / name).symlink_to(elsewhere)
    (place / f"{name}.old").mkdir()
    (place / f"my-{name}").mkdir()
    remove_abandoned(place)
    assert (elsewhere / "a").exists()
    assert len(list(place.iterdir())) == 3
