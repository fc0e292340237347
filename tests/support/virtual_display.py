"""A display for windows where there is none: Xvfb."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager


def missing() -> str:
    """Why there can be none; empty where there can."""
    return "" if shutil.which("Xvfb") else "Xvfb is not installed (make setup-test installs it)"


@contextmanager
def virtual_display() -> Iterator[str]:
    """The name of a display that lives as long as the context."""
    number, ready = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(ready), "-screen", "0", "1280x1024x24", "-nolisten", "tcp"],
        pass_fds=(ready,),
        stderr=subprocess.DEVNULL,
    )
    os.close(ready)
    try:
        with os.fdopen(number) as answer:
            yield f":{answer.readline().strip()}"
    finally:
        server.terminate()
        server.wait()
