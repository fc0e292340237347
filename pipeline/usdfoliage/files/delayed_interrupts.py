"""Blocks that an interrupt does not break off in their middle."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def interrupts_delayed() -> Iterator[None]:
    """The block ends before Ctrl-C, or a farm that ends the job, interrupts; what came meanwhile comes after it.

    Processes that are started in it begin with these signals blocked, until they call take_interrupts. In another
    thread than the main one nothing is delayed, as handlers run in the main thread alone.

    To block them in this thread is not enough: the system then hands them to another thread (a library of numpy
    has some), and Python runs their handlers in the main thread at once. So the handlers wait themselves.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    found = {number: signal.getsignal(number) for number in _INTERRUPTS}
    handlers = {number: handler for number, handler in found.items() if handler is not None}
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, _INTERRUPTS)
    try:
        for number in handlers:
            signal.signal(number, lambda number, _frame: received.append(number))
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)  # what was blocked comes here, and waits with the others
        for put_back, handler in handlers.items():
            signal.signal(put_back, handler)
        for one in received:
            signal.raise_signal(one)


def take_interrupts() -> None:
    """In a process that was started in interrupts_delayed: from here on these signals come, those that waited first."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _INTERRUPTS)
