"""How property tests look for examples, and in which order tests run.

Examples are the same ones every time, or, with HYPOTHESIS_PROFILE=explore, new ones.
"""

import os
import subprocess
from pathlib import Path

import pytest
from hypothesis import settings
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter

# On a loaded machine the time of an example is no measure.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

# Of one process of two that gets a file at a time: a file of minutes that came last would leave the other one idle.
WHOLE_RUNS = ("cli", "jobs", "hydra_preview", "bench", "tools", "api", "usd_plugins", "asset")


def pytest_collection_modifyitems(items):
    """Begin with the folders whose files take long, and skip what draws where nothing can, before any fixture tries."""
    here = Path(__file__).parent
    late = len(WHOLE_RUNS)
    rank = {name: number for number, name in enumerate(WHOLE_RUNS)}
    items.sort(key=lambda item: rank.get(item.path.relative_to(here).parts[0], late))
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
