#!/usr/bin/env python3
"""The forms of crowns in Storm: how much of a silhouette they share with the mesh, and how far their colours are apart.

usage: tools/bench/crown_forms.py CROWN [CROWN ...] [--views 12] [--size 480] [--clusters 320 32]
                                  [--sheet SHEET.jpg [--photos PHOTO ...]] [--apart FOLDER]

Every crown is drawn in each of its forms from the same cameras around it, at three distances: the mesh, the relief, the
leaves with so many clusters at most, and the cards where the asset has some. Of a whole plant its crown alone is drawn.
The sheet has a row of pictures for each crown, from the front and from behind, beside the photograph that it is made
of. The folder of --apart gets a picture for each form and camera: white is where both are, red the mesh alone, blue the
other form alone.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.packages.cards import read_cards
from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.asset.packages.planted_assets import measure_planted_asset
from usdfoliage.geometry.pinhole import Pinhole, look_at
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, finish_picture

SEEN = 128  # of 255, alpha from which on a pixel shows the crown
BENCH = "benchForm"  # variant set of the layer over an asset
MESH, RELIEF, LEAVES, CARDS = "mesh", "relief", "leaves", "cards"
ON_SHEET = (0, 7)  # cameras of the sheet: from the front, and from behind farther away
GREY = 94


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
    parser.add_argument("--forms", nargs="+", choices=[RELIEF, LEAVES, CARDS], default=[RELIEF, LEAVES, CARDS])
    parser.add_argument("--clusters", nargs="+", type=int, default=[320, 32])
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--photos", nargs="+", type=Path, default=[])
    parser.add_argument("--apart", type=Path)
    options = parser.parse_args()
    if options.photos and len(options.photos) != len(options.crowns):
        parser.error("--photos needs one photograph for each crown")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for number, crown in enumerate(options.crowns):
            forms = {MESH: (MESH, 0)}
            for form in options.forms:
                forms.update(
                    {f"{form} {n}": (form, n) for n in options.clusters} if form == LEAVES else {form: (form, 0)}
                )
            asset = measure_planted_asset(crown)
            interface = interface_of(crown)[0]
            stage = Usd.Stage.Open(str(interface))
            if not read_cards(stage.GetDefaultPrim(), interface.parent):
                forms.pop(CARDS, None)
            cameras = [
                camera_around(
                    asset.crown.extent_m,
                    2 * np.pi * view / options.views,
                    np.radians((5.0, 25.0, 50.0)[view % 3]),
                    (0.9, 0.45, 0.15)[view // 3 % 3],
                    options.size,
                )
                for view in range(options.views)
            ]
            lod = tuple(asset.crown.selections.items())
            scene = with_forms(interface, forms, Path(folder) / f"{number}.usda")
            views = [
                PreviewView(
                    output=Path("none.png"), pinhole=camera, variants=(*lod, ("crown", kind), (BENCH, variant(name)))
                )
                for name, (kind, _) in forms.items()
                for camera in cameras
            ]
            settings = PreviewSettings(background=None, complexity="high")
            pictures = [finish_picture(picture, None) for picture in draw_views(scene, views, settings)]
            drawn = {name: pictures[i * len(cameras) :][: len(cameras)] for i, name in enumerate(forms)}
            for name, own in list(drawn.items())[1:]:
                pairs = [compare(mesh, other) for mesh, other in zip(drawn[MESH], own, strict=True)]
                iou, apart = np.array(pairs).T
                print(
                    f"{crown.name} {name}: silhouette IoU {np.mean(iou):.4f} (least {iou.min():.4f}), "
                    f"mean colour difference {np.mean(apart):.2f} of 255 (most {apart.max():.2f})",
                    flush=True,
                )
                if options.apart:
                    options.apart.mkdir(parents=True, exist_ok=True)
                    for view, (mesh, other) in enumerate(zip(drawn[MESH], own, strict=True)):
                        file = options.apart / f"{crown.name}_{variant(name)}_{view}.png"
                        cv2.imwrite(str(file), silhouettes(mesh, other)[..., ::-1])
            if options.sheet:
                photo = [fitted(options.photos[number], options.size)] if options.photos else []
                drawn_views = [view for view in ON_SHEET if view < options.views]
                row = [over_grey(drawn[name][view]) for view in drawn_views for name in drawn]
                rows.append(np.hstack([*photo, *row]))
    if options.sheet:
        width = max(row.shape[1] for row in rows)
        rows = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0)), constant_values=GREY) for row in rows]
        cv2.imwrite(str(options.sheet), np.vstack(rows)[..., ::-1])
    return 0


def variant(name: str) -> str:
    return name.replace(" ", "_")


def with_forms(interface: Path, forms: dict[str, tuple[str, int]], file: Path) -> Path:
    """A layer over an asset with a variant for each form: so many clusters of leaves at most, or drawn as cards."""
    stage = Usd.Stage.CreateNew(str(file))
    layer = stage.GetRootLayer()
    layer.subLayerPaths.append(str(interface.absolute()))
    asset = Sdf.Layer.FindOrOpen(str(interface))
    root = stage.GetPrimAtPath(f"/{asset.defaultPrim}")
    stage.SetDefaultPrim(root)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    chosen = root.GetVariantSets().AddVariantSet(BENCH)
    for name, (kind, clusters) in forms.items():
        chosen.AddVariant(variant(name))
        chosen.SetVariantSelection(variant(name))
        with chosen.GetVariantEditContext():
            if kind == CARDS:
                UsdGeom.ModelAPI(root).CreateModelDrawModeAttr(UsdGeom.Tokens.cards)
            if kind == LEAVES:
                shader = stage.OverridePrim(root.GetPath().AppendPath("mtl/CrownLeaves/StormSurface"))
                shader.CreateAttribute("inputs:mostClusters", Sdf.ValueTypeNames.Float).Set(float(clusters))
    chosen.SetVariantSelection(variant(MESH))
    layer.Save()
    return file


def over_grey(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3) a picture with alpha over grey."""
    share = picture[..., 3:] / 255
    return np.asarray(np.rint(picture[..., :3] * share + GREY * (1 - share)), np.uint8)


def fitted(photo: Path, side_px: int) -> NDArray[np.uint8]:
    """(side, side, 3) a photograph as large as it fits, over grey."""
    picture = cv2.imread(str(photo))
    scale = side_px / max(picture.shape[:2])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)[:side_px, :side_px, ::-1]
    square = np.full((side_px, side_px, 3), GREY, np.uint8)
    top, left = (side_px - small.shape[0]) // 2, (side_px - small.shape[1]) // 2
    square[top : top + small.shape[0], left : left + small.shape[1]] = small
    return square


def silhouettes(mesh: NDArray[np.uint8], other: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3) where the mesh is alone (red), the other form (blue), both (white)."""
    first, second = mesh[..., 3] >= SEEN, other[..., 3] >= SEEN
    return np.asarray(np.stack([first, first & second, second], axis=-1) * 255, np.uint8)


def compare(mesh: NDArray[np.uint8], other: NDArray[np.uint8]) -> tuple[float, float]:
    """IoU of two silhouettes, and how far the mean colours of what both show are apart, the mean of three channels."""
    first, second = mesh[..., 3] >= SEEN, other[..., 3] >= SEEN
    both = first & second
    iou = both.sum() / max((first | second).sum(), 1)
    apart = np.abs(mesh[both][:, :3].mean(axis=0) - other[both][:, :3].mean(axis=0)).mean()
    return float(iou), float(apart)


if __name__ == "__main__":
    sys.exit(main())
