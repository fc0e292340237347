"""The same capture in another size, to see whether anything depends on how large a scene is."""

import shutil
from pathlib import Path

import numpy as np
import OpenEXR

from tools.synthetic.files import write_depth

LENGTHS = ("base", "apex", "length", "chord", "width", "vertices")  # of truth/leaves.npz
DEPTHS = ("depth", "depth_noisy")


def scale_capture(source: Path, target: Path, factor: float) -> None:
    """Write a capture whose every length is factor times that of source, with links to its photographs.

    Args:
        source: A capture folder with a COLMAP model as text and truth/leaves.npz.
        target: A folder that is not there yet.
        factor: Above 0.

    Raises:
        ValueError: factor is not above 0.
        OSError: A file cannot be read or written.
    """
    if not (np.isfinite(factor) and factor > 0):
        raise ValueError(f"factor must be above 0, not {factor}")
    target.mkdir(parents=True)
    (target / "images").symlink_to((source / "images").resolve(), target_is_directory=True)
    if (source / "capture.toml").is_file():
        shutil.copyfile(source / "capture.toml", target / "capture.toml")
    _scale_cameras(source / "cameras", target / "cameras", factor)
    for name in DEPTHS:
        for path in sorted((source / name).glob("*.exr")):
            (target / name).mkdir(exist_ok=True)
            with OpenEXR.File(str(path)) as file:
                depth_m = np.array(file.channels()["Z"].pixels, np.float64)
            write_depth(target / name / path.name, (depth_m * factor).astype(np.float32))
    (target / "truth").mkdir()
    with np.load(source / "truth" / "leaves.npz") as read:
        arrays = dict(read)
    for name in LENGTHS:
        arrays[name] = (arrays[name].astype(np.float64) * factor).astype(arrays[name].dtype)
    arrays["transform"][:, :3, 3] *= factor
    np.savez_compressed(target / "truth" / "leaves.npz", **arrays)


def _scale_cameras(source: Path, target: Path, factor: float) -> None:
    target.mkdir()
    shutil.copyfile(source / "cameras.txt", target / "cameras.txt")
    lines = (source / "images.txt").read_text().splitlines()
    data = [number for number, line in enumerate(lines) if not line.startswith("#")]
    for number in data[::2]:  # the other half are points in pixels
        lines[number] = _scale_words(lines[number], 5, factor)
    (target / "images.txt").write_text("\n".join(lines) + "\n")
    if (source / "points3D.txt").is_file():
        points = [
            line if line.startswith("#") or not line.strip() else _scale_words(line, 1, factor)
            for line in (source / "points3D.txt").read_text().splitlines()
        ]
        (target / "points3D.txt").write_text("\n".join(points) + "\n")


def _scale_words(line: str, first: int, factor: float) -> str:
    """A line whose three numbers from the first-th word on are multiplied."""
    words = line.split()
    words[first : first + 3] = [f"{float(word) * factor:.15g}" for word in words[first : first + 3]]
    return " ".join(words)
