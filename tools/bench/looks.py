#!/usr/bin/env python3
"""The colours of an asset's materials in Storm, by each of its three descriptions, and in Blender.

usage: tools/bench/looks.py [-o FOLDER]

Cards stand beside a plain grey one of 18 percent: leaves of a picture, plain and tinted, leaves without a picture, bark
and a crown. Compared are the albedos, which do not depend on how an application spreads light: one lamp at the eye and
no gloss in Storm, where what is drawn is divided by the grey card; the pass of the diffuse colour in Blender's Cycles.
Storm draws what it chooses, which is glslfx where a material has one, then MaterialX alone, whose library generates the
GLSL, then UsdPreviewSurface alone.

Printed are the colours of each patch in 8-bit sRGB and how far each is from what is true; exit 1 if one is too far.
FOLDER gets the scene and its pictures.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from usdfoliage.asset.layer import bind_material
from usdfoliage.asset.materials.bark import BarkMaterial, author_bark_material
from usdfoliage.asset.materials.crown import CROWN_SHADER, CrownMaterial, author_crown_material
from usdfoliage.asset.materials.cubemap_exr import write_color_cubemap, write_radius_cubemap
from usdfoliage.asset.materials.leaf import STORM_SURFACE, LeafMaterial, author_leaf_material
from usdfoliage.asset.materials.mtlx import MTLX_SURFACE
from usdfoliage.asset.resources import resource_folder
from usdfoliage.geometry.color import decode_srgb, encode_srgb
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, encode_png, finish_picture
from usdfoliage.jobs.preview.recorder import find_interpreter

BLENDER_TOOL = Path(__file__).resolve().parents[1] / "blender_import.py"
MAX_DIFFERENCE = 8.0  # of 255
GREY = 0.18
PLAIN = "grey"  # the card by which light is measured
CARD_PX = 64
SPACING_M = 1.25  # cards are 1 m wide
# The left and the right column of the picture, row 0 on top; sRGB.
PICTURE = np.array([[(46, 92, 30), (120, 150, 60)], [(181, 140, 70), (118, 118, 118)]], np.uint8)
OPACITY = np.array([[255, 180], [76, 0]], np.uint8)  # of the picture that is cut; half or more is opaque
MIDDLE = (0.15, 0.2, 0.06)  # what the picture is divided by where leaves tint it
TINTED = (0.2, 0.17, 0.09)  # the tinted leaf's own colour
GREEN = (0.06, 0.14, 0.03)
BROWN = (0.11, 0.075, 0.05)
# What Storm draws where the surfaces of these contexts are taken away from the materials; "" is UsdPreviewSurface's.
STORM: Mapping[str, tuple[str, ...]] = {
    "Storm": (),
    "Storm, MaterialX": ("glslfx", ""),
    "Storm, preview": ("glslfx", "mtlx"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Card:
    """A card of one material, and its true albedos."""

    name: str
    albedo: NDArray[np.float64]  # (2, 2, 3) linear, row 0 on top


def list_cards() -> list[Card]:
    """The cards from left to right, the grey one first."""

    def one(color: tuple[float, float, float]) -> NDArray[np.float64]:
        return np.broadcast_to(np.float64(color), (2, 2, 3))

    picture = decode_srgb(PICTURE / 255.0)
    return [
        Card(name=PLAIN, albedo=one((GREY, GREY, GREY))),
        Card(name="leaf_picture", albedo=picture),
        Card(name="leaf_tinted", albedo=picture * np.float64(TINTED) / np.float64(MIDDLE)),
        Card(name="leaf_cut", albedo=picture * (OPACITY[..., None] > 127)),
        Card(name="leaf_grey", albedo=one((GREY, GREY, GREY))),
        Card(name="leaf_plain", albedo=one(GREEN)),
        Card(name="bark_picture", albedo=picture),
        Card(name="bark_plain", albedo=one(BROWN)),
        Card(name="crown", albedo=one(GREEN)),
    ]


def write_scene(folder: Path) -> Path:
    """Cards in the XY plane, seen from +Z, and the light there; returns the scene."""
    for name, pixels in (("leaf.png", PICTURE), ("leaf_cut.png", np.dstack([PICTURE, OPACITY]))):
        (folder / name).write_bytes(encode_png(np.repeat(np.repeat(pixels, 32, axis=0), 32, axis=1)))
    write_color_cubemap(folder / "color.exr", np.broadcast_to(np.float32(GREEN), (6, 8, 8, 3)).copy(), {})
    write_radius_cubemap(folder / "radius.exr", np.ones((6, 8, 8), np.float32), {})
    stage = Usd.Stage.CreateNew(str(folder / "cards.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Cards").GetPrim())
    for number, card in enumerate(list_cards()):
        material = author_material(stage, card.name)
        author_card(stage, card, SPACING_M * number, material)
    light = UsdLux.DistantLight.Define(stage, "/Cards/Light")  # along -Z
    light.CreateIntensityAttr(1000.0)
    light.CreateAngleAttr(2.0)
    stage.Save()
    return folder / "cards.usda"


def author_material(stage: Usd.Stage, card: str) -> UsdShade.Material:
    """The material of a card, without gloss, veins and mottling."""
    path = Sdf.Path(f"/Cards/mtl/{card}")
    shaders = str(resource_folder("usd_plugins/usdFoliageShaders"))
    if card == PLAIN:
        material = UsdShade.Material.Define(stage, path)
        surface = UsdShade.Shader.Define(stage, path.AppendChild("PreviewSurface"))
        surface.CreateIdAttr("UsdPreviewSurface")
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(GREY))
        surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    elif card == "crown":
        crown = CrownMaterial(
            color_map="./color.exr",
            radius_map="./radius.exr",
            shader=f"{shaders}/{CROWN_SHADER}",
            face_size=8,
            center_m=(0, 0, 0),
            radius_range_m=(1.0, 1.0),
        )
        material = author_crown_material(stage, path, crown)
        UsdShade.Shader(stage.GetPrimAtPath(path.AppendChild(STORM_SURFACE))).CreateInput(
            "occlusion", Sdf.ValueTypeNames.Float
        ).Set(0.0)
    elif card.startswith("bark"):
        texture = "./leaf.png" if card == "bark_picture" else None
        material = author_bark_material(stage, path, BarkMaterial(texture=texture, texture_m=1.0))
    else:
        textures = {"leaf_picture": "./leaf.png", "leaf_tinted": "./leaf.png", "leaf_cut": "./leaf_cut.png"}
        leaf = LeafMaterial(
            shaders=shaders,
            texture=textures.get(card),
            texture_color=MIDDLE if card == "leaf_tinted" else None,
            typical_color=TINTED,
            specular=0.0,
            veins=0.0,
            mottling=0.0,
            relief=0.0,
        )
        material = author_leaf_material(stage, path, leaf)
    UsdShade.Shader(stage.GetPrimAtPath(path.AppendChild("PreviewSurface"))).CreateInput(
        "ior", Sdf.ValueTypeNames.Float
    ).Set(1.0)
    surface = UsdShade.Shader(stage.GetPrimAtPath(path.AppendChild(MTLX_SURFACE)))
    if surface:
        surface.CreateInput("specular_weight", Sdf.ValueTypeNames.Float).Set(0.0)
    return material


def author_card(stage: Usd.Stage, card: Card, x_m: float, material: UsdShade.Material) -> None:
    """A square of 1 m around (x, 0, 0), its st from the lower left corner; a crown's is all on one face of its map."""
    mesh = UsdGeom.Mesh.Define(stage, f"/Cards/{card.name}")
    corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    mesh.CreatePointsAttr([(x_m + x, y, 0) for x, y in corners])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateExtentAttr([(x_m - 0.5, -0.5, 0), (x_m + 0.5, 0.5, 0)])
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set([(x + 0.5, y + 0.5) for x, y in corners])
    color = {"leaf_tinted": TINTED, "leaf_grey": (GREY, GREY, GREY), "bark_plain": BROWN}.get(card.name, GREEN)
    mesh.CreateDisplayColorAttr([color])
    bind_material(stage, mesh.GetPath(), material.GetPath())


def draw_in_storm(scene: Path, shot: Path, taken_away: tuple[str, ...]) -> NDArray[np.float64]:
    """The picture of the cards, (64, 80 N, 3) linear; shot is the layer above that takes contexts away."""
    stage = Usd.Stage.CreateNew(str(shot))
    stage.GetRootLayer().subLayerPaths.append(f"./{scene.name}")
    for prim in stage.Traverse():
        material = UsdShade.Material(prim)
        for context in taken_away if material and prim.GetName() != PLAIN else ():
            output = material.GetSurfaceOutput(context)
            if output:
                output.GetAttr().SetConnections([])
    stage.Save()
    count = len(list_cards())
    left, width = -SPACING_M / 2, SPACING_M * count
    view = PreviewView(output=Path("unused.png"), orthographic=True, window=(left, left + width, -0.5, 0.5))
    settings = PreviewSettings(width_px=round(CARD_PX * width), height_px=CARD_PX, samples=1, background=None)
    (picture,) = draw_views(Path(stage.GetRootLayer().realPath), [view], settings)
    return picture[..., :3].astype(np.float64)


def draw_in_blender(scene: Path) -> NDArray[np.float64]:
    """The diffuse colour of the cards in Cycles, (64, 80 N, 3) linear."""
    count = len(list_cards())
    width_px = round(CARD_PX * SPACING_M * count)
    output = scene.with_name("blender.exr")
    words = [find_interpreter(), BLENDER_TOOL, scene, "--albedo", output, "--size", width_px, CARD_PX]
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"error: Blender did not draw the cards: {done.stderr[-2000:]}")
    picture = _read_pass(output, "Diffuse Color")
    # The tool's camera sees a tenth more than the cards, which end half a gap before the picture of Storm does.
    extent_m = SPACING_M * (count - 1) + 1
    return _resample(picture, 1.1 * extent_m, SPACING_M * count)


def _read_pass(path: Path, name: str) -> NDArray[np.float64]:
    """A pass of a multilayer EXR, (H, W, 3)."""
    buffer = oiio.ImageBuf(str(path))
    for part in range(buffer.nsubimages):
        buffer = oiio.ImageBuf(str(path), part, 0)
        names = list(buffer.spec().channelnames)
        places = {found.split(".", 1)[1]: number for number, found in enumerate(names)}  # after the layer's name
        if f"{name}.R" in places:
            channels = [places[f"{name}.{channel}"] for channel in "RGB"]
            return buffer.get_pixels(oiio.FLOAT)[..., channels].astype(np.float64)
    raise SystemExit(f"error: {path} has no pass {name}")


def _resample(picture: NDArray[np.float64], width_m: float, wanted_m: float) -> NDArray[np.float64]:
    """The middle of a picture of that width in metres, as another of the same pixels and a wanted width shows it."""
    height, width = picture.shape[:2]
    x = (np.arange(width) + 0.5 - width / 2) * wanted_m / width_m + width / 2
    y = (np.arange(height) + 0.5 - height / 2) * wanted_m / width_m + height / 2
    return picture[np.clip(y.astype(int), 0, height - 1)][:, np.clip(x.astype(int), 0, width - 1)]


def measure_patches(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    """The median colour in the middle of each patch: (cards, 2, 2, 3) linear.

    Where two triangles meet, a renderer on the processor may take the wrong level of a texture.
    """
    count = len(list_cards())
    found = np.empty((count, 2, 2, 3))
    for number in range(count):
        for row in range(2):
            for column in range(2):
                x = CARD_PX * (SPACING_M * (number + 0.5) + (column - 0.5) / 2)
                y = CARD_PX * (0.25 + row / 2)
                patch = picture[round(y) - 6 : round(y) + 6, round(x) - 6 : round(x) + 6]
                found[number, row, column] = np.median(patch, axis=(0, 1))
    return found


def compare(folder: Path, *, blender: bool = True) -> dict[str, NDArray[np.float64]]:
    """Albedos by application, (cards, 2, 2, 3) 8-bit sRGB as numbers, the true ones first."""
    scene = write_scene(folder)
    albedos = {"true": np.stack([card.albedo for card in list_cards()])}
    for name, taken_away in STORM.items():
        file = name.replace(", ", "_").replace(" ", "_")
        picture = draw_in_storm(scene, folder / f"{file}.usda", taken_away)
        _write_png(folder / f"{file}.png", picture)
        patches = measure_patches(picture)
        albedos[name] = patches * GREY / patches[0].mean()
    if blender:
        picture = draw_in_blender(scene)
        _write_png(folder / "Blender.png", picture)
        albedos["Blender"] = measure_patches(picture)
    return {name: 255 * encode_srgb(np.clip(values, 0, 1)) for name, values in albedos.items()}


def _write_png(path: Path, picture: NDArray[np.float64]) -> None:
    opaque = np.concatenate([picture, np.ones_like(picture[..., :1])], axis=2).astype(np.float32)
    path.write_bytes(encode_png(finish_picture(opaque, (0.0, 0.0, 0.0))))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", metavar="FOLDER", type=Path, help="an empty folder for scene and pictures")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.output or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        found = compare(folder)
    print("| card | patch | " + " | ".join(found) + " |\n| --- " * 1 + "| --- " * (1 + len(found)) + "|")
    for number, card in enumerate(list_cards()):
        whole = len(np.unique(card.albedo.reshape(-1, 3), axis=0)) == 1
        for patch in range(1 if whole else 4):
            colors = (values[number].reshape(4, 3)[patch].round().astype(int) for values in found.values())
            print(f"| {card.name} | {patch} | " + " | ".join("{} {} {}".format(*color) for color in colors) + " |")
    furthest = {name: float(np.abs(values - found["true"]).max()) for name, values in found.items()}
    print("| all | furthest from true | " + " | ".join(f"{value:.1f}" for value in furthest.values()) + " |")
    return 1 if max(furthest.values()) > MAX_DIFFERENCE else 0


if __name__ == "__main__":
    sys.exit(main())
