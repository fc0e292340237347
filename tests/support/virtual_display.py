"""What tests of windows need: the interpreter of the preview with Qt, and a display where there is none, Xvfb."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter


def python_with_qt() -> Path:
    """The interpreter of the preview; skips the test where there is none, or where it has no PySide6."""
    try:
        python = find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    if subprocess.run([str(python), "-c", "import PySide6"], capture_output=True, check=False).returncode:
        pytest.skip(f"{python} has no PySide6 (make setup installs it into .venv-preview)")
    return python


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
