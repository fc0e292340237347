#!/usr/bin/env python3
"""What assets cost to open and to draw, in each of their lods and as a shot of many; beside a former version's.

usage: tools/bench/draw_cost.py ASSET... [--former CHECKOUT --former-assets FOLDER] [--copies 2000] [--limit 300]

Of each lod: triangles before surfaces are refined, bytes of the layers that it opens, seconds to open the stage, and
seconds of the processor that one picture of 960 by 960 pixels takes with the defaults of usdfoliage preview. Of the
shot: the same plant so often, as native instances and by a PointInstancer. A former version draws the assets of the
same names in its folder, each right after the new one. The table is Markdown.
"""

import argparse
import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, Vt
from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.asset.resources import resource_folder

PURPOSES = ["default", "render"]
_OPEN = """
import sys, time
from pxr import Usd
start = time.perf_counter()
Usd.Stage.Open(sys.argv[1], Usd.Stage.LoadAll)
print(time.perf_counter() - start)
"""


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Of one thing to draw; None for what was not measured."""

    triangles: int
    layer_bytes: int
    open_s: float
    draw_s: float | None  # of the processor; None: not within the limit, or refused


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("assets", nargs="+", type=Path, metavar="ASSET")
    parser.add_argument("--former", type=Path, metavar="CHECKOUT", help="with its .venv; it draws the former assets")
    parser.add_argument("--former-assets", type=Path, metavar="FOLDER")
    parser.add_argument("--copies", type=int, default=2000, help="of each plant in a shot; 0 for no shots")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds by the clock for one picture")
    options = parser.parse_args()
    if (options.former is None) != (options.former_assets is None):
        parser.error("--former and --former-assets go together")
    versions = [(Path(sys.executable), None)]
    if options.former is not None:
        versions.append((options.former / ".venv" / "bin" / "python", options.former_assets))
    print("| plant | form | triangles | MB opened | open, s | draw, s |\n| --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory(prefix="usdfoliage-cost-") as name:
        for asset in options.assets:
            measure_asset(asset, versions, options.copies, options.limit, Path(name))


def measure_asset(
    asset: Path, versions: Sequence[tuple[Path, Path | None]], copies: int, limit_s: float, work: Path
) -> None:
    """Print the rows of an asset."""
    plants = [
        (python, interface_of(asset if folder is None else folder / asset.name)[0]) for python, folder in versions
    ]
    stage = Usd.Stage.Open(str(plants[0][1]), Usd.Stage.LoadNone)
    lods = stage.GetDefaultPrim().GetVariantSet("lod").GetVariantNames()
    for lod in lods:
        costs = []
        for python, interface in plants:
            file = write_lod(_new_file(work), interface, lod)
            costs.append(measure(file, python, limit_s, work))
        print_row(asset.name, lod, costs)
    for how in ("native instances", "PointInstancer") if copies else ():
        costs = []
        for python, interface in plants:
            file = write_shot(_new_file(work), interface, copies, how == "PointInstancer")
            costs.append(measure(file, python, limit_s, work))
        print_row(asset.name, f"{copies:,}, {how}", costs)


def write_lod(path: Path, interface: Path, lod: str) -> Path:
    """A layer that shows the asset in one lod."""
    stage = Usd.Stage.CreateInMemory()
    _set_axes(stage)
    plant = UsdGeom.Xform.Define(stage, "/Plant").GetPrim()
    plant.GetReferences().AddReference(str(interface.resolve()))
    plant.GetVariantSet("lod").SetVariantSelection(lod)
    stage.SetDefaultPrim(plant)
    stage.GetRootLayer().Export(str(path))
    return path


def write_shot(path: Path, interface: Path, copies: int, by_instancer: bool) -> Path:
    """A layer with a plant in a jittered square, turned at random, its neighbours as far apart as it is wide."""
    source = Usd.Stage.Open(str(interface), Usd.Stage.LoadNone)
    hint = UsdGeom.ModelAPI(source.GetDefaultPrim()).GetExtentsHint()
    width_m = float(max(hint[1][0] - hint[0][0], hint[1][2] - hint[0][2]))
    rng = np.random.default_rng(0)
    side = int(np.ceil(np.sqrt(copies)))
    places = np.stack([np.arange(copies) % side, np.arange(copies) // side], axis=1) + rng.uniform(
        -0.2, 0.2, (copies, 2)
    )
    positions = [Gf.Vec3d(float(width_m * x), 0, float(width_m * z)) for x, z in places]
    turns_deg = rng.uniform(0, 360, copies).tolist()
    stage = Usd.Stage.CreateInMemory()
    _set_axes(stage)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Shot").GetPrim())
    if by_instancer:
        instancer = UsdGeom.PointInstancer.Define(stage, "/Shot/Plants")
        plant = UsdGeom.Xform.Define(stage, "/Shot/Plants/Prototypes/Plant").GetPrim()
        plant.GetReferences().AddReference(str(interface.resolve()))
        instancer.CreatePrototypesRel().SetTargets([plant.GetPath()])
        instancer.CreateProtoIndicesAttr(Vt.IntArray(copies, 0))
        instancer.CreatePositionsAttr([Gf.Vec3f(place) for place in positions])
        up = Gf.Vec3d.YAxis()
        instancer.CreateOrientationsAttr([Gf.Quath(Gf.Rotation(up, turn).GetQuat()) for turn in turns_deg])
    else:
        for number, (place, turn) in enumerate(zip(positions, turns_deg, strict=True)):
            plant = UsdGeom.Xform.Define(stage, f"/Shot/Plant_{number:05}")
            plant.AddTranslateOp().Set(place)
            plant.AddRotateYOp().Set(turn)
            plant.GetPrim().GetReferences().AddReference(str(interface.resolve()))
            plant.GetPrim().SetInstanceable(True)
    stage.GetRootLayer().Export(str(path))
    return path


def measure(file: Path, python: Path, limit_s: float, work: Path) -> Cost:
    """What a file costs to open, by this version's USD, and to draw, by the preview of python."""
    opened = subprocess.run([sys.executable, "-c", _OPEN, str(file)], capture_output=True, text=True, check=True)
    stage = Usd.Stage.Open(str(file), Usd.Stage.LoadAll)
    layers = {Path(layer.realPath) for layer in stage.GetUsedLayers() if layer.realPath}
    return Cost(
        triangles=_weigh(stage),
        layer_bytes=sum(layer.stat().st_size for layer in layers if layer != file),
        open_s=float(opened.stdout),
        draw_s=time_picture(file, python, limit_s, work),
    )


def time_picture(file: Path, python: Path, limit_s: float, work: Path) -> float | None:
    """Seconds of the processor that a picture takes; None where none is drawn."""
    words = [str(python), "-m", "usdfoliage", "preview", str(file), "-o", str(work / "picture.png")]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        ended, status, usage = os.wait4(process.pid, os.WNOHANG)
        if ended:
            process.returncode = os.waitstatus_to_exitcode(status)
            return usage.ru_utime + usage.ru_stime if process.returncode == 0 else None
        time.sleep(0.05)
    os.killpg(process.pid, 9)
    process.wait()
    return None


def print_row(name: str, form: str, costs: Sequence[Cost]) -> None:
    """A row of the table; where there are two costs, the former one stands first."""
    ordered = [*costs[1:], costs[0]]
    cells = [
        " → ".join(f"{cost.triangles:,}" for cost in ordered),
        " → ".join(f"{cost.layer_bytes / 1e6:.1f}" for cost in ordered),
        " → ".join(f"{cost.open_s:.2f}" for cost in ordered),
        " → ".join("none" if cost.draw_s is None else f"{cost.draw_s:.1f}" for cost in ordered),
    ]
    print(f"| {name} | {form} | {' | '.join(cells)} |", flush=True)


def _new_file(work: Path) -> Path:
    """A file that no open layer is of."""
    return work / f"scene_{len(list(work.iterdir()))}.usda"


def _weigh(stage: Usd.Stage) -> int:
    """Triangles as the preview counts them, by its own module, which imports nothing of usdfoliage."""
    found = importlib.util.spec_from_file_location("weight", resource_folder("hydra_preview") / "weight.py")
    assert found is not None
    assert found.loader is not None
    weight = importlib.util.module_from_spec(found)
    sys.modules["weight"] = weight
    found.loader.exec_module(weight)
    return int(weight.weigh(stage, Usd.TimeCode.Default(), PURPOSES).drawn(0))


def _set_axes(stage: Usd.Stage) -> None:
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)


if __name__ == "__main__":
    main()
