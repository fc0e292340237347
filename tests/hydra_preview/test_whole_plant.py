"""Storm and Blender draw a whole plant in a scene by its lods and purposes."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pxr import UsdGeom
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.preview.recorder import find_interpreter

from tests.support.layered_scenes import MOVED, new_scene, place, write_layered_scene

TOOL = Path(__file__).resolve().parents[2] / "tools" / "blender_import.py"
SIDE_PX = 160
HALF_M = 7.5
LEAVES = 200

pytestmark = pytest.mark.preview


@pytest.fixture(scope="module")
def python():
    try:
        return find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")


@pytest.fixture(scope="module")
def scene(tmp_path_factory, python):
    return write_layered_scene(tmp_path_factory.mktemp("shot"), count=LEAVES)


def window(x_m):
    return PreviewView(
        output=Path("unused.png"), orthographic=True, window=(x_m - HALF_M, x_m + HALF_M, 2 - HALF_M, 2 + HALF_M)
    )


def draw(path, *purposes, **variants):
    """What Storm draws of both plants, (SIDE_PX, SIDE_PX, 4) each."""
    settings = PreviewSettings(
        width_px=SIDE_PX, height_px=SIDE_PX, samples=1, purposes=purposes, variants=tuple(variants.items())
    )
    return draw_views(path, [window(0.0), window(MOVED[0])], settings)


def covered(picture):
    return float((picture[..., 3] > 0.5).mean())


CROWN = np.pi * 5.9 * 6.8 / (2 * HALF_M) ** 2  # of the picture; a little less, for its mesh is coarse


@pytest.fixture(scope="module")
def pictures(scene):
    return {
        "render": draw(scene, "default", "render"),
        "proxy": draw(scene, "default", "proxy"),
    }


def test_in_a_picture_storm_draws_leaves_with_the_overrides(pictures):
    one, two = pictures["render"]
    assert 0.005 < covered(one) < 0.3
    assert 0.002 < covered(two) < 0.3
    red = two[two[..., 3] > 0.5][:, :3]
    assert (red[:, 0] > 3 * red[:, 1]).mean() > 0.5  # the leaves; the others are branches
    green = one[one[..., 3] > 0.5][:, :3]
    assert (green[:, 1] > green[:, 0]).mean() > 0.5


def test_the_look_widens_the_leaves_of_one_alone(pictures):
    one, two = pictures["render"]
    assert covered(one) > 1.5 * covered(two)


def test_while_one_works_storm_draws_the_crown_of_both_alone(pictures):
    one, two = pictures["proxy"]
    assert covered(one) == pytest.approx(covered(pictures["render"][0]), rel=0.05)  # without a proxy it is never blank
    assert covered(two) == pytest.approx(CROWN, rel=0.06)


def test_storm_which_does_not_know_usdlod_shows_leaves_in_auto(scene):
    known = [draw(scene, "default", lod=lod) for lod in ("auto", "leaves")]
    for auto, leaves in zip(*known, strict=True):
        assert covered(leaves) > 0.002
        assert np.array_equal(auto, leaves)


def test_storm_draws_instances_in_their_own_lods(scene):
    stage = new_scene(scene.with_name("stand.usda"))
    for name, lod, x_m in (("near", "leaves", 0.0), ("far", "crown", MOVED[0])):
        tree = place(stage, f"/set/{name}", scene.parent / "oak" / "oak.usda", lod=lod)
        tree.SetInstanceable(True)
        UsdGeom.XformCommonAPI(tree).SetTranslate((x_m, 0.0, 0.0))
    stage.Save()
    near, far = draw(scene.with_name("stand.usda"), "default", "render")
    assert 0.002 < covered(near) < 0.3
    assert covered(far) == pytest.approx(CROWN, rel=0.06)


@pytest.fixture(scope="module")
def blender(scene, python):
    """Blender's description of a scene."""
    if subprocess.run([python, "-c", "import bpy"], capture_output=True, check=False).returncode:
        pytest.skip(f"{python} has no bpy, which is Blender as a module")

    def describe(path):
        done = subprocess.run([python, TOOL, path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return describe


def test_blender_opens_the_scene_with_both_plants(scene, blender):
    found = blender(scene)
    meshes = {thing["name"]: thing for thing in found["objects"] if thing["type"] == "MESH"}
    leaves = [mesh for mesh in meshes.values() if mesh["islands"] == LEAVES]
    assert len(leaves) == 1  # the mesh of the second; the first are instances
    assert leaves[0]["materials"] == ["Autumn"]
    assert found["instances"] == LEAVES
    assert sum(name.startswith("Branches") for name in meshes) == 2
    assert {"Autumn", "Bark", "Leaf"} <= set(found["materials"])
    low, high = np.array(found["bound_asset"])
    assert high[0] > MOVED[0]
    assert low[0] < -3


def test_blender_is_never_blank_and_never_shows_both(scene, blender):
    stage = new_scene(scene.with_name("lods.usda"))
    for lod in ("auto", "crown"):
        place(stage, f"/set/{lod}", scene.parent / "oak" / "oak.usda", lod=lod, representation="mesh")
    stage.Save()
    found = blender(scene.with_name("lods.usda"))
    meshes = sorted(thing["name"] for thing in found["objects"] if thing["type"] == "MESH")
    assert meshes == ["Branches", "Crown", "Leaves"]  # of auto what does not need a choice, of crown the crown
