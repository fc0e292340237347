#!/usr/bin/env python3
"""Leaves out of captures that are spoiled in one way each: fewer may be found, with a warning, but none invented.

usage: tools/bench/bad_captures.py [--build] [--kinds KIND …] [--seed 3] [--leaves 36] [--views 8] [--size 440 330]
       [-o FOLDER]

Each capture is that of tools/synthetic/spoiled.py, without depth, or a scan of a plant with a third of noise. Runs are
those of `usdfoliage leaves` up to the leaves, which are measured as leaf_truth.py does. With --build they are whole
builds, and the leaves are those of the asset that are found or completed by their origin; filled-in ones are counted
apart. A run that ends with an error has found no leaf. Prints a line for each capture, with the codes of its remarks
that a good one has not. Exit 1 where the share of right leaves falls by more than 15 of 100 below that of the good
capture, or where a capture of which much is lost has no remark.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.jobs.leaves.request import LeavesRequest
from usdfoliage.jobs.leaves.run import ESTIMATED, find_capture_leaves
from usdfoliage.jobs.leaves.settings import LeavesRunSettings
from usdfoliage.leaf.model import LeafOrigin, Leaves
from usdfoliage.leaf.reconstruct_cloud import reconstruct_cloud_leaves
from usdfoliage.remarks import Remark

from tools.bench.cloud_leaves import compare_instances
from tools.bench.leaf_truth import (
    TruthSettings,
    read_asset_leaves,
    read_exact_depth,
    read_true_leaves,
    score_leaves,
    visible_shares,
)
from tools.synthetic.scan import ScanSettings
from tools.synthetic.scanned_plants import ScannedPlant, scan_plant
from tools.synthetic.spoiled import KINDS, SMALL, SpoilSettings, spoil_capture, write_spoiled

GOOD, SCANS = "good", ("good scan", "scan, a third noise")
MAX_FALL = 0.15  # of precision, below that of the good capture
OF_ALL = ("depth-estimated", "leaves-in-thinned-cloud")
LOST = 0.25  # of recall, below that of the good capture: so much needs a remark


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a capture gave."""

    kind: str
    visible: int
    found: int
    recall: float
    precision: float
    seconds: float
    remarks: tuple[str, ...]  # codes
    filled_in: int = 0  # leaves of a build that nothing shows


def run_capture(settings: SpoilSettings, folder: Path, threads: int = 0) -> Outcome:
    """Spoil a capture, find its leaves and measure them; its files stay in the folder."""
    write_spoiled(folder, spoil_capture(settings))
    start = time.perf_counter()
    request = LeavesRequest(
        capture=folder, output=folder, name="leaves", settings=LeavesRunSettings(threads=threads), depth=ESTIMATED
    )
    try:
        made = find_capture_leaves(request)
        found, remarks = made.found.leaves, codes_of(made.remarks)
    except CaptureError as error:
        found, remarks = None, (f"error: {error.text}",)
    return _measure(settings, folder, found, remarks, time.perf_counter() - start)


def build_capture(settings: SpoilSettings, folder: Path) -> Outcome:
    """Spoil a capture, build a plant of its photographs and cameras, and measure the leaves of the asset."""
    write_spoiled(folder, spoil_capture(settings))
    (folder / "depth").rename(folder / "truth" / "depth")  # the build is to have photographs alone
    asset = folder.with_name(f"{folder.name}_asset")
    start = time.perf_counter()
    made, remarks = _build(folder, asset)
    seconds = time.perf_counter() - start
    if not made:
        return _measure(settings, folder, None, remarks, seconds)
    try:
        leaves = read_asset_leaves(asset)
    except FoliageError:
        return _measure(settings, folder, None, (*remarks, "error: no leaves"), seconds)
    origin = np.full(len(leaves), LeafOrigin.FOUND) if leaves.origin is None else leaves.origin
    evident = origin <= LeafOrigin.COMPLETED
    outcome = _measure(settings, folder, leaves.take(evident), remarks, seconds)
    return replace(outcome, filled_in=int(np.count_nonzero(~evident)))


def _build(capture: Path, asset: Path) -> tuple[bool, tuple[str, ...]]:
    """Whether `usdfoliage build` wrote an asset, and the codes of its warnings, or its error."""
    command = [sys.executable, "-m", "usdfoliage", "build", str(capture), "-o", str(asset), "--json"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        made = json.loads(run.stdout)
    except ValueError:  # it ended before it could print a result
        return False, (f"error: {run.stderr.strip() or run.returncode}",)
    if made["asset"] is None:
        return False, (f"error: {made['error']}",)
    codes = (each["code"] for each in made["remarks"] if each["severity"] == "warning")
    return True, tuple(dict.fromkeys(code for code in codes if code not in OF_ALL))


def _measure(
    settings: SpoilSettings, folder: Path, found: Leaves | None, remarks: tuple[str, ...], seconds: float
) -> Outcome:
    true = read_true_leaves(folder)
    limits = TruthSettings(visible_within_m=0.06 * settings.scene.length_m)
    best = visible_shares(true, read_exact_depth(folder), limits).max(axis=1)
    if found is None:
        visible = int(np.count_nonzero(best >= limits.visible_share))
        return Outcome(
            kind=settings.kind, visible=visible, found=0, recall=0.0, precision=np.nan, seconds=seconds, remarks=remarks
        )
    scores = score_leaves(true, best, found, limits)
    return Outcome(
        kind=settings.kind,
        visible=scores.visible,
        found=scores.found,
        recall=scores.recall,
        precision=scores.precision,
        seconds=seconds,
        remarks=remarks,
    )


def run_scan(kind: str, clutter: float) -> Outcome:
    """Scan a plant with that share of noise, find its leaves and measure them."""
    plant = ScannedPlant(
        name=kind, kind="ovate", leaves=120, points_a_leaf=250, scan=ScanSettings(clutter=clutter), seed=7
    )
    scan = scan_plant(plant)
    start = time.perf_counter()
    found = reconstruct_cloud_leaves(scan.points_m)
    seconds = time.perf_counter() - start
    visible, judged, recall, precision = compare_instances(found.leaf, scan.leaf)
    return Outcome(
        kind=kind,
        visible=visible,
        found=judged,
        recall=recall,
        precision=precision,
        seconds=seconds,
        remarks=codes_of(found.remarks),
    )


def codes_of(remarks: Sequence[Remark]) -> tuple[str, ...]:
    """The codes of remarks, each once, without those of every capture."""
    return tuple(dict.fromkeys(each.code for each in remarks if each.code not in OF_ALL))


def find_misses(outcomes: Sequence[Outcome]) -> list[str]:
    """What is worse than it may be, in words; the first outcome is that of the good capture."""
    good, *others = outcomes
    misses = []
    for each in others:
        if each.found and each.precision < good.precision - MAX_FALL:
            misses.append(f"{each.kind}: precision {each.precision:.2f}, that of the good one {good.precision:.2f}")
        if each.recall < good.recall - LOST and not each.remarks:
            misses.append(f"{each.kind}: recall {each.recall:.2f} without a remark")
    return misses


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", action="store_true", help="whole builds instead of the leaves alone; no scans")
    parser.add_argument("--kinds", nargs="+", choices=(*KINDS, *SCANS), default=[*KINDS, *SCANS])
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--leaves", type=int, default=SMALL.leaves)
    parser.add_argument("--views", type=int, default=SMALL.views)
    parser.add_argument("--size", type=int, nargs=2, default=[SMALL.width_px, SMALL.height_px], metavar=("W", "H"))
    parser.add_argument("-o", "--output", type=Path, help="folder in which the captures stay")
    options = parser.parse_args()
    scene = replace(
        SMALL,
        seed=options.seed,
        leaves=options.leaves,
        views=options.views,
        width_px=options.size[0],
        height_px=options.size[1],
    )
    print(f"{'capture':22} {'leaves':>6} {'found':>6} {'filled':>6} {'recall':>7} {'precision':>9} {'s':>6}  remarks")
    photographed: list[Outcome] = []
    scanned: list[Outcome] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.output or Path(scratch)
        for kind in options.kinds:
            if kind in SCANS:
                if options.build:
                    continue
                outcome = run_scan(kind, 0.0 if kind == SCANS[0] else 1 / 3)
                scanned.append(outcome)
            else:
                run = build_capture if options.build else run_capture
                outcome = run(SpoilSettings(kind=kind, scene=scene), folder / kind.replace(" ", "_"))
                photographed.append(outcome)
            print(
                f"{outcome.kind:22} {outcome.visible:6} {outcome.found:6} {outcome.filled_in:6} {outcome.recall:7.2f} "
                f"{outcome.precision:9.2f} {outcome.seconds:6.1f}  {', '.join(outcome.remarks) or 'none'}",
                flush=True,
            )
    misses = [miss for outcomes in (photographed, scanned) if outcomes for miss in find_misses(outcomes)]
    for miss in misses:
        print(f"missed: {miss}")
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())
