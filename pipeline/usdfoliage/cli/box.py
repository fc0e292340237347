"""Commands that open USD of strangers run in a child process with limits; its death is one line and exit code 2.

USD's own readers trust a file: some damage makes them take all memory, run for hours, or end the process. No check of
ours before them finds all of that. So `info`, `validate`, `edit`, `bake`, `preview` and `view` run whole in a child.
The parent reads no file: it starts the child, waits, and ends it where it takes more memory or time than its files
explain. What libraries print by themselves goes to a pipe, so that nothing raw from a file reaches a terminal.

The child reports what it reads, once it knows, in one line of JSON; until then the limits of an empty asset hold.
"""

import argparse
import contextlib
import ctypes
import json
import logging
import math
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType

from usdfoliage.errors import FoliageError
from usdfoliage.files.printable import printable

logger = logging.getLogger(__name__)

MEMORY_VARIABLE = "USDFOLIAGE_MEMORY_LIMIT_GIB"
TIME_VARIABLE = "USDFOLIAGE_TIME_LIMIT_S"
BOXED = ("info", "validate", "edit", "bake", "preview", "view")
_DRAWING = ("preview", "view")  # they draw in a third process, which has limits of its own
_GIB = 1 << 30
_POLL_S = 0.03  # 100 MB at most are taken meanwhile
_MAX_NOISE_BYTES = 1 << 16  # of what libraries print, the last that is kept
_MAX_ENTRIES = 20_000  # of a folder that are counted
_ENDING_S = 20.0  # for a child that is asked to end
_PR_SET_PDEATHSIG = 1


@dataclass(frozen=True, kw_only=True)
class BoxLimits:
    """What a command may take for the files that it is given."""

    base_gib: float = 2.0  # GiB of memory for any asset.
    memory_ratio: float = 48.0  # Bytes of memory for each byte of the asset's files; crates are compressed.
    machine_share: float = 0.75  # The share of the machine's memory that no asset gets more than.
    base_s: float = 35.0  # Seconds for any asset, by the clock.
    seconds_per_mib: float = 5.0  # Seconds for each MiB of the asset's files.
    file_gib: float = 16.0  # GiB that a file written may have.

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be above 0, not {value}")


@dataclass(frozen=True, kw_only=True)
class Allowance:
    """What one child may take, and how it is called in messages."""

    name: str  # of the asset; empty while it is not known
    memory_bytes: int
    seconds: float | None  # by the clock; None for a window, which a user closes, and for pictures
    verbose: bool


def run_in_box(words: Sequence[str], limits: BoxLimits = BoxLimits()) -> int:
    """Run a command of usdfoliage in a child process; returns its exit code, 2 where it was ended or ended badly.

    The process that calls it gives up its handlers of SIGINT, SIGTERM, SIGHUP, which go to the child.

    Raises:
        FoliageError: A limit that the environment states is no number above 0.
    """
    allowed = allow("", words[0] if words else "", 0, limits)
    report_out, report_in = os.pipe()
    noise_out, noise_in = os.pipe()
    for pipe in (report_out, noise_out):
        os.set_blocking(pipe, False)
    script = Path(__file__).parents[1] / "boxed.py"
    child = subprocess.Popen(
        [sys.executable, str(script), str(report_in), str(noise_in), *words],
        pass_fds=(report_in, noise_in),
        process_group=0,  # what it starts is ended with it, and a terminal's signals come by way of the parent
    )
    for pipe in (report_in, noise_in):
        os.close(pipe)
    watched = _Watched(process=child, reports=report_out, noise=noise_out, allowed=allowed)
    with _forwarded_signals(child.pid) as received:
        ended = watched.wait()
    for pipe in (report_out, noise_out):
        os.close(pipe)
    if watched.allowed.verbose:
        for line in watched.noise_lines():
            print(f"INFO: library: {line}", file=sys.stderr)
    if not ended and child.returncode >= 0:
        return child.returncode
    if not ended and received and -child.returncode in received:  # it had no handler yet
        signal.signal(-child.returncode, signal.SIG_DFL)
        os.kill(os.getpid(), -child.returncode)
    print(f"error: {ended or _explain_signal(watched.allowed, -child.returncode)}", file=sys.stderr)
    return 2


def allow(
    name: str, command: str, size_bytes: int, limits: BoxLimits = BoxLimits(), verbose: bool = False
) -> Allowance:
    """What a command may take for an asset whose files have so many bytes; the environment may state other limits.

    Raises:
        FoliageError: The environment states what is no number above 0.
    """
    machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    stated_gib, stated_s = _stated(MEMORY_VARIABLE), _stated(TIME_VARIABLE)
    memory = min(limits.base_gib * _GIB + limits.memory_ratio * size_bytes, limits.machine_share * machine)
    seconds = limits.base_s + limits.seconds_per_mib * size_bytes / (1 << 20)
    return Allowance(
        name=name,
        memory_bytes=int(memory if stated_gib is None else stated_gib * _GIB),
        seconds=stated_s if stated_s is not None else None if command in _DRAWING else seconds,
        verbose=verbose,
    )


def _stated(variable: str) -> float | None:
    text = os.environ.get(variable, "").strip()
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise FoliageError(f"{variable} is {printable(text)!r}", "give a number above 0, or remove it")
    return value


def announce(options: argparse.Namespace, reports: int, limits: BoxLimits = BoxLimits()) -> None:
    """In the child: take limits for the asset that the command names, and report them to the parent."""
    asset: Path | None = getattr(options, "asset", None)
    size = measure(asset) if asset is not None else 0
    allowed = allow(printable(asset or ""), options.command, size, limits, options.verbose)
    os.write(reports, json.dumps(asdict(allowed)).encode() + b"\n")
    os.close(reports)
    _set_limits(allowed, limits, draws=options.command in _DRAWING)


def follow_parent() -> None:
    """In the child: end with the parent, however that ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def measure(asset: Path) -> int:
    """The bytes that the files of an asset take on the disk: its folder, or a file with what lies around it."""
    folder = asset if asset.is_dir() else asset.parent
    total = entries = 0
    for place, folders, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(OSError):
                total += os.lstat(os.path.join(place, name)).st_blocks * 512  # noqa: PTH118
        entries += len(names) + len(folders)
        if entries > _MAX_ENTRIES:
            break
    return total


def _set_limits(allowed: Allowance, limits: BoxLimits, draws: bool) -> None:
    import resource

    def lower(kind: int, value: int) -> None:
        _, hard = resource.getrlimit(kind)
        value = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(kind, (value, value))

    lower(resource.RLIMIT_CORE, 0)
    lower(resource.RLIMIT_FSIZE, int(limits.file_gib * _GIB))
    if not draws:  # graphics drivers reserve more addresses than a machine has memory
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

    def __init__(self, *, process: subprocess.Popen[bytes], reports: int, noise: int, allowed: Allowance) -> None:
        self.allowed = allowed
        self._process, self._reports, self._noise_pipe = process, reports, noise
        self._noise = b""
        self._started = time.monotonic()

    def wait(self) -> str:
        """Wait for its end, or end it; returns why it was ended, empty where it was not."""
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
                    if reason and self._process.poll() is None:
                        with contextlib.suppress(ProcessLookupError):
                            os.killpg(self._process.pid, signal.SIGKILL)
                        self._process.wait()
                        return reason
            finally:
                if ending is not None:
                    os.close(ending)
        for pipe in (self._reports, self._noise_pipe):
            self._read(pipe)
        return ""

    def noise_lines(self) -> list[str]:
        """What libraries printed, as far as it is kept."""
        return [printable(line) for line in self._noise.decode(errors="surrogateescape").splitlines() if line.strip()]

    def _read(self, pipe: int) -> bool:
        """Take what is in a pipe; False at its end."""
        try:
            data = os.read(pipe, _MAX_NOISE_BYTES)
        except BlockingIOError:
            return True
        if pipe == self._noise_pipe:
            self._noise = (self._noise + data)[-_MAX_NOISE_BYTES:]
        elif data:
            self.allowed = Allowance(**json.loads(data))
        return bool(data)

    def _excess(self) -> str:
        """What is above its limit, in words; empty for nothing."""
        name, seconds = self.allowed.name or "the asset", self.allowed.seconds
        if seconds is not None and time.monotonic() - self._started > seconds:
            return (
                f"{name} was not read within {seconds:.0f} s; it is damaged or larger than it seems: "
                f"if you trust it, set {TIME_VARIABLE} to more seconds"
            )
        if used_bytes(self._process.pid) > self.allowed.memory_bytes:
            gib = self.allowed.memory_bytes / _GIB
            return (
                f"{name} takes more than {gib:.1f} GiB of memory to read; it is damaged or larger than it seems: "
                f"if you trust it, set {MEMORY_VARIABLE} to more GiB"
            )
        return ""


def used_bytes(pid: int) -> int:
    """The memory of a process and of those that it started, without what files lend; 0 where it is not known."""
    total, waiting, page = 0, [pid], os.sysconf("SC_PAGE_SIZE")
    while waiting:
        folder = f"/proc/{waiting.pop()}"
        try:
            with open(f"{folder}/statm", encoding="ascii") as file:  # noqa: PTH123
                _, resident, shared, *_ = map(int, file.read().split())
            total += max(0, resident - shared) * page
            for task in os.listdir(f"{folder}/task"):  # noqa: PTH208
                with open(f"{folder}/task/{task}/children", encoding="ascii") as file:  # noqa: PTH123
                    waiting += map(int, file.read().split())
        except (OSError, ValueError):  # it ended meanwhile
            continue
    return total


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
    return f"{name} ended the process that read it ({called}); a file of it is damaged: write the asset again"
