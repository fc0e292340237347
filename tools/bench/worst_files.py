#!/usr/bin/env python3
"""The worst files there are, given to every command that reads them: none may take over 60 s, or 3 GB of memory.

usage: tools/bench/worst_files.py [--scale S] [--only TEXT …] [--commands NAME …] [--list]

Makes each file in a folder of its own: a million prims, 1 GB of text, counts of 2^31 in USD, PLY, LAS, EXR and NPZ,
pictures of 30,000 by 30,000, classes that inherit each other, parentheses in parentheses. Each command runs on it in a
process of its own, with the limits of the product alone, and has to end with 0, with 2 and one line that names the
file, or, validate, with 3. Prints a line for each: exit code, seconds of the processor and by the clock, the peak of
the memory of all its processes together, and its last line. The time of the processor counts for the limit, as the
clock counts other work of the machine too; by the clock no command may take four times as long. Exit 1 where a command
does anything else, writes a traceback, changes its input or leaves half an output.
"""

import argparse
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from usdfoliage.cli.box import usage

from tools.fuzz.cases import Case
from tools.fuzz.isolation import Ended, poll_command, start_command
from tools.fuzz.judgement import State, find_faults, folder_state, is_hidden_leftover
from tools.fuzz.worst_files import WorstFile, worst_files

WORK = "work"  # the folder that builds work in
TOOLS = Path(__file__).resolve().parents[1]
_POLL_S = 0.02
_LINE_CHARACTERS = 120
_ENDED_CHILD = re.compile(r"takes more than|was not read within|ended the process that read it")
_COLUMNS = f"{'file':<32} {'command':<9} {'exit':>4} {'cpu s':>6} {'s':>6} {'MiB':>6}  last line"


@dataclass(frozen=True, kw_only=True)
class WorstLimits:
    """What a command may take of any file."""

    cpu_s: float = 60.0  # Seconds of the processor.
    clock_s: float = 240.0  # Seconds by the clock, after which it is ended.
    memory_bytes: float = 3e9
    stop_bytes: float = 6e9  # It is ended there, so that the machine lives.


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What one command did with one file."""

    file: str
    words: Sequence[str]
    ended: Ended
    line: str  # the last that it printed
    peak_bytes: int
    faults: Sequence[str]


def link_tree(source: Path, folder: Path) -> None:
    """The files of a folder in another one, without their bytes where the disk allows."""

    def link(one: str, other: str) -> None:
        try:
            os.link(one, other, follow_symlinks=False)
        except OSError:
            shutil.copy2(one, other, follow_symlinks=False)

    shutil.copytree(source, folder, symlinks=True, copy_function=link, dirs_exist_ok=True)


def make_file(file: WorstFile, seeds: Path, folder: Path, scale: float) -> None:
    """Make a file, with the seeds that its commands read, in a process that gives back its memory.

    Raises:
        RuntimeError: It could not be made.
    """
    for tree in file.trees:
        shutil.copytree(seeds / tree, folder / tree)
    child = multiprocessing.get_context("fork").Process(target=file.make, args=(folder, scale))
    child.start()
    child.join()
    if child.exitcode:
        raise RuntimeError(f"{file.name} could not be made: exit code {child.exitcode}")


def run_command(
    file: WorstFile, words: Sequence[str], made: Path, folder: Path, limits: WorstLimits = WorstLimits()
) -> Outcome:
    """Run one command on a file in a folder, and judge it.

    Args:
        file: What was made.
        words: Of the command.
        made: Where that is.
        folder: Where the command runs, which is made, and removed.
        limits: What it may take.
    """
    case = Case(
        kind=file.name, number=0, mutation=words[0], target=file.target, words=words, prepare=partial(link_tree, made)
    )
    folder.mkdir()
    case.prepare(folder)
    before = folder_state(folder)
    running = start_command(words, folder, folder.with_name("streams"), limit=None)
    peak = 0
    while (ended := poll_command(running, limits.clock_s)) is None:
        peak = max(peak, usage(running.pid).memory_bytes)
        if peak > limits.stop_bytes:
            ended = poll_command(running, 0.0)
            if ended is not None:
                break
        time.sleep(_POLL_S)
    peak = max(peak, ended.peak_bytes)
    faults = judge(case, ended, peak, before, folder_state(folder), limits)
    shutil.rmtree(folder)
    lines = [line for line in (*ended.stdout.splitlines(), *ended.stderr.splitlines()) if line.strip()]
    line = lines[-1].replace(f"{folder}/", "") if lines else ""
    return Outcome(file=file.name, words=words, ended=ended, line=line, peak_bytes=peak, faults=faults)


def judge(
    case: Case, ended: Ended, peak_bytes: float, before: State, after: State, limits: WorstLimits = WorstLimits()
) -> list[str]:
    """What a command did wrong, none for nothing.

    A work folder is for the command to change. Where a box ended its child, hidden files stay for the next run to
    remove.
    """
    if peak_bytes > limits.stop_bytes:
        return [f"memory: ended at {peak_bytes / 1e9:.1f} GB"]
    if _ENDED_CHILD.search(ended.stderr):
        after = {name: state for name, state in after.items() if not is_hidden_leftover(name)}
    states = [{name: state for name, state in each.items() if Path(name).parts[0] != WORK} for each in (before, after)]
    faults = find_faults(case, ended, *states, time_limit_s=limits.cpu_s)
    if peak_bytes > limits.memory_bytes:
        faults.append(f"memory: {peak_bytes / 1e9:.1f} GB")
    return faults


def format_line(outcome: Outcome) -> str:
    """A line of the table."""
    ended, line = outcome.ended, outcome.line
    line = line if len(line) <= _LINE_CHARACTERS else f"{line[:_LINE_CHARACTERS]} …"
    return (
        f"{outcome.file:<32} {outcome.words[0]:<9} {ended.code:>4} {ended.seconds:>6.1f} {ended.waited_s:>6.1f} "
        f"{outcome.peak_bytes / 2**20:>6.0f}  {line}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scale", type=float, default=1.0, help="of what is large (%(default)s)")
    parser.add_argument("--only", nargs="+", default=[""], help="files with one of these texts in their names")
    parser.add_argument("--commands", nargs="+", help="only these commands (all)")
    parser.add_argument("--list", action="store_true", help="print the names of the files, and stop")
    options = parser.parse_args()
    if not 0 < options.scale <= 1:
        parser.error(f"--scale must be above 0 and at most 1, not {options.scale}")
    files = [file for file in worst_files() if any(text in file.name for text in options.only)]
    if options.list:
        print("\n".join(file.name for file in files))
        return 0

    outcomes = []
    with tempfile.TemporaryDirectory(prefix="usdfoliage-worst-") as work_folder:
        scratch = Path(work_folder)
        seeds = scratch / "seeds"
        seeds.mkdir()
        if any(file.trees for file in files):
            subprocess.run([sys.executable, TOOLS / "fuzz" / "seeds.py", seeds], check=True, stdout=subprocess.DEVNULL)
        print(_COLUMNS, flush=True)
        for file in files:
            made = scratch / "made"
            made.mkdir()
            make_file(file, seeds, made, options.scale)
            for words in file.commands:
                if options.commands and words[0] not in options.commands:
                    continue
                outcome = run_command(file, words, made, scratch / "run")
                outcomes.append(outcome)
                print(format_line(outcome), flush=True)
                for fault in outcome.faults:
                    print(f"    fault: {fault}", flush=True)
            shutil.rmtree(made)
    faulty = sum(bool(each.faults) for each in outcomes)
    print(
        f"{len(outcomes)} commands on {len(files)} files, {faulty} with faults; at most "
        f"{max(each.ended.seconds for each in outcomes):.1f} s of the processor, "
        f"{max(each.ended.waited_s for each in outcomes):.1f} s by the clock, "
        f"{max(each.peak_bytes for each in outcomes) / 2**20:.0f} MiB; scale {options.scale:g}"
    )
    return 1 if faulty else 0


if __name__ == "__main__":
    sys.exit(main())
