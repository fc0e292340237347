#!/usr/bin/env python3
"""How long a build takes with one worker and with two, and how long a library takes to plan.

usage: tools/bench/build_scaling.py [--captures 1] [--views 8] [--size 320 240] [--work FOLDER]
       tools/bench/build_scaling.py --plan-only 1000      plans so many captures of 40 photographs

The same captures are built anew in this process, by two local processes, and by two Dask workers, each task with one
thread. Asked of the results: the same bytes each time.
"""

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

from usdfoliage.__main__ import main as usdfoliage
from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.executor_choice import ExecutorChoice
from usdfoliage.jobs.plant.run import build_plants
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.settings_file import read_settings_file

from tests.support.dask_clusters import dask_cluster
from tools.synthetic.scene import SceneSettings
from tools.synthetic_foliage import CaptureSettings, make_capture, write_capture

PLAN = """
[branches]
make = "off"
[crown]
make = false
[pictures]
make = false
[tasks]
photographs_a_task = 1
"""
PHOTOGRAPHS = 40


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=int, default=1, help="a library of so many, each of its own seed")
    parser.add_argument("--views", type=int, default=8)
    parser.add_argument("--size", type=int, nargs=2, default=[320, 240], metavar=("W", "H"))
    parser.add_argument("--work", type=Path, help="kept; else a temporary folder")
    parser.add_argument("--plan-only", type=int, metavar="N", help="only plan so many captures")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="build-scaling-") as temporary:
        folder = options.work or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        if options.plan_only is not None:
            return time_planning(folder, options.plan_only)
        return time_building(folder, options.captures, options.views, *options.size)


def time_planning(folder: Path, count: int) -> int:
    """Print how long a dry run of a library of tiny files takes."""
    library = folder / "library"
    for number in range(count):
        images = library / f"plant{number:04d}" / "images"
        images.mkdir(parents=True, exist_ok=True)
        for photograph in range(PHOTOGRAPHS):
            (images / f"{photograph:03d}.jpg").write_bytes(b"%d %d" % (number, photograph))
    start = time.perf_counter()
    code = usdfoliage(["batch", str(library), "-o", str(folder / "out"), "--dry-run"])
    seconds = time.perf_counter() - start
    print(f"planning: {seconds:.2f} s for {count:,} captures of {PHOTOGRAPHS} photographs")
    return code


def time_building(folder: Path, captures: int, views: int, width_px: int, height_px: int) -> int:
    """Print how long the same builds take on each executor."""
    plan = folder / "plan.toml"
    given = [folder / f"capture{number}" for number in range(captures)]
    for seed, capture in enumerate(given):
        scene = SceneSettings(leaves=40, views=views, width_px=width_px, height_px=height_px, seed=seed)
        write_capture(capture, make_capture(CaptureSettings(scene=scene)))
    plan.write_text(PLAN)
    settings = read_settings_file(plan, BuildSettings())
    seconds: dict[str, float] = {}
    made: dict[str, dict[str, bytes]] = {}

    def build(what: str, where: ExecutorChoice) -> None:
        library = folder / what.replace(" ", "-")
        requests = [
            BuildRequest(
                capture=capture,
                output=library / capture.name,
                name="plant",
                settings=settings,
                work=library / "work",
            )
            for capture in given
        ]
        start = time.perf_counter()
        plants = [plant for _, plant in build_plants(requests, where)]
        seconds[what] = time.perf_counter() - start
        for plant in plants:
            if plant.asset is None:
                sys.exit(f"{what}: {plant.error or f'{plant.errors} errors'}")
        made[what] = {
            path.relative_to(library).as_posix(): path.read_bytes()
            for request in requests
            for path in sorted(request.output.rglob("*"))
            if path.is_file() and path.name != "timings.js"
        }
        shutil.rmtree(library)

    build("this process", ExecutorChoice(threads=1))
    build("2 processes", ExecutorChoice(jobs=2, threads=1))
    with dask_cluster(folder) as cluster:
        build("2 Dask workers", ExecutorChoice(scheduler=cluster.address, threads=1))
    first = next(iter(made))
    for what, taken_s in seconds.items():
        same = "the same bytes" if made[what] == made[first] else "OTHER BYTES"
        print(f"{what:<16} {taken_s:7.1f} s   {seconds[first] / taken_s:5.2f} times as fast   {same}")
    return 0 if all(each == made[first] for each in made.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
