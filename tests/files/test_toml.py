"""TOML that somebody else wrote, and what is refused of it."""

import os

import pytest
from usdfoliage.files.toml import MAX_BYTES, MAX_DOTS, read_toml


def test_values_are_those_of_the_file(tmp_path):
    (tmp_path / "a.toml").write_text("\ufeffa = 1\n# " + "." * 500 + '\n[b]\nc = [0.5, "x"]\n', encoding="utf-8")
    assert read_toml(tmp_path / "a.toml") == {"a": 1, "b": {"c": [0.5, "x"]}}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"a = " + b"[" * 50_000, "too deep"),
        (b"a = " + b"{a = " * 50_000, "too deep"),
        (b"a" + b".a" * (MAX_DOTS + 1) + b" = 1", "dots"),
        (b"a = 1\nb = " + b"9" * 5000, "digits"),
        (b"a = " + b"9" * 400, "digits"),
        (b"a = '\xff'", "byte 5 is no UTF-8"),
        (b"#" * (MAX_BYTES + 1), "more than"),
        (b"a = ", "Invalid value"),
    ],
    ids=["lists", "tables", "key", "digits", "number", "bytes", "size", "value"],
)
def test_what_would_stop_a_reader_is_refused(tmp_path, data, words):
    (tmp_path / "a.toml").write_bytes(data)
    with pytest.raises(ValueError, match=words):
        read_toml(tmp_path / "a.toml")


def test_nothing_is_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "endless.toml").symlink_to("/dev/zero")
    for name in ("pipe", "endless"):
        with pytest.raises(ValueError, match="regular"):
            read_toml(tmp_path / f"{name}.toml")
    with pytest.raises(OSError, match="directory"):
        read_toml(tmp_path)
