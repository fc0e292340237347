"""Blender as the artist's application: a rig of branches arrives as an armature that moves the surface as USD does."""

import json
import subprocess

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdSkel
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.jobs.branches.motion import BranchMotion

from tests.support.branch_motions import write_moving
from tests.support.branch_shapes import fork
from tests.support.machines.blender import blender_interpreter

pytestmark = pytest.mark.preview

FRAME = 3
SCRIPT = f"""
import json, sys
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=sys.argv[1])
(rig,) = (found for found in bpy.data.objects if found.type == "ARMATURE")
(tree,) = (found for found in bpy.data.objects if found.type == "MESH")
bones = {{bone.name: bone.parent.name if bone.parent else "" for bone in rig.data.bones}}
for modifier in tree.modifiers:
    modifier.show_viewport = modifier.type == "ARMATURE"
bpy.context.scene.frame_set({FRAME})
moved = tree.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
points = [list(vertex.co) for vertex in moved.vertices]
print("result", json.dumps({{"bones": bones, "points": points}}))
"""


def test_blender_moves_the_surface_as_usd_does(tmp_path):
    python = blender_interpreter()
    motion = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=4, swing_rad=0.3))
    stage = Usd.Stage.Open(str(write_moving(tmp_path / "fork", "fork", fork(), motion)))
    stage.GetDefaultPrim().GetVariantSet("rig").SetVariantSelection("skel")
    stage.Flatten().Export(str(tmp_path / "rigged.usdc"))
    done = subprocess.run([python, "-c", SCRIPT, tmp_path / "rigged.usdc"], capture_output=True, text=True, check=True)
    result = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("result"))[len("result") :])
    assert result["bones"] == {"branch_0": "", "branch_1": "branch_0", "branch_2": "branch_1"}
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/fork/geo/render/Branches"))
    rest = np.array(mesh.GetPointsAttr().Get())
    assert UsdSkel.BakeSkinning(stage.Traverse())
    baked = np.array(mesh.GetPointsAttr().Get(FRAME))
    assert np.array(result["points"]) == pytest.approx(baked, abs=1e-5)
    assert np.abs(baked - rest).max() > 0.05
