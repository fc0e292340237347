"""Blender opens a forest: every plant is an instance at its place, in one piece and in tiles, and Cycles draws it."""

import json
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.__main__ import main

from tests.support.forests.shots import forest_words
from tests.support.machines.blender import blender_interpreter

TOOL = Path(__file__).resolve().parents[2] / "tools" / "blender_import.py"

pytestmark = pytest.mark.preview


@pytest.mark.parametrize("tile", [[], ["--tile", "30"]], ids=["in one piece", "in tiles"])
def test_every_plant_of_a_forest_is_an_instance(tmp_path, tile):
    python = blender_interpreter()
    assert main([*forest_words(tmp_path), *tile, "-o", str(tmp_path / "valley")]) == 0
    interface = tmp_path / "valley" / "valley.usda"
    picture = tmp_path / "cycles.png"
    done = subprocess.run(
        [python, TOOL, interface, "--render", picture, "--size", "160", "96", "--samples", "4"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    stage = Usd.Stage.Open(str(interface))
    plants = [prim for prim in stage.Traverse() if prim.HasAPI("FoliageForestAPI")]
    count = sum(len(UsdGeom.PointInstancer(prim).GetIdsAttr().Get()) for prim in plants)
    assert count > 50
    assert found["instances"] == 2 * count  # a crown and its trunk
    hint = np.array(stage.GetDefaultPrim().GetAttribute("extentsHint").Get())
    bound = np.array(found["bound_asset"])
    assert (bound[0] >= hint[0] - 0.01).all()
    assert (bound[1] <= hint[1] + 0.01).all()
    assert np.ptp(cv2.imread(str(picture))[..., :3], axis=(0, 1)).max() > 50
