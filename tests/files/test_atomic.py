"""Files that appear whole."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from usdfoliage.errors import WriteError
from usdfoliage.files.atomic import replace_file, whole_file, write_whole_files


def test_a_file_is_there_when_the_block_ends_and_not_before(tmp_path: Path) -> None:
    path = tmp_path / "new" / "maps" / "a.exr"
    with replace_file(path) as new:
        new.write_bytes(b"whole")
        assert not path.exists()
        assert (new.parent, new.suffix) == (path.parent, ".exr")
    assert path.read_bytes() == b"whole"
    assert list(path.parent.iterdir()) == [path]


def test_what_was_there_stays_when_the_block_fails(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"old")
    with pytest.raises(UnicodeEncodeError), replace_file(path) as new:
        new.write_text("half\udcff", encoding="utf-8")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_found_before_the_name_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "a.txt"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, "fsync", full)
    free = "1,024"
    monkeypatch.setattr(os, "statvfs", lambda _path: SimpleNamespace(f_bavail=2**10, f_frsize=10**6, f_files=0))
    with pytest.raises(WriteError) as refusal, whole_file(path) as new:
        new.write_bytes(b"new")
    assert str(refusal.value) == (
        f"{path} was not written: No space left on device, {free} MB are free there; "
        "what was there is unchanged; make room there, or name another output"
    )
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(WriteError) as refusal, whole_file(tmp_path / "file" / "a"):
        pass
    assert str(refusal.value).endswith("was not written: File exists; what was there is unchanged; name another output")


@pytest.mark.parametrize("letter", ["a", "é", "葉", "𝒶"])
def test_the_longest_names_can_be_written(tmp_path: Path, letter: str) -> None:
    stem = letter * (250 // len(letter.encode()))
    with replace_file(tmp_path / f"{stem}.ply") as new:
        new.write_bytes(b"whole")
    assert (tmp_path / f"{stem}.ply").read_bytes() == b"whole"


def test_files_that_belong_together_appear_together(tmp_path: Path) -> None:
    first, second = tmp_path / "a.png", tmp_path / "new" / "b.png"
    first.write_bytes(b"old")
    write_whole_files([(first, b"new"), (second, b"new too")])
    assert (first.read_bytes(), second.read_bytes()) == (b"new", b"new too")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a.png", "b.png", "new"]


def test_files_that_belong_together_do_not_appear_where_one_has_no_folder(tmp_path: Path) -> None:
    first, second = tmp_path / "a.png", tmp_path / "taken" / "b.png"
    first.write_bytes(b"old")
    (tmp_path / "taken").write_bytes(b"a file where a folder is needed")
    with pytest.raises(WriteError) as refusal:
        write_whole_files([(first, b"new"), (second, b"new")])
    assert str(second) in str(refusal.value)
    assert first.read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "taken"]


@pytest.mark.parametrize("has_links", [True, False])
def test_files_that_belong_together_are_put_back_where_the_last_one_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_links: bool
) -> None:
    def refuse(*_words: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    if not has_links:
        monkeypatch.setattr(os, "link", refuse)
    (tmp_path / "old.png").write_bytes(b"old")
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(WriteError, match=r"folder.png was not written"):
        write_whole_files([(tmp_path / name, b"new") for name in ("old.png", "fresh.png", "folder.png")])
    assert (tmp_path / "old.png").read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.png", "old.png"]


def test_a_full_disk_is_reported_with_the_users_file_and_the_room_that_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(WriteError) as refusal:
        write_whole_files([(tmp_path / "job.yaml", b"new")])
    assert refusal.value.text.startswith(f"{tmp_path / 'job.yaml'} was not written: No space left on device, ")
    assert "MB are free there" in refusal.value.text
    assert refusal.value.remedy
    assert list(tmp_path.iterdir()) == []


KILLED = """
import os, signal, sys
from pathlib import Path
from usdfoliage.files.atomic import replace_file
with replace_file(Path(sys.argv[1])) as new:
    new.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_process_left_is_removed_by_the_next_that_writes_the_file(tmp_path: Path) -> None:
    path = tmp_path / "look.usda"
    path.write_bytes(b"old")
    for _ in range(2):
        subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 2  # the second removed what the first left
    (tmp_path / ".other.0123456789ab.usdfoliage-new.usda").write_bytes(b"")
    with replace_file(path) as new:
        new.write_bytes(b"new")
    assert path.read_bytes() == b"new"
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        ".other.0123456789ab.usdfoliage-new.usda",
        "look.usda",
    ]
    subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    write_whole_files([(path, b"newer"), (tmp_path / "b", b"")])
    assert len(list(tmp_path.iterdir())) == 3


def test_what_another_process_writes_at_the_moment_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with replace_file(path) as first:
        first.write_bytes(b"first")
        with replace_file(path) as second:
            second.write_bytes(b"second")
        assert first.exists()
    assert path.read_bytes() == b"first"
    assert list(tmp_path.iterdir()) == [path]
