"""Blender as a module, in the interpreter of previews."""

import subprocess

import pytest
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter


def blender_interpreter() -> str:
    """The interpreter that has bpy; the test is skipped, with the reason, where there is none."""
    try:
        python = find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    if subprocess.run([python, "-c", "import bpy"], capture_output=True, check=False).returncode:
        pytest.skip(f"{python} has no bpy, which is Blender as a module")
    return python
