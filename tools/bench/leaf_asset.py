#!/usr/bin/env python3
"""Assets of leaves, measured: seconds to write, bytes, seconds to open, peak memory.

usage: tools/bench/leaf_asset.py [-n 100000] [--many 1000000] [--repeat 3] [--representation bezier mesh]

Writes a spray in every representation in a process of its own, and opens each in fresh ones: composed and traversed
with its payload, then with every value read too. Of repeated times the best is printed: other work on the machine
only adds.
Exit 1 if the instancer misses a target.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

TARGETS = {"write s": 2.0, "MB": 16.0, "compose s": 0.3}  # of 100,000 leaves as bezier
TARGET_LEAVES = 100_000
MAX_GIB = 4.0  # of memory, to write a million


def write(out: Path, count: int, representation: str, repeat: int) -> dict[str, float]:
    """Write the same leaves into out, repeat times; in this process."""
    import numpy as np
    from usdfoliage.asset.materials.leaf import LEAF_COLOR
    from usdfoliage.asset.packages.leaf_package import write_leaf_asset
    from usdfoliage.asset.parts.leaf_part import LeafAssetSettings
    from usdfoliage.asset.provenance import Provenance
    from usdfoliage.leaf.shape.spray import scatter_spray
    from usdfoliage.leaf.shape.variation import vary_colors

    rng = np.random.default_rng(0)
    leaves = scatter_spray(count, rng)
    leaves = replace(leaves, color=vary_colors(LEAF_COLOR, count, rng))  # as `usdfoliage scatter` does
    provenance = Provenance(capture="", generator="bench", seed=0, input_sha256="")
    settings = LeafAssetSettings(representations=(representation,))
    out.mkdir()
    wall, cpu = [], []
    for _ in range(repeat):
        start, start_cpu = time.perf_counter(), time.process_time()
        write_leaf_asset(out, "spray", leaves, provenance, settings)
        wall.append(time.perf_counter() - start)
        cpu.append(time.process_time() - start_cpu)
    return {
        "write s": min(wall),
        "write cpu s": min(cpu),
        "MB": sum(path.stat().st_size for path in out.rglob("*") if path.is_file()) / 1e6,
        "peak GiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def open_asset(asset: Path) -> dict[str, float]:
    """Open an asset with its payload, once; in this process."""
    from pxr import Usd, UsdGeom

    UsdGeom.Tokens.points  # noqa: B018  loads the library
    start = time.perf_counter()
    stage = Usd.Stage.Open(str(asset))
    prims = list(stage.Traverse())
    composed = time.perf_counter() - start
    for prim in prims:
        for attribute in prim.GetAuthoredAttributes():
            attribute.Get()
    return {"compose s": composed, "read s": time.perf_counter() - start, "prims": len(prims)}


def in_a_process(*arguments: object) -> dict[str, float]:
    command = [sys.executable, __file__, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"error: {' '.join(command)} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def measure(folder: Path, count: int, representation: str, repeat: int) -> dict[str, float]:
    """One row of the table."""
    out = folder / f"{representation}_{count}"
    row = in_a_process("--write", out, "-n", count, "--representation", representation, "--repeat", repeat)
    opened = [in_a_process("--open", out / "spray.usda") for _ in range(max(repeat, 3))]
    return row | {name: min(times[name] for times in opened) for name in opened[0]}


def print_table(rows: dict[str, dict[str, float]]) -> None:
    columns = list(next(iter(rows.values())))
    print(f"{'':<20}" + "".join(f"{column:>13}" for column in columns))
    for name, row in rows.items():
        print(f"{name:<20}" + "".join(f"{row[column]:13.3f}" for column in columns))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", "--count", type=int, default=TARGET_LEAVES, help="leaves")
    parser.add_argument("--many", type=int, default=1_000_000, help="leaves of the test for memory; 0 for none")
    parser.add_argument("--repeat", type=int, default=3, help="times that each asset is written")
    parser.add_argument("--representation", nargs="*", default=["bezier", "mesh"])
    parser.add_argument("--write", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--open", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.write:
        print(json.dumps(write(options.write, options.count, options.representation[0], options.repeat)))
        return 0
    if options.open:
        print(json.dumps(open_asset(options.open)))
        return 0

    with tempfile.TemporaryDirectory() as folder:
        rows = {
            f"{name} {options.count:,}": measure(Path(folder), options.count, name, options.repeat)
            for name in options.representation
        }
        if options.many:
            rows[f"bezier {options.many:,}"] = measure(Path(folder), options.many, "bezier", 1)
    print_table(rows)
    named = dict(zip(options.representation, rows.values(), strict=False))
    missed = []
    if "bezier" in named:
        for name in named.keys() - {"bezier"}:
            ratios = [f"{column} {named[name][column] / named['bezier'][column]:.1f}" for column in ("MB", "read s")]
            print(f"{name} / bezier: {', '.join(ratios)}")
        if options.count == TARGET_LEAVES:
            missed = [f"{name} above {limit}" for name, limit in TARGETS.items() if named["bezier"][name] > limit]
    if options.many and rows[f"bezier {options.many:,}"]["peak GiB"] > MAX_GIB:
        missed.append(f"peak GiB above {MAX_GIB}")
    print(f"missed: {', '.join(missed)}" if missed else "every target is met")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
