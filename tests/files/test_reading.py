"""The one way into a file: regular files only, and never a wait."""

import os
import socket
import threading

import pytest
from usdfoliage.files.reading import IrregularFileError, explain_refusal, open_regular, read_regular, why_irregular


def within(seconds, function):
    """What a function raises or returns; fails where it waits."""
    found = []

    def work():
        try:
            found.append(function())
        except OSError as error:
            found.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(seconds)
    assert found, "it waits"
    return found[0]


def test_a_regular_file_is_read(tmp_path):
    (tmp_path / "a").write_bytes(b"12345")
    (tmp_path / "link").symlink_to("a")
    assert read_regular(tmp_path / "a") == read_regular(tmp_path / "link") == b"12345"
    assert read_regular(tmp_path / "a", 2) == b"12"
    assert why_irregular(tmp_path / "a") == why_irregular(tmp_path) == ""


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "to pipe").symlink_to("pipe")
    for name, kind in (("pipe", "a pipe"), ("to pipe", "a pipe"), ("zero", "a device")):
        error = within(5, lambda name=name: open_regular(tmp_path / name))
        assert isinstance(error, IrregularFileError)
        assert kind in error.strerror
        assert kind in why_irregular(tmp_path / name)
        assert name in explain_refusal(error)[0]
    assert isinstance(within(5, lambda: open_regular(tmp_path)), IsADirectoryError)
    assert "circle" in why_irregular(tmp_path / "loop")
    assert "circle" in explain_refusal(within(5, lambda: open_regular(tmp_path / "loop")))[0]
    assert isinstance(within(5, lambda: open_regular(tmp_path / "none")), FileNotFoundError)


def test_a_socket_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # its name must be short
    with socket.socket(socket.AF_UNIX) as one:
        one.bind("socket")
        with pytest.raises(OSError, match="socket"):
            open_regular(tmp_path / "socket")
        assert "a socket" in why_irregular(tmp_path / "socket")
