#!/usr/bin/env python3
"""The sheet of the wood of scanned trees: of each cloud the traced tree and the grown one, whole and at three forks.

usage: tools/wood_picture.py [-o docs/wood.jpg] [--builds out/wood] [--data ../shared/data]

Trees that are in --builds already are not built again. Prints of each its branches, faces, and how it was measured.
"""

import argparse
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.jobs.models import read_models
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, finish_picture

SIDE_PX = 240  # of a picture
BACKGROUND = (0.36, 0.37, 0.38)
QUALITY = 82
FORKS = ((0.003, 14.0), (0.15, 30.0), (0.6, 60.0))  # quantile of the parents' radii from the thickest, radii around it
TEXT_PX = 22


@dataclass(frozen=True, kw_only=True)
class PicturedCloud:
    """A cloud of the data, by the name of its tree."""

    name: str
    cloud: str


CLOUDS = (
    PicturedCloud(name="tree33", cloud="cloud-adtree/tree33.ply"),
    PicturedCloud(name="tree7", cloud="cloud-adtree/tree7.ply"),
    PicturedCloud(name="Lille_2", cloud="cloud-adtree/Lille_2.ply"),
    PicturedCloud(name="Paris_Luxembourg_1", cloud="cloud-adtree/Paris_Luxembourg_1.ply"),
    PicturedCloud(name="airborne", cloud="cloud-amsterdam-street-tree/airborne_tree_121913_487434.ply"),
    PicturedCloud(name="stem", cloud="cloud-amsterdam-street-tree/stem_121913_487434.ply"),
    PicturedCloud(name="archi", cloud="cloud-archi/tree_1.ply"),
    PicturedCloud(name="itsme", cloud="cloud-itsme/tree_1.ply"),
    PicturedCloud(name="buttressed", cloud="cloud-itsme/buttressed_tree_1.ply"),
    PicturedCloud(name="rtwig", cloud="cloud-rtwig/tree.ply"),
    PicturedCloud(name="pine", cloud="cloud-treels/pine.ply"),
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="output", type=Path, default=Path("docs/wood.jpg"))
    parser.add_argument("--builds", type=Path, default=Path("out/wood"))
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    arguments = parser.parse_args()
    rows = []
    for cloud in CLOUDS:
        pictures = []
        for method in ("trace", "grow"):
            asset = build(cloud, method, arguments.data, arguments.builds / method / cloud.name)
            pictures += draw(asset)
        row = np.hstack(pictures)
        cv2.putText(row, cloud.name, (6, TEXT_PX), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
        rows.append(row)
    cv2.imwrite(str(arguments.output), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return 0


def build(cloud: PicturedCloud, method: str, data: Path, asset: Path) -> Path:
    """The asset of a cloud's branches, built where it is not there yet."""
    if not asset.exists():
        command = [sys.executable, "-m", "usdfoliage", "branches", str(data / cloud.cloud), "-o", str(asset)]
        done = subprocess.run(
            [*command, "--method", method, "--no-preview"], capture_output=True, text=True, check=True
        )
        lines = [line for line in done.stdout.splitlines() if line.startswith(("branches:", "cage:", "wood:"))]
        print(cloud.name, method, "; ".join(lines), flush=True)
    return asset


def draw(asset: Path) -> list[NDArray[np.uint8]]:
    """The whole tree, and three of its forks, at a thick, a thinner and a thin parent."""
    skeleton = read_models(asset).skeleton
    if skeleton is None:
        raise SystemExit(f"{asset} has no skeleton")
    nowhere = asset / "none.png"  # pictures are not written one by one
    views = [PreviewView(output=nowhere, direction="three-quarter")]
    forks = skeleton.parent_vertex[skeleton.parent_curve >= 0]
    forks = forks[np.argsort(-skeleton.radius_m[forks], kind="stable")]
    for quantile, radii in FORKS if len(forks) else ():
        vertex = forks[int(quantile * len(forks))]
        (x, y, _), beside_m = skeleton.points_m[vertex], radii * skeleton.radius_m[vertex]
        window = (x - beside_m, x + beside_m, y - beside_m, y + beside_m)
        views.append(PreviewView(output=nowhere, direction="front", orthographic=True, window=window))
    settings = PreviewSettings(width_px=SIDE_PX, height_px=SIDE_PX, complexity="high")
    drawn = draw_views(interface_of(asset)[0], views, settings)
    pictures = [np.ascontiguousarray(finish_picture(picture, BACKGROUND)[..., :3]) for picture in drawn]
    empty = np.full_like(pictures[0], pictures[0][0, 0])
    return pictures + [empty] * (1 + len(FORKS) - len(pictures))


if __name__ == "__main__":
    sys.exit(main())
