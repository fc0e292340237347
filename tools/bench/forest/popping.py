#!/usr/bin/env python3
"""How much a forest jumps where plants change their form: frames of a shot, each with its changes and without them.

usage: tools/bench/forest/popping.py FOREST SHOT.usda [--level shot010] [--width 480] [--every 1] [--sheet SHEET.jpg]

FOREST was planted with --camera SHOT.usda. Each frame in which plants change is drawn twice from its camera: as it is,
and with the forms of the frame before it.
"""

import argparse
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from pxr import Usd, UsdGeom
from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.asset.packages.forest_package import LEVEL
from usdfoliage.asset.shot_camera import read_shot_camera
from usdfoliage.jobs.forest.report import pinhole_of
from usdfoliage.jobs.forest.shots import shot_name
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, finish_picture

CHANGED = 24  # of 255: what is more is seen to change
BACKGROUND = (0.3, 0.33, 0.38)
TIMES_LOUDER = 4  # differences in the sheet


def changing_frames(interface: Path, level: str) -> dict[float, int]:
    """Frames at which plants change their form, and how many do."""
    stage = Usd.Stage.Open(str(interface))
    stage.GetDefaultPrim().GetVariantSet(LEVEL).SetVariantSelection(level)
    hidden = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.PointInstancer):
            attribute = UsdGeom.PointInstancer(prim).GetInvisibleIdsAttr()
            hidden[prim.GetName()] = {time: set(attribute.Get(time) or ()) for time in attribute.GetTimeSamples()}
    changes: dict[float, int] = {}
    for samples in hidden.values():
        for before, after in pairwise(sorted(samples)):
            # What appears in one instancer goes from another.
            changes[after] = changes.get(after, 0) + len(samples[before] - samples[after])
    return {frame: count for frame, count in sorted(changes.items()) if count}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("forest", metavar="FOREST", type=Path)
    parser.add_argument("shot", metavar="SHOT", type=Path)
    parser.add_argument("--level", help="variant of the shot; the default is that of the file's name")
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--every", type=int, default=1, help="only each so manyth frame with changes")
    parser.add_argument(
        "--sheet", type=Path, help="the frame that changes most, with and without, and their difference"
    )
    options = parser.parse_args()
    interface = interface_of(options.forest)[0]
    level = options.level or shot_name(options.shot)
    changes = changing_frames(interface, level)
    path = read_shot_camera(options.shot).path
    frames = list(changes)[:: options.every]
    with tempfile.TemporaryDirectory() as folder:
        views = []
        for frame in frames:
            pinhole = pinhole_of(path, int(np.flatnonzero(path.frame == frame)[0]), options.width)
            views += [
                PreviewView(
                    output=Path(folder) / f"{frame:g}_{drawn_at:g}.png",
                    pinhole=pinhole,
                    variants=((LEVEL, level),),
                    frame=drawn_at,
                )
                for drawn_at in (frame, frame - 1)
            ]
        settings = PreviewSettings(purposes=("default", "render", "proxy"), complexity="low")
        drawn = [finish_picture(each, BACKGROUND)[..., :3] for each in draw_views(interface, views, settings)]
    shares = []
    for with_changes, without in zip(drawn[::2], drawn[1::2], strict=True):
        apart = np.abs(with_changes.astype(np.int16) - without.astype(np.int16)).max(axis=2)
        shares.append(float((apart > CHANGED).mean()))
    print(f"frames with changes: {len(changes)} of {len(path.frame)}, {len(frames)} of them drawn")
    print(f"changes of form: {sum(changes.values()):,}, at most {max(changes.values(), default=0)} in a frame")
    largest, mean = (max(shares), np.mean(shares)) if shares else (0.0, 0.0)
    print(f"pixels that change by more than {CHANGED}/255: at most {largest:.3%}, mean {mean:.3%}")
    if options.sheet and shares:
        worst = 2 * int(np.argmax(shares))
        apart = np.abs(drawn[worst].astype(np.int16) - drawn[worst + 1].astype(np.int16))
        loud = np.clip(TIMES_LOUDER * apart, 0, 255).astype(np.uint8)
        cv2.imwrite(str(options.sheet), np.hstack([drawn[worst], drawn[worst + 1], loud])[..., ::-1])
        print(f"worst frame: {frames[worst // 2]:g}, in {options.sheet}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
