#!/usr/bin/env python3
"""The forms of crowns in Storm: how much of a silhouette they share with the mesh, and how far their colours are apart.

usage: tools/bench/crown_forms.py CROWN [CROWN ...] [--views 12] [--size 480] [--clusters N] [--sheet SHEET.jpg]

Every crown is drawn in each of its forms from the same cameras around it, at three distances. Of a whole plant
its crown alone is drawn.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pxr import Sdf
from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.asset.packages.planted_assets import measure_planted_asset
from usdfoliage.geometry.pinhole import Pinhole, look_at
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, finish_picture

FORMS = ("mesh", "relief", "leaves")
SEEN = 128  # of 255, alpha from which on a pixel shows the crown


def camera_around(box_m: NDArray[np.float64], azimuth: float, elevation: float, fill: float, size: int) -> Pinhole:
    """A camera in which the ball around a box (2, 3) fills so much of the picture."""
    middle_m, radius_m = box_m.mean(axis=0), float(np.linalg.norm(box_m[1] - box_m[0])) / 2
    focal = 1.2
    away_m = radius_m * 2 * focal / fill
    out = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
    return look_at(middle_m + away_m * out, middle_m, focal * size, (size, size))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("crowns", metavar="CROWN", nargs="+", type=Path)
    parser.add_argument("--views", type=int, default=12)
    parser.add_argument("--size", type=int, default=480)
    parser.add_argument("--forms", nargs="+", choices=FORMS[1:], default=list(FORMS[1:]))
    parser.add_argument("--clusters", type=int, help="At most this many clusters of leaves are drawn.")
    parser.add_argument("--sheet", type=Path)
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for crown in options.crowns:
            interface = interface_of(crown)[0]
            if options.clusters is not None:
                interface = with_clusters(interface, options.clusters, Path(folder))
            asset = measure_planted_asset(crown)
            lod = tuple(asset.crown.selections.items())
            cameras = [
                camera_around(
                    asset.crown.extent_m,
                    2 * np.pi * number / options.views,
                    np.radians((5.0, 25.0, 50.0)[number % 3]),
                    (0.9, 0.45, 0.15)[number // 3 % 3],
                    options.size,
                )
                for number in range(options.views)
            ]
            drawn = {}
            for form in ("mesh", *options.forms):
                views = [
                    PreviewView(
                        output=Path(folder) / f"{number}.png",
                        pinhole=camera,
                        variants=(*lod, ("crown", form)),
                    )
                    for number, camera in enumerate(cameras)
                ]
                settings = PreviewSettings(background=None, complexity="high")
                drawn[form] = [finish_picture(picture, None) for picture in draw_views(interface, views, settings)]
            for form in options.forms:
                pairs = [compare(mesh, other) for mesh, other in zip(drawn["mesh"], drawn[form], strict=True)]
                iou, apart = np.array(pairs).T
                print(
                    f"{crown.name} {form}: silhouette IoU {np.mean(iou):.4f} (least {iou.min():.4f}), "
                    f"mean colour difference {np.mean(apart):.2f} of 255 (most {apart.max():.2f})",
                    flush=True,
                )
            if options.sheet:
                pictures = [np.hstack([over_grey(drawn[form][number]) for form in drawn]) for number in (0, 4)]
                rows.append(np.hstack(pictures))
    if options.sheet:
        cv2.imwrite(str(options.sheet), np.vstack(rows)[..., ::-1])
    return 0


def with_clusters(interface: Path, count: int, folder: Path) -> Path:
    """A layer over an asset that draws at most so many clusters of leaves."""
    layer = Sdf.Layer.CreateNew(str(folder / f"{interface.stem}_{count}.usda"))
    layer.subLayerPaths.append(str(interface.absolute()))
    layer.defaultPrim = Sdf.Layer.FindOrOpen(str(interface)).defaultPrim
    shader = Sdf.CreatePrimInLayer(layer, f"/{layer.defaultPrim}/mtl/CrownLeaves/StormSurface")
    number = Sdf.AttributeSpec(shader, "inputs:mostClusters", Sdf.ValueTypeNames.Float)
    number.default = float(count)
    layer.Save()
    return Path(layer.realPath)


def over_grey(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3) a picture with alpha over grey."""
    share = picture[..., 3:] / 255
    return np.asarray(np.rint(picture[..., :3] * share + 94 * (1 - share)), np.uint8)


def compare(mesh: NDArray[np.uint8], other: NDArray[np.uint8]) -> tuple[float, float]:
    """IoU of two silhouettes, and how far the mean colours of what both show are apart, the mean of three channels."""
    first, second = mesh[..., 3] >= SEEN, other[..., 3] >= SEEN
    both = first & second
    iou = both.sum() / max((first | second).sum(), 1)
    apart = np.abs(mesh[both][:, :3].mean(axis=0) - other[both][:, :3].mean(axis=0)).mean()
    return float(iou), float(apart)


if __name__ == "__main__":
    sys.exit(main())
