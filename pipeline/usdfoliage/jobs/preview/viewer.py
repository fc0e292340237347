"""The interactive viewer: a window of the preview interpreter, and what this process does for it.

The window draws and edits; what a leaf is and how a look is written it asks here, a line of JSON each:

    {"op": "leaf", "asset": file, "edits": {…}}                  {"curves": [{"name", "points", "controls"}]}
    {"op": "bounds", "asset": file, "edits": {…}}                {"bounds": [{"leaf", "among"}]}, two corners each
    {"op": "save", "asset": file, "edits": {…}, "path": file}    {"written": file}

and, for what cannot be done, {"error": text}. Edits have the names of usdfoliage.leaf.shape.edits.LeafEdits. The
plug-in of usdview asks the same of `usdfoliage view`.
"""

import json
import logging
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.locate import find_interface, require_leaves, select_leafy_lod, select_representation, try_layer
from usdfoliage.asset.look_layer import BEZIER
from usdfoliage.asset.looks.look import open_asset, read_look, write_look_layer
from usdfoliage.asset.materials.jitter_map import read_jitter_map
from usdfoliage.asset.packages.contents import representations, require_plant
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.asset.resources import resource_folder
from usdfoliage.errors import FoliageError, PreviewError
from usdfoliage.files.children import bound_command
from usdfoliage.files.json import read_json
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.jobs.preview.pictures import file_to_draw, write_dome
from usdfoliage.jobs.preview.recorder import (
    describe_crash,
    describe_refusal,
    find_interpreter,
    read_result,
    recorder_environment,
    sort_complaints,
)
from usdfoliage.leaf.model import Leaves, mean_leaf
from usdfoliage.leaf.shape.bounds import common_bounds, leaf_bounds_m
from usdfoliage.leaf.shape.curves import leaf_curves
from usdfoliage.leaf.shape.edits import LeafEdits, apply_edits
from usdfoliage.leaf.shape.jitter import Jitter

logger = logging.getLogger(__name__)

CAPTURE_LAYER = "capture.usda"


@dataclass(frozen=True, kw_only=True)
class ViewerSettings:
    """What the window shows at first."""

    width_px: int = 1280
    height_px: int = 800
    capture: Path | None = None  # a capture's folder, whose cameras and cloud are shown too
    script: Path | None = None  # actions to do, and then end; hydra_preview/README.md lists them

    def __post_init__(self) -> None:
        if min(self.width_px, self.height_px) < 200:
            raise ValueError(f"the window must have 200 x 200 pixels at least, not {self.width_px} x {self.height_px}")


def view_asset(asset: Path, settings: ViewerSettings = ViewerSettings()) -> None:
    """Show an asset, a look over its asset, or a scene in a window, until it is closed.

    Raises:
        FoliageError: There is no such asset, no preview interpreter, no display, no OpenGL, or the window failed.
    """
    usd_file = find_interface(asset)
    open_asset(usd_file)  # raises where it cannot be opened
    python = find_interpreter()
    _require_display()
    layer, _ = try_layer(usd_file)
    look = read_look(layer) if layer is not None else None
    with temporary_folder("view", PreviewError) as work:
        write_dome(work / "dome.exr")
        request = {
            "usd_file": str(file_to_draw(usd_file, work).resolve()),
            "look": str(usd_file.resolve()) if look else "",
            "file": str(usd_file),
            "title": usd_file.name,
            "dome_texture": str(work / "dome.exr"),
            "capture": str(_capture_layer(settings.capture)) if settings.capture else "",
            "script": _read_script(settings.script) if settings.script else None,
            "width_px": settings.width_px,
            "height_px": settings.height_px,
        }
        _run_window(python, request, work)


def _run_window(python: Path, request: Mapping[str, Any], work: Path) -> None:
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
                answer_requests(requests, replies)
            process.wait()
        finally:
            process.kill()  # does nothing to one that has ended
            process.wait()
    text = complaints_file.read_text(encoding="utf-8", errors="replace")
    logger.info("output of the viewer: %s", text.strip() or "nothing")
    result = read_result(result_file)
    if result is None:
        raise PreviewError(_describe_end(process.returncode, text, python))
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


def answer_requests(requests: BinaryIO, replies: BinaryIO) -> None:
    """Answer one line after the other until there are no more."""
    for line in requests:
        try:
            reply = _answer(json.loads(line))
        except (FoliageError, OSError, ValueError, KeyError, TypeError) as error:
            reply = {"error": str(error)}
        try:
            replies.write(json.dumps(reply).encode() + b"\n")
            replies.flush()
        except BrokenPipeError:  # the window is gone
            return


def _answer(request: Mapping[str, Any]) -> dict[str, Any]:
    asset, edits = Path(request["asset"]), _read_edits(request["edits"])
    if request["op"] == "leaf":
        return {"curves": average_leaf(asset, edits)}
    if request["op"] == "bounds":
        return {"bounds": edited_bounds(asset, edits)}
    if request["op"] == "save":
        return {"written": str(write_look_layer(Path(request["path"]), asset, edits))}
    raise ValueError(f"nothing is known of {request['op']!r}; leaf, bounds and save are")


def average_leaf(asset: Path, edits: LeafEdits) -> list[dict[str, Any]]:
    """The curves of an asset's average leaf under edits, as JSON has them."""
    leaves = _stored_leaves(asset, _stamp(asset))
    curves = leaf_curves(apply_edits(leaves[0].mean[None], edits)[0], leaves[0].jitter(edits))
    return [
        {"name": curve.name, "points": curve.points.tolist(), "controls": curve.controls.tolist()} for curve in curves
    ]


def edited_bounds(asset: Path, edits: LeafEdits) -> list[dict[str, Any]]:
    """What holds the edited leaves of each prim: one leaf in leaf space, and all in the space of the prim."""
    found = []
    for leaves in _stored_leaves(asset, _stamp(asset)):
        edited = replace(leaves.leaves, parameters=apply_edits(leaves.leaves.parameters, edits))
        jitter = leaves.jitter(edits)
        box, among = common_bounds(edited.parameters, jitter), leaf_bounds_m(edited, jitter)
        found.append({"leaf": box.tolist(), "among": among.tolist()})
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _StoredLeaves:
    """The leaves of one prim, before their edits."""

    leaves: Leaves
    mean: NDArray[np.float64]  # (7, 3), of all prims of the asset
    wave: NDArray[np.float64] | None  # (M,), the map of their jitter

    def jitter(self, edits: LeafEdits) -> Jitter:
        return Jitter(amplitude=edits.jitter_amplitude, frequency=edits.jitter_frequency, map=self.wave)


@lru_cache(maxsize=4)
def _stored_leaves(asset: Path, stamp: int) -> list[_StoredLeaves]:
    """The leaves of every prim; stamp differs between versions of a file."""
    del stamp
    stage = open_asset(asset)
    select_leafy_lod(stage)
    if representations(require_plant(stage, asset, one=False)):
        select_representation(stage, BEZIER)
    leaves = [read_leaves(prim) for prim in require_leaves(stage, asset)]
    parameters = np.concatenate([one.leaves.parameters for one in leaves])
    if not len(parameters):
        raise FoliageError(f"{asset} has no leaf to show")
    mean = mean_leaf(parameters)
    return [
        _StoredLeaves(leaves=one.leaves, mean=mean, wave=read_jitter_map(one.jitter_map) if one.jitter_map else None)
        for one in leaves
    ]


def _stamp(asset: Path) -> int:
    return asset.stat().st_mtime_ns if asset.exists() else 0


def _read_edits(stored: Mapping[str, Any]) -> LeafEdits:
    known = {field.name for field in fields(LeafEdits)}
    if unknown := sorted(set(stored) - known):
        raise ValueError(f"no edit is called {', '.join(unknown)}")
    values: dict[str, Any] = {
        name: tuple(map(float, value)) if isinstance(value, list) else float(value) for name, value in stored.items()
    }
    return LeafEdits(**values)


def _read_script(path: Path) -> list[Any]:
    try:
        actions = read_json(path)
    except OSError as error:
        raise PreviewError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise PreviewError(f"{path} is no JSON: {error}") from error
    if not isinstance(actions, list) or not all(isinstance(action, dict) and len(action) == 1 for action in actions):
        raise PreviewError(f"{path} must be a list of actions, an object with one key each")
    return actions


def _capture_layer(capture: Path) -> Path:
    layer = capture / CAPTURE_LAYER if capture.is_dir() else capture
    if not layer.is_file():
        raise PreviewError(f"{layer} is missing; `usdfoliage capture {capture}` writes it")
    return layer.resolve()


def _require_display() -> None:
    if not sys.platform.startswith("linux") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    ):
        return
    raise PreviewError(
        "there is no display for a window (DISPLAY is not set); start it on a desktop, with `ssh -X`, or under "
        "`xvfb-run`; `usdfoliage preview` draws pictures without a display"
    )


def _describe_end(code: int, complaints: str, python: Path) -> str:
    if "could not connect to display" in complaints or "no Qt platform plugin" in complaints:
        display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or os.environ.get("QT_QPA_PLATFORM")
        return (
            f"the display {display} cannot be used; set DISPLAY to one that can, or use `xvfb-run`; on Debian a window "
            "needs libxcb-cursor0 and the other packages of `make setup`"
        )
    return describe_crash(code, complaints, python)
