"""What a user learns of a file that cannot be written: which one, why, and what to do."""

import errno
import os
import pickle
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from usdfoliage.errors import AssetError, FoliageError, WriteError
from usdfoliage.files.atomic import copy_whole, make_folders, write_whole_files
from usdfoliage.files.open_exr import write_open_exr
from usdfoliage.files.unwritten import describe_failed, describe_unwritten, with_users_names


def of_number(number: int) -> OSError:
    return OSError(number, os.strerror(number))


@pytest.mark.parametrize(
    ("number", "advice"),
    [
        (errno.ENOSPC, "make room there, or name another output"),
        (errno.EDQUOT, "your quota is used up: make room there, or name another output"),
        (errno.EFBIG, "allow larger files (ulimit -f), or name another output"),
        (errno.EACCES, "check the permissions of its folder, or name another output"),
        (errno.EPERM, "check who owns it and its folder, or name another output"),
        (errno.EROFS, "the disk is read-only: name another output"),
        (errno.ENAMETOOLONG, "give it a shorter name"),
        (errno.EIO, "name another output"),
    ],
)
def test_every_reason_has_its_advice(tmp_path: Path, number: int, advice: str) -> None:
    error = describe_unwritten(tmp_path / "oak", of_number(number))
    assert str(error).startswith(f"{tmp_path / 'oak'} was not written: {os.strerror(number)}")
    assert str(error).endswith(f"; {advice}")
    assert error.path == tmp_path / "oak"


def test_an_error_without_words_still_has_a_reason(tmp_path: Path) -> None:
    assert "None" not in str(describe_unwritten(tmp_path / "oak", OSError()))


def test_the_room_that_is_left_is_stated_also_where_no_folder_is_there_yet(tmp_path: Path) -> None:
    assert "MB are free there" in str(describe_unwritten(tmp_path / "a" / "b" / "oak", of_number(errno.ENOSPC)))


def test_a_disk_that_can_have_no_more_files_is_not_called_small(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = SimpleNamespace(f_bavail=10**6, f_frsize=4096, f_files=1000, f_favail=0)
    monkeypatch.setattr(os, "statvfs", lambda _path: left)
    assert "as many files as it can have" in str(describe_unwritten(tmp_path / "oak", of_number(errno.ENOSPC)))


def test_a_work_folder_is_called_so_and_what_is_done_is_kept(tmp_path: Path) -> None:
    error = describe_unwritten(tmp_path, of_number(errno.ENOSPC), place="work folder", goes_on=True)
    assert str(error).endswith("or name another work folder, then the same command goes on from here")


def test_the_words_of_a_library_come_only_where_the_disk_has_room(tmp_path: Path, small_disk: Path) -> None:
    scratch = tmp_path / ".oak.0123.usdfoliage-new.exr"
    error = describe_failed(tmp_path / "oak.exr", f"cannot write\n{scratch}.", scratch=scratch)
    assert f"was not written: cannot write {tmp_path / 'oak.exr'}; see whether the disk is full" in str(error)
    with (small_disk / "filling").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, shutil.disk_usage(small_disk).free)
    error = describe_failed(small_disk / "oak.exr", "cannot write")
    assert "was not written: No space left on device, 0 MB are free there; make room there" in str(error)


def test_an_image_on_a_full_disk_is_named_as_the_user_does(small_disk: Path) -> None:
    with (small_disk / "filling").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, shutil.disk_usage(small_disk).free - 8192)
    noise = np.random.default_rng(0).random((64, 64), np.float32)
    with pytest.raises(WriteError) as refusal:
        write_open_exr(small_disk / "new" / "oak.exr", {}, {"R": noise})
    assert str(refusal.value).startswith(f"{small_disk / 'new' / 'oak.exr'} was not written: No space left on device")
    assert "usdfoliage-new" not in str(refusal.value)
    assert [path.name for path in small_disk.iterdir()] == ["filling"]


def test_a_scratch_folder_has_the_users_name_in_an_error(tmp_path: Path) -> None:
    scratch, out = tmp_path / ".oak.0123.usdfoliage-new", tmp_path / "oak"
    renamed = with_users_names(describe_unwritten(scratch / "maps" / "a", of_number(errno.ENOSPC)), scratch, out)
    assert isinstance(renamed, WriteError)
    assert renamed.path == out / "maps" / "a"
    assert "usdfoliage-new" not in str(renamed)
    other = with_users_names(FoliageError(f"{scratch / 'a'} is odd", "write it again"), scratch, out)
    assert (type(other), str(other)) == (FoliageError, f"{out / 'a'} is odd; write it again")


def test_the_path_of_an_error_comes_through_a_process(tmp_path: Path) -> None:
    assert pickle.loads(pickle.dumps(describe_unwritten(tmp_path, of_number(errno.EIO)))).path == tmp_path


def test_of_a_copy_the_side_that_failed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, target = tmp_path / "a.png", tmp_path / "maps" / "b.png"
    with pytest.raises(AssetError, match=r"a\.png cannot be copied: it is not there") as refusal:
        copy_whole(source, target)
    assert not isinstance(refusal.value, WriteError)
    source.write_bytes(bytes(3 << 20))
    copy_whole(source, target)
    assert target.read_bytes() == source.read_bytes()
    target.unlink()
    monkeypatch.setattr(os, "fsync", lambda _descriptor: (_ for _ in ()).throw(of_number(errno.EDQUOT)))
    with pytest.raises(WriteError, match=r"b.png was not written: .*quota.*what was there is unchanged.*quota"):
        copy_whole(source, target)
    assert list(target.parent.iterdir()) == []


def test_folders_that_were_made_for_files_go_with_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", lambda _descriptor: (_ for _ in ()).throw(of_number(errno.ENOSPC)))
    with pytest.raises(WriteError):
        write_whole_files([(tmp_path / "t" / "job.yaml", b"1"), (tmp_path / "b" / "new" / "template.yaml", b"2")])
    assert list(tmp_path.iterdir()) == []


def test_folders_that_cannot_be_made_leave_none(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    assert make_folders(tmp_path / "a" / "b") == [tmp_path / "a", tmp_path / "a" / "b"]
    assert make_folders(tmp_path / "a" / "b") == []
    with pytest.raises(FileExistsError):
        make_folders(tmp_path / "file")
    with pytest.raises(OSError, match="File name too long"):
        make_folders(tmp_path / "c" / ("x" * 300))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "file"]
