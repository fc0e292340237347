"""Processes of this machine that do tasks, and end when the process ends that has opened them, however it ends."""

import io
import logging
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import ParamSpec, TypeVar

from usdfoliage.files.delayed_interrupts import interrupts_delayed, take_interrupts
from usdfoliage.files.printable import PrintableFormatter
from usdfoliage.jobs.plant.executors import Workers

_P = ParamSpec("_P")
_T = TypeVar("_T")


class _Processes(ProcessPoolExecutor):
    """Processes whose start an interrupt waits for.

    A task that is given may start a process. An interrupt between its start and the moment when it hears what to
    do, and when its executor watches it, leaves it with nothing, and it dies with a traceback of its own.
    """

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        with interrupts_delayed():
            return super().submit(fn, *args, **kwargs)


@contextmanager
def open_processes(jobs: int) -> Iterator[Workers]:
    """So many processes; each begins anew, for OpenGL, USD and threads do not survive a fork.

    When the body fails or is interrupted, what they do is broken off.
    """
    context = multiprocessing.get_context("spawn")
    # A helper of multiprocessing that is killed is started again, and nothing is lost: no words of Python about it.
    warnings.filterwarnings("ignore", "resource_tracker: process died unexpectedly", UserWarning)
    end_signal, end = context.Pipe(duplex=False)
    heard = _share_stderr()
    opened: list[_Processes] = []

    def open_executor() -> ProcessPoolExecutor:
        opened.append(_Processes(jobs, mp_context=context, initializer=_follow, initargs=(end_signal, heard)))
        return opened[-1]

    try:
        yield Workers(open_executor=open_executor, count=lambda: jobs)
    except BaseException:
        end.close()
        raise
    finally:
        for executor in opened:
            executor.shutdown(wait=True, cancel_futures=True)
        end.close()
        end_signal.close()
        if heard is not None:
            heard.close()


def _share_stderr() -> Connection | None:
    """A copy of sys.stderr that a new process can be given, as descriptor 2 may be the libraries' alone."""
    try:
        return Connection(os.dup(sys.stderr.fileno()), readable=False)
    except (AttributeError, OSError):  # a stream that is no file
        return None


def threads_each(jobs: int) -> int:
    """Threads of a task where so many run at once."""
    return max(1, (os.cpu_count() or 1) // jobs)


def _follow(end_signal: Connection, heard: Connection | None) -> None:
    """In a worker: end with the process that has opened it, which alone hears Ctrl-C.

    A worker of concurrent.futures whose parent is killed would wait for work for ever.
    """
    if heard is not None:
        raw = io.BufferedWriter(io.FileIO(os.dup(heard.fileno()), "w"))
        sys.stderr = io.TextIOWrapper(raw, encoding="utf-8", errors="backslashreplace", line_buffering=True)
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(PrintableFormatter("%(levelname)s: %(message)s"))
        logging.basicConfig(level=logging.WARNING, handlers=[handler])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    take_interrupts()

    def end() -> None:
        try:
            end_signal.recv_bytes()
        except (EOFError, OSError):
            os._exit(1)  # a task that is broken off has no stamp, and is done again

    threading.Thread(target=end, daemon=True, name="usdfoliage-end").start()
