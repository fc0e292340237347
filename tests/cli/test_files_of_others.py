"""What an asset names outside its folder, or what is no picture, is never copied into another asset."""

import os
import shutil

import cv2
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdMedia

from tests.support.leaves.commands import files, printed, refused, run
from tests.support.plant_assets import write_whole_plant

SECRET = b"the password of the studio"
OUTSIDE = ["../../secret.txt", "{studio}/secret.txt", "../../private.png", "{studio}/private.png"]


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """A spray with a texture and a map of its jitter, and a whole plant, in a folder beside which a secret lies."""
    folder = tmp_path_factory.mktemp("studio")
    cv2.imwrite(str(folder / "leaf.png"), np.full((8, 8, 4), 128, np.uint8))
    cv2.imwrite(str(folder / "wave.png"), np.linspace(0, 255, 16).astype(np.uint8)[None])
    words = ("--texture", folder / "leaf.png", "--jitter-map", folder / "wave.png")
    assert run("scatter", "-n", 4, "-o", folder / "spray", *words) == 0
    write_whole_plant(folder / "oak")
    return folder


@pytest.fixture
def studio(given, tmp_path):
    folder = tmp_path / "studio"
    shutil.copytree(given, folder)
    (folder / "secret.txt").write_bytes(SECRET)
    cv2.imwrite(str(folder / "private.png"), np.full((8, 8, 3), 77, np.uint8))
    cv2.imwrite(str(folder / "private_wave.png"), np.linspace(255, 0, 8).astype(np.uint8)[None])
    return folder


def name_elsewhere(asset, old, new):
    """Let every attribute of an asset's layers that names a file whose name ends with old name another one."""
    count = 0
    for path in (*asset.glob("*.usd*"), *asset.glob("payload/*.usd*")):
        layer = Sdf.Layer.FindOrOpen(str(path))
        found = []
        layer.Traverse("/", found.append)
        for spec in (layer.GetAttributeAtPath(at) for at in found if at.IsPropertyPath()):
            if spec and isinstance(spec.default, Sdf.AssetPath) and spec.default.path.endswith(old):
                spec.default = Sdf.AssetPath(str(new))
                count += 1
        layer.Save()
    assert count


def copied(folder):
    """What of the files beside the assets is in what was written."""
    names = ("private.png", "private_wave.png")
    private = {SECRET, *((folder.parent / "studio" / name).read_bytes() for name in names)}
    return private & set(files(folder).values()) if folder.exists() else set()


@pytest.mark.parametrize("name", OUTSIDE)
@pytest.mark.parametrize("dry", [False, True])
def test_a_texture_outside_the_asset_is_not_copied(studio, tmp_path, capsys, name, dry):
    name_elsewhere(studio / "spray", "spray_leaf.png", name.format(studio=studio))
    line = refused(capsys, "bake", studio / "spray", "-o", tmp_path / "new", *(["--dry-run"] if dry else []))
    assert "the texture" in line
    assert "lies outside the asset's folder" in line
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("target", ["secret.txt", "private.png"])
def test_a_texture_that_links_out_of_the_asset_is_not_copied(studio, tmp_path, capsys, target):
    texture = studio / "spray" / "maps" / "spray_leaf.png"
    texture.unlink()
    texture.symlink_to(os.path.relpath(studio / target, texture.parent))
    assert "lies outside" in refused(capsys, "bake", studio / "spray", "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_folder_that_links_out_of_the_asset_is_seen_through(studio, tmp_path, capsys):
    maps = studio / "spray" / "maps"
    maps.rename(studio / "elsewhere")
    maps.symlink_to("../elsewhere")
    assert "lies outside" in refused(capsys, "bake", studio / "spray", "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("name", ["../notes.txt", "../maps/spray_leaf.png"])
def test_a_texture_that_is_no_picture_is_not_copied(studio, tmp_path, capsys, name):
    (studio / "spray" / "payload" / name).write_bytes(SECRET)
    name_elsewhere(studio / "spray", "spray_leaf.png", name)
    assert "is no picture" in refused(capsys, "bake", studio / "spray", "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_the_map_of_a_jitter_outside_the_asset_is_not_copied(studio, tmp_path, capsys):
    name_elsewhere(studio / "spray", "leaf_jitter.png", "../../private_wave.png")
    assert "the jitter map" in refused(capsys, "bake", studio / "spray", "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_the_map_of_a_look_lies_beside_the_look_or_in_the_asset(studio, tmp_path, capsys):
    wide = ("edit", studio / "spray", "--jitter", 0.02, 6, "--width", 2)
    assert run(*wide, "--jitter-map", studio / "wave.png", "-o", studio / "looks" / "a.usda") == 0
    assert "the jitter map" in refused(capsys, "bake", studio / "looks" / "a.usda", "-o", tmp_path / "new")
    shutil.copy(studio / "wave.png", studio / "looks" / "wave.png")
    assert run(*wide, "--jitter-map", studio / "looks" / "wave.png", "-o", studio / "looks" / "b.usda") == 0
    assert run("bake", studio / "looks" / "b.usda", "-o", tmp_path / "new") == 0


def test_leaves_of_a_scene_bring_the_pictures_of_their_own_asset(studio, tmp_path, capsys):
    scene = tmp_path / "scenes" / "garden.usda"
    scene.parent.mkdir()
    stage = Usd.Stage.CreateNew(str(scene))
    stage.SetDefaultPrim(stage.DefinePrim("/plant"))
    stage.GetDefaultPrim().GetReferences().AddReference(str(studio / "spray" / "spray.usda"))
    stage.Save()
    assert run("bake", scene, "-o", tmp_path / "new") == 0
    assert (tmp_path / "new" / "maps" / "new_leaf.png").read_bytes() == (studio / "leaf.png").read_bytes()
    name_elsewhere(studio / "spray", "spray_leaf.png", "../../private.png")
    assert "lies outside" in refused(capsys, "bake", scene, "-o", tmp_path / "newer")


@pytest.mark.parametrize("name", [*OUTSIDE, "../notes.txt"])
@pytest.mark.parametrize("old", ["bark.png", "crown_color.exr"])
def test_pictures_of_other_parts_outside_the_asset_are_left_out_with_a_remark(studio, tmp_path, capsys, name, old):
    (studio / "oak" / "notes.txt").write_bytes(SECRET)
    name_elsewhere(studio / "oak", old, name.format(studio=studio))
    lines = printed(capsys, "bake", studio / "oak", "-o", tmp_path / "new")
    (line,) = [line for line in lines if "not copied into the new asset" in line]
    assert line.startswith("warning: ")
    assert name.rsplit("/", 1)[-1] in line
    assert not copied(tmp_path / "new")


def test_a_picture_of_other_parts_that_links_out_of_the_asset_is_left_out(studio, tmp_path, capsys):
    (bark,) = (studio / "oak" / "maps").glob("*bark.png")
    bark.unlink()
    bark.symlink_to(studio / "private.png")
    lines = printed(capsys, "bake", studio / "oak", "-o", tmp_path / "new")
    assert any("not copied into the new asset" in line and "bark.png" in line for line in lines)
    assert not copied(tmp_path / "new")


@pytest.mark.parametrize("name", ["../secret.txt", "{studio}/private.png", "./thumbnails/link.png", "./notes.txt"])
def test_a_thumbnail_outside_the_asset_or_that_is_no_picture_is_left_out(studio, tmp_path, capsys, name):
    (studio / "oak" / "notes.txt").write_bytes(SECRET)
    (studio / "oak" / "thumbnails" / "link.png").symlink_to("../../private.png")
    stage = Usd.Stage.Open(str(studio / "oak" / "oak.usda"), Usd.Stage.LoadNone)
    media = UsdMedia.AssetPreviewsAPI(stage.GetDefaultPrim())
    media.SetDefaultThumbnails(UsdMedia.AssetPreviewsAPI.Thumbnails(name.format(studio=studio)))
    stage.GetRootLayer().Save()
    lines = printed(capsys, "bake", studio / "oak", "-o", tmp_path / "new")
    assert any("not copied into the new asset" in line for line in lines)
    assert not (tmp_path / "new" / "thumbnails").exists()
    assert not copied(tmp_path / "new")


@pytest.mark.parametrize("place", ["../../../evil.usdc", "{studio}/evil.usdc", "../evil.usdc"])
def test_a_layer_outside_the_asset_is_neither_copied_nor_written_elsewhere(studio, tmp_path, capsys, place):
    place = place.format(studio=studio)
    payload = studio / "oak" / "payload"
    layer = Sdf.Layer.FindOrOpen(str(payload / "payload.usda"))
    text = layer.ExportToString()
    branches = sorted(payload.glob("branches*.usd*"))[0]
    shutil.copy(branches, payload / place)
    (payload / "payload.usda").write_text(text.replace(f"@./{branches.name}@", f"@{place}@"))
    layer.Reload(force=True)
    assert place in (payload / "payload.usda").read_text()
    before = files(tmp_path)
    line = refused(capsys, "bake", studio / "oak", "-o", tmp_path / "deep" / "er" / "new")
    assert "outside" in line
    assert files(tmp_path) == before


def test_branches_take_no_texture_from_outside_the_leaves_asset(studio, tmp_path, capsys):
    (tmp_path / "t.xyz").write_text("".join(f"0 {k / 100} 0\n" for k in range(100)))
    name_elsewhere(studio / "spray", "spray_leaf.png", "../../secret.txt")
    words = ("--leaves", studio / "spray", "-o", tmp_path / "new", "--no-preview")
    assert "lies outside" in refused(capsys, "branches", tmp_path / "t.xyz", *words)


def test_a_picture_that_a_user_gives_may_lie_anywhere_and_is_a_picture(studio, tmp_path, capsys):
    (tmp_path / "link.png").symlink_to(studio / "private.png")
    assert run("scatter", "-n", 3, "--texture", tmp_path / "link.png", "-o", tmp_path / "new") == 0
    assert copied(tmp_path / "new")
    refused(capsys, "scatter", "-n", 3, "--texture", studio / "secret.txt", "-o", tmp_path / "newer")
