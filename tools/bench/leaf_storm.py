#!/usr/bin/env python3
"""What Storm draws of whole assets of leaves: the instancer against a fine mesh of the same leaves.

usage: tools/bench/leaf_storm.py [-n 60] [--size 800]

A spray is edited and baked by the command line, as a user would, and drawn without perspective from the front and the
right. Printed are the silhouettes' intersection over union and the mean colour difference on the leaves, of 255.
Exit 1 if one misses its target.
"""

import argparse
import contextlib
import io
import sys
import tempfile
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom
from usdfoliage.__main__ import main as usdfoliage
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, finish_picture

MIN_IOU, MAX_DIFFERENCE = 0.995, 2.0
FINE = ("--representation", "bezier", "mesh", "--resolution", "32", "128")
CURLED = "--width 1.4 --curl 0.02 0.05 0.1"
EDITS = {
    "plain": "",
    "edited": f"{CURLED} --asymmetry 0.1 0 --silhouette 2 0.05 0.05 0.02 --bend -0.1",
    "jittered": "--jitter 0.03 8",
    "edited and jittered": f"{CURLED} --jitter 0.03 8",
}


def run(*words: object) -> None:
    """The command line, quietly."""
    with contextlib.redirect_stdout(io.StringIO()):
        if usdfoliage([str(word) for word in words]):
            raise SystemExit("error: usdfoliage failed")


def views_of(asset: Path) -> list[PreviewView]:
    """Windows that hold the mesh, seen from the front and the right; both representations get the same."""
    stage = Usd.Stage.Open(str(asset))
    stage.SetEditTarget(stage.GetSessionLayer())
    plant = stage.GetDefaultPrim()
    plant.GetVariantSet("representation").SetVariantSelection("mesh")
    points = np.array(UsdGeom.Mesh(plant.GetPrimAtPath("geo/render/Leaves")).GetPointsAttr().Get(), np.float64)
    x, y, z = ((points.min(axis=0) + points.max(axis=0)) / 2).tolist()
    half = 1.05 * float(np.ptp(points, axis=0).max()) / 2
    return [
        PreviewView(
            output=Path("unused.png"),
            direction=direction,
            orthographic=True,
            window=(across - half, across + half, y - half, y + half),
        )
        for direction, across in (("front", x), ("right", -z))
    ]


def compare(asset: Path, size_px: int) -> list[tuple[str, float, float]]:
    """Direction, intersection over union and colour difference of the two representations."""
    views = views_of(asset)
    drawn = [
        draw_views(
            asset, views, PreviewSettings(width_px=size_px, height_px=size_px, variants=(("representation", name),))
        )
        for name in ("bezier", "mesh")
    ]
    rows = []
    for view, first, second in zip(views, *drawn, strict=True):
        covered = [picture[..., 3] > 0.5 for picture in (first, second)]
        either = covered[0] | covered[1]
        finished = [finish_picture(picture, PreviewSettings().background).astype(float) for picture in (first, second)]
        iou = float((covered[0] & covered[1]).sum() / either.sum())
        rows.append((view.direction, iou, float(np.abs(finished[0] - finished[1])[either].mean())))
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", "--count", type=int, default=60)
    parser.add_argument("--size", type=int, default=800, help="pixels a side")
    options = parser.parse_args()
    missed = False
    print(f"{'':<22}{'':<8}{'IoU':>8}{'colour':>8}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run("scatter", "-n", options.count, "-o", folder / "spray", "--representation", "bezier")
        for number, (title, edits) in enumerate(EDITS.items()):
            source = folder / "spray"
            if edits:
                source = folder / f"look_{number}.usda"
                run("edit", folder / "spray", *edits.split(), "-o", source)
            run("bake", source, "-o", folder / f"baked_{number}", *FINE)
            for direction, iou, difference in compare(
                folder / f"baked_{number}" / f"baked_{number}.usda", options.size
            ):
                missed |= iou < MIN_IOU or difference > MAX_DIFFERENCE
                print(f"{title:<22}{direction:<8}{iou:8.4f}{difference:8.3f}", flush=True)
    print("a target is missed" if missed else "every target is met")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
