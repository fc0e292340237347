"""What every model file must do: come back whole, the same bytes each time, and be refused by name where damaged."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from usdfoliage.errors import CaptureError, WriteError


def check_model_file(
    tmp_path: Path, model: Any, write: Callable[[Path, Any], None], read: Callable[[Path], Any], lost: str
) -> Any:
    """Check what does not depend on the model; returns what was read.

    Args:
        tmp_path: An empty folder.
        model: What is written.
        write: Writes it.
        read: Reads it.
        lost: An array without which the file is none.
    """
    path = tmp_path / "new folder" / "model.npz"
    write(path, model)
    write(tmp_path / "again.npz", model)
    data = path.read_bytes()
    assert data == (tmp_path / "again.npz").read_bytes()
    assert [each.name for each in path.parent.iterdir()] == ["model.npz"]
    found = read(path)
    write(tmp_path / "again.npz", found)
    assert data == (tmp_path / "again.npz").read_bytes()
    with np.load(path, allow_pickle=False) as loaded:
        arrays = dict(loaded)
    np.savez(tmp_path / "lost.npz", **{name: array for name, array in arrays.items() if name != lost})
    np.savez(tmp_path / "shape.npz", **(arrays | {lost: arrays[lost][..., :-1]}))
    np.savez(tmp_path / "pickle.npz", **(arrays | {lost: np.array([{}], object)}))
    (tmp_path / "short.npz").write_bytes(data[: len(data) // 2])
    (tmp_path / "empty.npz").write_bytes(b"")
    altered = bytearray(data)
    altered[data.index(arrays[lost].tobytes()) + 5] ^= 0xFF
    (tmp_path / "altered.npz").write_bytes(bytes(altered))
    for name in ("lost", "shape", "pickle", "short", "empty", "altered", "missing"):
        with pytest.raises(CaptureError, match=f"{name}.npz holds no .*run the same command again"):
            read(tmp_path / f"{name}.npz")
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match=r"file/model.npz was not written"):
        write(tmp_path / "file" / "model.npz", model)
    return found
