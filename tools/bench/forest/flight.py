#!/usr/bin/env python3
r"""Write the shot of a camera that flies over a forest from its south-west corner to its north-east corner.

usage: tools/bench/forest/flight.py SHOT.usda [--side 320] [--height 40] [--frames 120]

The shot is for usdfoliage forest --camera, and then for tools/bench/forest/popping.py. Over the synthetic forest:

    tools/bench/forest/flight.py out/flight.usda
    usdfoliage forest dem.tif --plants plants.toml --canopy canopy.tif --lod-distance 60 120 \
        --camera out/flight.usda -o out/f
    tools/bench/forest/popping.py out/f out/flight.usda
"""

import argparse
import sys
from pathlib import Path

from tools.bench.forest.scenes import write_flight


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shot", metavar="SHOT", type=Path)
    parser.add_argument("--side", type=float, default=320.0, help="of the ground, in metres")
    parser.add_argument("--height", type=float, default=40.0, help="above the middle of the ground, in metres")
    parser.add_argument("--frames", type=int, default=120)
    options = parser.parse_args()
    corner_m = options.side / 2
    begin_m, end_m = (-corner_m, options.height, corner_m), (corner_m, options.height, -corner_m)
    write_flight(options.shot, begin_m, end_m, (1.0, -0.35, -1.0), options.frames)
    print(f"shot: {options.shot}, {options.frames} frames")
    return 0


if __name__ == "__main__":
    sys.exit(main())
