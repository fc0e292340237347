"""The ground as an OBJ mesh."""

from pathlib import Path

import numpy as np


def grid_quads(rows: int, columns: int) -> np.ndarray:
    """(F, 4) the faces of a grid of points, row by row."""
    number = np.arange(rows * columns).reshape(rows, columns)
    corners = number[1:, :-1], number[1:, 1:], number[:-1, 1:], number[:-1, :-1]
    return np.stack(corners, axis=-1).reshape(-1, 4)


def write_obj(path: Path, points, faces, more: str = "") -> Path:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(points, float).tolist()]
    lines += ["f " + " ".join(f"{corner + 1}//1" for corner in face) for face in np.asarray(faces).tolist()]
    path.write_text("\n".join(["# ground", "o Ground", "vn 0 0 1", *lines, more]) + "\n")
    return path
