"""Commands run in processes of their own, forked so that importing costs nothing, with limits of time and memory."""

import importlib
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from usdfoliage.__main__ import COMMANDS, main
from usdfoliage.cli.box import TIME_VARIABLE

JOBS = (
    "jobs.branches.run",
    "jobs.capture.run",
    "jobs.crown.run_photograph",
    "jobs.edits.scatter",
    "jobs.edits.bake",
    "jobs.edits.edit",
    "jobs.info",
    "jobs.leaves.run",
    "jobs.preview.pictures",
)
TIME_LIMIT_S = 10.0  # of the processor
WAITING_LIMIT_S = 40.0  # by the clock: other work of the machine may take most of it
BOX_LIMIT_S = 8.0  # by the clock: of commands in a box, whose end by it is a refusal
MEMORY_LIMIT_BYTES = 6 * 2**30


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a command ended."""

    code: int  # of exit; a signal as its negative number
    seconds: float  # of the processor
    waited_s: float  # by the clock
    timed_out: bool
    stdout: str
    stderr: str
    peak_bytes: int  # of memory that it had at once


@dataclass(frozen=True, kw_only=True)
class Running:
    """A command that runs."""

    pid: int
    started: float
    streams: Path


def import_commands() -> None:
    """Import what the commands import, once, before processes are forked."""
    for module in (*map("cli.{}".format, COMMANDS), *JOBS, "asset.validation.validate", "asset.locate"):
        importlib.import_module(f"usdfoliage.{module}")


def limit_process() -> None:
    """What the process of a small case gets: addresses, no core, and little time where the command has a box."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT_BYTES, MEMORY_LIMIT_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.environ[TIME_VARIABLE] = str(BOX_LIMIT_S)


def start_command(
    words: Sequence[str],
    folder: Path,
    streams: Path,
    harden: Callable[[], None] | None = None,
    limit: Callable[[], None] | None = limit_process,
) -> Running:
    """Run a command of usdfoliage in a folder; what it prints goes to files beside streams.

    Args:
        words: Of the command line.
        folder: Where it runs.
        streams: The start of the files' names.
        harden: Called in the process before the command begins.
        limit: Called before that; None: the limits of the product alone.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    started = time.monotonic()
    pid = os.fork()
    if pid:
        return Running(pid=pid, started=started, streams=streams)
    code = 70
    try:
        os.setsid()
        for stream, suffix in ((1, ".out"), (2, ".err")):
            os.dup2(os.open(f"{streams}{suffix}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.chdir(folder)
        if limit is not None:
            limit()
        if harden is not None:
            harden()
        sys.argv = ["usdfoliage", *words]
        code = main()  # as a command line's: in a box, or with its libraries diverted
    except SystemExit as error:  # of argparse
        code = error.code if isinstance(error.code, int) else 1
    except BaseException:  # noqa: BLE001  # a fault of the command must not run the loop of the parent
        import traceback

        traceback.print_exc()
        code = 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def poll_command(running: Running, time_limit_s: float = WAITING_LIMIT_S) -> Ended | None:
    """How it ended, None while it runs; past the limit it is killed, with its children."""
    pid, status, used = os.wait4(running.pid, os.WNOHANG)
    timed_out = not pid and time.monotonic() - running.started > time_limit_s
    if not pid and not timed_out:
        return None
    seconds = time.monotonic() - running.started
    if timed_out:
        os.killpg(running.pid, signal.SIGKILL)
        _, status, used = os.wait4(running.pid, 0)
    return Ended(
        code=os.waitstatus_to_exitcode(status),
        seconds=used.ru_utime + used.ru_stime,
        waited_s=seconds,
        timed_out=timed_out,
        stdout=_text(Path(f"{running.streams}.out")),
        stderr=_text(Path(f"{running.streams}.err")),
        peak_bytes=used.ru_maxrss * 1024,
    )


def _text(path: Path) -> str:
    return path.read_bytes().decode(errors="replace") if path.exists() else ""
