"""Hashes of files and values."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from usdfoliage.errors import CaptureError
from usdfoliage.files.hashing import digest_file, digest_text, digest_values, hash_bytes, hash_each, hash_files


@dataclass(frozen=True)
class Chosen:
    length_m: float = 1.0
    threads: int = 0


def test_files_and_texts_are_hashed_as_sha256sum_does(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("leaf")
    known = hashlib.sha256(b"leaf").hexdigest()
    assert digest_file(tmp_path / "a") == digest_text("leaf") == known
    assert hash_bytes(b"le", b"af").hex() == hash_each(iter([b"l", b"eaf"])).hex() == known


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"a cannot be read: No such file or directory; check its permissions"):
        digest_file(tmp_path / "a")


def test_the_name_and_the_bytes_of_a_file_count(tmp_path: Path) -> None:
    for name, text in (("a", "x"), ("b", "y")):
        (tmp_path / name).write_text(text)
    a, b = tmp_path / "a", tmp_path / "b"
    asked = ([("a", a)], [("b", a)], [("a", b)], [("a", a), ("b", b)], [("b", b), ("a", a)])
    assert len({hash_files(files) for files in asked}) == 5


def test_kinds_lengths_and_shapes_of_values_count() -> None:
    row = np.arange(6.0)
    values = (1, 1.0, "1", True, None, "", (), ("",), row, row.reshape(2, 3), row.astype(np.float32), Chosen())
    assert len({digest_values(value) for value in values}) == len(values)
    assert digest_values("a", "b") != digest_values("ab")
    assert digest_values(("a",), "b") != digest_values(("a", "b"))


def test_threads_do_not_count() -> None:
    assert digest_values(Chosen(threads=4)) == digest_values(Chosen())
    assert digest_values(Chosen(length_m=2.0)) != digest_values(Chosen())


def test_a_value_without_a_lasting_hash_is_refused() -> None:
    with pytest.raises(TypeError, match="a dict has no hash that lasts"):
        digest_values({1: 2})
