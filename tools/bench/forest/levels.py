#!/usr/bin/env python3
"""The thesis' table 7.2: what a forest costs to open and to draw, by the distance at which plants change their level.

usage: tools/bench/forest/levels.py CROWN [--plants 27424] [--side 1500] [--distances 50 100 200] [--frames 4] [--mesh]

CROWN is the asset of all plants, which stand at random on a ground of waves; a camera flies over it. For each level of
all plants, and for shots that change from leaves to relief at each distance: seconds of a picture after the first one,
and by how much more memory the process that draws needs than for the ground alone. Meshes (--mesh) take minutes a
picture without a GPU.
"""

import argparse
import multiprocessing
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.packages.forest_package import LEVEL
from usdfoliage.asset.shot_camera import read_shot_camera
from usdfoliage.jobs.forest.report import pinhole_of
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views

from tools.bench.forest.scenes import write_flight, write_inputs

CELL_M = 5.0


def write_ridge(folder: Path, crown: Path, plants: int, side_m: float) -> list[str]:
    """The inputs of a forest on a ridge; returns the arguments of usdfoliage forest."""
    cells = int(side_m / CELL_M)
    row, column = np.mgrid[:cells, :cells]
    heights = 300 + 0.12 * side_m * np.exp(-np.square((row - 0.4 * cells) / (0.2 * cells))) + 8 * np.sin(column / 9)
    return write_inputs(folder, crown, [("oak", 1, 5, 12)], heights, CELL_M, plants)


def fly_over_ridge(path: Path, side_m: float, frames: int) -> Path:
    """A camera that flies to the north."""
    height_m = 0.16 * side_m
    return write_flight(path, (0, height_m, 0.5 * side_m), (0, height_m, 0), (0.1, -0.35, -1), frames)


def draw(interface: str, shot: str, level: str | None, width_px: int) -> tuple[float, float, int]:
    """Seconds to open, seconds of a picture after the first, and bytes of the process that draws."""
    started = time.perf_counter()
    stage = Usd.Stage.Open(interface)
    if level is not None:
        stage.GetDefaultPrim().GetVariantSet(LEVEL).SetVariantSelection(level)
    open_s = time.perf_counter() - started
    path = read_shot_camera(Path(shot)).path
    with tempfile.TemporaryDirectory() as folder:
        views = [
            PreviewView(
                output=Path(folder) / f"{number}.png",
                pinhole=pinhole_of(path, number, width_px),
                frame=float(frame),
                variants=() if level is None else ((LEVEL, level),),
            )
            for number, frame in enumerate(path.frame)
        ]
        times: list[float] = []
        settings = PreviewSettings(purposes=("default", "render", "proxy"), complexity="low", samples=1)
        draw_views(Path(interface), views, settings, lambda _done, _count: times.append(time.perf_counter()))
    picture_s = (times[-1] - times[0]) / max(len(times) - 1, 1)
    return open_s, picture_s, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024


def in_own_process(*words) -> tuple[float, float, int]:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as one:
        return one.submit(draw, *words).result()


def write_bare(interface: Path) -> Path:
    """The forest without its plants."""
    bare = interface.with_name("bare.usda")
    layer = Sdf.Layer.CreateNew(str(bare))
    layer.subLayerPaths.append(f"./{interface.name}")
    stage = Usd.Stage.Open(layer)
    name = interface.stem
    stage.OverridePrim(f"/{name}/plants").SetActive(False)
    stage.SetDefaultPrim(stage.OverridePrim(f"/{name}"))
    layer.Save()
    return bare


def count_plants(interface: Path, level: str, frame: float) -> str:
    """How many plants each instancer draws at a frame."""
    stage = Usd.Stage.Open(str(interface))
    stage.GetDefaultPrim().GetVariantSet(LEVEL).SetVariantSelection(level)
    counts = []
    for prim in stage.Traverse():
        if prim.HasAPI("FoliageForestAPI"):
            instancer = UsdGeom.PointInstancer(prim)
            hidden = instancer.GetInvisibleIdsAttr().Get(frame) or ()
            counts.append(f"{len(instancer.GetIdsAttr().Get()) - len(hidden):,} {prim.GetName()}")
    return ", ".join(counts)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("crown", metavar="CROWN", type=Path)
    parser.add_argument("--plants", type=int, default=27_424, help="as in the thesis")
    parser.add_argument("--side", type=float, default=1500.0, help="of the ground, in metres")
    parser.add_argument("--distances", type=float, nargs="+", default=[50.0, 100.0, 200.0])
    parser.add_argument("--frames", type=int, default=4)
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--mesh", action="store_true", help="draw all plants as meshes, too")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        words = write_ridge(folder, options.crown, options.plants, options.side)
        rows: list[tuple[str, Path, str]] = []
        for distance in options.distances:
            shot = fly_over_ridge(folder / f"shot_{distance:g}.usda", options.side, options.frames)
            forest = folder / f"forest_{distance:g}"
            limits = ["--lod-distance", f"{distance:g}", f"{distance:g}", "--camera", str(shot), "--no-preview"]
            subprocess.run(
                [sys.executable, "-m", "usdfoliage", "forest", *words, *limits, "-o", str(forest)],
                check=True,
                stdout=subprocess.DEVNULL,
            )
            rows.append((f"leaves to {distance:g} m", forest / f"{forest.name}.usda", shot.stem))
        interface = rows[0][1]
        shot_file = str(folder / f"shot_{options.distances[0]:g}.usda")
        forms = ["relief", *(["crown"] if options.mesh else [])]
        rows += [(f"all as {form}", interface, form) for form in forms]
        _, bare_s, bare_bytes = in_own_process(str(write_bare(interface)), shot_file, None, options.width)
        print(f"the ground alone: {bare_s:.2f} s a picture, {bare_bytes / 1e6:.0f} MB\n")
        print("| plants | drawn in the middle frame | open s | s a picture | MB more than the ground |")
        print("| --- | --- | --- | --- | --- |", flush=True)
        for name, file, level in rows:
            open_s, picture_s, peak = in_own_process(str(file), shot_file, level, options.width)
            middle = count_plants(file, level, 1 + options.frames // 2)
            print(
                f"| {name} | {middle} | {open_s:.2f} | {picture_s:.2f} | {(peak - bare_bytes) / 1e6:.0f} |", flush=True
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
