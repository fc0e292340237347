#!/usr/bin/env python3
"""Make a scan without classes of a forest's rasters, and measure the ground that is found in it.

    python tools/bench/forest/scan.py FOREST -o scan.las
    usdfoliage forest scan.las --plants FOREST/plants.toml --orthophoto FOREST/orthophoto.tif -o forests/scan

FOREST has dem.tif, canopy_height.tif and plants.toml, with all rasters in one frame in metres.
"""

import argparse
import time
from pathlib import Path

import laspy
import numpy as np
from laspy.vlrs.known import WktCoordinateSystemVlr
from usdfoliage.forest.raster import Raster, pixel_grid, sample_bilinear, sample_nearest, to_ground
from usdfoliage.forest.raster_files import read_raster
from usdfoliage.jobs.forest.inputs import ForestFiles, read_forest

GROUND_SHARE, TOP_SHARE = 0.15, 0.65  # of the points over a crown; the others lie within it
LOWEST_SHARE = 0.35  # of a crown's height, from which it has points
NOISE_M = 0.04
CROWN_M = 0.3  # height from which a pixel is under a crown


def make_scan(dem: Raster, canopy: Raster, density: float, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) easting, northing and height of points, so many on a square metre."""
    rows, columns = dem.values.shape
    count = int(density * rows * columns * dem.cell_m**2)
    plan_m = to_ground(dem, rng.uniform(0, 1, (count, 2)) * [columns, rows])
    top_m = np.nan_to_num(sample_nearest(canopy, plan_m))
    draw = rng.random(count)
    share = np.where(draw < GROUND_SHARE + TOP_SHARE, 1.0, rng.uniform(LOWEST_SHARE, 1, count))
    up_m = np.where((draw < GROUND_SHARE) | (top_m < CROWN_M), 0.0, share * top_m)
    return np.column_stack([plan_m, sample_bilinear(dem, plan_m) + up_m + rng.normal(0, NOISE_M, count)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("forest", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--density", type=float, default=12.0, help="points on a square metre")
    options = parser.parse_args()
    dem = read_raster(options.forest / "dem.tif", "the DEM").raster
    canopy = read_raster(options.forest / "canopy_height.tif", "the canopy height").raster
    points_m = make_scan(dem, canopy, options.density, np.random.default_rng(0))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(points_m.min(axis=0))
    header.vlrs.append(WktCoordinateSystemVlr(dem.crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points_m.T
    las.write(options.output)
    started = time.perf_counter()
    found = read_forest(ForestFiles(dem=options.output, plants=options.forest / "plants.toml")).planted.terrain.heights
    seconds = time.perf_counter() - started
    places_m = pixel_grid(found).reshape(-1, 2)
    error_m = found.values.reshape(-1) - sample_bilinear(dem, places_m)
    under = np.nan_to_num(sample_nearest(canopy, places_m)) >= CROWN_M
    named = (("all", slice(None)), ("open", ~under), ("under crowns", under))
    rms = ", ".join(f"{name} {np.sqrt(np.mean(error_m[chosen] ** 2)):.3f} m" for name, chosen in named)
    print(f"{len(points_m):,} points, {seconds:.1f} s; error of the ground, root mean square: {rms}")


if __name__ == "__main__":
    main()
