"""The gate: what is read never lies in what is replaced, by whatever name."""

import os
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from usdfoliage.errors import AssetError
from usdfoliage.files import write_gate
from usdfoliage.files.write_gate import Access, check_access


@pytest.fixture
def capture(tmp_path):
    folder = tmp_path / "studio" / "capture"
    (folder / "images").mkdir(parents=True)
    (folder / "images" / "a.jpg").write_text("a photograph")
    return folder


def refused(*, reads=(), replaces=(), fills=(), keeps=()):
    with pytest.raises(AssetError) as refusal:
        check_access(Access(reads=tuple(reads), replaces=tuple(replaces), fills=tuple(fills), keeps=tuple(keeps)))
    assert refusal.value.remedy
    return refusal.value.text


@pytest.mark.parametrize("place", [".", "..", "../..", "images", "images/new", "new", "images/a.jpg", "images/../new"])
def test_an_output_at_above_or_below_an_input_is_refused(capture, place):
    text = refused(reads=[capture], replaces=[capture / place])
    assert str(capture) in text
    assert str(capture / place) in text


@pytest.mark.parametrize("place", ["../assets", "../capture2", "../capture.new", "../../capture"])
def test_places_beside_an_input_are_free(capture, place):
    check_access(Access(reads=(capture,), replaces=(capture / place,)))


def test_symbolic_links_are_followed_from_input_and_output(capture, tmp_path):
    (tmp_path / "link").symlink_to(capture.parent)
    refused(reads=[capture], replaces=[tmp_path / "link"])
    refused(reads=[tmp_path / "link" / "capture"], replaces=[capture])
    refused(reads=[capture], replaces=[tmp_path / "link" / "capture" / "new"])
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    check_access(Access(reads=(capture,), replaces=(tmp_path / "loop",)))  # who writes there refuses it


def test_a_link_in_an_input_that_leads_into_the_output_is_refused(capture, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "b.jpg").write_text("a photograph")
    (capture / "images" / "b.jpg").symlink_to(out / "b.jpg")
    assert "images/b.jpg" in refused(reads=[capture], replaces=[out])


def test_a_link_in_the_output_that_leads_to_an_input_is_free(capture, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "images").symlink_to(capture / "images")
    check_access(Access(reads=(capture,), replaces=(tmp_path / "out",)))


def test_hard_links_are_the_same_file(capture, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    os.link(capture / "images" / "a.jpg", out / "kept.jpg")
    refused(reads=[capture], replaces=[out])
    refused(reads=[capture / "images" / "a.jpg"], replaces=[out])
    refused(reads=[capture / "images" / "a.jpg"], replaces=[out / "kept.jpg"])
    refused(reads=[capture], replaces=[out / "kept.jpg"])
    check_access(Access(reads=(capture,), replaces=(out / "other.jpg",)))


@contextmanager
def mounted(*words):
    if subprocess.run(["mount", *map(str, words)], capture_output=True, check=False).returncode:
        pytest.skip("this machine does not allow mounting")
    try:
        yield
    finally:
        subprocess.run(["umount", str(words[-1])], check=True)


def test_bind_mounts_are_seen_through(capture, tmp_path):
    there = tmp_path / "there"
    there.mkdir()
    with mounted("--bind", capture.parent, there):
        refused(reads=[capture], replaces=[there])
        refused(reads=[capture], replaces=[there / "capture"])
        refused(reads=[there / "capture"], replaces=[capture])
        refused(reads=[capture], replaces=[there / "capture" / "new"])
        refused(reads=[there / "capture" / "images"], replaces=[capture.parent])
        check_access(Access(reads=(capture,), replaces=(there / "other",)))
    with mounted("--bind", capture / "images", there):
        refused(reads=[there], replaces=[capture])
        refused(reads=[there / "a.jpg"], replaces=[capture])
        refused(reads=[capture], replaces=[there / "new"])


def test_names_that_differ_in_case_alone_are_one_where_the_file_system_takes_them_for_one(capture, monkeypatch):
    """As on a Mac: a path is found by a name of any case, and has one inode."""
    stat = Path.stat

    def stat_any_case(path, **words):
        here = Path(path.anchor)
        for part in path.parts[1:]:
            names = os.listdir(here) if here.is_dir() else []  # noqa: PTH208
            here /= next((name for name in names if name.casefold() == part.casefold()), part)
        return stat(here, **words)

    other = capture.with_name("CAPTURE")
    check_access(Access(reads=(capture,), replaces=(other,)))
    monkeypatch.setattr(Path, "stat", stat_any_case)
    assert "is the same as" in refused(reads=[capture], replaces=[other])
    refused(reads=[capture], replaces=[other / "Images"])
    refused(reads=[other], replaces=[capture / "IMAGES" / "new"])


def test_names_that_differ_in_case_alone_are_one_on_a_file_system_that_ignores_case(tmp_path):
    there = tmp_path / "there"
    there.mkdir()
    with mounted("-t", "tmpfs", "-o", "casefold", "tmpfs", there):
        root = there / "folded"
        root.mkdir()
        if subprocess.run(["chattr", "+F", root], capture_output=True, check=False).returncode:
            pytest.skip("this machine has no folders that ignore case")
        (root / "capture").mkdir()
        refused(reads=[root / "capture"], replaces=[root / "CAPTURE"])
        refused(reads=[root / "capture"], replaces=[root / "Capture" / "new"])


def test_what_is_filled_may_lie_in_an_input_and_holds_none(capture, tmp_path):
    check_access(Access(reads=(capture,), replaces=(tmp_path / "out",), fills=(capture / ".usdfoliage",)))
    refused(reads=[capture], replaces=[tmp_path / "out"], fills=[capture.parent])


def test_one_output_lies_in_no_other(tmp_path):
    refused(replaces=[tmp_path / "out"], fills=[tmp_path / "out" / "work"])
    refused(replaces=[tmp_path / "out", tmp_path / "out" / "second"])
    check_access(Access(replaces=(tmp_path / "out",), fills=(tmp_path / ".usdfoliage",)))


def test_what_a_run_keeps_may_be_replaced(capture):
    check_access(Access(reads=(capture,), replaces=(capture,), keeps=(capture,)))
    mask = capture / "mask.png"
    mask.touch()
    refused(reads=[capture, mask], replaces=[capture], keeps=[capture])
    refused(reads=[capture], replaces=[capture.parent], keeps=[capture])
    check_access(Access(reads=(mask,), replaces=(capture,), keeps=(mask,)))


def test_a_folder_that_links_lead_out_of_without_end_is_refused_in_time(capture, tmp_path, monkeypatch):
    for number in range(30):
        (tmp_path / f"{number}").mkdir()
    (capture / "all").symlink_to(tmp_path)
    (tmp_path / "out").mkdir()
    monkeypatch.setattr(write_gate, "MAX_ENTRIES", 20)
    assert "more than 20 files" in refused(reads=[capture], replaces=[tmp_path / "out"])
    check_access(Access(reads=(capture,)))


def is_refused(reads, replaces):
    try:
        check_access(Access(reads=tuple(reads), replaces=tuple(replaces)))
    except AssetError:
        return True
    return False


def test_many_paths_are_refused_where_one_pair_of_them_is(tmp_path):
    rng = np.random.default_rng(3)
    names = ("a", "b", "a/c", "b/c", "a/c/d", "b/link", "b/link/d", "e", "e/f")
    for number in range(30):
        top = tmp_path / str(number)
        (top / "a" / "c").mkdir(parents=True)
        (top / "b").mkdir()
        (top / "b" / "link").symlink_to("../a/c")
        (top / "a" / "file").write_text("one")
        os.link(top / "a" / "file", top / "b" / "file")
        reads = [top / names[each] for each in rng.choice(len(names), 3)]
        replaces = [top / names[each] for each in rng.choice(len(names), 2, replace=False)]
        pairs = any(is_refused([read], [place]) for read in reads for place in replaces)
        assert is_refused(reads, replaces) == (pairs or is_refused([], replaces)), (reads, replaces)


def test_the_time_does_not_grow_with_the_square_of_the_paths(tmp_path):
    began = time.process_time()
    count = 10_000  # pair by pair this takes half an hour
    reads = [tmp_path / "in" / f"oak{number}" for number in range(count)]
    check_access(Access(reads=tuple(reads), replaces=tuple(tmp_path / "out" / read.name for read in reads)))
    assert time.process_time() - began < 20
    assert refused(reads=reads, replaces=[tmp_path / "out" / "a", reads[-1]])
