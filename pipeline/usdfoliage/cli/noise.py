"""What libraries print by themselves does not reach a terminal.

libpng, libtiff, OpenEXR, USD and others write to the descriptors 1 and 2, past Python, raw bytes of files among it.
So a command keeps these two for itself under other numbers and puts a pipe in their place, once, before any thread
begins. Writing to the pipe never waits: what does not fit is lost. A process that is started later has the pipe too;
one that shall be heard gets a copy of ours (usdfoliage.jobs.plant.processes).
"""

import io
import os
import select
import sys
import threading
import traceback
import warnings
from contextlib import suppress
from types import TracebackType
from typing import Any, TextIO

from usdfoliage.files.printable import printable

MAX_BYTES = 1 << 16  # the last that are kept


class PrintableStream(io.TextIOWrapper):
    """A stream in which no name of a file acts on a terminal."""

    def write(self, text: str) -> int:
        """As of every stream; tabs and ends of lines stay."""
        if text.isprintable() or text == "\n":
            return super().write(text)
        lines = ("\t".join(map(printable, line.split("\t"))) for line in text.split("\n"))
        super().write("\n".join(lines))
        return len(text)


class Noise:
    """What libraries printed since divert_libraries, the end of it."""

    def __init__(self, pipe: int) -> None:
        self._pipe, self._kept, self._lock = pipe, b"", threading.Lock()
        os.set_blocking(pipe, False)
        threading.Thread(target=self._follow, daemon=True, name="usdfoliage-noise").start()

    def lines(self) -> list[str]:
        """Each in a form that a terminal can show."""
        with self._lock:
            self._take()
            return noise_lines(self._kept)

    def _follow(self) -> None:
        while True:
            select.select([self._pipe], [], [])
            with self._lock:
                self._take()

    def _take(self) -> None:
        try:
            while data := os.read(self._pipe, MAX_BYTES):
                self._kept = (self._kept + data)[-MAX_BYTES:]
        except BlockingIOError:
            return


def noise_lines(data: bytes) -> list[str]:
    """The lines of what libraries printed, each in a form that a terminal can show."""
    return [printable(line) for line in data.decode(errors="surrogateescape").splitlines() if line.strip()]


def divert_libraries() -> Noise:
    """Give libraries a pipe in place of this process's stdout and stderr, for as long as it lives."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    move_streams(write)
    os.close(write)
    return Noise(read)


def move_streams(noise: int) -> None:
    """Move sys.stdout and sys.stderr to descriptors of their own, and put a pipe where they were.

    Exceptions that compiled code prints instead of raising them, as USD does while it unpacks a damaged crate, go
    there too, and so do the warnings of Python modules, as numpy's on numbers that nothing can be done with.
    """
    sys.stdout, sys.stderr = _moved(sys.stdout, 1, noise), _moved(sys.stderr, 2, noise)
    vars(sys).update(__stdout__=sys.stdout, __stderr__=sys.stderr)  # by which the width of a terminal is asked
    sys.excepthook = _print_exception
    warnings.showwarning = _print_warning


def _print_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """A warning of a Python module, where the noise of libraries goes."""
    _write_noise(warnings.formatwarning(message, category, filename, lineno, line))


def _print_exception(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """What Python does with an exception that nobody takes, but for those that began outside of Python."""
    if trace is not None:
        sys.__excepthook__(kind, error, trace)
        return
    _write_noise("".join(traceback.format_exception_only(kind, error)))


def _write_noise(text: str) -> None:
    with suppress(BlockingIOError):  # the pipe is full: what does not fit is lost
        os.write(2, text.encode(errors="backslashreplace"))


def _moved(stream: Any, number: int, noise: int) -> Any:
    """A stream of ours on a descriptor of its own, and the noise of libraries in its old place."""
    if stream is None or stream.fileno() != number:  # closed, as by a daemon
        return stream
    stream.flush()
    kept = os.dup(number)
    os.dup2(noise, number)
    is_line = number == 2 or os.isatty(kept)
    kind = PrintableStream if number == 1 else io.TextIOWrapper  # a bar on stderr steers the terminal
    return kind(
        io.BufferedWriter(io.FileIO(kept, "w")), encoding=stream.encoding, errors=stream.errors, line_buffering=is_line
    )
