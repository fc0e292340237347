"""A display for the tests of windows."""

import pytest

from tests.support.virtual_display import missing, python_with_qt, virtual_display


@pytest.fixture(scope="module")
def display():
    python_with_qt()
    if missing():
        pytest.skip(missing())
    with virtual_display() as name, pytest.MonkeyPatch.context() as patch:
        patch.setenv("DISPLAY", name)
        patch.delenv("WAYLAND_DISPLAY", raising=False)
        patch.delenv("QT_QPA_PLATFORM", raising=False)
        yield name
