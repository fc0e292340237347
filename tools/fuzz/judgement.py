"""What a command may do with files that somebody damaged: work, or refuse them in one line, and nothing else."""

import re
from collections.abc import Mapping
from pathlib import Path

from tools.fuzz.cases import CHILDREN_KILLED, Case
from tools.fuzz.isolation import TIME_LIMIT_S, Ended

_LEFT = re.compile(r"usdfoliage-(?:new|old|lock)|\.tmp$")  # names of what is not yet whole

_STEERING = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\x9b]")  # what a terminal acts on

# A run of capture that stopped keeps links to its input and what it has done, to go on; these come last.
_RESULTS = {f"out/{name}" for name in ("depth", "normals", "confidence", "cloud.ply", "capture.usda")}
_KNOWN = re.compile(r"^WARNING: |, \d+% done in \d")  # lines of ours, which are no noise: of the log, and of progress

State = Mapping[str, tuple[int, int, int]]


def folder_state(folder: Path) -> State:
    """Mode, size and time of everything below a folder; nothing is opened, as that may be a pipe."""
    found = {}
    for path in sorted(folder.rglob("*")):
        status = path.lstat()
        found[path.relative_to(folder).as_posix()] = (status.st_mode, status.st_size, status.st_mtime_ns)
    return found


def find_faults(case: Case, ended: Ended, before: State, after: State, time_limit_s: float = TIME_LIMIT_S) -> list[str]:
    """What a command did wrong, none for nothing; time_limit_s is of the processor."""
    if ended.timed_out:
        return [f"hang: no end after {ended.waited_s:.0f} s"]
    faults = [f"slow: {ended.seconds:.0f} s"] if ended.seconds > time_limit_s else []
    allowed = (0, 2, 3) if case.words[0] == "validate" else (0, 2)
    if ended.code < 0:
        faults.append(f"crash: signal {-ended.code}")
    elif ended.code not in allowed:
        faults.append(f"exit code {ended.code}")
    for word in ("Traceback", "internal fault"):
        if word in ended.stderr:
            faults.append(word)
    for name, text in (("stderr", ended.stderr), ("stdout", ended.stdout)):
        if _STEERING.search(text):
            faults.append(f"control characters on {name}")
    faults += _message_faults(case, ended) if ended.code in allowed else []
    changed = [name for name, state in before.items() if after.get(name, (0, 0, 0))[:2] != state[:2]]
    if changed:
        faults.append(f"input changed: {changed[0]}")
    new = [name for name in after if name not in before]
    if case.kind == CHILDREN_KILLED:  # the next run for the same output removes what they leave; bench/kills.py
        new = [name for name in new if not is_hidden_leftover(name)]
    left = [name for name in new if _LEFT.search(name)]
    if left:
        faults.append(f"left behind: {left[0]}")
    elif ended.code in (1, 2) and (case.words[0] != "capture" or _RESULTS & set(new)) and new:
        faults.append(f"partial output: {new[0]}")
    elif any(not name.startswith("out") for name in new):
        faults.append("output elsewhere: " + next(name for name in new if not name.startswith("out")))
    return faults


def is_hidden_leftover(name: str) -> bool:
    """Whether a path is of what a killed run leaves, hidden, for the next run to remove."""
    return any(part[0] == "." and _LEFT.search(part) for part in Path(name).parts)


def _message_faults(case: Case, ended: Ended) -> list[str]:
    lines = [line for line in ended.stderr.splitlines() if line.strip() and not _KNOWN.search(line)]
    if ended.code != 2:
        return [f"noise: {lines[0][:100]}"] if lines else []
    errors = [line for line in lines if line.startswith("error: ")]
    if case.words[0] == "batch" and not errors and ended.stdout:
        return [f"noise: {lines[0][:100]}"] if lines else []  # it reports each plant that cannot be built
    if len(errors) != 1:
        return [f"{len(errors)} messages"]
    faults = [f"noise: {line[:100]}" for line in lines if line not in errors][:1]
    if ended.stdout:
        faults.append("output on stdout as well")
    if len(errors[0]) > 1500:
        faults.append(f"message of {len(errors[0])} characters")
    # The message may name a folder: the one that lacks the file.
    if case.names_file and not any(part in errors[0] for part in Path(case.target).parts):
        faults.append("the file is not named")
    return faults
