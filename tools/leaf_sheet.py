#!/usr/bin/env python3
"""A picture of every edit of a leaf, as in figure 7 of the paper, drawn by Storm.

usage: tools/leaf_sheet.py -o SHEET.jpg|png

One leaf stands before the camera eight times, from the front and turned: as it is, and under each edit, which is a look
of that placement. The control polygons of axis and silhouette, of the edited leaf, are drawn over the front.
"""

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np
from pxr import Gf, Usd, UsdGeom
from usdfoliage.asset.looks.look import write_look_layer
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.provenance import Provenance
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, finish_picture
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import (
    NEUTRAL,
    LeafEdits,
    apply_edits,
    bend_axis,
    curl,
    jitter_silhouette,
    scale_width,
    shift_silhouette,
    skew_axis,
)
from usdfoliage.leaf.shape.surface import leaf_nets
from usdfoliage.leaf.shape.variation import default_leaf

EDITS: dict[str, LeafEdits] = {
    "the leaf": NEUTRAL,
    "a  width": scale_width(NEUTRAL, 1.6),
    "b  asymmetry": skew_axis(NEUTRAL, -0.2, 0.0),
    "c  silhouette, wide apex": shift_silhouette(shift_silhouette(NEUTRAL, 3, 0.05, 0.25), 1, 0.1, -0.1),
    "d  silhouette, heart": shift_silhouette(shift_silhouette(NEUTRAL, 1, -0.2, 0.25), 2, -0.1, -0.1),
    "e  bend along the axis": bend_axis(NEUTRAL, -0.4),
    "f  curl across": curl(NEUTRAL, 0.0, 0.1, 0.4),
    "g  jitter": jitter_silhouette(NEUTRAL, 0.03, 12.0),
}
STEP, HIGH = 1.1, 1.25  # of a tile, in leaf lengths
TILE_PX = 220


def write_scene(folder: Path) -> Path:
    """One leaf eight times in two rows, with a look on each column."""
    leaf = Leaves(
        parameters=default_leaf()[None],
        base_m=np.zeros((1, 3)),
        orientation=np.array([[0.0, 0.0, 0.0, 1.0]]),
        length_m=np.ones(1),
        phase=np.zeros(1),
    )
    (folder / "leaf").mkdir()
    write_leaf_asset(folder / "leaf", "leaf", leaf, Provenance(capture="", generator="", seed=0, input_sha256=""))
    stage = Usd.Stage.CreateNew(str(folder / "sheet.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    for column, edits in enumerate(EDITS.values()):
        for row, turn_deg in enumerate((0.0, 65.0)):
            path = f"/leaf_{column}_{row}"
            placed = UsdGeom.Xform.Define(stage, path)
            placed.GetPrim().GetReferences().AddReference("./leaf/leaf.usda")
            placed.AddTranslateOp().Set(Gf.Vec3d(STEP * column, -HIGH * row, 0))
            placed.AddRotateYOp().Set(turn_deg)
            if edits != NEUTRAL:
                look = folder / f"look_{column}_{row}.usda"
                write_look_layer(look, folder / "leaf", edits, prim_path=path)
                stage.GetRootLayer().subLayerPaths.append(f"./{look.name}")
    stage.Save()
    return folder / "sheet.usda"


def draw_sheet(scene: Path) -> np.ndarray:
    """The scene in Storm with names and control polygons, BGR."""
    width_px, height_px = len(EDITS) * TILE_PX, round(2 * HIGH / STEP * TILE_PX)
    left, top = -STEP / 2, 1 + (HIGH - 1) / 2
    window = (left, left + STEP * len(EDITS), top - 2 * HIGH, top)
    view = PreviewView(output=Path("unused.png"), orthographic=True, window=window)
    settings = PreviewSettings(width_px=width_px, height_px=height_px, background=(0.9, 0.9, 0.9))
    picture = cv2.cvtColor(
        finish_picture(draw_views(scene, [view], settings)[0], settings.background), cv2.COLOR_RGB2BGR
    )
    for column, (name, edits) in enumerate(EDITS.items()):
        net = leaf_nets(apply_edits(default_leaf()[None], edits))[0]
        for curve, color in ((net[:, 3], (40, 40, 200)), (net[:, 0], (90, 40, 0)), (net[:, 6], (90, 40, 0))):
            across, up = curve[:, 0] + STEP * column - left, top - curve[:, 1]
            pixels = np.rint(np.column_stack([across, up]) * TILE_PX / STEP * 16).astype(np.int32)
            cv2.polylines(picture, [pixels], False, color, 1, cv2.LINE_AA, 4)
            for point in pixels:
                cv2.circle(picture, point.tolist(), 3 * 16, color, -1, cv2.LINE_AA, 4)
        cv2.putText(
            picture, name, (column * TILE_PX + 8, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA
        )
    return picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        picture = draw_sheet(write_scene(Path(folder)))
    if not cv2.imwrite(str(options.output), picture):
        raise SystemExit(f"error: {options.output} cannot be written")
    print(options.output)


if __name__ == "__main__":
    main()
