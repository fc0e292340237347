#!/usr/bin/env python3
"""What photographs without cameras give, of a capture whose truth is known.

usage: tools/bench/without_poses.py CAPTURE [--photographs PATH …] [-o FOLDER]

CAPTURE has images/, cameras/ and truth/leaves.npz, with exact depth. A folder of copies of its photographs and a video,
in which each stands still for three frames, are made, and `usdfoliage build` builds a plant of each and of nothing
else. With --photographs plants are built of these instead: folders whose files' names end in those of CAPTURE's
photographs, as IMG_007.HEIC for 007.jpg. The cameras that were found are laid over the true ones by a similarity, and
the leaves that are found or completed are measured in the frame of the true ones, as leaf_truth.py does. Prints a line
for each. Exit 1 where a build fails.
"""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.colmap.model import find_camera_model, read_camera_model
from usdfoliage.leaf.model import LeafOrigin

from tools.bench.leaf_truth import (
    Scores,
    move_leaves,
    read_asset_leaves,
    read_exact_depth,
    read_true_leaves,
    score_leaves,
    visible_shares,
)
from tools.bench.poses import centers, fit_similarity

Array = NDArray[np.float64]

STILL, RATE_HZ = 3, 10  # frames of a video that show one photograph, and how many are a second
FRAME_NAME = re.compile(r"frame_(\d+)m(\d+\.\d+)s")


@dataclass(frozen=True, kw_only=True, eq=False)
class LaidOver:
    """Cameras that were found, laid over the true ones."""

    true_from_found: Array  # (4, 4)
    cameras: int
    apart: float  # root mean square distance of their places, over the spread of the true ones


def copy_photographs(photographs: Sequence[Path], folder: Path) -> Path:
    """A folder of the same files."""
    folder.mkdir(parents=True)
    for photograph in photographs:
        shutil.copy(photograph, folder)
    return folder


def write_video(photographs: Sequence[Path], path: Path) -> Path:
    """A video in which each photograph stands still for a while."""
    path.parent.mkdir(parents=True, exist_ok=True)
    first = cv2.imread(str(photographs[0]))
    code = cv2.VideoWriter.fourcc(*"mp4v")
    video = cv2.VideoWriter(str(path), code, RATE_HZ, (first.shape[1], first.shape[0]))
    for photograph in photographs:
        picture = cv2.imread(str(photograph))
        for _ in range(STILL):
            video.write(picture)
    video.release()
    return path


def find_stem(name: str, stems: Sequence[str]) -> str | None:
    """Which of the photographs' names, in their order, the file of a photograph or of a frame of the video shows."""
    if frame := FRAME_NAME.search(name):
        number = round((60 * int(frame[1]) + float(frame[2])) * RATE_HZ) // STILL
        return stems[number] if number < len(stems) else None
    ends = [stem for stem in stems if Path(name).stem.endswith(stem)]
    return max(ends, key=len, default=None)


def lay_over(found: Mapping[str, Array], true: Mapping[str, Array]) -> LaidOver:
    """The similarity between two frames, by cameras (3, 4) that are in both.

    Raises:
        ValueError: There are fewer than three.
    """
    common = sorted(found.keys() & true.keys())
    if len(common) < 3:
        raise ValueError(f"{len(common)} cameras are in both: three are needed")
    found_m, true_m = (centers(np.array([poses[name] for name in common])) for poses in (found, true))
    scale, turn, move_m = fit_similarity(found_m, true_m)
    apart_m = np.linalg.norm(scale * found_m @ turn.T + move_m - true_m, axis=1)
    spread_m = np.linalg.norm(true_m - true_m.mean(axis=0), axis=1)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = scale * turn, move_m
    return LaidOver(
        true_from_found=matrix,
        cameras=len(common),
        apart=float(np.sqrt(np.mean(apart_m**2) / np.mean(spread_m**2))),
    )


def read_poses(folder: Path, stems: Sequence[str]) -> dict[str, Array]:
    """Camera from world (3, 4) by the name of the photograph."""
    images = read_camera_model(find_camera_model(folder)).images
    by_stem = {find_stem(image.name, stems): image.cam_from_world for image in images}
    return {stem: pose for stem, pose in by_stem.items() if stem is not None}


def build_and_measure(photographs: Path, capture: Path, folder: Path) -> tuple[LaidOver, Scores]:
    """Build a plant of photographs alone, and measure its leaves by the truth of a capture.

    Raises:
        CalledProcessError: The build failed.
    """
    asset, work = folder / "plant", folder / "work"
    command = [sys.executable, "-m", "usdfoliage", "build", photographs, "-o", asset, "--work", work]
    subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL)
    stems = sorted(each.stem for each in (capture / "images").iterdir())
    cameras = next(iter(sorted(work.glob("results/*/capture/*/cameras"))))
    laid = lay_over(read_poses(cameras, stems), read_poses(capture / "cameras", stems))
    leaves = read_asset_leaves(asset)
    if leaves.origin is not None:
        leaves = leaves.take(leaves.origin <= LeafOrigin.COMPLETED)
    true = read_true_leaves(capture)
    best = visible_shares(true, read_exact_depth(capture)).max(axis=1)
    return laid, score_leaves(true, best, move_leaves(leaves, laid.true_from_found))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", type=Path)
    parser.add_argument("--photographs", type=Path, nargs="+", default=[])
    parser.add_argument("-o", "--output", type=Path, help="folder in which photographs and builds stay")
    options = parser.parse_args()
    failed = False
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.output or Path(scratch)
        sources = options.photographs
        if not sources:
            files = sorted((options.capture / "images").iterdir())
            sources = [copy_photographs(files, folder / "photographs"), write_video(files, folder / "video.mp4")]
        print(f"{'photographs':16} {'cameras':>7} {'apart':>7} {'leaves':>6} {'recall':>6} {'precision':>9} {'s':>6}")
        for source in sources:
            start = time.perf_counter()
            try:
                laid, scores = build_and_measure(source, options.capture, folder / f"{source.stem}_build")
            except subprocess.CalledProcessError:
                failed = True
                continue
            print(
                f"{source.name[:16]:16} {laid.cameras:7} {laid.apart:7.2%} {scores.found:6} {scores.recall:6.2f} "
                f"{scores.precision:9.2f} {time.perf_counter() - start:6.0f}",
                flush=True,
            )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
