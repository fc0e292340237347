"""Interrupts on the command line."""

import signal
import threading
from types import FrameType


def handle_interrupts() -> None:
    """From here on Ctrl-C, and a farm that ends the job, stop it in good order: nothing half-made stays behind.

    Commands call it when everything heavy is imported, since pxr swallows what arrives while it loads.
    """
    if threading.current_thread() is not threading.main_thread():
        return  # handlers belong to the main thread
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _interrupt)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
