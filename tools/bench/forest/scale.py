#!/usr/bin/env python3
"""A large forest: how long it takes to plant, to write in tiles, and to open with and without its payloads.

usage: tools/bench/forest/scale.py CROWN [--plants 1000000] [--side 10000] [--tile 1000] [--jobs N] [-o FOLDER]

CROWN is the asset of all plants. The ground is made of waves, with a height every 10 m; the trunks are given, so that
what is measured is reading them, choosing species and sizes, and writing. 100,000 plants in one piece: --tile 0. With
--jobs the forest is made of tasks in so many processes; without, in one process and without a work folder.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from pxr import Usd

from tools.bench.forest.scenes import write_inputs

CELL_M = 10.0


def write_waves(folder: Path, crown: Path, plants: int, side_m: float) -> list[str]:
    """The inputs of a forest of two species on waves; returns the arguments of usdfoliage forest."""
    cells = int(side_m / CELL_M)
    row, column = np.mgrid[:cells, :cells]
    heights = 300 + 60 * np.sin(column / 37) * np.cos(row / 29) + 15 * np.sin((row + 2 * column) / 11)
    return write_inputs(folder, crown, [("oak", 0.6, 8, 18), ("pine", 0.4, 10, 24)], heights, CELL_M, plants)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("crown", metavar="CROWN", type=Path)
    parser.add_argument("--plants", type=int, default=1_000_000)
    parser.add_argument("--side", type=float, default=10_000.0)
    parser.add_argument("--tile", type=float, default=1000.0, help="0 for a forest in one piece")
    parser.add_argument("--jobs", type=int, help="processes that do tasks; 1: this one, with a work folder")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.output or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        words = write_waves(folder, options.crown, options.plants, options.side)
        words += ["--tile", f"{options.tile:g}"] if options.tile else []
        if options.jobs is not None:
            words += ["--work", str(folder / "work"), "--jobs", str(options.jobs)]
        forest = folder / "forest"
        started = time.perf_counter()
        command = [sys.executable, "-m", "usdfoliage", "forest", *words, "-o", str(forest), "--no-preview", "--force"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        seconds = time.perf_counter() - started
        if done.returncode:
            raise SystemExit(done.stderr)
        layers = list(forest.rglob("*.usd*"))
        plants = [each for each in layers if each.name.startswith("plants_")]
        levels = len({each.name for each in plants})
        print(f"whole command: {seconds:.1f} s, {options.plants:,} plants in {levels} levels, {len(layers):,} layers")
        print(f"layers of plants, of one level: {sum(each.stat().st_size for each in plants) / levels / 1e6:.1f} MB")
        timings = (forest / "report" / "timings.js").read_text(encoding="utf-8")
        for stage in json.loads(timings[timings.index("(") + 1 : timings.rindex(")")])["stages"]:
            print(f"{stage['stage']}: {stage['seconds']:.1f} s")
        interface = str(forest / "forest.usda")
        for what, load in (("without payloads", Usd.Stage.LoadNone), ("with payloads", Usd.Stage.LoadAll)):
            started = time.perf_counter()
            stage = Usd.Stage.Open(interface, load)
            prims = sum(1 for _ in stage.TraverseAll())
            print(f"opened {what}: {time.perf_counter() - started:.2f} s, {prims:,} prims")
            del stage
    return 0


if __name__ == "__main__":
    sys.exit(main())
