"""Locks of files."""

import errno
import fcntl
import os
from pathlib import Path

import pytest
from usdfoliage.files.locks import is_locked, lacks_locks, open_lock, open_old_lock, try_lock, wait_for_lock


def test_one_alone_or_several_who_share(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    first, second, third = (open_lock(path) for _ in range(3))
    try:
        wait_for_lock(first, shared=True)
        wait_for_lock(second, shared=True)
        assert not try_lock(third)
        assert is_locked(path)
        os.close(first)
        assert not try_lock(third)
        os.close(second)
        assert not is_locked(path)
        assert try_lock(third)
        assert is_locked(path)
    finally:
        os.close(third)


def test_no_lock_is_made_by_asking(tmp_path: Path) -> None:
    assert not is_locked(tmp_path / "lock")
    with pytest.raises(FileNotFoundError):
        open_old_lock(tmp_path / "lock")
    assert list(tmp_path.iterdir()) == []


def test_a_lock_that_must_be_new_is_not_taken_over_and_a_link_not_followed(tmp_path: Path) -> None:
    os.close(open_lock(tmp_path / "lock", must_be_new=True))
    with pytest.raises(FileExistsError):
        open_lock(tmp_path / "lock", must_be_new=True)
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="symbolic links"):
        open_lock(tmp_path / "link")
    assert not (tmp_path / "elsewhere").exists()


def test_a_file_system_without_locks_is_recognized(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    lock = open_lock(tmp_path / "lock")
    monkeypatch.setattr(fcntl, "flock", refuse)
    try:
        for attempt in (wait_for_lock, try_lock):
            with pytest.raises(OSError, match="No locks") as refusal:
                attempt(lock)
            assert lacks_locks(refusal.value)
        assert not is_locked(tmp_path / "lock")
    finally:
        os.close(lock)
    assert not lacks_locks(PermissionError(errno.EACCES, "Permission denied"))
