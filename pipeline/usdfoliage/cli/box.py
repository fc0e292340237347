"""Commands that open USD of strangers run in a child process with limits; its death is one line and exit code 2.

USD's own readers trust a file: some damage makes them take all memory, run for hours, or end the process. No check of
ours before them finds all of that. So `info`, `validate`, `edit`, `bake`, `export`, `preview` and `view` run whole in a
child. The parent reads no file: it starts the child, waits, and ends it where it takes more memory or time than its
files explain. Time is that of the processor, so that a busy machine refuses no good asset; the clock ends what only
waits. What libraries print by themselves goes to a pipe, so that nothing raw from a file reaches a terminal.

The child reports what it reads, once it knows, in one line of JSON; until then the limits of an empty asset hold.
Another line comes before it prints an error of its own: after that the parent adds none.
"""

import argparse
import contextlib
import json
import logging
import math
import os
import selectors
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType
from typing import IO

from usdfoliage.cli.composition import Composition, measure_composition
from usdfoliage.cli.noise import MAX_BYTES, noise_lines
from usdfoliage.errors import FoliageError
from usdfoliage.files.delayed_interrupts import interrupts_delayed
from usdfoliage.files.printable import printable
from usdfoliage.files.temporary_folder import remove_abandoned

logger = logging.getLogger(__name__)

MEMORY_VARIABLE = "USDFOLIAGE_MEMORY_LIMIT_GIB"
WORK_VARIABLE = "USDFOLIAGE_CPU_LIMIT_S"
TIME_VARIABLE = "USDFOLIAGE_TIME_LIMIT_S"
OUTPUT_VARIABLE = "USDFOLIAGE_OUTPUT_LIMIT_GIB"
TEXT_VARIABLE = "USDFOLIAGE_TEXT_LIMIT_MIB"
BOXED = ("info", "validate", "edit", "bake", "export", "preview", "view")
_DRAWING = ("preview", "view")  # they draw in a third process: Storm has a limit, and a window is closed by its user
_GIB = 1 << 30
_ERROR = "error: "  # how the line of a refusal begins
_CONCLUDED = b"null"  # the line before an error of the child's own
_POLL_S = 0.03  # 100 MB at most are taken meanwhile
_FROM_OUTSIDE = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT)
_ENDING_S = 20.0  # for a child that is asked to end


@dataclass(frozen=True, kw_only=True)
class BoxLimits:
    """What a command may take for the files that it is given."""

    base_gib: float = 2.0  # GiB of memory for any asset.
    memory_ratio: float = 32.0  # Bytes of memory for each byte of the asset's files; crates are compressed.
    machine_share: float = 0.75  # The share of the machine's memory that no asset gets more than.
    base_cpu_s: float = 50.0  # Seconds of the processor for any asset.
    seconds_per_mib: float = 2.5  # Seconds of the processor for each MiB of its files, where that is more.
    base_s: float = 180.0  # Seconds for any asset by the clock, which runs while other work has the processor.
    waiting_ratio: float = 5.0  # Seconds by the clock for each of the processor beyond those for any asset.
    drawing_gib: float = 4.0  # GiB of memory beyond that while Storm draws.
    file_gib: float = 16.0  # GiB that a file written may have.
    text_mib: float = 64.0  # MiB that a layer of text may have: USD takes up to 50 times as much memory for it.

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be above 0, not {value}")


@dataclass(frozen=True, kw_only=True)
class Allowance:
    """What one child may take, and how it is called in messages."""

    name: str  # of the asset; empty while it is not known
    memory_bytes: int
    drawing_bytes: int  # of memory, instead of those, from when it draws
    cpu_s: float  # of the processor, by the child and what it starts
    seconds: float  # by the clock
    output_bytes: int  # of a file
    until_drawing: bool  # cpu_s and seconds hold until the child starts another process, which draws
    verbose: bool


def run_in_box(words: Sequence[str], limits: BoxLimits = BoxLimits()) -> int:
    """Run a command of usdfoliage in a child process; returns its exit code, 2 where it was ended or ended badly.

    The process that calls it gives up its handlers of SIGINT, SIGTERM, SIGHUP, which go to the child.

    Raises:
        FoliageError: A limit that the environment states is no number above 0.
    """
    ended = _run_child(words, limits)
    if ended.allowed.verbose:
        for line in ended.noise:
            print(f"INFO: library: {line}", file=sys.stderr)
    if not ended.reason and ended.code >= 0:
        return ended.code
    if not ended.reason and -ended.code in ended.received:  # it had no handler yet
        signal.signal(-ended.code, signal.SIG_DFL)
        os.kill(os.getpid(), -ended.code)
    remove_abandoned()
    print(f"{_ERROR}{ended.reason or _explain_signal(ended.allowed, -ended.code)}", file=sys.stderr)
    return 2


def refuse_harmful(asset: Path, limits: BoxLimits = BoxLimits()) -> None:
    """Let a child open an asset as `info` does, before this process opens it for a command that is in no box.

    The child gets half of the time of the processor: what it takes, this process takes again.

    Raises:
        FoliageError: The child took more than its limits, died, or refused the asset.
        KeyboardInterrupt: A signal came that interrupts.
    """
    with tempfile.TemporaryFile() as complaints:
        ended = _run_child(("info", "--", str(asset)), limits, complaints=complaints, cpu_share=0.5)
        complaints.seek(0)
        lines = complaints.read(MAX_BYTES).decode(errors="replace").splitlines()
    if ended.received:
        raise KeyboardInterrupt
    if ended.reason or ended.code < 0:
        remove_abandoned()
        raise FoliageError(ended.reason or _explain_signal(ended.allowed, -ended.code))
    if ended.code:
        refused = [line.removeprefix(_ERROR) for line in lines if line.startswith(_ERROR)]
        raise FoliageError(refused[-1] if refused else f"{printable(asset)} cannot be read as USD")


@dataclass(frozen=True, kw_only=True)
class _Ended:
    """How a child ended."""

    code: int  # of exit; a signal as its negative number
    reason: str  # why the parent ended it; empty where it did not
    received: frozenset[int]  # signals that came meanwhile
    allowed: Allowance
    noise: Sequence[str]


def _run_child(
    words: Sequence[str], limits: BoxLimits, complaints: IO[bytes] | None = None, cpu_share: float = 1.0
) -> _Ended:
    """Run a command in a child and wait for its end, or end it.

    Args:
        words: Of the command line.
        limits: What it may take.
        complaints: Where its stderr goes, without its stdout; None: both are this process's.
        cpu_share: Of the time of the processor that it may take.
    """
    likely = next(
        (word for word in words[1:] if os.path.lexists(word)), ""
    )  # until the child knows, as on a busy machine
    allowed = allow(printable(likely), words[0] if words else "", 0, limits)
    report_out, report_in = os.pipe()
    noise_out, noise_in = os.pipe()
    for pipe in (report_out, noise_out):
        os.set_blocking(pipe, False)
    script = Path(__file__).parents[1] / "boxed.py"
    with interrupts_delayed():
        child = subprocess.Popen(
            [sys.executable, str(script), str(os.getpid()), str(report_in), str(noise_in), *words],
            pass_fds=(report_in, noise_in),
            process_group=0,  # what it starts is ended with it, and a terminal's signals come by way of the parent
            stdout=None if complaints is None else subprocess.DEVNULL,
            stderr=complaints,
        )
    for pipe in (report_in, noise_in):
        os.close(pipe)
    watched = _Watched(process=child, reports=report_out, noise=noise_out, allowed=allowed, cpu_share=cpu_share)
    with _forwarded_signals(child.pid) as received:
        code, reason = watched.wait()
    for pipe in (report_out, noise_out):
        os.close(pipe)
    return _Ended(
        code=code,
        reason=reason,
        received=frozenset(received),
        allowed=watched.allowed,
        noise=watched.noise_lines(),
    )


def allow(
    name: str, command: str, size_bytes: int, limits: BoxLimits = BoxLimits(), verbose: bool = False
) -> Allowance:
    """What a command may take for an asset whose files have so many bytes; the environment may state other limits.

    Raises:
        FoliageError: The environment states what is no number above 0.
    """
    machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    memory = min(limits.base_gib * _GIB + limits.memory_ratio * size_bytes, limits.machine_share * machine)
    cpu_s = max(limits.base_cpu_s, limits.seconds_per_mib * size_bytes / (1 << 20))
    drawing = min(memory + limits.drawing_gib * _GIB, limits.machine_share * machine)
    return Allowance(
        name=name,
        memory_bytes=int(_stated(MEMORY_VARIABLE, memory / _GIB) * _GIB),
        drawing_bytes=int(_stated(MEMORY_VARIABLE, drawing / _GIB) * _GIB),
        cpu_s=_stated(WORK_VARIABLE, cpu_s),
        seconds=_stated(TIME_VARIABLE, limits.base_s + limits.waiting_ratio * (cpu_s - limits.base_cpu_s)),
        output_bytes=int(_stated(OUTPUT_VARIABLE, limits.file_gib) * _GIB),
        until_drawing=command in _DRAWING,
        verbose=verbose,
    )


def _stated(variable: str, default: float) -> float:
    text = os.environ.get(variable, "").strip()
    if not text:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise FoliageError(f"{variable} is {printable(text)!r}", "give a number above 0, or remove it")
    return value


def announce(options: argparse.Namespace, reports: int, limits: BoxLimits = BoxLimits()) -> None:
    """In the child: take limits for the asset that the command names, and report them to the parent.

    Raises:
        FoliageError: A layer is so long a text that USD should not read it.
    """
    asset: Path | None = getattr(options, "asset", None)
    found = Composition(size_bytes=0) if asset is None else measure_composition(asset)
    allowed = allow(printable(asset or ""), options.command, found.size_bytes, limits, options.verbose)
    os.write(reports, json.dumps(asdict(allowed)).encode() + b"\n")
    _set_limits(allowed)
    mib_allowed = _stated(TEXT_VARIABLE, limits.text_mib)
    if found.text_bytes > mib_allowed * (1 << 20):
        raise FoliageError(
            f"{found.text} is a layer of {found.text_bytes / (1 << 20):,.0f} MiB of text, more than {mib_allowed:,.0f}",
            f"write it as .usdc; if you trust it, set {TEXT_VARIABLE} to more MiB",
        )


def conclude(reports: int) -> None:
    """In the child: let the parent know that the child prints its own error now, whatever it takes from then on."""
    os.write(reports, _CONCLUDED + b"\n")


def _set_limits(allowed: Allowance) -> None:
    import resource

    def lower(kind: int, value: int) -> None:
        _, hard = resource.getrlimit(kind)
        value = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(kind, (value, value))

    lower(resource.RLIMIT_CORE, 0)
    lower(resource.RLIMIT_FSIZE, allowed.output_bytes)
    if not allowed.until_drawing:  # graphics drivers reserve more addresses than a machine has memory
        threads = os.cpu_count() or 1
        lower(resource.RLIMIT_AS, allowed.memory_bytes + 4 * _GIB + threads * _GIB // 4)


@contextlib.contextmanager
def _forwarded_signals(group: int) -> Iterator[set[int]]:
    """What would end the parent goes to the group of the child; yields the signals that came."""
    received: set[int] = set()

    def forward(number: int, _frame: FrameType | None) -> None:
        received.add(number)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, number)

    def pause(_number: int, _frame: FrameType | None) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, signal.SIGSTOP)
        os.kill(os.getpid(), signal.SIGSTOP)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, signal.SIGCONT)

    earlier = {number: signal.signal(number, forward) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    earlier[signal.SIGTSTP] = signal.signal(signal.SIGTSTP, pause)
    try:
        yield received
    finally:
        for number, handler in earlier.items():
            signal.signal(number, handler)


class _Watched:
    """A child that runs: what it reports, what its libraries print, and what it takes."""

    def __init__(
        self, *, process: subprocess.Popen[bytes], reports: int, noise: int, allowed: Allowance, cpu_share: float
    ) -> None:
        self.allowed = allowed
        self._cpu_share = cpu_share
        self._process, self._reports, self._noise_pipe = process, reports, noise
        self._noise = b""
        self._started = time.monotonic()
        self._draws = False
        self._concluded = False  # whether the child prints an error of its own

    def wait(self) -> tuple[int, str]:
        """Wait for its end, or end it; returns its exit code and why it was ended, empty where it was not."""
        with selectors.DefaultSelector() as selector:
            for pipe in (self._reports, self._noise_pipe):
                selector.register(pipe, selectors.EVENT_READ)
            ending = _open_ending(self._process.pid)
            if ending is not None:
                selector.register(ending, selectors.EVENT_READ)
            try:
                while self._process.poll() is None:
                    for key, _ in selector.select(_POLL_S):
                        if key.fd != ending and not self._read(key.fd):
                            selector.unregister(key.fd)
                    reason = self._excess()
                    if not reason or self._process.poll() is not None:
                        continue
                    self._read(self._reports)  # it may have come to an error of its own meanwhile
                    if not self._concluded:
                        self._kill()
                        return self._process.returncode, reason
                    with contextlib.suppress(subprocess.TimeoutExpired):
                        self._process.wait(_ENDING_S)
                    self._kill()
            finally:
                if ending is not None:
                    os.close(ending)
        for pipe in (self._reports, self._noise_pipe):
            self._read(pipe)
        code = self._process.returncode
        return (2 if code < 0 and self._concluded else code), ""

    def _kill(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def noise_lines(self) -> list[str]:
        """What libraries printed, as far as it is kept."""
        return noise_lines(self._noise)

    def _read(self, pipe: int) -> bool:
        """Take what is in a pipe; False at its end."""
        try:
            data = os.read(pipe, MAX_BYTES)
        except BlockingIOError:
            return True
        if pipe == self._noise_pipe:
            self._noise = (self._noise + data)[-MAX_BYTES:]
        for line in data.splitlines() if pipe == self._reports else ():
            if line == _CONCLUDED:
                self._concluded = True
            else:
                self.allowed = Allowance(**json.loads(line))
        return bool(data)

    def _excess(self) -> str:
        """What is above its limit, in words; empty for nothing."""
        allowed, name = self.allowed, self.allowed.name or "the asset"
        used = usage(self._process.pid)
        self._draws |= allowed.until_drawing and used.processes > 1
        limit = ""
        if not self._draws and time.monotonic() - self._started > allowed.seconds:
            limit, stated = f"{name} was not read within {allowed.seconds:.0f} s", f"{TIME_VARIABLE} to more seconds"
        elif not self._draws and used.cpu_s > self._cpu_share * allowed.cpu_s:
            limit = f"{name} takes more than {self._cpu_share * allowed.cpu_s:.0f} s of the processor to read"
            stated = f"{WORK_VARIABLE} to more seconds"
        elif used.memory_bytes > (memory_bytes := allowed.drawing_bytes if self._draws else allowed.memory_bytes):
            purpose = "draw" if self._draws else "read"
            limit = f"{name} takes more than {memory_bytes / _GIB:.1f} GiB of memory to {purpose}"
            stated = f"{MEMORY_VARIABLE} to more GiB"
        return f"{limit}; it is damaged or larger than it seems: if you trust it, set {stated}" if limit else ""


@dataclass(frozen=True, kw_only=True)
class Usage:
    """What a process and those that it started have and took; nothing where that is not known."""

    memory_bytes: int = 0  # without what files lend
    cpu_s: float = 0.0
    processes: int = 0


def usage(pid: int) -> Usage:
    """What a process takes, and what those take that it started."""
    memory, ticks, processes, waiting, page = 0, 0, 0, [pid], os.sysconf("SC_PAGE_SIZE")
    while waiting:
        folder = f"/proc/{waiting.pop()}"
        try:
            with open(f"{folder}/statm", encoding="ascii") as file:  # noqa: PTH123
                _, resident, shared, *_ = map(int, file.read().split())
            with open(f"{folder}/stat", "rb") as file:  # noqa: PTH123
                fields = file.read().rpartition(b")")[2].split()  # the name before may have any bytes
            memory += max(0, resident - shared) * page
            ticks += sum(map(int, fields[11:15]))  # its own, and of its children that have ended
            processes += 1
            for task in os.listdir(f"{folder}/task"):  # noqa: PTH208
                with open(f"{folder}/task/{task}/children", encoding="ascii") as file:  # noqa: PTH123
                    waiting += map(int, file.read().split())
        except (OSError, ValueError):  # it ended meanwhile
            continue
    return Usage(memory_bytes=memory, cpu_s=ticks / os.sysconf("SC_CLK_TCK"), processes=processes)


def _open_ending(pid: int) -> int | None:
    """What becomes readable when a child ends; None where the system has no such thing."""
    try:
        return os.pidfd_open(pid)
    except (AttributeError, OSError):
        return None


def _explain_signal(allowed: Allowance, number: int) -> str:
    name = allowed.name or "the asset"
    try:
        called = signal.Signals(number).name
    except ValueError:
        called = f"signal {number}"
    if number == signal.SIGKILL:
        return (
            f"the process that read {name} was killed from outside (SIGKILL); "
            "where nobody did, the machine has too little memory"
        )
    if number in _FROM_OUTSIDE:
        return f"the process that read {name} was ended from outside ({called}); nothing was written: run it again"
    return f"{name} ended the process that read it ({called}); a file of it is damaged: write the asset again"
