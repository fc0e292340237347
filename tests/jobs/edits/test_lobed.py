"""Edits of a leaf of several lobes: looks that bend, turn and twist its branches."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.__main__ import main
from usdfoliage.asset.looks.lobed import find_lobed_leaf
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.leaf.lobed.deformation import rotations_of

from tests.support.leaves.lobed import lobed_mask


@pytest.fixture(scope="module")
def ivy(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("lobed")
    mask = lobed_mask().astype(np.uint8) * 255
    cv2.imwrite(str(folder / "scan.png"), np.dstack([mask // 4, mask // 2, mask // 3, mask]))
    assert main(["lobed", str(folder / "scan.png"), "-o", str(folder / "ivy"), "--dpi", "300", "--no-preview"]) == 0
    return folder / "ivy"


def edit(asset: Path, look: Path, *words: object) -> int:
    return main(["edit", str(asset), "-o", str(look), *map(str, words)])


def points_of(stage: Usd.Stage) -> np.ndarray:
    return np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/ivy/geo/render/Leaves")).GetPointsAttr().Get())


def test_a_look_bends_one_branch_and_a_look_over_it_adds(ivy, tmp_path, capsys):
    bent, twisted = tmp_path / "bent.usda", tmp_path / "twisted.usda"
    assert edit(ivy, bent, "--bend", 50, "--branch", 1) == 0
    assert "bend of branch 1: 50 (was 0)" in capsys.readouterr().out
    assert edit(bent, twisted, "--twist", 30, "--bend", 10) == 0
    found = find_lobed_leaf(twisted)
    expected = np.zeros((3, 5))
    expected[1], expected[2] = 10, 30
    expected[1, 1] = 60
    assert np.degrees(rotations_of(found.leaf.functions, 5)) == pytest.approx(expected, abs=1e-4)
    stage = open_asset(twisted)
    assert points_of(stage) == pytest.approx(found.leaf.points_m(), abs=1e-6)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/ivy/geo/render/Leaves"))
    assert np.array(mesh.GetExtentAttr().Get()) == pytest.approx(
        np.array([points_of(stage).min(axis=0), points_of(stage).max(axis=0)])
    )
    assert not points_of(open_asset(ivy))[:, 2].any()


def test_a_look_reaches_a_scene_and_can_be_muted(ivy, tmp_path):
    look = tmp_path / "look.usda"
    assert edit(ivy, look, "--bend", 40) == 0
    scene = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    scene.GetRootLayer().subLayerPaths.append("./look.usda")
    prim = scene.DefinePrim("/World/leaf", "Xform")
    prim.GetReferences().AddReference(str(ivy / "ivy.usda"))
    mesh = UsdGeom.Mesh(scene.GetPrimAtPath("/World/leaf/geo/render/Leaves"))
    assert np.array(mesh.GetPointsAttr().Get())[:, 2].min() < -0.001
    scene.MuteLayer(str(look))
    assert not np.array(mesh.GetPointsAttr().Get())[:, 2].any()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--width", 2), "which has no --width"),
        (("--branch", 1), "no edit is named"),
        (("--bend", 1, 2), "takes one number of degrees"),
        (("--bend", "nan"), "bend must be -3600 to 3600 degrees"),
        (("--twist", 9999), "twist must be -3600 to 3600 degrees"),
        (("--bend", 10, "--branch", 5), "branch must be 0 to 4"),
        (("--bend", 10, "--branch", -1), "branch must be 0 to 4"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(ivy, tmp_path, capsys, words, reason):
    assert edit(ivy, tmp_path / "look.usda", *words) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
    assert not (tmp_path / "look.usda").exists()


def test_a_dry_run_writes_nothing(ivy, tmp_path, capsys):
    assert edit(ivy, tmp_path / "look.usda", "--turn", 20, "--dry-run") == 0
    assert "turn of branch 4: 20 (was 0)" in capsys.readouterr().out
    assert not (tmp_path / "look.usda").exists()
