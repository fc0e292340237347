#!/usr/bin/env python3
"""Leaves out of captures, measured against the true ones: what is found, how near it is, how long it takes.

usage: tools/bench/leaves.py [--captures FOLDER …] [--depths depth depth_noisy estimated] [--methods dense paper]
       tools/bench/leaves.py --scales      the capture in a tenth and ten times its size gives the same leaves
       tools/bench/leaves.py --scaling     cost at 1, 4 and 16 times as many leaves and views

Every run is that of `usdfoliage leaves`, asset and report included but without pictures by Storm, in a process of its
own, so that the peak memory is its own. Measures are those of leaf_truth.py, on the asset as it was written.
Without --captures ../shared/data/synthetic/dense_foliage is used, or where that is absent one of our own making
(tools/synthetic_foliage.py). Exit 1 if the method dense misses a target.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tools.bench.leaf_truth import (
    Scores,
    TruthSettings,
    read_asset_leaves,
    read_exact_depth,
    read_true_leaves,
    score_leaves,
    visible_shares,
)
from tools.synthetic.scaled import scale_capture
from tools.synthetic.scene import SceneSettings
from tools.synthetic_foliage import CaptureSettings, make_capture, write_capture

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SHARED_CAPTURE = Path("synthetic") / "dense_foliage"
DEPTHS, METHODS = ("depth", "depth_noisy"), ("dense", "paper")
ESTIMATED = "estimated"  # depth that usdfoliage leaves computes from the photographs

LIMIT_PIXELS = 10 * 1200 * 900  # of all views, that MAX_SECONDS is for
MAX_SECONDS, MAX_GIB = 60.0, 3.0
FACTORS = (0.1, 10.0)
SAME_SHARE, SAME_PERCENT = 0.01, 0.1  # of recall and precision, of the distance: how far they may move with the size
TIMES = (1, 4, 16)
BASE_LEAVES, BASE_VIEWS, BASE_SIZE = 60, 3, (640, 480)  # of the smallest capture of --scaling
MAX_GROWTH = 1.5  # of the cost of a view or a leaf, from 1 to 16 times as many


@dataclass(frozen=True, kw_only=True)
class Targets:
    """What the method dense must reach with one kind of depth."""

    recall: float
    precision: float
    distance_percent: float
    half_hidden_length_error: float = 0.15
    axis_error_deg: float = 8.0
    base_right: float = 0.8

    def missed(self, scores: Scores) -> list[str]:
        """What was not reached, in words; NaN is not."""
        floors, ceilings = ("recall", "precision", "base_right"), ("distance_percent", "axis_error_deg")
        checks = [(name, getattr(scores, name) >= getattr(self, name), "below") for name in floors]
        checks += [(name, getattr(scores, name) <= getattr(self, name), "above") for name in ceilings]
        name = "half_hidden_length_error"
        checks.append((name, scores.half_hidden == 0 or getattr(scores, name) <= getattr(self, name), "above"))
        return [
            f"{name} {getattr(scores, name):.3g} {side} {getattr(self, name):g}"
            for name, met, side in checks
            if not met
        ]


TARGETS: Mapping[str, Targets] = {
    "depth": Targets(recall=0.92, precision=0.93, distance_percent=3.0),
    "depth_noisy": Targets(recall=0.80, precision=0.88, distance_percent=4.0),
}


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run."""

    capture: Path
    depth: str = "depth"
    method: str = "dense"
    visible_within_m: float = TruthSettings().visible_within_m
    threads: int = 0


@dataclass(frozen=True, kw_only=True)
class Result:
    """What a run gave and took."""

    scores: Scores
    seconds: Mapping[str, float]  # by stage
    cpu_seconds: Mapping[str, float]  # likewise, of all threads
    peak_gib: float
    views: int
    pixels: int  # of all views

    @property
    def wall_s(self) -> float:
        return sum(self.seconds.values())


class StageClock:
    """Seconds by stage, from a job's progress, which names the stage that runs."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}
        self._stage = "start"
        self._since = time.perf_counter(), time.process_time()

    def __call__(self, stage: str, share: float) -> None:
        if stage != self._stage:
            self.stop()
            self._stage = stage

    def stop(self) -> None:
        """Count the stage that runs up to now."""
        now = time.perf_counter(), time.process_time()
        for spent, end, begin in zip((self.seconds, self.cpu_seconds), now, self._since, strict=True):
            spent[self._stage] = spent.get(self._stage, 0.0) + end - begin
        self._since = now


def make_asset(case: Case, output: Path, progress: Callable[[str, float], None]) -> None:
    """Write what the product makes of a case's capture as an asset, output."""
    from usdfoliage.jobs.leaves.request import LeavesRequest
    from usdfoliage.jobs.leaves.run import make_leaves_asset
    from usdfoliage.jobs.leaves.settings import LeavesRunSettings
    from usdfoliage.jobs.work.settings_file import set_everywhere

    settings = set_everywhere(LeavesRunSettings(method=case.method), "threads", case.threads)
    request = LeavesRequest(
        capture=case.capture, output=output, name="leaves", settings=settings, depth=case.depth, preview=False
    )
    make_leaves_asset(request, progress)


def run_case(case: Case, make: Callable[[Case, Path, Callable[[str, float], None]], None] = make_asset) -> Result:
    """Make the asset of a case and measure it; in this process."""
    with tempfile.TemporaryDirectory() as folder:
        asset, clock = Path(folder) / "leaves", StageClock()
        make(case, asset, clock)
        clock.stop()
        peak_gib = read_peak_gib()
        leaves = read_asset_leaves(asset)
    true, views = read_true_leaves(case.capture), read_exact_depth(case.capture)
    settings = TruthSettings(visible_within_m=case.visible_within_m)
    return Result(
        scores=score_leaves(true, visible_shares(true, views, settings).max(axis=1), leaves, settings),
        seconds=clock.seconds,
        cpu_seconds=clock.cpu_seconds,
        peak_gib=peak_gib,
        views=len(views),
        pixels=sum(depth_m.size for _, depth_m in views),
    )


def read_peak_gib() -> float:
    """The most memory this process had, in GiB; by getrusage a new process has had what its parent had."""
    status = Path("/proc/self/status")
    if status.is_file():
        kib = next(line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(kib) / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def run_in_a_process(case: Case) -> Result:
    """run_case in a process of its own; its words are ours, and an error ends the benchmark."""
    case_json = json.dumps(asdict(case), default=str)
    done = subprocess.run([sys.executable, __file__, "--case", case_json], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"error: {case.capture.name}, {case.depth}, {case.method} failed:\n{done.stderr}")
    read = json.loads(done.stdout.splitlines()[-1])
    return Result(**{**read, "scores": Scores(**read["scores"])})


COLUMNS: Mapping[str, Callable[[Result], str]] = {
    "true": lambda result: f"{result.scores.visible}",
    "found": lambda result: f"{result.scores.found}",
    "recall": lambda result: f"{result.scores.recall:.3f}",
    "precision": lambda result: f"{result.scores.precision:.3f}",
    "F1": lambda result: f"{result.scores.f1:.3f}",
    "mm": lambda result: f"{result.scores.distance_mm:.2f}",
    "%": lambda result: f"{result.scores.distance_percent:.2f}",
    "axis °": lambda result: f"{result.scores.axis_error_deg:.1f}",
    "base": lambda result: f"{result.scores.base_right:.2f}",
    "length": lambda result: f"{100 * result.scores.length_error:.1f} %",
    "half hidden": lambda result: f"{100 * result.scores.half_hidden_length_error:.1f} %",
    "twice": lambda result: f"{result.scores.duplicates}",
    "poor": lambda result: f"{result.scores.poor}",
    "s": lambda result: f"{result.wall_s:.1f}",
    "cpu s": lambda result: f"{sum(result.cpu_seconds.values()):.1f}",
    "GiB": lambda result: f"{result.peak_gib:.2f}",
}


WIDTHS = {head: max(len(head), 6) + 2 for head in COLUMNS}


def print_head(names: Sequence[str]) -> int:
    """The line over the runs of these names; returns how wide the names are."""
    width = max(map(len, names)) + 2
    print(" " * width + "".join(head.rjust(WIDTHS[head]) for head in COLUMNS), flush=True)
    return width


def print_result(name: str, width: int, result: Result) -> None:
    """The line of a run."""
    cells = (column(result).rjust(WIDTHS[head]) for head, column in COLUMNS.items())
    print(name.ljust(width) + "".join(cells), flush=True)


def print_stages(rows: Sequence[tuple[str, Result]]) -> None:
    """What runs took by stage, a table of its own."""
    names = [*(name for name, _ in rows), "cpu s (s)"]
    width = max(map(len, names)) + 2
    stages = list(dict.fromkeys(stage for _, result in rows for stage in result.seconds))
    print("\n" + names[-1].ljust(width) + "".join(stage.rjust(max(len(stage), 13) + 2) for stage in stages))
    for name, result in rows:
        each, found = name.ljust(width), max(result.scores.found, 1)
        ms = "  ms a leaf".ljust(width)
        for stage in stages:
            wide = max(len(stage), 13) + 2
            seconds, cpu_s = result.seconds.get(stage, 0.0), result.cpu_seconds.get(stage, 0.0)
            each += f"{cpu_s:.2f} ({seconds:.2f})".rjust(wide)
            ms += f"{1000 * cpu_s / found:.2f} ({1000 * seconds / found:.2f})".rjust(wide)
        print(f"{each}\n{ms}", flush=True)


def check_result(name: str, case: Case, result: Result) -> list[str]:
    """The targets that a run missed."""
    max_s = MAX_SECONDS * max(1.0, result.pixels / LIMIT_PIXELS)
    missed = TARGETS[case.depth].missed(result.scores) if case.depth in TARGETS else []
    if result.wall_s > max_s:
        missed.append(f"{result.wall_s:.1f} s above {max_s:g}")
    if result.peak_gib > MAX_GIB:
        missed.append(f"{result.peak_gib:.2f} GiB above {MAX_GIB:g}")
    return [f"{name}: {miss}" for miss in missed]


def bench_captures(captures: Sequence[Path], options: argparse.Namespace) -> list[str]:
    """Every capture with every depth and method."""
    cases = [
        Case(
            capture=capture,
            depth=depth,
            method=method,
            visible_within_m=options.visible_within,
            threads=options.threads,
        )
        for capture in captures
        for depth in options.depths
        for method in options.methods
        if depth == ESTIMATED or (capture / depth).is_dir()
    ]
    if not cases:
        sys.exit(f"error: no capture has {' or '.join(options.depths)}")
    names = [f"{case.capture.name} {case.depth} {case.method}" for case in cases]
    rows, missed = [], []
    width = print_head(names)
    for name, case in zip(names, cases, strict=True):
        rows.append((name, run_in_a_process(case)))
        print_result(name, width, rows[-1][1])
        if case.method == "dense":
            missed += check_result(name, case, rows[-1][1])
    print_stages(rows)
    return missed


def bench_scales(capture: Path, work: Path, options: argparse.Namespace) -> list[str]:
    """One capture in other sizes; with the first depth and method asked for."""
    depth, method, within_m = options.depths[0], options.methods[0], options.visible_within
    case = Case(capture=capture, depth=depth, method=method, visible_within_m=within_m, threads=options.threads)
    print(f"{capture.name}, {depth}, {method}, scaled")
    width = print_head(["× 0.1"])
    rows = [("× 1", run_in_a_process(case))]
    print_result(rows[0][0], width, rows[0][1])
    for factor in FACTORS:
        scaled = work / f"{capture.name}_x{factor:g}"
        scale_capture(capture, scaled, factor)
        case = Case(
            capture=scaled, depth=depth, method=method, visible_within_m=within_m * factor, threads=options.threads
        )
        rows.append((f"× {factor:g}", run_in_a_process(case)))
        print_result(rows[-1][0], width, rows[-1][1])
    print_stages(rows)
    missed = []
    first = rows[0][1].scores
    for name, result in rows[1:]:
        for measure, limit in (("recall", SAME_SHARE), ("precision", SAME_SHARE), ("distance_percent", SAME_PERCENT)):
            change = getattr(result.scores, measure) - getattr(first, measure)
            if not abs(change) <= limit:
                missed.append(f"{name}: {measure} moves by {change:+.3f}, at most {limit:g} is the same")
    return missed


def bench_scaling(work: Path, options: argparse.Namespace) -> list[str]:
    """Beds of growing length with as many more views, then more views of the same bed."""
    missed = []
    for title, more_leaves in (("leaves and views", True), ("views alone", False)):
        costs = []
        print(
            f"{title}: 1 × is {BASE_LEAVES} leaves in {BASE_VIEWS} views of {BASE_SIZE[0]} × {BASE_SIZE[1]}\n"
            f"{'':<6}{'leaves':>8}{'found':>7}{'views':>7}{'s':>9}{'s a view':>10}{'ms a leaf':>11}{'cpu s':>9}"
            f"{'GiB':>7}   seconds by stage"
        )
        for times in TIMES:
            scene = SceneSettings(
                leaves=BASE_LEAVES * (times if more_leaves else 1),
                views=BASE_VIEWS * times,
                width_px=BASE_SIZE[0],
                height_px=BASE_SIZE[1],
                framed_leaves=BASE_LEAVES,
            )
            capture = work / f"{title.split()[-1]}_{times}"
            write_capture(capture, make_capture(CaptureSettings(scene=scene, samples=1)))
            result = run_in_a_process(
                Case(capture=capture, depth=options.depths[0], method=options.methods[0], threads=options.threads)
            )
            stages = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in result.seconds.items())
            cpu_s = sum(result.cpu_seconds.values())
            costs.append(cpu_s / times)
            print(
                f"{times:>3} × {scene.leaves:>8}{result.scores.found:>7}{scene.views:>7}{result.wall_s:>9.2f}"
                f"{result.wall_s / scene.views:>10.3f}{1000 * result.wall_s / max(result.scores.found, 1):>11.1f}"
                f"{cpu_s:>9.2f}{result.peak_gib:>7.2f}   {stages}",
                flush=True,
            )
        growth = costs[-1] / costs[0]
        if growth > MAX_GROWTH:
            missed.append(f"{title}: {TIMES[-1]} × costs {growth:.2f} × as much for each, at most {MAX_GROWTH:g}")
    return missed


def find_captures(options: argparse.Namespace, work: Path) -> list[Path]:
    """Those asked for, the shared one, or one of our own."""
    if options.captures:
        return list(options.captures)
    shared = options.data / SHARED_CAPTURE
    if shared.is_dir():
        return [shared]
    print(f"{shared} is absent: a capture of our own is measured", flush=True)
    write_capture(work / "synthetic_foliage", make_capture())
    return [work / "synthetic_foliage"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=Path, nargs="+", metavar="FOLDER", help="with truth/ and exact depth/")
    parser.add_argument("--data", type=Path, default=DATA, help="where the shared capture is looked for")
    parser.add_argument("--depths", nargs="+", default=list(DEPTHS), help=f"folders; {ESTIMATED}: of photographs alone")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--scales", action="store_true", help="compare the first capture with itself in other sizes")
    parser.add_argument("--scaling", action="store_true", help="print the cost of more leaves and views")
    parser.add_argument("--threads", type=int, default=0, help="0: all cores")
    parser.add_argument(
        "--visible-within",
        type=float,
        default=TruthSettings().visible_within_m,
        metavar="M",
        help="of the depth, for a true point to be seen; for leaves of some 70 mm",
    )
    parser.add_argument("--case", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        given = json.loads(options.case)
        print(json.dumps(asdict(run_case(Case(**{**given, "capture": Path(given["capture"])})))))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        if options.scaling:
            missed = bench_scaling(work, options)
        else:
            captures = find_captures(options, work)
            missed = bench_scales(captures[0], work, options) if options.scales else bench_captures(captures, options)
    for miss in missed:
        print(f"target missed: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
