"""Damaged files given to every command that reads them: none may crash, hang, or leave half an output.

usage: tools/bench/hostile_input.py [--seed N] [--share S] [--no-named] [--kind TEXT …] [-o FOLDER] [--lanes N]
       [--minutes M]

Each case damages one of the small valid files that the project makes of every kind, and runs one command on it in a
process of its own, of at most 10 s of the processor and 6 GiB. A command may end with 0, with 2 and one line that
names the file, or, validate, with 3; else the case has a fault. Prints a table of kinds and outcomes; the folder of
every case with a fault is kept below FOLDER (out/fuzz), with its command in command.txt. The exit code is 1 where there
is one.
"""

import argparse
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tools.fuzz.cases import Case, found_cases, random_cases
from tools.fuzz.hard_cases import hard_cases
from tools.fuzz.isolation import Ended, Running, import_commands, poll_command, start_command
from tools.fuzz.judgement import State, find_faults, folder_state
from tools.fuzz.named_cases import named_cases

TOOLS = Path(__file__).resolve().parents[1]
COLUMNS = ("cases", "good", "refused", "faults", "slowest")


def run_cases(
    cases: list[Case], scratch: Path, lanes: int, minutes: float | None = None
) -> list[tuple[Case, Ended, list[str]]]:
    """Run cases, as many at once as there are lanes; folders of those without fault are removed."""
    waiting = list(enumerate(cases))[::-1]
    end = None if minutes is None else time.monotonic() + 60 * minutes
    running: dict[int, tuple[Case, Running, State]] = {}
    results: dict[int, tuple[Case, Ended, list[str]]] = {}
    while waiting or running:
        if end is not None and time.monotonic() > end:
            waiting.clear()
        while waiting and len(running) < lanes:
            number, case = waiting.pop()
            folder = scratch / f"{number:04d}"
            folder.mkdir()
            case.prepare(folder)
            before = folder_state(folder)
            streams = scratch / f"{number:04d}"
            running[number] = case, start_command(case.words, folder, streams, case.harden), before
        for number in list(running):
            case, one, before = running[number]
            ended = poll_command(one)
            if ended is None:
                continue
            del running[number]
            folder = scratch / f"{number:04d}"
            faults = find_faults(case, ended, before, folder_state(folder))
            results[number] = case, ended, faults
            if not faults:
                shutil.rmtree(folder)
        time.sleep(0.005)
    return [results[number] for number in sorted(results)]


def keep_fault(case: Case, ended: Ended, faults: list[str], folder: Path, kept: Path) -> None:
    """Lay a case with a fault where it can be run again."""
    kept.parent.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(kept, ignore_errors=True)
    shutil.move(folder, kept)
    (kept / "command.txt").write_text(
        "\n".join([f"# {case.kind}, {case.mutation}: {'; '.join(faults)}", f"usdfoliage {shlex.join(case.words)}", ""]),
        errors="surrogateescape",
    )
    (kept / "stderr.txt").write_text(ended.stderr)


def format_table(results: list[tuple[Case, Ended, list[str]]]) -> str:
    """A line for every kind of file, and one for all."""
    rows: dict[str, Counter[str]] = {}
    slowest: dict[str, float] = {}
    for case, ended, faults in results:
        for name in (case.kind, "all"):
            row = rows.setdefault(name, Counter())
            row["cases"] += 1
            row["faults" if faults else "refused" if ended.code == 2 else "good"] += 1
            slowest[name] = max(slowest.get(name, 0), ended.seconds)
    rows["all"] = rows.pop("all")
    width = max(map(len, rows))
    lines = [f"{'kind':<{width}} " + " ".join(f"{column:>8}" for column in COLUMNS)]
    for name, row in rows.items():
        counts = " ".join(f"{row[column]:>8}" for column in COLUMNS[:-1])
        lines.append(f"{name:<{width}} {counts} {slowest[name]:>6.1f} s")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="of the damage (%(default)s)")
    parser.add_argument("--share", type=float, default=1.0, help="of the cases of every kind (%(default)s)")
    parser.add_argument("--no-named", action="store_true", help="only random damage")
    parser.add_argument("--kind", nargs="+", default=[""], help="only kinds with one of these texts in their names")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/fuzz"), help="for faults (%(default)s)")
    parser.add_argument("--minutes", type=float, help="start no case after so many (all cases)")
    parser.add_argument("--lanes", type=int, default=os.cpu_count() or 1, help="cases at once (all cores)")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory(prefix="usdfoliage-fuzz-") as work_folder:
        seeds, scratch = Path(work_folder) / "seeds", Path(work_folder) / "cases"
        seeds.mkdir()
        scratch.mkdir()
        subprocess.run(
            [sys.executable, TOOLS / "fuzz" / "seeds.py", seeds], check=True, stdout=subprocess.DEVNULL
        )  # elsewhere, as threads do not live through a fork
        import_commands()
        named = [] if options.no_named else [*named_cases(seeds), *found_cases(seeds), *hard_cases(seeds, options.seed)]
        cases = [*named, *random_cases(seeds, options.seed, options.share)]
        cases = [case for case in cases if any(text in case.kind for text in options.kind)]
        results = run_cases(cases, scratch, options.lanes, options.minutes)
        for number, (case, ended, faults) in enumerate(results):
            if faults:
                name = f"{case.kind} {case.number} {case.mutation}".replace("/", "_").replace(" ", "-")
                keep_fault(case, ended, faults, scratch / f"{number:04d}", options.output / name)
                print(f"fault: {case.kind}, {case.number} {case.mutation}: {'; '.join(faults)}")
    print(format_table(results))
    faulty = sum(bool(faults) for _, _, faults in results)
    max_bytes = max((ended.peak_bytes for _, ended, _ in results), default=0)
    print(f"{len(results)} cases, {faulty} with faults, at most {max_bytes / 2**20:.0f} MiB; seed {options.seed}")
    return 1 if faulty else 0


if __name__ == "__main__":
    sys.exit(main())
