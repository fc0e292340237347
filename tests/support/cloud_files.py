"""Small clouds in files of every format that is read."""

from pathlib import Path

import laspy
import numpy as np


def some_points(count: int = 200, seed: int = 0) -> np.ndarray:
    """Two metres wide, on whole millimetres, all different."""
    cells = np.random.default_rng(seed).choice(2000, (3 * count, 3))
    cells = np.unique(cells, axis=0)
    return np.random.default_rng(seed).permutation(cells)[:count] / 1000


def some_colors(count: int = 200) -> np.ndarray:
    return np.random.default_rng(1).integers(1, 256, (count, 3))


def write_ply(path: Path, points, colors=None, kind: str = "double", order: str = "<", comment: str = "") -> Path:
    name = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
    header = ["ply", f"format {name} 1.0", *([f"comment {comment}"] if comment else [])]
    header += [f"element vertex {len(points)}", *(f"property {kind} {axis}" for axis in "xyz")]
    if colors is not None:
        header += [f"property uchar {channel}" for channel in ("red", "green", "blue")]
    text = "\n".join([*header, "end_header"]) + "\n"
    if not order:
        rows = [[*map(repr, map(float, point))] for point in points]
        rows = rows if colors is None else [[*row, *map(str, color)] for row, color in zip(rows, colors, strict=True)]
        path.write_text(text + "\n".join(map(" ".join, rows)) + "\n")
        return path
    dtype = [(axis, order + {"double": "f8", "float": "f4"}[kind]) for axis in "xyz"]
    dtype += [] if colors is None else [(channel, "u1") for channel in "rgb"]
    rows = np.empty(len(points), dtype)
    for column, axis in enumerate("xyz"):
        rows[axis] = np.asarray(points)[:, column]
        if colors is not None:
            rows["rgb"[column]] = np.asarray(colors)[:, column]
    path.write_bytes(text.encode() + rows.tobytes())
    return path


def write_las(path: Path, points, colors=None, offset=(0.0, 0.0, 0.0), **fields) -> Path:
    header = laspy.LasHeader(point_format=7 if colors is not None else 6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, list(offset)
    for record in fields.pop("vlrs", ()):
        header.vlrs.append(record)
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.asarray(points).T
    if colors is not None:
        las.red, las.green, las.blue = np.asarray(colors).T * 257
    for name, values in fields.items():
        las[name] = values
    las.write(path)
    return path


def write_text(path: Path, points, colors=None, separator: str = " ", head: str = "") -> Path:
    rows = [[f"{value:.3f}" for value in point] for point in points]
    if colors is not None:
        rows = [[*row, *map(str, color)] for row, color in zip(rows, colors, strict=True)]
    path.write_text(head + "".join(separator.join(row) + "\n" for row in rows))
    return path


def write_any(path: Path, points, colors=None) -> Path:
    if path.suffix == ".ply":
        return write_ply(path, points, colors)
    if path.suffix in (".las", ".laz"):
        return write_las(path, points, colors, offset=np.floor(np.mean(points, axis=0)))
    return write_text(path, points, colors, "," if path.suffix == ".csv" else " ")
