"""Blocks that an interrupt does not break off in their middle."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def interrupts_delayed() -> Iterator[None]:
    """The block ends before Ctrl-C, or a farm that ends the job, interrupts; what came meanwhile comes after it.

    It is for a moment, as handlers alone can wait: where a signal ends the process at once, that is as a kill. In
    another thread than the main one nothing is delayed, as nothing interrupts it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: dict[int, FrameType | None] = {}
    handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
    try:
        for number in _INTERRUPTS:
            handler = signal.getsignal(number)
            if callable(handler):
                handlers[number] = handler
                signal.signal(number, received.__setitem__)
        yield
    finally:
        for each, earlier in handlers.items():
            signal.signal(each, earlier)
        for each, frame in received.items():
            handlers[each](each, frame)
