"""The window of `usdfoliage view`: viewer.py REQUEST.json RESULT.json REQUEST_FD REPLY_FD, in the preview interpreter.

The request and the result are described in README.md; over the two pipes it asks the process that started it what only
usdfoliage knows (usdfoliage.jobs.preview.viewer).
"""

import json
import os
import sys
from pathlib import Path

from record import RecordError, load_usd, open_stage

sys.path.append(str(Path(__file__).resolve().parents[1] / "usd_plugins"))  # the panel


def show(request: dict, request_fd: int, reply_fd: int) -> dict:
    """Show the window until it is closed, or the script has ended; returns the result."""
    version = load_usd()
    try:
        from PySide6 import QtGui, QtWidgets
        from storm_view import surface_format
        from view_script import ScriptError, run_script, settle
    except ModuleNotFoundError as error:
        raise RecordError("qt", str(error)) from error
    except ImportError as error:  # a shared library that does not load
        raise RecordError("library", str(error)) from error
    QtGui.QSurfaceFormat.setDefaultFormat(surface_format())
    application = QtWidgets.QApplication(["usdfoliage"])
    failures: list[str] = []
    open_window = _open_drawing if "photo" in request else _open_asset
    window, actions = open_window(request, request_fd, reply_fd, failures)
    window.show()
    try:
        if request["script"] is None:
            application.exec()
        else:
            settle(window)
            run_script(window, request["script"], actions)
    except ScriptError as error:
        raise RecordError("script", str(error)) from error
    if failures:
        raise RecordError("gl" if "OpenGL" in failures[0] else "draw", failures[0])
    return {"usd_version": version}


def _open_asset(request: dict, request_fd: int, reply_fd: int, failures: list[str]):
    """The window on an asset, and the actions of its scripts."""
    from captured import add_capture
    from usdviewFoliage.plants import find_plants
    from usdviewFoliage.product import inherited_product
    from view_script import ACTIONS
    from view_window import ViewWindow

    stage = open_stage(request["usd_file"], [])
    if request["capture"]:
        plants = find_plants(stage)
        if not plants:
            raise RecordError("file", "there is no plant to lay the capture over")
        add_capture(stage, request["capture"], plants[0])
    window = ViewWindow(stage, request, inherited_product(request_fd, reply_fd))
    window.view.failed.connect(failures.append)
    window.view.failed.connect(window.close)
    return window, ACTIONS


def _open_drawing(request: dict, request_fd: int, reply_fd: int, failures: list[str]):
    """The window on a photograph, and the actions of its scripts."""
    from drawing_link import DrawingLink
    from drawing_script import ACTIONS
    from drawing_window import DrawingWindow

    window = DrawingWindow(request, DrawingLink(request_fd, reply_fd))
    window.grown.failed.connect(failures.append)  # strokes can be drawn and saved without the tree
    return window, ACTIONS


def main(request_path: str, result_path: str, request_fd: str, reply_fd: str) -> None:
    request = json.loads(Path(request_path).read_text(encoding="utf-8"))
    try:
        result = show(request, int(request_fd), int(reply_fd))
    except RecordError as error:
        result = {"error": {"kind": error.kind, "message": str(error)}}
    Path(result_path).write_text(json.dumps(result), encoding="utf-8")
    sys.stdout.flush()
    sys.stderr.flush()
    # Storm's and Blender's clean-up may crash a process that has done its work.
    os._exit(1 if "error" in result else 0)


if __name__ == "__main__":
    main(*sys.argv[1:5])
