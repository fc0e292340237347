#!/usr/bin/env python3
"""The README's picture of plants of photographs alone: each photograph, and the plant drawn from the same camera.

usage: tools/photographs_picture.py [-o docs/photographs.jpg] [--builds out/photographs] [--data ../shared/data]

Plants that are in --builds already are not built again. Prints of each plant
its leaves by origin, and how it agrees with the photographs that it was not built of.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.capture.folder.read import Capture, read_capture, read_view
from usdfoliage.jobs.models import read_models
from usdfoliage.jobs.plant.pages.pictures import PictureSettings, shrink_to_stage
from usdfoliage.jobs.preview.pictures import PreviewView, draw_views, finish_picture
from usdfoliage.jobs.report.pictures import shrink_to
from usdfoliage.jobs.withheld.measure import measure_by_withheld
from usdfoliage.leaf.model import count_origins, describe_origins

HEIGHT_PX = 520  # of a row
SIDE_PX = 1400  # of the pictures, before they are cropped
MARGIN = 0.08  # around the plant, of its size in the picture
QUALITY = 88
MAX_LINK_BYTES = 1000


@dataclass(frozen=True, kw_only=True)
class PicturedPlant:
    """One plant, what it is built of, and the photograph that it is drawn beside."""

    name: str
    capture: str  # in the data: photographs and cameras; nothing else of it is used
    photograph: str  # its name
    is_beside: bool = False  # whether the photograph is in a capture beside that one, in the same frame
    hold_back: int | None = None  # every so many photographs, from the third on, one is withheld from the build


ROWS: tuple[tuple[PicturedPlant, ...], ...] = (
    (
        PicturedPlant(
            name="basil",
            capture="basil-bush-heldback/train",
            is_beside=True,
            photograph="00024_rgb.jpg",
        ),
        PicturedPlant(name="arabidopsis", capture="mv-arabidopsis", photograph="00008_rgb.jpg", hold_back=6),
    ),
    (
        PicturedPlant(name="pot", capture="synthetic/pot", photograph="007.jpg", hold_back=5),
        PicturedPlant(name="tree", capture="synthetic/tree_leaf_on", photograph="002.jpg", hold_back=6),
    ),
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="output", type=Path, default=Path("docs/photographs.jpg"))
    parser.add_argument("--builds", type=Path, default=Path("out/photographs"))
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    arguments = parser.parse_args()
    rows = []
    for plants in ROWS:
        pairs = [draw_pair(plant, arguments.data, arguments.builds / plant.name) for plant in plants]
        rows.append(np.hstack([picture for pair in pairs for picture in pair]))
    width = max(row.shape[1] for row in rows)
    rows = [cv2.resize(row, (width, round(row.shape[0] * width / row.shape[1]))) for row in rows]
    cv2.imwrite(str(arguments.output), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return 0


def draw_pair(plant: PicturedPlant, data: Path, folder: Path) -> list[NDArray[np.uint8]]:
    """A photograph and the plant from its camera, of one height and cut to what the plant fills in them."""
    asset = build(plant, data, folder)
    capture = pictured_capture(plant, data, folder)
    names = [view.name for view in capture.views]
    view = read_view(capture, names.index(plant.photograph))
    models = read_models(asset)
    unit = capture.settings.metres_per_unit
    asset_from_world = models.asset_from_capture @ np.diag([1 / unit, 1 / unit, 1 / unit, 1.0])
    settings = replace(PictureSettings().preview(SIDE_PX), variants=(("lod", "leaves"),))
    wanted = PreviewView(output=folder / "plant.png", pinhole=shrink_to_stage(view.camera, SIDE_PX, asset_from_world))
    (drawn,) = draw_views(interface_of(asset)[0], [wanted], settings)
    photograph, picture = shrink_to(view.srgb, SIDE_PX), finish_picture(drawn, settings.background)[..., :3]
    counts = {} if models.leaves is None else count_origins(models.leaves)
    print(plant.name, view.name, "leaves:", describe_origins(counts) or "none", flush=True)
    if plant.is_beside:
        with tempfile.TemporaryDirectory() as scratch:
            measured = measure_by_withheld(asset, capture, Path(scratch), 0)
        for row in measured.rows()[:1]:
            print(f"  {row.name}: {row.value} ({row.remark})", flush=True)
    window = plant_window(drawn[..., 3])
    return [fit_height(photograph[window]), fit_height(picture[window])]


def build(plant: PicturedPlant, data: Path, folder: Path) -> Path:
    """The asset of photographs and cameras alone, built where it is not there yet."""
    asset = folder / plant.name
    if asset.exists():
        return asset
    capture = copy_capture(data / plant.capture, folder / "capture")
    words: list[str | Path] = [capture, "-o", asset, "--work", folder / "work"]
    if plant.hold_back is not None:
        words += ["--hold-back", str(plant.hold_back)]
    subprocess.run([sys.executable, "-m", "usdfoliage", "build", *map(str, words)], check=True)
    return asset


def copy_capture(source: Path, to: Path) -> Path:
    """Photographs, cameras and units of a capture, where they are not there yet."""
    if to.exists():
        return to
    (to / "images").mkdir(parents=True)
    for photograph in sorted((source / "images").iterdir()):
        if photograph.stat().st_size < MAX_LINK_BYTES:  # links of the data may have become files with their targets
            photograph = photograph.parent / photograph.read_text().strip()
        shutil.copy(photograph, to / "images")
    if (source / "cameras").exists():
        shutil.copytree(source / "cameras", to / "cameras")
    if (source / "capture.toml").exists():
        shutil.copy(source / "capture.toml", to)
    return to


def pictured_capture(plant: PicturedPlant, data: Path, folder: Path) -> Capture:
    """The capture that has the photograph, with its camera in the frame of what the plant was built of.

    Of a plant of photographs alone that is what the build found, withheld photographs included.
    """
    if plant.is_beside:
        (found,) = (data / plant.capture).parent.glob(f"*/images/{plant.photograph}")
        return read_capture(copy_capture(found.parents[1], folder / "beside"))
    if not (folder / "capture" / "cameras").exists():
        (found,) = (folder / "work" / "results").glob("*/withheld/*")
        return read_capture(found)
    return read_capture(folder / "capture")


def plant_window(alpha: NDArray[np.float32]) -> tuple[slice, slice]:
    """Rows and columns of a picture (H, W) that a plant fills, with a margin."""
    rows, columns = (np.flatnonzero((alpha > 0.5).any(axis=axis)) for axis in (1, 0))
    margin = round(MARGIN * max(np.ptp(rows), np.ptp(columns)))
    return (
        slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + margin),
        slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + margin),
    )


def fit_height(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    scale = HEIGHT_PX / picture.shape[0]
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)


if __name__ == "__main__":
    sys.exit(main())
