#!/usr/bin/env python3
"""Every command that writes, killed at random moments, alone, with its children, or through one of these.

usage: tools/bench/kills.py [--kills 100] [--seed 0] [--only NAME …] [--lanes N] [-o FOLDER]

A command works on small input in a folder of its own, on top of an earlier result or of none. It gets SIGKILL, SIGTERM
or SIGINT, or one of its children does; three times in one folder, and then it runs to its end. Checked after every
kill: its output is absent, the old one or the new one, whole; its input is unchanged; no child is left; what it printed
has no traceback, and is one line where it failed. Checked at the end: exit 0, the bytes of a run that nothing happened
to, and no other file anywhere. Prints a line for every command; the folders of what went wrong are kept below FOLDER
(out/kills). Exit 1 if anything did.
"""

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

from tools.fuzz.killing import Process, descendants, end_child
from tools.fuzz.writing import INPUT, SUBJECTS, Subject, write_input

KILLS_A_ROUND = 3
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
VICTIMS = ("command", "all", "child", "child")
TEMPORARY = "tmp"
_LIMIT_S = 600.0
_ENDING_S = 20.0  # for children to end after their parent; the machine may be busy
_WHILE_BUILT = "index.html"  # of a library: it shows which plants are built so far
_POOR = "no pictures of the asset"  # a child was killed that draws: a result without, which the next run completes

_KNOWN = re.compile(r"^error: |^WARNING: |\d% done in \d|^warning: ")  # errors, warnings, and progress in no terminal

Tree = Mapping[str, str]  # digests of files by their path


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """What a command makes when nothing happens to it."""

    new: Tree
    old: Tree
    earlier: Path  # where the old result lies
    seconds: float


@dataclass(kw_only=True)
class Tally:
    """What happened to a command."""

    kills: Counter[str] = field(default_factory=Counter)
    states: Counter[str] = field(default_factory=Counter)
    codes: Counter[int] = field(default_factory=Counter)
    rounds: int = 0
    faults: list[str] = field(default_factory=list)


def digest_tree(folder: Path, outputs: Sequence[str], earlier: Path | None = None) -> Tree:
    """The files of outputs in a folder, wherever that is; what is hidden in a capture is its work.

    Args:
        folder: Where they are.
        outputs: Which.
        earlier: Where some of them were written, if elsewhere.
    """
    found = {}
    places = [os.fsencode(place) for place in (folder, earlier) if place is not None]
    for name in outputs:
        path = folder / name
        for each in [path] if path.is_file() else sorted(path.rglob("*")):
            inside = each.relative_to(folder).as_posix()
            if each.is_file() and "/.usdfoliage/" not in f"/{inside}":
                data = each.read_bytes()
                for place in places:
                    data = data.replace(place, b"PLACE")
                found[inside] = sha256(data).hexdigest()
    return found


def environment(folder: Path) -> dict[str, str]:
    return {**os.environ, "TMPDIR": str(folder / TEMPORARY), "OMP_NUM_THREADS": "1"}


def command(words: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", "usdfoliage", *words]


def run(folder: Path, words: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command(words), cwd=folder, env=environment(folder), capture_output=True, text=True, check=False
    )


def prepare(folder: Path, given: Path, earlier: Path | None = None, subject: Subject | None = None) -> None:
    """A folder for a command: the input, room for temporary files, and an earlier result."""
    folder.mkdir(parents=True)
    (folder / TEMPORARY).mkdir()
    shutil.copytree(given, folder / INPUT, symlinks=True)
    for name in (*subject.outputs, subject.work) if earlier is not None and subject is not None else ():
        if name and (earlier / name).is_dir() and not (folder / name).exists():
            shutil.copytree(earlier / name, folder / name)
        elif name and (earlier / name).is_file():
            shutil.copyfile(earlier / name, folder / name)


def learn(subject: Subject, given: Path, folder: Path) -> Known:
    """Run a command undisturbed: with its other words, and, in a folder without that result, with its own."""
    for name, words in (("old", (*subject.words, *subject.other)), ("new", subject.words)):
        prepare(folder / name, given)
        begin = time.perf_counter()
        ended = run(folder / name, words)
        seconds = time.perf_counter() - begin
        if ended.returncode:
            raise RuntimeError(f"usdfoliage {' '.join(words)}: exit {ended.returncode}: {ended.stderr}")
    old, new = (digest_tree(folder / name, subject.outputs) for name in ("old", "new"))
    return Known(new=new, old=old, earlier=folder / "old", seconds=seconds)


def judge_output(subject: Subject, found: Tree, known: Known, had_old: bool, given: Collection[str]) -> tuple[str, str]:
    """What an output is after a kill, and what is wrong with it; given are digests of the input."""
    before = known.old if had_old else {}
    if found in (known.new, before):
        return "new" if found == known.new else "old" if had_old else "absent", ""
    if not subject.apart:
        differing = [n for n in sorted({*found, *known.new}) if found.get(n) != known.new.get(n)]
        return "other", f"neither old nor new: {differing[:3]} of {len(differing)}"
    half = [n for n, d in found.items() if d not in (known.new.get(n), known.old.get(n)) and d not in given]
    half = [n for n in half if Path(n).name != _WHILE_BUILT]
    return ("between", "") if not half else ("other", f"half: {half[:3]}")


def judge_words(victim: str, number: int, code: int, out: str, err: str, found: Tree, known: Known) -> str:
    """What is wrong with what a killed command printed and ended with."""
    if "Traceback" in err or "Traceback" in out or "internal fault" in err:
        return f"traceback: {err.strip().splitlines()[-1:]}"
    if victim != "child" and (code == -number or number == signal.SIGKILL):
        return ""
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    others = [line for line in err.splitlines() if line.strip() and not _KNOWN.search(line)]
    if others:
        return f"other words on stderr: {others[:2]}"
    if code == 0:
        if errors or (found != known.new and _POOR not in out + err):
            differing = [n for n in sorted({*found, *known.new}) if found.get(n) != known.new.get(n)]
            return f"exit 0 after a kill, with another result: {differing[:3]}, {err.strip().splitlines()[-1:]}"
        return ""
    if code not in (2, 130) or len(errors) != 1:
        return f"exit {code} with {len(errors)} lines of error: {err.strip().splitlines()[-2:]}"
    return ""


def kill_once(
    subject: Subject, folder: Path, known: Known, rng: random.Random
) -> tuple[str, int, int, str, str, list[Process]]:
    """Run a command and kill; returns what was killed, by which signal, exit code, texts, and children that live on."""
    victim, number = rng.choice(VICTIMS), rng.choice(SIGNALS)
    streams = [(folder / TEMPORARY).parent / f"{name}.txt" for name in ("printed", "complaints")]
    with streams[0].open("wb") as out, streams[1].open("wb") as err:
        process = subprocess.Popen(
            command(subject.words), cwd=folder, env=environment(folder), stdout=out, stderr=err, start_new_session=True
        )
        moment = rng.uniform(0.05, 1.0) * known.seconds
        with suppress(subprocess.TimeoutExpired):
            process.wait(moment)
        below = descendants(process.pid)
        if victim == "child":
            if not end_child(process.pid, number, rng, wait_s=known.seconds):
                victim = "none"
        elif process.poll() is not None:
            victim = "none"
        elif victim == "all":
            os.killpg(process.pid, number)
            for each in below:
                if each.is_alive:  # those with a group of their own
                    os.kill(each.pid, number)
        else:
            process.send_signal(number)
        try:
            process.wait(_LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return victim, number, 99, "", "error: it did not end", []
    end = time.monotonic() + _ENDING_S
    while any(each.is_alive for each in below) and time.monotonic() < end:
        time.sleep(0.05)
    texts = [path.read_text(errors="replace") for path in streams]
    for path in streams:
        path.unlink()
    return victim, number, process.returncode, *texts, [each for each in below if each.is_alive]


def find_left_over(subject: Subject, folder: Path, expected: Tree) -> list[str]:
    """What lies anywhere that no undisturbed run leaves."""
    known = {INPUT, TEMPORARY, *subject.outputs, *([subject.work] if subject.work else [])}
    left_over = [path.name for path in folder.iterdir() if path.name not in known]
    left_over += [f"{TEMPORARY}/{path.name}" for path in (folder / TEMPORARY).iterdir()]
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if not name.startswith((f"{INPUT}/", f"{TEMPORARY}/")) and (
            "usdfoliage-" in path.name or path.name.endswith((".new", ".old", ".tmp")) or path.name.startswith(".job-")
            or (path.name.startswith("tmp") and path.name != TEMPORARY)
        ):  # fmt: skip
            left_over.append(name)
    return left_over


def kill_rounds(
    name: str, subject: Subject, kills: int, known: Known, given: Path, scratch: Path, kept: Path, seed: int
) -> Tally:
    """Rounds of kills of one command, until there were so many."""
    rng = random.Random(f"{seed} {name}")
    tally = Tally()
    whole_input = digest_tree(given.parent, [INPUT])
    while tally.kills.total() < kills and tally.rounds < 4 * kills:
        had_old = bool(rng.getrandbits(1))
        folder = scratch / f"{tally.rounds:03d}"
        prepare(folder, given, known.earlier if had_old else None, subject)
        faults = []
        for _ in range(min(KILLS_A_ROUND, kills - tally.kills.total())):
            victim, number, code, out, err, alive = kill_once(subject, folder, known, rng)
            found = digest_tree(folder, subject.outputs, known.earlier)
            state, fault = judge_output(subject, found, known, had_old, whole_input.values())
            is_poor = code == 0 and _POOR in out + err
            signal_name = signal.Signals(number).name
            if victim != "none":
                tally.kills[f"{victim} {signal_name}"] += 1
                tally.states["poor" if is_poor and fault else state] += 1
                tally.codes[code] += 1
            where = f"{victim} {signal_name}, exit {code}"
            faults += [f"{where}: {fault}"] if fault and not is_poor else []
            words = judge_words(victim, number, code, out, err, found, known)
            faults += [f"{where}: {words}"] if words else []
            faults += [f"{where}: {len(alive)} children are left"] if alive else []
            if digest_tree(folder, [INPUT]) != whole_input:
                faults.append(f"{where}: the input changed")
            if victim == "none" or faults or is_poor:
                break
        ended = run(folder, subject.words)
        if ended.returncode or ended.stderr.count("Traceback"):
            faults.append(f"the next run: exit {ended.returncode}: {ended.stderr.strip().splitlines()[-2:]}")
        again = digest_tree(folder, subject.outputs)
        if again != known.new:
            differing = [n for n in sorted({*again, *known.new}) if again.get(n) != known.new.get(n)]
            faults.append(f"the next run: OTHER BYTES: {differing[:3]} of {len(differing)}")
        left_over = find_left_over(subject, folder, known.new)
        faults += [f"the next run leaves {left_over[:3]}"] if left_over else []
        tally.rounds += 1
        tally.faults += faults
        if faults:
            place = kept / f"{name.replace(' ', '-')}-{tally.rounds}"
            shutil.rmtree(place, ignore_errors=True)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(folder, place)
            (place / "faults.txt").write_text("\n".join([*faults, err, ended.stderr]))
        else:
            shutil.rmtree(folder)
    return tally


def describe(tally: Tally) -> str:
    counts = [
        ", ".join(f"{count} {name}" for name, count in sorted(each.items(), key=str))
        for each in (tally.kills, tally.states, tally.codes)
    ]
    return f"{tally.kills.total():>4} kills ({counts[0]}); then {counts[1]}; exit codes {counts[2]}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100, help="of all commands together (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of moments, signals and victims (%(default)s)")
    parser.add_argument("--only", nargs="+", choices=list(SUBJECTS), default=list(SUBJECTS), help="these commands")
    parser.add_argument("--lanes", type=int, default=1, help="commands at once (%(default)s)")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/kills"), help="for faults (%(default)s)")
    options = parser.parse_args()
    shares = {name: (options.kills + place) // len(options.only) for place, name in enumerate(reversed(options.only))}
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="usdfoliage-kills-") as temporary:
        top = Path(temporary)
        (top / INPUT).mkdir()
        (top / TEMPORARY).mkdir()
        subjects = [SUBJECTS[name] for name in options.only]
        write_input(top / INPUT, lambda *words: run(top, words).check_returncode(), subjects)

        def try_one(name: str) -> Tally:
            subject, scratch = SUBJECTS[name], top / name.replace(" ", "-")
            known = learn(subject, top / INPUT, scratch)
            tally = kill_rounds(
                name, subject, shares[name], known, top / INPUT, scratch / "rounds", options.output, options.seed
            )
            print(
                f"{name:<20} {'BAD ' if tally.faults else 'good'} {describe(tally)}; {known.seconds:.1f} s", flush=True
            )
            for fault in tally.faults:
                print(f"    {fault.replace(str(top), '…')}", flush=True)
            shutil.rmtree(scratch)
            return tally

        with ThreadPoolExecutor(options.lanes) as lanes:
            tallies = list(lanes.map(try_one, [name for name in options.only if shares[name]]))
    kills, faults = sum(each.kills.total() for each in tallies), sum(len(each.faults) for each in tallies)
    children = sum(count for each in tallies for what, count in each.kills.items() if what.startswith("child"))
    print(
        f"{kills} kills, {children} of them of a child, in {sum(each.rounds for each in tallies)} folders; "
        f"{faults} faults; seed {options.seed}, {time.monotonic() - begin:.0f} s"
    )
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
