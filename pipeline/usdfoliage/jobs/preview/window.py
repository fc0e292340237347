"""A window of the preview interpreter: started, answered while it is open, and its end put into words."""

import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from usdfoliage.asset.resources import resource_folder
from usdfoliage.errors import PreviewError
from usdfoliage.files.children import bound_command
from usdfoliage.files.json import read_json
from usdfoliage.jobs.preview.recorder import (
    describe_crash,
    describe_refusal,
    read_result,
    recorder_environment,
    sort_complaints,
)

logger = logging.getLogger(__name__)


def run_window(
    python: Path, request: Mapping[str, Any], work: Path, answer: Callable[[BinaryIO, BinaryIO], None]
) -> None:
    """Show a window until it is closed.

    Args:
        python: The preview interpreter.
        request: As hydra_preview/README.md describes it; "file" is as the user named it.
        work: A folder for files.
        answer: Called with what the window asks, a line of JSON each, and where replies go; it returns at its end.

    Raises:
        PreviewError: The window cannot be shown, or failed.
    """
    viewer = resource_folder("hydra_preview") / "viewer.py"
    request_file, result_file, complaints_file = work / "request.json", work / "result.json", work / "stderr.txt"
    request_file.write_text(json.dumps(request), encoding="utf-8")
    asked, asks = os.pipe()
    answered, answers = os.pipe()
    with complaints_file.open("wb") as complaints:
        try:
            process = subprocess.Popen(
                bound_command(
                    [str(python), str(viewer), str(request_file), str(result_file), str(asks), str(answered)]
                ),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=complaints,
                pass_fds=(asks, answered),
                env=recorder_environment(work),
            )
        except OSError as error:
            raise PreviewError(f"the preview interpreter cannot be started: {error.strerror} ({python})") from error
        finally:
            os.close(asks)
            os.close(answered)
        try:
            with os.fdopen(asked, "rb") as requests, os.fdopen(answers, "wb") as replies:
                answer(requests, replies)
            process.wait()
        finally:
            process.kill()  # does nothing to one that has ended
            process.wait()
    text = complaints_file.read_text(encoding="utf-8", errors="replace")
    logger.info("output of the viewer: %s", text.strip() or "nothing")
    result = read_result(result_file)
    if result is None:
        raise PreviewError(describe_end(process.returncode, text, python))
    if "error" in result:
        kind, message = result["error"]["kind"], result["error"]["message"]
        raise PreviewError(
            f"the preview interpreter has no Qt: {message}; pip install PySide6-Essentials into it ({python})"
            if kind == "qt"
            else describe_refusal(kind, message, str(request["file"]))
        )
    faults, _ = sort_complaints(text)
    if faults:
        raise PreviewError(f"Storm could not draw all of it: {'; '.join(faults)} ({request['file']})")


def read_script(path: Path) -> list[Any]:
    """The actions of a file; PreviewError where there are none."""
    try:
        actions = read_json(path)
    except OSError as error:
        raise PreviewError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise PreviewError(f"{path} is no JSON: {error}") from error
    if not isinstance(actions, list) or not all(isinstance(action, dict) and len(action) == 1 for action in actions):
        raise PreviewError(f"{path} must be a list of actions, an object with one key each")
    return actions


def require_display() -> None:
    """Raise PreviewError where a window cannot be shown."""
    if not sys.platform.startswith("linux") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    ):
        return
    raise PreviewError(
        "there is no display for a window (DISPLAY is not set); start it on a desktop, with `ssh -X`, or under "
        "`xvfb-run`; `usdfoliage preview` draws pictures without a display"
    )


def describe_end(code: int, complaints: str, python: Path) -> str:
    """Why a window ended without a result."""
    if "could not connect to display" in complaints or "no Qt platform plugin" in complaints:
        display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or os.environ.get("QT_QPA_PLATFORM")
        return (
            f"the display {display} cannot be used; set DISPLAY to one that can, or use `xvfb-run`; on Debian a window "
            "needs libxcb-cursor0 and the other packages of `make setup`"
        )
    return describe_crash(code, complaints, python)
