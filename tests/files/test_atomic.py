"""Files that appear whole."""

import os
from pathlib import Path

import pytest
from usdfoliage.errors import WriteError
from usdfoliage.files.atomic import replace_file, whole_file


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
    with pytest.raises(WriteError) as refusal, whole_file(path) as new:
        new.write_bytes(b"new")
    assert str(refusal.value) == (
        f"{path} was not written: No space left on device; "
        "what was there is unchanged; make room or choose another folder"
    )
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(WriteError) as refusal, whole_file(tmp_path / "file" / "a", remedy=""):
        pass
    assert str(refusal.value).endswith("was not written: File exists; what was there is unchanged")


@pytest.mark.parametrize("letter", ["a", "é", "葉", "𝒶"])
def test_the_longest_names_can_be_written(tmp_path: Path, letter: str) -> None:
    stem = letter * (250 // len(letter.encode()))
    with replace_file(tmp_path / f"{stem}.ply") as new:
        new.write_bytes(b"whole")
    assert (tmp_path / f"{stem}.ply").read_bytes() == b"whole"
