"""Baking from the command line: the edits become parameters, everything else travels along."""

import os
import shutil

import cv2
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt
from usdfoliage.leaf.shape.edits import LeafEdits, apply_edits

from tests.support.leaves.commands import attribute, files, patch_count, printed, read, refused, run

EDITS = ("--width", 1.4, "--asymmetry", 0.05, -0.02, "--silhouette", 2, 0.02, 0.05, 0.03, "--curl", 0.02, 0.05, 0.1)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A spray with pictures and known facts of each leaf, and a look of it, in a folder with a space."""
    folder = tmp_path_factory.mktemp("my assets")
    cv2.imwrite(str(folder / "leaf.png"), np.full((8, 8, 4), 128, np.uint8))
    cv2.imwrite(str(folder / "wave.png"), np.linspace(0, 255, 16).astype(np.uint8)[None])
    words = ("--texture", folder / "leaf.png", "--jitter-map", folder / "wave.png", "--color", 0.2, 0.3, 0.1)
    assert run("scatter", "-n", 8, "-o", folder / "spray", "--seed", 7, *words) == 0
    layer = Sdf.Layer.FindOrOpen(str(folder / "spray" / "payload" / "leaves.usdc"))
    stage = Usd.Stage.Open(layer)
    leaves = stage.GetPrimAtPath("/spray/geo/render/Leaves")
    facts = (
        ("confidence", Sdf.ValueTypeNames.FloatArray, Vt.FloatArray([k / 8 for k in range(8)])),
        ("residual", Sdf.ValueTypeNames.FloatArray, Vt.FloatArray([k / 4096 for k in range(8)])),
        ("view", Sdf.ValueTypeNames.IntArray, Vt.IntArray([k % 3 - 1 for k in range(8)])),
    )
    for name, kind, values in facts:
        UsdGeom.PrimvarsAPI(leaves).CreatePrimvar(f"leaf:{name}", kind, UsdGeom.Tokens.varying).Set(values)
    layer.Save()
    interface = Sdf.Layer.FindOrOpen(str(folder / "spray" / "spray.usda"))
    stage = Usd.Stage.Open(interface, Usd.Stage.LoadNone)
    root = stage.GetDefaultPrim()
    root.GetAttribute("foliage:species").Set("Quercus robur")
    root.GetAttribute("foliage:capture").Set("oak.jpg")
    interface.Save()
    assert run("edit", folder / "spray", *EDITS, "--jitter", 0.02, 6, "-o", folder / "look.usda") == 0
    return folder


def test_edits_become_parameters_and_everything_else_travels(source, tmp_path, capsys):
    out = tmp_path / "baked leaves"
    before = files(source)

    lines = printed(capsys, "bake", source / "look.usda", "-o", out)

    assert "leaves: 8, from bezier" in lines
    assert any(line.startswith("baked edits: width 1.4; axis1 0.05 -0.02 0") for line in lines)
    assert any(
        "the jitter stays an edit: " in line and "nurbs has the slow part of it, subdiv" in line for line in lines
    )
    assert f"asset: {out / 'baked_leaves.usda'}" in lines
    assert files(source) == before
    edited, baked = read(source / "look.usda"), read(out)
    expected = apply_edits(edited.leaves.parameters, edited.edits)
    np.testing.assert_array_equal(baked.leaves.parameters, expected.astype(np.float32))
    assert baked.edits == LeafEdits(jitter_amplitude=edited.edits.jitter_amplitude, jitter_frequency=6)
    for name in ("base_m", "orientation", "length_m", "phase", "color", "confidence", "residual_m", "view"):
        np.testing.assert_array_equal(getattr(baked.leaves, name), getattr(edited.leaves, name), err_msg=name)
    assert baked.jitter_map.read_bytes() == (source / "wave.png").read_bytes()
    assert (source / "leaf.png").read_bytes() in files(out).values()
    np.testing.assert_array_equal(attribute(out, "mesh", "primvars:displayColor"), edited.leaves.color)
    stage = Usd.Stage.Open(str(out / "baked_leaves.usda"))
    root = stage.GetDefaultPrim()
    assert root.GetAttribute("foliage:species").Get() == "Quercus robur"
    assert root.GetAttribute("foliage:capture").Get() == "oak.jpg"
    record = stage.GetRootLayer().customLayerData["usdfoliage"]
    assert record["seed"] == 7
    assert "width 1.4" in record["settings"]["bake-edits"]
    for name, data in files(out).items():
        assert str(tmp_path).encode() not in data, name
        assert str(source).encode() not in data, name


def test_all_representations_are_the_same_leaves(source, tmp_path):
    look = tmp_path / "smooth.usda"
    assert run("edit", source / "spray", *EDITS, "-o", look) == 0
    out = tmp_path / "baked"
    assert run("bake", look, "-o", out, "--resolution", 16, 32) == 0
    assert patch_count(out) == 8
    leaves = read(out).leaves
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    points = attribute(out, "mesh", "points").reshape(8, -1, 3)
    for leaf in range(8):
        away = np.linalg.norm(points[leaf] - leaves.base_m[leaf], axis=1) / leaves.length_m[leaf]
        assert away.min() < 1e-5
        low, high = np.minimum(low, points[leaf].min(axis=0)), np.maximum(high, points[leaf].max(axis=0))
    cage = attribute(out, "subdiv", "points")
    size = (high - low).max()
    np.testing.assert_allclose(cage.min(axis=0), low, atol=0.05 * size)
    np.testing.assert_allclose(cage.max(axis=0), high, atol=0.05 * size)


def test_baking_twice_changes_nothing_more(source, tmp_path):
    assert run("bake", source / "look.usda", "-o", tmp_path / "one", "--name", "oak") == 0
    assert run("bake", tmp_path / "one", "-o", tmp_path / "two", "--name", "oak") == 0
    one, two = (files(tmp_path / name) for name in ("one", "two"))
    assert one.keys() == two.keys()
    assert [name for name in one if one[name] != two[name]] in ([], ["oak.usda"])  # which records what was baked


def test_the_same_bake_gives_the_same_bytes(source, tmp_path):
    for name in ("one", "two"):
        assert run("bake", source / "look.usda", "-o", tmp_path / name, "--name", "oak") == 0
    assert files(tmp_path / "one") == files(tmp_path / "two")


def test_representations_and_resolution(source, tmp_path, capsys):
    out = tmp_path / "a"
    lines = printed(capsys, "bake", source / "spray", "-o", out, "--representation", "mesh", "--resolution", 4, 6)
    assert "representations: bezier, mesh" in lines
    assert "baked edits: none" in lines
    assert not (out / "payload" / "leaves_nurbs.usdc").exists()
    coarse = len(attribute(out, "mesh", "points"))
    assert coarse < len(attribute(source / "spray", "mesh", "points"))
    # Without the option, those that the asset has.
    assert "representations: bezier, mesh" in printed(capsys, "bake", out, "-o", tmp_path / "b")


def test_refresh_in_place(source, tmp_path, capsys):
    asset = tmp_path / "folder"
    shutil.copytree(source / "spray", asset)
    look = tmp_path / "look.usda"
    assert run("edit", asset, "--width", 2, "-o", look) == 0
    wide = read(look)
    # As an artist would do it: an edit in the asset's own layer.
    lines = printed(capsys, "bake", look, "-o", asset / ".." / "folder")
    assert any("act twice" in line for line in lines)
    assert f"asset: {asset / '..' / 'folder' / 'spray.usda'}" in lines  # its name stays
    np.testing.assert_allclose(
        read(asset).leaves.parameters, apply_edits(wide.leaves.parameters, wide.edits), atol=1e-7
    )
    assert read(asset).edits.width == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder", "look.usda"]

    (asset / "notes.txt").write_text("years of work")
    before = files(asset)
    assert "notes.txt" in refused(capsys, "bake", asset, "-o", asset)
    assert files(asset) == before
    assert run("bake", asset, "-o", asset, "--force") == 0
    assert (asset / "notes.txt").read_text() == "years of work"


def test_a_look_of_one_placement_is_baked_under_the_assets_name(source, tmp_path, capsys):
    asset = tmp_path / "spray"
    shutil.copytree(source / "spray", asset)
    assert run("edit", asset, "--width", 2, "--prim", "/World/hedge", "-o", tmp_path / "look.usda") == 0
    wide = read(tmp_path / "look.usda")
    assert wide.edits.width == 2
    assert f"asset: {asset / 'spray.usda'}" in printed(capsys, "bake", tmp_path / "look.usda", "-o", asset)
    np.testing.assert_allclose(read(asset).leaves.parameters[:, 2:5, 1], 2 * wide.leaves.parameters[:, 2:5, 1])


def test_patches_that_a_modeller_changed_come_back(source, tmp_path, capsys):
    asset = tmp_path / "spray"
    assert run("bake", source / "spray", "-o", asset) == 0  # so that the patches know the facts of each leaf too
    scene = tmp_path / "model.usda"
    stage = Usd.Stage.CreateNew(str(scene))
    plant = stage.DefinePrim("/spray")
    plant.GetReferences().AddReference("./spray/spray.usda")
    plant.GetVariantSets().SetSelection("representation", "nurbs")
    stage.SetDefaultPrim(plant)
    stage.Save()
    assert not any("not read" in line for line in printed(capsys, "bake", scene, "-o", tmp_path / "same"))
    patch = UsdGeom.NurbsPatch(stage.GetPrimAtPath("/spray/geo/render/Leaves").GetChildren()[3])
    points = np.array(patch.GetPointsAttr().Get())
    points[:, 0] *= 1.5  # wider, and nearly a leaf still
    patch.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points))
    stage.Save()

    unread = "note: 1 patch of the representation nurbs has changes that were not read: --from nurbs reads them"
    assert unread in printed(capsys, "bake", scene, "-o", tmp_path / "unread")
    lines = printed(capsys, "bake", scene, "--from", "nurbs", "-o", tmp_path / "back")
    assert not any("not read" in line for line in lines)

    assert "leaves: 8, from nurbs" in lines
    assert any(line.startswith("note: 1 of 8 patches were changed") and "mm" in line for line in lines)
    before, after = read(asset).leaves, read(tmp_path / "back").leaves
    others = [0, 1, 2, 4, 5, 6, 7]
    np.testing.assert_array_equal(after.parameters[others], before.parameters[others])
    np.testing.assert_allclose(after.base_m[others], before.base_m[others], atol=1e-6)
    np.testing.assert_allclose(after.length_m[others], before.length_m[others], rtol=1e-6)
    same = np.abs(np.sum(after.orientation[others] * before.orientation[others], axis=1))
    np.testing.assert_allclose(same, 1, atol=1e-6)
    np.testing.assert_array_equal(after.view, before.view)
    np.testing.assert_allclose(after.parameters[3, 2:5, 1], 1.5 * before.parameters[3, 2:5, 1], rtol=0.1)
    np.testing.assert_allclose(after.length_m[3], before.length_m[3], rtol=1e-4)


def test_leaves_that_were_moved_or_hidden_in_a_scene(source, tmp_path, capsys):
    scene = tmp_path / "moved.usda"
    stage = Usd.Stage.CreateNew(str(scene))
    plant = stage.DefinePrim("/spray")
    plant.GetReferences().AddReference(str(source / "spray" / "spray.usda"))
    stage.SetDefaultPrim(plant)
    UsdGeom.Xformable(plant).AddTranslateOp().Set((9, 9, 9))  # where the plant stands is no part of the plant
    leaves = UsdGeom.PointInstancer(stage.GetPrimAtPath("/spray/geo/render/Leaves"))
    leaves.AddTranslateOp().Set((0, 1, 0))
    leaves.AddRotateYOp().Set(90)
    leaves.AddScaleOp().Set((2, 2, 2))
    leaves.InvisId(5, Usd.TimeCode.Default())
    width = leaves.GetPrim().GetAttribute("primvars:leaf:edit:width")
    width.Set(1.0, 1)
    width.Set(2.0, 10)
    stage.Save()
    lines = printed(capsys, "bake", scene, "-o", tmp_path / "a", "--representation", "mesh")
    assert "note: 1 leaf is hidden and left out" in lines
    assert "note: animated: leaf:edit:width; baked as at the earliest time" in lines
    before, after = read(source / "spray").leaves.take([0, 1, 2, 3, 4, 6, 7]), read(tmp_path / "a").leaves
    x, y, z = before.base_m.T
    np.testing.assert_allclose(after.base_m, np.stack([2 * z, 2 * y + 1, -2 * x], axis=1), atol=1e-6)
    np.testing.assert_allclose(after.length_m, 2 * before.length_m, rtol=1e-6)
    turned = before.asset_from_leaf()[:, :, :3]
    expected = np.array([[0, 0, 2], [0, 2, 0], [-2, 0, 0]]) @ turned
    np.testing.assert_allclose(after.asset_from_leaf()[:, :, :3], expected, atol=1e-6)

    leaves.GetOrderedXformOps()[2].Set((1, 2, 1))
    stage.Save()
    assert "stretches" in refused(capsys, "bake", scene, "-o", tmp_path / "b")


def test_a_dry_run_writes_nothing(source, tmp_path, capsys):
    lines = printed(capsys, "bake", source / "look.usda", "-o", tmp_path / "a", "--dry-run")
    assert f"would write: {tmp_path / 'a' / 'a.usda'}" in lines
    assert any(line.startswith("baked edits: width 1.4") for line in lines)
    assert list(tmp_path.iterdir()) == []


def test_a_dry_run_refuses_what_a_run_refuses(source, tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    words = ("bake", source / "look.usda", "-o", tmp_path)
    assert refused(capsys, *words, "--dry-run") == refused(capsys, *words)


def test_paths_with_dots(source, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert (
        run("bake", os.path.relpath(source / "look.usda"), "-o", "../there/./5 oaks", "--representation", "mesh") == 0
    )
    assert (tmp_path / "there" / "5 oaks" / "_5_oaks.usda").exists()


class TestBadInput:
    """Exit 2, one line, nothing written."""

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--representation", "voxels"), "bezier, nurbs, subdiv, mesh"),
            (("--resolution", 3, 4), "across"),
            (("--resolution", -2, 4), "across"),
        ],
    )
    def test_impossible_settings(self, source, tmp_path, capsys, words, message):
        assert message in refused(capsys, "bake", source / "spray", *words, "-o", tmp_path / "a")
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("damage", ["short", "nan", "missing", "scale"])
    def test_damaged_leaves(self, source, tmp_path, capsys, damage):
        asset = tmp_path / "bad oak"
        shutil.copytree(source / "spray", asset)
        layer = Sdf.Layer.FindOrOpen(str(asset / "payload" / "leaves.usdc"))
        stage = Usd.Stage.Open(layer)
        leaves = stage.GetPrimAtPath("/spray/geo/render/Leaves")
        inner = leaves.GetAttribute("primvars:leaf:inner")
        values = np.array(inner.Get())
        if damage == "short":
            inner.Set(Vt.Vec3fArray.FromNumpy(values[:-1]))
        elif damage == "nan":
            values[2, 1] = np.nan
            inner.Set(Vt.Vec3fArray.FromNumpy(values))
        elif damage == "missing":
            leaves.RemoveProperty("primvars:leaf:inner")
        else:
            leaves.GetAttribute("scales").Set(Vt.Vec3fArray(8, (-1, -1, -1)))
        layer.Save()
        for command in (("bake", asset, "-o", tmp_path / "a"), ("info", asset)):
            line = refused(capsys, *command)
            assert "bad oak" in line
            assert "scales" in line if damage == "scale" else "leaf:inner" in line
        assert sorted(p.name for p in tmp_path.iterdir()) == ["bad oak"]

    def test_places_that_would_harm_the_source(self, source, tmp_path, capsys):
        asset = tmp_path / "assets" / "spray"
        shutil.copytree(source / "spray", asset)
        before = files(tmp_path)
        for place in (asset / "baked", asset / "payload", asset.parent, tmp_path):
            line = refused(capsys, "bake", asset / "spray.usda", "-o", place, "--force")
            assert str(asset) in line
            assert "is read" in line
        assert files(tmp_path) == before

    def test_no_such_variant_to_read(self, source, tmp_path, capsys):
        assert run("bake", source / "spray", "-o", tmp_path / "a", "--representation", "mesh") == 0
        line = refused(capsys, "bake", tmp_path / "a", "--from", "nurbs", "-o", tmp_path / "b")
        assert "bezier, mesh" in line

    def test_assets_that_are_none(self, source, tmp_path, capsys):
        theirs = tmp_path / "theirs.usda"
        theirs.write_text('#usda 1.0\ndef Xform "World" {}\n')
        for asset in (tmp_path / "absent", theirs):
            assert asset.name in refused(capsys, "bake", asset, "-o", tmp_path / "a")
        pair = tmp_path / "pair.usda"
        stage = Usd.Stage.CreateNew(str(pair))
        for name in "ab":
            stage.DefinePrim(f"/{name}").GetReferences().AddReference(str(source / "spray" / "spray.usda"))
        stage.Save()
        assert "2 plants" in refused(capsys, "bake", pair, "-o", tmp_path / "a")
        assert not (tmp_path / "a").exists()

    def test_a_missing_texture(self, source, tmp_path, capsys):
        asset = tmp_path / "oak"
        shutil.copytree(source / "spray", asset)
        for picture in (asset / "maps").glob("*.png"):
            if picture.read_bytes() == (source / "leaf.png").read_bytes():
                picture.unlink()
        assert "texture" in refused(capsys, "bake", asset, "-o", tmp_path / "a")

    def test_a_full_disk(self, source, small_disk, capsys):
        line = refused(capsys, "bake", source / "look.usda", "-o", small_disk / "oak", "--resolution", 64, 128)
        assert "oak" in line
        assert "No space left" in line or "full" in line
        assert list(small_disk.iterdir()) == []
