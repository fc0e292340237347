"""A tree of a drawn photograph, by the command."""

import json

import cv2
import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.__main__ import main
from usdfoliage.jobs.models import read_models
from usdfoliage.sketch.strokes import TreeStrokes, read_strokes

from tests.support.commands.json_output import read_output
from tests.support.photographs.drawn_trees import DrawnTree, draw_bare, draw_leafy, write_photograph

SMALL = ["--no-preview", "--most-leaves", "1500", "--reproducible"]


def write_tree(folder, tree: DrawnTree, trees=1):
    return write_photograph(folder, tree, "tree photo", trees)


@pytest.fixture(scope="module")
def leafy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("leafy")
    tree = draw_leafy()
    photo, strokes = write_tree(folder, tree)
    out = folder / "oak"
    assert main(["sketch", str(photo), "-o", str(out), "--height", "4", *SMALL]) == 0
    return tree, photo, strokes, out


def test_the_asset_is_a_whole_plant_of_the_height_that_was_asked_for(leafy):
    _, _, strokes, out = leafy
    models = read_models(out)
    assert models.skeleton is not None
    assert np.ptp(models.skeleton.points_m[:, 1]) == pytest.approx(4, rel=0.1)
    assert (models.skeleton.radius_m > 0).all()
    stage = Usd.Stage.Open(str(out / "oak.usda"))
    plant = stage.GetDefaultPrim()
    assert {"lod", "representation", "branches"} <= set(plant.GetVariantSets().GetNames())
    assert main(["validate", str(out)]) == 0
    kept = read_strokes(out / "strokes.json")
    np.testing.assert_allclose(kept.trees[0].crown_px, read_strokes(strokes).trees[0].crown_px)
    assert (out / "report" / "index.html").is_file()


def test_from_the_front_it_is_the_photograph(leafy):
    tree, _, _, out = leafy
    stage = Usd.Stage.Open(str(out / "oak.usda"))
    plant = stage.GetDefaultPrim()
    asset_from_photo = np.array(plant.GetAttribute("foliage:captureToAsset").Get()).T
    scale = np.linalg.norm(asset_from_photo[:3, 0])
    np.testing.assert_allclose(asset_from_photo[:3, :3], scale * np.diag([1, -1, 1]), atol=1e-9)
    leaves = next(UsdGeom.PointInstancer(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.PointInstancer))
    base_m = np.array(leaves.GetPositionsAttr().Get())
    pixels = (np.linalg.inv(asset_from_photo) @ np.c_[base_m, np.ones(len(base_m))].T)[:2].T
    drawn = np.zeros(tree.leaves.shape, np.uint8)
    for x, y in pixels:
        cv2.circle(drawn, (int(x), int(y)), 7, 1, -1)
    both = ((drawn > 0) & tree.leaves).sum() / ((drawn > 0) | tree.leaves).sum()
    assert both > 0.8
    depth_m = base_m[:, 2]
    assert depth_m.std() / base_m[:, 0].std() == pytest.approx(1, abs=0.25)


def test_the_same_strokes_give_the_same_bytes_and_are_printed_as_json(leafy, tmp_path, capsys):
    _, photo, strokes, out = leafy
    again = tmp_path / "oak"
    words = ["sketch", str(photo), "--strokes", str(strokes), "-o", str(again), "--height", "4", *SMALL]
    assert main([*words, "--json"]) == 0
    assert read_output("sketch", capsys.readouterr().out)["asset"] == str(again / "oak.usda")
    for name in ("leaves_bezier.usdc", "skeleton.usdc", "branches.usdc"):
        for one in sorted(out.rglob(name)):
            assert one.read_bytes() == (again / one.relative_to(out)).read_bytes()
    assert list(out.rglob("skeleton.usdc"))


def test_a_bare_tree_has_no_leaves_and_its_branches_are_those_of_the_picture(tmp_path, capsys):
    tree = draw_bare()
    photo, _ = write_tree(tmp_path, tree)
    assert main(["sketch", str(photo), "-o", str(tmp_path / "ash"), "--json", *SMALL]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert "tree-without-leaves" in [each["code"] for each in printed["remarks"]]
    skeleton = read_models(tmp_path / "ash").skeleton
    assert (~skeleton.inferred).sum() == 4


def test_a_tape_gives_the_scale(tmp_path):
    tree = draw_leafy()
    photo, _ = write_tree(tmp_path, tree)
    tape = ["--tape", "10", "20", "10", "120", "2", "--no-crown"]
    assert main(["sketch", str(photo), "-o", str(tmp_path / "oak"), *tape, *SMALL]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "oak" / "oak.usda"))
    matrix = np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get())
    assert np.linalg.norm(matrix[0, :3]) == pytest.approx(0.02)
    kept = ["--strokes", str(tmp_path / "oak" / "strokes.json"), "--no-crown"]
    assert main(["sketch", str(photo), "-o", str(tmp_path / "again"), *kept, *SMALL]) == 0
    again = Usd.Stage.Open(str(tmp_path / "again" / "again.usda"))
    np.testing.assert_allclose(again.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get(), matrix)


def test_a_large_photograph_is_made_of_a_smaller_picture(tmp_path):
    tree = draw_leafy()
    factor = 6
    large = DrawnTree(
        srgb=cv2.resize(tree.srgb, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST),
        strokes=TreeStrokes(
            crown_px=factor * tree.strokes.crown_px, branches_px=(factor * tree.strokes.branches_px[0],)
        ),
        leaves=tree.leaves,
        branches=tree.branches,
    )
    photo, _ = write_tree(tmp_path, large)
    assert main(["sketch", str(photo), "-o", str(tmp_path / "oak"), "--height", "4", "--no-crown", *SMALL]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "oak" / "oak.usda"))
    asset_from_photo = np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get()).T
    root_m = asset_from_photo @ [*(factor * tree.strokes.branches_px[0][0]), 0, 1]
    np.testing.assert_allclose(root_m[:2], 0, atol=0.03)
    top_px = np.nonzero(tree.leaves.any(axis=1))[0].min() * factor
    assert (asset_from_photo @ [0, top_px, 0, 1])[1] == pytest.approx(4, rel=0.05)


def test_it_sways_and_grows_on_request(tmp_path):
    photo, _ = write_tree(tmp_path, draw_bare())
    words = ["--sway", "4", "--growth", "3", "--rig-order", "1"]
    assert main(["sketch", str(photo), "-o", str(tmp_path / "ash"), *words, *SMALL]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "ash" / "ash.usda"))
    sets = stage.GetDefaultPrim().GetVariantSets()
    assert sets.GetVariantSet("rig").GetVariantNames() == ["none", "skel"]
    assert sets.GetVariantSet("growth").GetVariantNames() == ["growing", "still"]
    assert main(["validate", str(tmp_path / "ash")]) == 0


def test_several_trees_are_several_assets(tmp_path):
    photo, _ = write_tree(tmp_path, draw_leafy(), trees=2)
    assert main(["sketch", str(photo), "-o", str(tmp_path / "out"), "--no-crown", *SMALL]) == 0
    assert (tmp_path / "out" / "tree_01" / "tree_01.usda").is_file()
    assert (tmp_path / "out" / "tree_02" / "tree_02.usda").is_file()


def test_a_dry_run_writes_nothing(tmp_path, capsys):
    photo, _ = write_tree(tmp_path, draw_leafy())
    assert main(["sketch", str(photo), "-o", str(tmp_path / "out"), "--dry-run"]) == 0
    assert "trees 1" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()


def test_settings_beside_strokes_count_under_options(tmp_path, capsys):
    photo, strokes = write_tree(tmp_path, draw_leafy())
    content = json.loads(strokes.read_text())
    chosen = {"height_m": 4, "depth": 2.5, "density": 0.5, "gravity": 0.5, "leaf_length_m": 0.1, "seed": 5}
    strokes.write_text(json.dumps({**content, "settings": chosen}))
    assert main(["sketch", str(photo), "-o", str(tmp_path / "out"), "--dry-run", "--depth", "1.5"]) == 0
    planned = capsys.readouterr().out
    for words in ("height 4,", "depth 1.5,", "density 0.5,", "gravity 0.5,", "leaf-length 0.1,", "seed 5,"):
        assert words in planned
    strokes.write_text(json.dumps({**content, "settings": {"depth": 50}}))
    assert main(["sketch", str(photo), "-o", str(tmp_path / "out")]) == 2
    assert "settings: depth must be 0.1 to 5, not 50" in capsys.readouterr().err


def test_density_is_that_of_the_leaves(leafy, tmp_path):
    _, photo, _, _ = leafy
    counts = []
    for density in ("0.25", "0.5"):
        out = tmp_path / density
        words = ["--no-preview", "--no-crown", "--most-leaves", "100000", "--density", density, "--json"]
        assert main(["sketch", str(photo), "-o", str(out), *words]) == 0
        stage = Usd.Stage.Open(str(next(out.glob("*.usda"))))
        leaves = next(UsdGeom.PointInstancer(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.PointInstancer))
        counts.append(len(leaves.GetPositionsAttr().Get()))
    assert counts[0] / counts[1] == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--gravity", "2"], "gravity must be"),
        (["--density", "0"], "density must be"),
        (["--height", "0"], "height must be above 0"),
        (["--depth", "9"], "depth must be"),
        (["--tape", "1", "1", "1", "1", "2"], "--tape"),
        (["--leaf-length", "-1"], "the leaf length must be"),
        (["--species", "no such one"], "no species"),
        (["--strokes", "none.json"], "none.json"),
    ],
)
def test_what_cannot_be_is_one_line_and_nothing_written(tmp_path, capsys, words, error):
    photo, _ = write_tree(tmp_path, draw_leafy())
    assert main(["sketch", str(photo), "-o", str(tmp_path / "out"), *words]) == 2
    complained = capsys.readouterr().err
    assert error in complained
    assert complained.count("error: ") == 1
    assert not (tmp_path / "out").exists()


def test_a_crown_of_sky_alone_is_refused(tmp_path, capsys):
    tree = draw_leafy()
    photo, strokes = write_tree(tmp_path, tree)
    content = json.loads(strokes.read_text())
    content["crown"] = [[2, 2], [30, 2], [30, 30], [2, 30]]
    strokes.write_text(json.dumps(content))
    assert main(["sketch", str(photo), "-o", str(tmp_path / "out"), *SMALL]) == 2
    assert "no leaves" in capsys.readouterr().err


def test_forms_of_leaves_are_written_on_request(tmp_path):
    photo, _ = write_tree(tmp_path, draw_leafy(120, 160))
    words = ["--no-preview", "--no-crown", "--most-leaves", "100", "--representation", "subdiv"]
    assert main(["sketch", str(photo), "-o", str(tmp_path / "out"), *words]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "out" / "out.usda"))
    forms = stage.GetDefaultPrim().GetVariantSets().GetVariantSet("representation")
    assert forms.GetVariantNames() == ["bezier", "subdiv"]
