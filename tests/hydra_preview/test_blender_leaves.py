"""Blender opens an asset of leaves: the same leaves as one mesh and as a subdivision cage, mean leaves as instances."""

import json
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.parts.leaf_part import LeafAppearance, LeafAssetSettings
from usdfoliage.asset.provenance import Provenance
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.leaf.shape.spray import scatter_spray

from tests.support.machines.blender import blender_interpreter

TOOL = Path(__file__).resolve().parents[2] / "tools" / "blender_import.py"
LEAVES = 60
SIDE_PX = 256
TINTED = (0.1, 0.1, 0.02)
REPRESENTATIONS = ("bezier", "subdiv", "mesh")

pytestmark = pytest.mark.preview


@pytest.fixture(scope="module")
def shots(tmp_path_factory):
    """A scene for each representation, with the asset referenced in it."""
    folder = tmp_path_factory.mktemp("a spray") / "spray"
    folder.mkdir()
    leaves = scatter_spray(LEAVES, np.random.default_rng(4))
    provenance = Provenance(capture="", generator="test", seed=4, input_sha256="")
    asset = write_leaf_asset(folder, "spray", leaves, provenance)
    written = {}
    for representation in REPRESENTATIONS:
        shot = Usd.Stage.CreateNew(str(folder.parent / f"{representation}.usda"))
        UsdGeom.SetStageUpAxis(shot, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(shot, 1.0)
        prim = UsdGeom.Xform.Define(shot, "/spray").GetPrim()
        prim.GetReferences().AddReference(f"./spray/{asset.name}")
        prim.GetVariantSet("representation").SetVariantSelection(representation)
        shot.Save()
        written[representation] = Path(shot.GetRootLayer().realPath)
    written["textured"] = write_textured(folder.parent / "textured")
    return written


def picture_color():
    """Blue, green and red of the leaf's picture, sRGB."""
    return 40, 120, 60


def write_textured(folder):
    """Three leaves of a picture that is green where a leaf is opaque, and tinted."""
    folder.mkdir()
    picture = np.zeros((32, 32, 4), np.uint8)
    picture[4:-4] = (*picture_color(), 255)
    assert cv2.imwrite(str(folder.parent / "leaf.png"), picture)
    appearance = LeafAppearance(texture=folder.parent / "leaf.png", texture_color=(0.05, 0.2, 0.02), color=TINTED)
    leaves = scatter_spray(3, np.random.default_rng(4))
    provenance = Provenance(capture="", generator="test", seed=4, input_sha256="")
    settings = LeafAssetSettings(representations=("mesh",))
    return write_leaf_asset(folder, "textured", leaves, provenance, settings, appearance=appearance)


@pytest.fixture(scope="module")
def blender(shots):
    """Blender's description of each scene, and its picture of the front."""
    python = blender_interpreter()
    seen = {}
    for representation, shot in shots.items():
        picture = shot.with_suffix(".png")
        words = [python, TOOL, shot, "--render", picture, "--size", str(SIDE_PX), str(SIDE_PX), "--samples", "4"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        seen[representation] = json.loads(done.stdout.splitlines()[-1]), cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)
    return seen


def assert_same_bounds(found, expected, share):
    size = np.ptp(expected, axis=0).max()
    np.testing.assert_allclose(found["bound_asset"], expected, atol=share * size)


@pytest.mark.parametrize("representation", ["subdiv", "mesh"])
def test_one_mesh_of_all_leaves_arrives(shots, blender, representation):
    found, _ = blender[representation]
    (mesh,) = (thing for thing in found["objects"] if thing["type"] == "MESH")
    assert mesh["islands"] == LEAVES
    assert mesh["uv_maps"] == ["st"]
    assert mesh["materials"] == ["Leaf"]
    assert mesh["subdivided"] == (representation == "subdiv")
    stage = Usd.Stage.Open(str(shots[representation]))
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/spray/geo/render/Leaves")).GetPointsAttr().Get())
    assert_same_bounds(found, [points.min(axis=0), points.max(axis=0)], 1e-3)


def test_the_picture_of_a_leaf_is_a_colour_and_its_opacity(blender):
    """Not data: linear numbers would be lighter greens. Its tint does not change what is cut away."""
    found, picture = blender["textured"]
    (image,) = found["images"]
    assert Path(image["file"]).suffix == ".png"
    assert image["color_space"] == "sRGB"
    opaque = picture[picture[..., 3] > 250][:, :3]
    assert len(opaque) > 0.5 * np.count_nonzero(picture[..., 3])  # no leaf is glass
    # What it shows is lit from all sides, with a gloss: the tint is by its ratio of red to green.
    _, green, red = decode_srgb(np.float64(picture_color()) / 255)
    drawn = decode_srgb(np.median(opaque, axis=0) / 255)
    assert drawn[2] / drawn[1] == pytest.approx(4 * red / green, rel=0.2)


def test_the_instancer_shows_a_mean_leaf_for_every_leaf(shots, blender):
    found, _ = blender["bezier"]
    assert found["instances"] == LEAVES
    stage = Usd.Stage.Open(str(shots["bezier"]))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/spray/geo/render/Leaves"))
    time = Usd.TimeCode.Default()
    matrices = np.array(instancer.ComputeInstanceTransformsAtTime(time, time))
    (prototype,) = instancer.GetPrototypesRel().GetTargets()
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(prototype)).GetPointsAttr().Get())
    world = points @ matrices[:, :3, :3] + matrices[:, 3:, :3]
    # Blender reads the half-float rotations.
    assert_same_bounds(found, [world.min(axis=(0, 1)), world.max(axis=(0, 1))], 2e-3)


def test_the_pictures_are_of_the_same_spray(blender):
    blender = {name: blender[name] for name in REPRESENTATIONS}
    covered = {name: picture[..., 3] > 127 for name, (_, picture) in blender.items()}
    assert covered["mesh"].mean() > 0.03
    # Cages are drawn as subdivision surfaces, instances as mean leaves: similar, not the same.
    for name, min_iou in (("subdiv", 0.97), ("bezier", 0.6)):
        both, either = covered[name] & covered["mesh"], covered[name] | covered["mesh"]
        assert both.sum() / either.sum() > min_iou
    green = {name: picture[covered[name]][:, :3].mean(axis=0) for name, (_, picture) in blender.items()}
    for color in green.values():
        assert color.argmax() == 1
        np.testing.assert_allclose(color, green["mesh"], atol=25)
