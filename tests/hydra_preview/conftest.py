"""A display for the tests of windows."""

import subprocess

import pytest
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter

from tests.support.virtual_display import missing, virtual_display


@pytest.fixture(scope="module")
def display():
    try:
        python = find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    if subprocess.run([str(python), "-c", "import PySide6"], capture_output=True, check=False).returncode:
        pytest.skip(f"{python} has no PySide6 (make setup installs it into .venv-preview)")
    if missing():
        pytest.skip(missing())
    with virtual_display() as name, pytest.MonkeyPatch.context() as patch:
        patch.setenv("DISPLAY", name)
        patch.delenv("WAYLAND_DISPLAY", raising=False)
        patch.delenv("QT_QPA_PLATFORM", raising=False)
        yield name
