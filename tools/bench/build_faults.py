#!/usr/bin/env python3
"""What becomes of a build when its processes are killed, disks are full, and files are damaged.

usage: tools/bench/build_faults.py [--kills 20] [--seed 0] [--only NAME …]

Every fault happens to a build of a small synthetic capture by the command line, without branches, crown and
pictures; then the same command runs again. A whole plant with all of these, and a build of poses alone, are killed run
after run until one comes to its end. Checked each time: its messages, its exit code, whether the output is absent or
whole, whether the second run makes the same bytes as a build that nothing happened to, and whether it did anything
again that was done. Disks are small tmpfs, which need root; without it those are left out. Exit 1 if anything is
otherwise than it should be.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from tests.support import textured_scene
from tests.support.plant_captures import write_known_plant
from tests.support.small_builds import digests, spawned_by, write_quick_plan, write_small_capture
from tools.synthetic.scene import SceneSettings
from tools.synthetic_foliage import CaptureSettings, make_capture, write_capture

# A whole plant in a minute.
WHOLE = """
[leaves]
depth = "estimated"
[crown]
size = 64
mesh_size = 17
[pictures]
turntable_frames = 4
turntable_px = 200
comparisons = 2
comparison_px = 240
variant_px = 120
complexity = "low"
[tasks]
photographs_a_task = 2
[capture.depth]
max_side_px = 160
rounds = [{ level = 1, iterations = 1, coherent = false, segments = false },
          { level = 0, iterations = 1, coherent = true, segments = false }]
"""


@dataclass(frozen=True, kw_only=True)
class Given:
    """What all faults happen to."""

    capture: Path
    plan: Path
    truth: Mapping[str, str]  # digests of the asset that should come out
    seconds: float  # that a build takes
    rng: random.Random
    kills: int


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What happened."""

    good: bool
    text: str


def command(capture: Path, plan: Path, folder: Path, *options: str) -> list[str]:
    words = ["build", capture, "-o", folder / "plant", "--plan", plan, "--work", folder / "work"]
    return [sys.executable, "-m", "usdfoliage", *map(str, words), *options]


def run(given: Given, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(given.capture, given.plan, folder, *options), capture_output=True, text=True, check=False
    )


def start(given: Given, folder: Path, *options: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        command(given.capture, given.plan, folder, *options),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def stamps(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in (folder / "work" / "tasks").glob("*.json")}


def judge(given: Given, folder: Path, first: str, before: Mapping[Path, int], again: int, *, codes: str) -> Outcome:
    """How it stands after the second run."""
    after = stamps(folder)
    repeated = sum(after.get(path) != mark for path, mark in before.items())
    same = digests(folder / "plant") == given.truth
    left = [path.name for path in (folder / "work" / "results").glob(".*")]
    left += [path.name for path in folder.glob(".plant.*")]
    good = again == 0 and same and not repeated and not left
    summary = f"{codes}; then exit {again}, {'same bytes' if same else 'OTHER BYTES'}, {repeated} tasks done again"
    return Outcome(good=good, text=f"{summary}{f', left: {left}' if left else ''}{f': {first}' if first else ''}")


def kill_at_random(given: Given, folder: Path) -> Outcome:
    """kill -9 of a build and all its processes, at random moments."""
    bad, finished = [], []
    for number in range(given.kills):
        place = folder / f"{number:02d}"
        process = start(given, place, *(["--jobs", "2"] if number % 2 else []))
        time.sleep(given.rng.uniform(0.3, 1.1) * given.seconds)
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        before = stamps(place)
        whole = not (place / "plant").exists() or digests(place / "plant") == given.truth
        outcome = judge(given, place, "", before, run(given, place).returncode, codes="")
        finished.append(len(before))
        if not (outcome.good and whole):
            bad.append(f"{number}: {outcome.text}{'' if whole else ', HALF AN ASSET'}")
        shutil.rmtree(place)
    summary = f"{given.kills} kills after {min(finished)} to {max(finished)} finished tasks; {len(bad)} went wrong"
    return Outcome(good=not bad, text="; ".join([summary, *bad]))


def write_whole(folder: Path) -> list[str]:
    """A capture with branches, and the command that builds all of it in the folder PLACE."""
    write_known_plant(folder / "plant capture")
    plan = folder / "whole.toml"
    plan.write_text(WHOLE)
    return command(folder / "plant capture", plan, Path("PLACE"))


def placed(words: Sequence[str], place: Path) -> list[str]:
    """A command in a folder."""
    return [word.replace("PLACE", str(place)) for word in words]


def kill_whole(given: Given, folder: Path) -> Outcome:
    """kill -9 of builds with branches, leaves, crown, pictures and report, one after another in one work folder."""
    return _kill_until_done(given, folder, write_whole(folder), "plant")


def kill_poses(given: Given, folder: Path) -> Outcome:
    """The same of a build that estimates poses, and nothing more."""
    photographs = folder / "photographs"
    photographs.mkdir(parents=True)
    for name, pose in textured_scene.arc(10).items():
        cv2.imwrite(str(photographs / name), textured_scene.render(pose))
    words = command(photographs, given.plan, Path("PLACE"), "--only", "poses")
    return _kill_until_done(given, folder, words, "work/results")


def _kill_until_done(given: Given, folder: Path, words: Sequence[str], made: str) -> Outcome:
    """Kill runs of a command at random moments until one ends, again and again; made is what must be the same then."""

    begin = time.perf_counter()
    subprocess.run(placed(words, folder / "truth"), check=True, capture_output=True)
    seconds, truth = time.perf_counter() - begin, digests(folder / "truth" / made)
    kills, bad = 0, list[str]()
    while kills < given.kills and not bad:
        place = folder / f"after {kills}"
        known: dict[Path, int] = {}
        code = None
        while code is None:
            process = subprocess.Popen(
                placed(words, place), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
            )
            try:
                code = process.wait(given.rng.uniform(0.1, 0.8) * seconds)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
                kills += 1
            after = stamps(place)
            bad += [f"{path.name} was done again" for path, mark in known.items() if after.get(path) != mark]
            known = after
        if code != 0 or digests(place / made) != truth:
            bad.append(f"exit {code}, {'same bytes' if digests(place / made) == truth else 'OTHER BYTES'}")
        shutil.rmtree(place)
    summary = f"{kills} kills of builds of {seconds:.0f} s and {len(truth)} files; {len(bad)} went wrong"
    return Outcome(good=not bad, text="; ".join([summary, *bad]))


def kill_parent(given: Given, folder: Path) -> Outcome:
    """kill -9 of the process that has two workers: these must end too."""
    process = start(given, folder, "--jobs", "2")
    while not stamps(folder):
        time.sleep(0.05)
    workers = spawned_by(process.pid)
    process.kill()
    process.communicate()
    time.sleep(2)
    alive = [pid for pid in workers if Path(f"/proc/{pid}").exists()]
    outcome = judge(
        given, folder, "", stamps(folder), run(given, folder).returncode, codes=f"{len(alive)} workers left"
    )
    return Outcome(good=outcome.good and bool(workers) and not alive, text=outcome.text)


def kill_worker(given: Given, folder: Path) -> Outcome:
    """kill -9 of one of two workers."""
    process = start(given, folder, "--jobs", "2")
    while not stamps(folder):
        time.sleep(0.05)
    os.kill(spawned_by(process.pid)[0], signal.SIGKILL)
    _, errors = process.communicate()
    same = digests(folder / "plant") == given.truth
    first_lines = errors.strip().splitlines()[:1]
    text = f"exit {process.returncode}, {'same bytes' if same else 'OTHER BYTES'}: {first_lines}"
    return Outcome(good=process.returncode == 0 and same, text=text)


def fill_disk(given: Given, folder: Path) -> Outcome:
    """A work folder on a disk that is full after each of some sizes; then it grows."""
    disk = folder / "disk"
    disk.mkdir(parents=True)
    mount("-t", "tmpfs", "-o", "size=300k", "tmpfs", str(disk))
    try:
        codes = []
        first = ""
        for size in ("300k", "1500k", "4m"):
            mount("-o", f"remount,size={size}", str(disk))
            ended = run(given, disk)
            codes.append(ended.returncode)
            first = first or last_line(ended.stderr)
            if (disk / "plant").exists():
                return Outcome(good=False, text=f"AN ASSET ON A FULL DISK of {size}")
        before = stamps(disk)
        mount("-o", "remount,size=200m", str(disk))
        outcome = judge(given, disk, first, before, run(given, disk).returncode, codes=f"exits {codes}")
        return Outcome(good=outcome.good and set(codes) == {2}, text=outcome.text)
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def fill_disk_whole(given: Given, folder: Path) -> Outcome:
    """A whole plant on a disk that is full, its folder of temporary files too, and that grows by a little each time."""
    words = write_whole(folder)
    subprocess.run(placed(words, folder / "truth"), check=True, capture_output=True)
    truth = digests(folder / "truth" / "plant")
    needed = sum(path.stat().st_size for path in (folder / "truth").rglob("*") if path.is_file())
    disk = folder / "disk"
    disk.mkdir(parents=True)
    mount("-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk))
    bad, messages, full = [], set[str](), 0
    try:
        for step in range(1, 200):
            mount("-o", f"remount,size={step * needed // 48}", str(disk))
            (disk / "tmp").mkdir(exist_ok=True)
            ended = subprocess.run(
                placed(words, disk),
                capture_output=True,
                text=True,
                check=False,
                env={**os.environ, "TMPDIR": str(disk / "tmp")},
            )
            if ended.returncode == 0:
                break
            full += 1
            messages.add(last_line(ended.stderr))
            if ended.returncode != 2 or "Traceback" in ended.stderr:
                bad.append(f"exit {ended.returncode} at {step} forty-eighths: {last_line(ended.stderr)}")
            if (disk / "plant").exists():
                bad.append(f"AN ASSET ON A FULL DISK at {step} forty-eighths")
        same = digests(disk / "plant") == truth
        summary = f"full {full} times, then exit {ended.returncode}, {'same bytes' if same else 'OTHER BYTES'}"
        return Outcome(good=same and not bad and full > 0, text="; ".join([summary, *bad, *sorted(messages)]))
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def write_protect(given: Given, folder: Path) -> Outcome:
    """An output on a disk that cannot be written; then it can."""
    disk = folder / "disk"
    disk.mkdir(parents=True)
    mount("-t", "tmpfs", "-o", "size=50m,ro", "tmpfs", str(disk))
    (folder / "plant").symlink_to(disk / "plant")
    words = ["build", given.capture, "-o", disk / "plant", "--plan", given.plan, "--work", folder / "work"]
    try:
        call = [sys.executable, "-m", "usdfoliage", *map(str, words)]
        ended = subprocess.run(call, capture_output=True, text=True, check=False)
        before = stamps(folder)
        mount("-o", "remount,rw", str(disk))
        again = subprocess.run(call, capture_output=True, text=True, check=False).returncode
        first = last_line(ended.stderr)
        outcome = judge(given, folder, first, before, again, codes=f"exit {ended.returncode}")
        return Outcome(good=outcome.good and ended.returncode == 2, text=outcome.text)
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def damage(given: Given, folder: Path) -> Outcome:
    """Results that are altered by a byte, cut, and removed, and a stamp with another figure."""

    def alter(path: Path) -> None:
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)

    damages: Mapping[str, Callable[[Path], object]] = {
        "an altered byte": alter,
        "a cut file": lambda path: path.write_bytes(path.read_bytes()[:-10]),
        "a removed file": lambda path: path.unlink(),
    }
    failures, good = [], True
    for what, spoil in damages.items():
        for pattern in ("results/*/capture/*/cloud.ply", "results/*/asset/payload/leaves.usdc", "views/*/depth/*.npz"):
            run(given, folder, "--only", "asset")
            paths = sorted((folder / "work").glob(pattern))
            spoil(given.rng.choice(paths))
            ended = run(given, folder)
            same = digests(folder / "plant") == given.truth
            good &= ended.returncode == 0 and same
            if not same or ended.returncode:
                failures.append(f"{what} of {pattern}: exit {ended.returncode}, {last_line(ended.stderr)}")
            shutil.rmtree(folder)
    run(given, folder, "--only", "asset")
    for path in stamps(folder):
        path.write_text(path.read_text().replace('"seconds": ', '"seconds": 1'))
    same = run(given, folder).returncode == 0 and digests(folder / "plant") == given.truth
    return Outcome(good=good and same, text="; ".join(failures) or "10 damages, each found: exit 0, same bytes")


def meet(given: Given, folder: Path) -> Outcome:
    """Two builds at once of one asset."""
    processes = [start(given, folder) for _ in range(2)]
    texts = [process.communicate() for process in processes]
    codes = [process.returncode for process in processes]
    ran = [line for out, _ in texts for line in out.splitlines() if line.startswith("tasks:")]
    outcome = judge(
        given, folder, " | ".join(ran), stamps(folder), run(given, folder).returncode, codes=f"exits {codes}"
    )
    return Outcome(good=outcome.good and codes == [0, 0], text=outcome.text)


def break_photographs(given: Given, folder: Path) -> Outcome:
    """A capture of which three of ten photographs cannot be read."""
    capture = folder / "broken"
    scene = SceneSettings(leaves=40, views=10, width_px=320, height_px=240)
    write_capture(capture, make_capture(CaptureSettings(scene=scene)))
    photographs = sorted((capture / "images").iterdir())
    photographs[1].write_bytes(b"")
    photographs[4].write_bytes(photographs[4].read_bytes()[:400])
    photographs[8].write_bytes(b"no photograph")
    ended = subprocess.run(command(capture, given.plan, folder), capture_output=True, text=True, check=False)
    warnings = [line for line in ended.stdout.splitlines() if "photographs are left out" in line]
    good = ended.returncode == 0 and any(line.startswith("warning: 3 of 10") for line in warnings)
    return Outcome(good=good, text=f"exit {ended.returncode}: {' '.join(warnings) or last_line(ended.stderr)}")


FAULTS: Mapping[str, Callable[[Given, Path], Outcome]] = {
    "random kills": kill_at_random,
    "kills, whole plant": kill_whole,
    "kills, poses": kill_poses,
    "parent killed": kill_parent,
    "worker killed": kill_worker,
    "disk full": fill_disk,
    "disk full, whole": fill_disk_whole,
    "read-only output": write_protect,
    "damaged results": damage,
    "two runs at once": meet,
    "30 % broken files": break_photographs,
}
NEED_ROOT = ("disk full", "disk full, whole", "read-only output")


def mount(*arguments: str) -> None:
    subprocess.run(["mount", *arguments], check=True)


def last_line(text: str) -> str:
    return (text.strip().splitlines() or [""])[-1]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=list(FAULTS), default=list(FAULTS))
    options = parser.parse_args()
    good = True
    with tempfile.TemporaryDirectory(prefix="build-faults-") as temporary:
        folder = Path(temporary)
        capture, plan = write_small_capture(folder / "capture"), write_quick_plan(folder / "plan.toml")
        begin = time.perf_counter()
        subprocess.run(command(capture, plan, folder / "truth"), check=True, stdout=subprocess.DEVNULL)
        given = Given(
            capture=capture,
            plan=plan,
            truth=digests(folder / "truth" / "plant"),
            seconds=time.perf_counter() - begin,
            rng=random.Random(options.seed),
            kills=options.kills,
        )
        print(f"a build takes {given.seconds:.1f} s and makes {len(given.truth)} files")
        for name in options.only:
            if name in NEED_ROOT and os.geteuid() != 0:
                print(f"{name:<20} left out: it needs root")
                continue
            outcome = FAULTS[name](given, folder / name.replace(" ", "-"))
            good &= outcome.good
            text = outcome.text.replace(str(folder), "…")
            print(f"{name:<20} {'good' if outcome.good else 'BAD '}  {text}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
