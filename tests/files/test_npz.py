"""Arrays in .npz files."""

from pathlib import Path

import numpy as np
import pytest
from usdfoliage.files.npz import DAMAGED, find_damage, read_arrays, write_arrays

ARRAYS = {"depth": np.random.default_rng(0).random((40, 30)), "count": np.array(7, np.int64)}


@pytest.mark.parametrize("compressed", [False, True])
def test_arrays_come_back_and_their_bytes_are_the_same_each_time(tmp_path: Path, compressed: bool) -> None:
    for name in ("a.npz", "b.npz"):
        write_arrays(tmp_path / name, ARRAYS, compressed=compressed)
    read = read_arrays(tmp_path / "a.npz")
    assert {name: array.tobytes() for name, array in read.items()} == {n: a.tobytes() for n, a in ARRAYS.items()}
    assert list(read_arrays(tmp_path / "a.npz", ["count"])) == ["count"]
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert find_damage(tmp_path / "a.npz") is None


@pytest.mark.parametrize("compressed", [False, True])
def test_a_wrong_bit_is_found(tmp_path: Path, compressed: bool) -> None:
    path = tmp_path / "a.npz"
    write_arrays(path, ARRAYS, compressed=compressed)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    assert find_damage(path)
    with pytest.raises(DAMAGED):
        read_arrays(path)


def test_missing_files_and_arrays_raise_and_damage_is_returned(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        find_damage(tmp_path / "a.npz")
    write_arrays(tmp_path / "a.npz", ARRAYS)
    with pytest.raises(KeyError):
        read_arrays(tmp_path / "a.npz", ["color"])
    (tmp_path / "a.npz").write_bytes(b"no archive")
    assert find_damage(tmp_path / "a.npz")


def test_a_file_that_somebody_else_wrote_is_found(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    for other in ({**ARRAYS, "depth": ARRAYS["depth"][:3]}, {**ARRAYS, "count": np.zeros((0, 2))}, ARRAYS):
        np.savez(path, **other)
        assert find_damage(path) == "it is not what was written"
        with pytest.raises(ValueError, match="not what was written"):
            read_arrays(path, sealed=True)
    write_arrays(path, ARRAYS)
    assert sorted(read_arrays(path, sealed=True)) == ["count", "depth"]
