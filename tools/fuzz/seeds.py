"""Small valid files of every kind that a user hands over, made by the project's own test helpers.

usage: tools/fuzz/seeds.py FOLDER
"""

import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio
from usdfoliage.__main__ import main
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.jobs.capture.settings import CaptureRunSettings
from usdfoliage.jobs.leaves.settings import LeavesRunSettings
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.settings_file import format_settings
from usdfoliage.sketch.strokes import Strokes, strokes_beside, write_strokes

from tests.support.capture_photos import LENS, draw, poses, scene, write_posed_photos
from tests.support.captures import write_binary_model, write_depth
from tests.support.cloud_files import write_las, write_ply, write_text
from tests.support.crown_shapes import disc_mask, foliage
from tests.support.photographs.drawn_trees import draw_leafy

SIDE_PX = 96
SPECIES = """[larch]
internode_m = 0.02
roll_deg = 137.5
leaves_per_node = 2
leaf_length_m = 0.05
leaf_width = 0.2
bare_internodes = 1
color = [0.05, 0.2, 0.03]

[Maple]
divergence_deg = 180
exponent = 0.4
"""
PROFILE = """[[accepted]]
validator = "usdGeomValidators:StageMetadataChecker"
error = "MissingDefaultPrim"
path = "/spray/*"
reason = "a studio's own"
"""
CAPTURE_TOML = """name = "bed 1"
up_axis = "Z"
metres_per_unit = 1.0
color_space = "sRGB"
note = "morning"

[scale_bar]
points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
length_m = 1.0

[known_distance]
photographs = ["leaf 0.png", "leaf 1.png"]
distance_m = 0.7
"""


def make_seeds(folder: Path) -> None:
    """Write the folders photo/, sketch/, plants/, bed/, binary/, cloud/, toml/, library/ and work/.

    Raises:
        RuntimeError: A command that makes one failed.
    """

    def make(*words: object) -> None:
        if main([str(word) for word in words]):
            raise RuntimeError(f"no seed: {' '.join(map(str, words))}")

    _write_photographs(folder / "photo")
    _write_sketch(folder / "sketch")
    _write_clouds(folder / "cloud")
    plants = folder / "plants"
    make("scatter", "-n", 2, "-o", plants / "spray", "--texture", folder / "photo" / "oak alpha.png")
    make("edit", plants / "spray", "--width", 1.2, "--bend", 0.1, "--jitter", 0.02, 3, "-o", plants / "look.usda")
    small = ("--size", 32, "--mesh-size", 17, "--no-preview")
    make("crown", folder / "photo/oak.png", "--mask", folder / "photo/mask.png", *small, "-o", plants / "crown")
    grown = ("--foliage", "template", "--most-leaves", 20, "--rig", "--no-preview")
    make("branches", folder / "cloud" / "tree.ply", *grown, "-o", plants / "tree")
    _write_beds(folder)
    words = ("--settings", folder / "bed" / "fast.toml", "--no-report")
    make("capture", folder / "bed", "-o", folder / "done", *words)
    for name in ("capture.usda", "capture_cloud.usdc", "cloud.ply"):
        shutil.copy(folder / "done" / name, folder / "bed" / name)
    shutil.rmtree(folder / "done")
    (folder / "toml").mkdir()
    (folder / "toml" / "species.toml").write_text(SPECIES)
    (folder / "toml" / "profile.toml").write_text(PROFILE)
    (folder / "toml" / "leaves.toml").write_text(format_settings(LeavesRunSettings()))
    (folder / "toml" / "capture.toml").write_text(format_settings(CaptureRunSettings()))
    (folder / "toml" / "build.toml").write_text(format_settings(BuildSettings()))
    (folder / "library").mkdir()
    (folder / "library" / "list.txt").write_text(
        "../bed\n# a cloud\n../cloud/tree.ply\ttall tree\t../toml/build.toml\n"
    )
    (folder / "library" / "list.csv").write_text(
        'capture,name,plan\n../bed,bed,\n# a cloud\n../cloud/tree.ply,"tall, tree",../toml/build.toml\n'
    )
    make("build", folder / "bed", "-o", folder / "built", "--work", folder / "work", "--only", "poses")


def _write_sketch(folder: Path) -> None:
    """A photograph of a tree, and the strokes beside it."""
    folder.mkdir(parents=True)
    tree = draw_leafy(SIDE_PX, SIDE_PX)
    photo = folder / "oak.png"
    cv2.imwrite(str(photo), tree.srgb[..., ::-1])
    strokes = Strokes(image=photo.name, width_px=SIDE_PX, height_px=SIDE_PX, trees=(tree.strokes,))
    write_strokes(strokes_beside(photo), strokes)


def _write_photographs(folder: Path) -> None:
    folder.mkdir(parents=True)
    srgb = np.clip(encode_srgb(foliage((SIDE_PX, SIDE_PX))), 0, 1)
    eight, sixteen = np.rint(srgb * 255).astype(np.uint8), np.rint(srgb * 65535).astype(np.uint16)
    mask = disc_mask(0.4 * SIDE_PX, size_px=SIDE_PX).astype(np.uint8) * 255
    cv2.imwrite(str(folder / "oak.png"), eight[..., ::-1])
    cv2.imwrite(str(folder / "oak 16.png"), sixteen[..., ::-1])
    cv2.imwrite(str(folder / "oak alpha.png"), np.dstack([eight[..., ::-1], mask]))
    cv2.imwrite(str(folder / "oak grey.png"), eight[..., 1])
    cv2.imwrite(str(folder / "oak.jpg"), eight[..., ::-1])
    cv2.imwrite(str(folder / "oak progressive.jpg"), eight[..., ::-1], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    cv2.imwrite(str(folder / "oak.tif"), eight[..., ::-1])
    cv2.imwrite(str(folder / "mask.png"), mask)
    for name, kind in (("oak.exr", "half"), ("oak tiled.tif", "uint16")):
        output = oiio.ImageOutput.create(str(folder / name))
        spec = oiio.ImageSpec(SIDE_PX, SIDE_PX, 3, kind)
        if "tiled" in name:
            spec.tile_width = spec.tile_height = 32
            spec.attribute("compression", "zip")
        assert output.open(str(folder / name), spec)
        assert output.write_image(srgb.astype(np.float32))
        output.close()


def _write_clouds(folder: Path) -> None:
    """A stem with an arm, 1 m high, Y up."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    along, turn = rng.uniform(0, 1, 900), rng.uniform(0, 2 * np.pi, 900)
    stem = np.column_stack([0.03 * np.cos(turn), along, 0.03 * np.sin(turn)])
    arm = np.array([0, 0.5, 0]) + along[:300, None] * [0.4, 0.3, 0] + 0.3 * stem[:300] * [1, 0, 1]
    points = np.concatenate([stem, arm]).round(3)
    colors = rng.integers(40, 200, (len(points), 3))
    write_ply(folder / "tree.ply", points, colors)
    write_ply(folder / "big endian.ply", points, colors, kind="float", order=">")
    write_ply(folder / "ascii.ply", points, colors, order="")
    write_las(folder / "tree.las", points, colors)
    write_las(folder / "tree.laz", points, colors)
    write_text(folder / "tree.xyz", points)
    write_text(folder / "tree.csv", points, colors, ",", "x,y,z,r,g,b\n")
    write_text(folder / "tree.pts", points, head=f"{len(points)}\n")


def _write_beds(folder: Path) -> None:
    """Two equal captures, one with a text and one with a binary model."""
    bed, binary = folder / "bed", folder / "binary"
    made = write_posed_photos(bed, CAPTURE_TOML)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3))
    (bed / "cameras" / "points3D.txt").write_text(
        "".join(f"{number} {x} {y} {z} 9 9 9 0.1 1 2\n" for number, (x, y, z) in enumerate(points, 1))
    )
    leaves = scene()
    (bed / "masks").mkdir()
    for number, (name, pose) in enumerate(made.items()):
        _, depth_m, leaf_ids = draw(leaves, LENS.pinhole(pose))
        stem = bed / "depth" / name
        if number == 4:
            cv2.imwrite(str(stem), np.rint(depth_m * 1000).astype(np.uint16))
        else:
            write_depth(stem.with_suffix(".exr"), depth_m)
        cv2.imwrite(str(bed / "masks" / name), (leaf_ids > 0).astype(np.uint8) * 255)
    shutil.copytree(bed, binary)
    for file in (binary / "cameras").iterdir():
        file.unlink()
    write_binary_model(binary / "cameras", poses(), [LENS], points, observations=3)


if __name__ == "__main__":
    make_seeds(Path(sys.argv[1]))
