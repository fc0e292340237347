"""How property tests look for examples: the same ones every time, or, with HYPOTHESIS_PROFILE=explore, new ones."""

import os
import subprocess

import pytest
from hypothesis import settings
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter

# On a loaded machine the time of an example is no measure.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


def pytest_collection_modifyitems(items):
    """Skip what draws where nothing can draw it, before any fixture tries."""
    try:
        find_interpreter()
    except PreviewError as error:
        absent = pytest.mark.skip(reason=f"the preview interpreter is absent: {error}")
        for item in items:
            if item.get_closest_marker("preview"):
                item.add_marker(absent)


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 600 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", str(disk)]
    mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    if mounted.returncode:
        pytest.skip(f"a small tmpfs cannot be mounted, it needs root: {mounted.stderr.strip()}")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)
