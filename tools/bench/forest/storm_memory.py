#!/usr/bin/env python3
"""What Storm keeps on the GPU of a forest's plants, for each level of all of them: shapes, instances and textures.

usage: tools/bench/forest/storm_memory.py CROWN [--plants 2000] [--complexity low medium high]

CROWN is the asset of all plants. Storm states the bytes itself (GetRenderStats), so that neither the driver nor what
Python needs counts. Shapes are the buffers of points and faces of one crown, which all plants share: they are measured
in a forest of one plant. What the ground needs is taken off.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from usdfoliage.asset.packages.forest_package import LEVEL
from usdfoliage.jobs.preview.recorder import find_interpreter

from tools.bench.forest.levels import write_bare, write_ridge

SIDE_M = 300.0
COMPLEXITIES = {"low": 1.0, "medium": 1.1, "high": 1.2, "veryhigh": 1.3}
RECORDER = Path(__file__).parents[3] / "hydra_preview"
INSIDE = """
import json, sys
sys.path.insert(0, sys.argv[1])
import gl_context, record
record.load_usd()
gl_context.make_context()
from pxr import Gf, Usd, UsdGeom, UsdImagingGL
file, variant_set, level, complexity = sys.argv[2:]
stage = Usd.Stage.Open(file)
if level:
    stage.GetDefaultPrim().GetVariantSet(variant_set).SetVariantSelection(level)
engine = UsdImagingGL.Engine()
engine.SetRendererAov("color")
engine.SetRenderBufferSize(Gf.Vec2i(160, 120))
box = UsdGeom.BBoxCache(1, ["default", "render"]).ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange()
middle, size = box.GetMidpoint(), box.GetSize().GetLength()
eye = Gf.Matrix4d().SetLookAt(middle + Gf.Vec3d(0, size, size), middle, Gf.Vec3d(0, 1, 0))
frustum = Gf.Frustum()
frustum.SetPerspective(50, 4 / 3, size / 100, size * 10)
engine.SetCameraState(eye, frustum.ComputeProjectionMatrix())
params = UsdImagingGL.RenderParams()
params.frame, params.showRender, params.showProxy, params.complexity = 1, True, True, float(complexity)
engine.Render(stage.GetPseudoRoot(), params)
engine.Render(stage.GetPseudoRoot(), params)
print(json.dumps({name: value for name, value in engine.GetRenderStats().items() if isinstance(value, int)}))
"""


def measure(interface: Path, level: str, complexity: float) -> dict[str, int]:
    """Storm's own numbers of bytes, of a forest with all plants in a level; the ground alone without one."""
    words = [str(find_interpreter()), "-c", INSIDE, str(RECORDER), str(interface), LEVEL, level, str(complexity)]
    printed = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    numbers: dict[str, int] = json.loads(printed.splitlines()[-1])
    return numbers


def make_forest(folder: Path, crown: Path, plants: int) -> Path:
    folder.mkdir()
    words = write_ridge(folder, crown, plants, SIDE_M)
    command = [sys.executable, "-m", "usdfoliage", "forest", *words, "--no-preview", "-o", str(folder / "forest")]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder / "forest" / "forest.usda"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("crown", metavar="CROWN", type=Path)
    parser.add_argument("--plants", type=int, default=2000)
    parser.add_argument("--complexity", nargs="+", choices=list(COMPLEXITIES), default=["low", "medium", "high"])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        one = make_forest(Path(scratch) / "one", options.crown, 1)
        many = make_forest(Path(scratch) / "many", options.crown, options.plants)
        ground = {forest: measure(write_bare(forest), "", 1.0) for forest in (one, many)}
        print("| level | complexity | shapes kB | bytes more an instance | textures kB |")
        print("| --- | --- | --- | --- | --- |", flush=True)
        shapes: dict[tuple[str, str], int] = {}
        for level, complexities in (("relief", ["low"]), ("crown", options.complexity)):
            for complexity in complexities:
                single, all_ = (measure(forest, level, COMPLEXITIES[complexity]) for forest in (one, many))
                # Of the ground at the same complexity: relief is no subdivision surface, nor is the ground.
                shape = sum(single[name] - ground[one][name] for name in ("primvar", "topology"))
                instances = sum(all_[name] - ground[many][name] for name in ("primvar", "topology")) - shape
                textures = single["textureMemory"] - ground[one]["textureMemory"]
                shapes[level, complexity] = shape
                each = instances / (options.plants - 1)
                print(f"| {level} | {complexity} | {shape / 1e3:.0f} | {each:.0f} | {textures / 1e3:.0f} |", flush=True)
        for complexity in options.complexity:
            ratio = shapes["crown", complexity] / shapes["relief", "low"]
            print(f"shapes of the mesh ({complexity}) over the relief's: {ratio:.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
