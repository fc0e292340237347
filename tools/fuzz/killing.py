"""The processes of a command, and the end of one or all of them from outside."""

import os
import random
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path

_WAIT_S = 10.0  # for a child to appear


@dataclass(frozen=True, kw_only=True)
class Process:
    """A process, also after another one has got its number."""

    pid: int
    started: str

    @property
    def is_alive(self) -> bool:
        return _state(self.pid)[1:] == (self.started,) and _state(self.pid)[0] != "Z"


def descendants(pid: int) -> list[Process]:
    """What a process has started, and what that has, as far as it lives."""
    found, waiting = list[Process](), [pid]
    while waiting:
        for path in Path(f"/proc/{waiting.pop()}/task").glob("*/children"):
            try:
                below = [int(each) for each in path.read_text().split()]
            except OSError:  # it has just ended
                continue
            waiting += below
            for each in below:
                state = _state(each)
                if state and state[0] != "Z":
                    found.append(Process(pid=each, started=state[1]))
    return found


def end_child(pid: int, number: int, rng: random.Random, wait_s: float = _WAIT_S) -> bool:
    """Send a signal to one of the processes below a process, as soon as there is one; returns whether there was."""
    end = time.monotonic() + wait_s
    while time.monotonic() < end and _state(pid) and _state(pid)[0] != "Z":
        below = descendants(pid)
        if below:
            try:
                os.kill(rng.choice(below).pid, number)
            except ProcessLookupError:
                continue
            return True
        time.sleep(0.01)
    return False


def end_own_child(delay_s: float, number: int = signal.SIGKILL) -> None:
    """In the process of a command, before it begins: some time from now, end one of its children."""

    def wait_and_end() -> None:
        time.sleep(delay_s)
        end_child(os.getpid(), number, random.Random(0))

    threading.Thread(target=wait_and_end, daemon=True).start()


def _state(pid: int) -> tuple[str, str] | tuple[()]:
    """The state of a process and when it started; nothing where there is none."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(errors="replace").rsplit(")", 1)[1].split()
    except OSError:
        return ()
    return fields[0], fields[19]
