"""The interactive viewer: a window of the preview interpreter, and what this process does for it.

The window draws and edits; what a leaf is and how a look is written it asks here, a line of JSON each:

    {"op": "leaf", "asset": file, "edits": {…}}                  {"curves": [{"name", "points", "controls"}]}
    {"op": "bounds", "asset": file, "edits": {…}}                {"bounds": [{"leaf", "among"}]}, two corners each
    {"op": "save", "asset": file, "edits": {…}, "path": file}    {"written": file}

and, for what cannot be done, {"error": text}. Edits have the names of usdfoliage.leaf.shape.edits.LeafEdits. The
plug-in of usdview asks the same of `usdfoliage view`.
"""

import json
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
from usdfoliage.errors import FoliageError, PreviewError
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.jobs.preview.pictures import file_to_draw, write_dome
from usdfoliage.jobs.preview.recorder import find_interpreter
from usdfoliage.jobs.preview.window import read_script, require_display, run_window
from usdfoliage.leaf.model import Leaves, mean_leaf
from usdfoliage.leaf.shape.bounds import common_bounds, leaf_bounds_m
from usdfoliage.leaf.shape.curves import leaf_curves
from usdfoliage.leaf.shape.edits import LeafEdits, apply_edits
from usdfoliage.leaf.shape.jitter import Jitter

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
    require_display()
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
            "script": read_script(settings.script) if settings.script else None,
            "width_px": settings.width_px,
            "height_px": settings.height_px,
        }
        run_window(python, request, work, answer_requests)


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


def _capture_layer(capture: Path) -> Path:
    layer = capture / CAPTURE_LAYER if capture.is_dir() else capture
    if not layer.is_file():
        raise PreviewError(f"{layer} is missing; `usdfoliage capture {capture}` writes it")
    return layer.resolve()
