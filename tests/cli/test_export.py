"""Exports from the command line: edits are in them, they need nothing else, and bad input is one line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.parts.leaves import edited_leaves
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.jobs.branches.motion import BranchMotion
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.mesh import LeafMeshSettings, build_leaf_mesh

from tests.support.branch_motions import leaves_on, write_moving
from tests.support.branch_shapes import fork
from tests.support.leaves.commands import files, printed, read, refused, run
from tests.support.plant_assets import write_whole_plant

EDITS = ("--width", 1.5, "--curl", 0.02, 0.05, 0.1, "--jitter", 0.02, 6)
# Without the schemas: a process that has never heard of us.
PLAIN = """
import sys
from pxr import Plug, Usd, UsdUtils
heard = UsdUtils.CoalescingDiagnosticDelegate()
stage = Usd.Stage.Open(sys.argv[1])
for prim in stage.TraverseAll():
    for entry in prim.GetAttributes():
        entry.Get()
for each in heard.TakeUncoalescedDiagnostics():
    print(each.commentary)
print([each.name for each in Plug.Registry().GetAllPlugins() if "oliage" in each.name])
"""


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A whole plant, a look of it, a spray with a texture, a crown alone, and a scene."""
    folder = tmp_path_factory.mktemp("my studio")
    write_whole_plant(folder / "oak")
    assert run("edit", folder / "oak", *EDITS, "-o", folder / "look.usda") == 0
    write_whole_plant(folder / "ball", "ball", leaves=False, branches=False)
    assert run("scatter", "-n", 12, "-o", folder / "spray", "--seed", 3, "--color", 0.2, 0.3, 0.1) == 0
    stage = Usd.Stage.CreateNew(str(folder / "scene.usda"))
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    stage.DefinePrim("/World/oak").GetReferences().AddReference("./oak/oak.usda")
    stage.GetRootLayer().Save()
    return folder


def opened(path: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(path))


@pytest.mark.parametrize(("profile", "out"), [("standalone", "new"), ("usdz", "new.usdz"), ("unreal", "new")])
def test_an_export_opens_without_us_and_without_a_warning(studio, tmp_path, capfd, profile, out):
    assert run("export", studio / "oak", "--profile", profile, "-o", tmp_path / "a" / out) == 0
    file = tmp_path / "a" / out if profile == "usdz" else tmp_path / "a" / out / "new.usdc"
    environment = {name: value for name, value in os.environ.items() if name != "PXR_PLUGINPATH_NAME"}
    ended = subprocess.run(
        [sys.executable, "-I", "-c", PLAIN, file], capture_output=True, text=True, env=environment, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "[]\n", "")
    stage = opened(file)
    assert stage.GetDefaultPrim().GetName() == "new"
    assert not [prim for prim in stage.Traverse() if prim.GetVariantSets().GetNames()]
    for name, data in files(tmp_path).items():
        assert str(tmp_path).encode() not in data, name
        assert str(studio).encode() not in data, name
        assert not name.endswith(".glslfx")


def test_the_edits_of_a_look_are_in_the_points(studio, tmp_path):
    look = read(studio / "look.usda")
    jitter = Jitter(amplitude=look.edits.jitter_amplitude, frequency=look.edits.jitter_frequency)
    assert jitter.amplitude == pytest.approx(0.02)
    expected = build_leaf_mesh(edited_leaves(look.leaves, look.edits), LeafMeshSettings(), jitter)
    for profile, out in (("standalone", "new"), ("usdz", "new.usdz")):
        assert run("export", studio / "look.usda", "--profile", profile, "-o", tmp_path / out) == 0
        file = tmp_path / out if profile == "usdz" else tmp_path / out / "new.usdc"
        stage = opened(file)
        points = np.array(stage.GetAttributeAtPath("/new/geo/render/Leaves.points").Get())
        sides = np.split(points, 2) if profile == "usdz" else [points]
        np.testing.assert_allclose(np.mean(sides, axis=0), expected.points_m, atol=1e-5)
    # Each leaf of Unreal's assembly is a part, moved, turned and scaled.
    assert run("export", studio / "look.usda", "--profile", "unreal", "-o", tmp_path / "ue") == 0
    stage = opened(tmp_path / "ue" / "ue.usdc")
    parts = UsdGeom.PointInstancer(stage.GetPrimAtPath("/ue/Leaves"))
    places = np.array(parts.ComputeInstanceTransformsAtTime(0, 0, UsdGeom.PointInstancer.ExcludeProtoXform))
    each = expected.points_m.reshape(len(places), -1, 3)
    for number, (index, place) in enumerate(zip(parts.GetProtoIndicesAttr().Get(), places, strict=True)):
        target = parts.GetPrototypesRel().GetTargets()[index]
        shape = np.array(stage.GetPrimAtPath(f"{target}/Part/Leaf").GetAttribute("points").Get())
        moved = np.c_[shape, np.ones(len(shape))] @ place
        np.testing.assert_allclose(moved[:, :3], each[number], atol=1e-3)  # orientations are half floats in some


def test_leaves_of_a_package_have_faces_for_both_sides(studio, tmp_path):
    """Three.js ignores doubleSided, and would leave out every leaf that is seen from behind."""
    counts = {}
    for out, words in (("both.usdz", ()), ("one.usdz", ("--sides", 1)), ("plain", ()), ("two", ("--sides", 2))):
        profile = "usdz" if out.endswith("z") else "standalone"
        assert run("export", studio / "oak", "--profile", profile, *words, "-o", tmp_path / out) == 0
        file = tmp_path / out if profile == "usdz" else tmp_path / out / f"{out}.usdc"
        name = out.removesuffix(".usdz")
        stage = opened(file)
        for part in ("Leaves", "Branches"):
            faces = stage.GetAttributeAtPath(f"/{name}/geo/render/{part}.faceVertexCounts").Get()
            counts[name, part] = len(faces)
    both, two, one, plain = (counts[name, "Leaves"] for name in ("both", "two", "one", "plain"))
    assert both == two == 2 * one == 2 * plain
    assert len({number for (_, part), number in counts.items() if part == "Branches"}) == 1


def test_leaves_have_materialx_where_it_is_read_and_the_rest_preview_surfaces(studio, tmp_path):
    assert run("export", studio / "oak", "--profile", "standalone", "-o", tmp_path / "new") == 0
    assert run("export", studio / "oak", "--profile", "usdz", "-o", tmp_path / "new.usdz") == 0
    for file in (tmp_path / "new" / "new.usdc", tmp_path / "new.usdz"):
        stage = opened(file)
        materials = [UsdShade.Material(prim) for prim in stage.Traverse() if prim.IsA(UsdShade.Material)]
        assert materials
        for material in materials:
            outputs = {output.GetBaseName() for output in material.GetOutputs() if output.HasConnectedSource()}
            is_translucent = material.GetPrim().GetName() == "Leaf" and file.suffix == ".usdc"
            assert outputs == ({"surface", "mtlx:surface"} if is_translucent else {"surface"})
        for prim in stage.Traverse():
            if prim.IsA(UsdGeom.Gprim) and not prim.IsA(UsdGeom.BasisCurves):
                assert UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    assert opened(tmp_path / "new" / "new.usdc").GetPrimAtPath("/new/geo/guide/Skeleton")
    assert not opened(tmp_path / "new.usdz").GetPrimAtPath("/new/geo/guide")


def test_a_crown_has_its_colours_as_png_in_a_package(studio, tmp_path):
    assert run("export", studio / "ball", "--profile", "usdz", "-o", tmp_path / "ball.usdz") == 0
    stage = opened(tmp_path / "ball.usdz")
    texture = next(prim for prim in stage.Traverse() if prim.GetAttribute("inputs:file"))
    assert texture.GetAttribute("inputs:file").Get().path.endswith(".png")
    assert texture.GetAttribute("inputs:sourceColorSpace").Get() == "sRGB"
    names = Sdf.ZipFile.Open(str(tmp_path / "ball.usdz")).GetFileNames()
    assert [Path(name).suffix for name in names] == [".usdc", ".png"]
    assert run("export", studio / "ball", "--profile", "standalone", "-o", tmp_path / "ball") == 0
    assert {Path(name).suffix for name in files(tmp_path / "ball")} == {".usdc", ".exr", ".json", ".png"}


def test_converted_colours_are_the_same_in_srgb(studio, tmp_path):
    import OpenImageIO as oiio

    assert run("export", studio / "ball", "--profile", "usdz", "-o", tmp_path / "ball.usdz") == 0
    import zipfile

    with zipfile.ZipFile(tmp_path / "ball.usdz") as archive:
        archive.extractall(tmp_path)
    pixels = np.asarray(oiio.ImageBuf(str(next((tmp_path / "textures").glob("*.png")))).get_pixels(oiio.UINT8))
    assert pixels.reshape(-1, 3)[0].tolist() == [89, 149, 63]  # linear 0.1, 0.3, 0.05


def test_leaves_repeat_shapes_where_that_is_asked_for(studio, tmp_path, capsys):
    words = ("--profile", "standalone", "--leaves", "instances", "--shapes", 3)
    lines = printed(capsys, "export", studio / "spray", *words, "-o", tmp_path / "new")
    assert any("12 leaves have 3 shapes" in line and "--shapes" in line for line in lines)
    stage = opened(tmp_path / "new" / "new.usdc")
    (instancer,) = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.PointInstancer)]
    assert len(instancer.GetRelationship("prototypes").GetTargets()) == 3
    assert {"instances: 12", "shapes: 3"} <= set(lines)


def test_a_spray_becomes_an_assembly_of_static_parts(studio, tmp_path, capsys):
    lines = printed(capsys, "export", studio / "spray", "--profile", "unreal", "-o", tmp_path / "new")
    assert any("no branches" in line for line in lines)
    stage = opened(tmp_path / "new" / "new.usdc")
    assert stage.GetAttributeAtPath("/new.unreal:naniteAssembly:meshType").Get() == "staticMesh"
    assert not list(tmp_path.rglob("*_wind.json"))


def test_branches_alone_are_exported_without_a_bake(tmp_path, capsys):
    write_whole_plant(tmp_path / "bare", leaves=False, crown=False)
    for profile, out in (("standalone", "new"), ("usdz", "new.usdz")):
        words = ("export", tmp_path / "bare", "--profile", profile, "-o", tmp_path / out)
        assert "meshes: 1" in printed(capsys, *words)
    line = refused(capsys, "export", tmp_path / "bare", "--profile", "unreal", "-o", tmp_path / "ue")
    assert "is exported without leaves" in line


def test_a_look_for_one_placement_is_exported_as_any(studio, tmp_path):
    look = tmp_path / "one.usda"
    assert run("edit", studio / "oak", *EDITS, "--prim", "/World/plants/oak_1", "-o", look) == 0
    for name, given in (("one", look), ("all", studio / "look.usda")):
        assert run("export", given, "--profile", "standalone", "-o", tmp_path / name, "--name", "oak") == 0
    one, every = (opened(tmp_path / name / "oak.usdc") for name in ("one", "all"))
    for path in ("/oak/geo/render/Leaves.points", "/oak/geo/render/Branches.points"):
        np.testing.assert_array_equal(one.GetAttributeAtPath(path).Get(), every.GetAttributeAtPath(path).Get())


def test_what_moves_is_exported_at_rest(tmp_path):
    motion = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=4), growth_frames=4)
    write_moving(tmp_path / "ash", "ash", fork(), motion, leaves_on(fork(), "bezier", "mesh"))
    resting = Usd.Stage.Open(str(tmp_path / "ash" / "ash.usda"))
    resting.GetDefaultPrim().GetVariantSets().SetSelection("rig", "none")
    resting.GetDefaultPrim().GetVariantSets().SetSelection("growth", "still")
    resting.GetDefaultPrim().GetVariantSets().SetSelection("representation", "mesh")
    leaves = np.array(resting.GetAttributeAtPath("/ash/geo/render/Leaves.points").Get())
    for profile, out in (("standalone", "new"), ("usdz", "new.usdz"), ("unreal", "ue")):
        assert run("export", tmp_path / "ash", "--profile", profile, "-o", tmp_path / out) == 0
        stage = opened(tmp_path / out if profile == "usdz" else tmp_path / out / f"{out}.usdc")
        assert not [
            entry for prim in stage.Traverse() for entry in prim.GetAttributes() if entry.GetNumTimeSamples() > 1
        ]
        if profile != "unreal":
            points = np.array(stage.GetAttributeAtPath("/new/geo/render/Leaves.points").Get())
            sides = np.split(points, 2) if profile == "usdz" else [points]
            np.testing.assert_allclose(np.mean(sides, axis=0), leaves, atol=1e-6)


def test_boxes_of_an_assembly_are_those_that_usd_derives(studio, tmp_path):
    assert run("export", studio / "oak", "--profile", "unreal", "-o", tmp_path / "new") == 0
    stage = opened(tmp_path / "new" / "new.usdc")
    boxes = [
        UsdGeom.Boundable(prim) for prim in stage.Traverse() if prim.GetTypeName() in ("SkelRoot", "PointInstancer")
    ]
    assert len(boxes) > 2
    for box in boxes:
        derived = UsdGeom.Boundable.ComputeExtentFromPlugins(box, Usd.TimeCode.Default())
        np.testing.assert_allclose(box.GetExtentAttr().Get(), derived, atol=1e-6)
    (low, high), (base_low, base_high) = (
        np.array(stage.GetAttributeAtPath(f"/new/Base{part}.extent").Get()) for part in ("/Branches", "")
    )
    assert (base_low <= low).all()
    assert (base_high >= high).all()


def test_wind_beside_an_assembly_names_its_joints(studio, tmp_path):
    assert run("export", studio / "oak", "--profile", "unreal", "-o", tmp_path / "new") == 0
    wind = json.loads((tmp_path / "new" / "new_wind.json").read_text())
    stage = opened(tmp_path / "new" / "new.usdc")
    joints = stage.GetAttributeAtPath("/new/Base/Skeleton.jointNames").Get()
    assert (
        [each["JointName"] for each in wind["Joints"]] == list(joints) == ["root", "branch_0", "branch_1", "branch_2"]
    )
    assert [each["SimulationGroupIndex"] for each in wind["Joints"]] == [0, 0, 1, 2]
    assert [each["bIsTrunkGroup"] for each in wind["SimulationGroups"]] == [True, False, False]


def test_the_same_export_gives_the_same_bytes_and_json_counts_what_is_in_it(studio, tmp_path, capsys):
    for name in ("one", "two"):
        for profile, out in (("standalone", "a/oak"), ("unreal", "b/oak"), ("usdz", "oak.usdz")):
            assert run("export", studio / "oak", "--profile", profile, "-o", tmp_path / name / out) == 0
    assert files(tmp_path / "one") == files(tmp_path / "two")
    made = json.loads(
        "\n".join(printed(capsys, "export", studio / "oak", "--profile", "usdz", "-o", tmp_path / "x.usdz", "--json"))
    )
    assert made["asset"] == str(tmp_path / "x.usdz")
    assert made["profile"] == "usdz"
    assert {fact["name"] for fact in made["facts"]} == {"meshes", "triangles"}


def test_an_export_replaces_its_own_and_no_other(studio, tmp_path, capsys):
    for profile, out in (("standalone", tmp_path / "new"), ("usdz", tmp_path / "new.usdz")):
        words = ("--profile", profile, "-o", out)
        assert run("export", studio / "oak", *words) == 0
        assert run("export", studio / "look.usda", *words) == 0
        before = files(tmp_path)
        assert "--force" in refused(capsys, "export", studio / "spray", *words)
        assert files(tmp_path) == before
        assert run("export", studio / "spray", *words, "--force") == 0
    (tmp_path / "other.usdz").write_bytes(b"mine")
    line = refused(capsys, "export", studio / "oak", "--profile", "usdz", "-o", tmp_path / "other.usdz")
    assert "no export of usdfoliage" in line
    assert (tmp_path / "other.usdz").read_bytes() == b"mine"


def test_a_dry_run_writes_nothing(studio, tmp_path, capsys):
    for profile, out in (("standalone", "new"), ("usdz", "new.usdz"), ("unreal", "new")):
        lines = printed(capsys, "export", studio / "look.usda", "--profile", profile, "-o", tmp_path / out, "--dry-run")
        assert "leaves: 6" in lines
        assert lines[-1].startswith(f"would write: {tmp_path / out}")
    assert list(tmp_path.iterdir()) == []


def bad_inputs(studio: Path, tmp_path: Path):
    """What is refused, by its name: words of the command, and what the line must have."""
    old = tmp_path / "old"
    write_whole_plant(old)
    change(old / "oak.usda", '"test"', '"usdfoliage 0.0.9"')
    new = tmp_path / "newer"
    write_whole_plant(new)
    change(new / "oak.usda", '"test"', '"usdfoliage 99.0"')
    lost = tmp_path / "lost"
    write_whole_plant(lost)
    (lost / "payload" / "leaves_nurbs.usdc").unlink()
    out, package = ("-o", tmp_path / "out"), ("-o", tmp_path / "out.usdz")
    plain = ("--profile", "standalone")
    ar = ("--profile", "usdz")
    return {
        "scene": ((studio / "scene.usda", *plain, *out), "is no asset of usdfoliage: the default prim of scene.usda"),
        "older": ((old, *plain, *out), "was written by usdfoliage 0.0.9"),
        "newer": ((new, *plain, *out), "was written by usdfoliage 99.0"),
        "lost": ((lost, *plain, *out), "leaves_nurbs.usdc, which is not there"),
        "inside": ((studio / "oak", *plain, "-o", studio / "oak" / "out"), str(studio / "oak")),
        "itself": ((studio / "oak", *plain, "-o", studio / "oak", "--force"), str(studio / "oak")),
        "around": ((studio / "oak", *plain, "-o", studio, "--force"), str(studio / "oak")),
        "package inside": ((studio / "oak", *ar, "-o", studio / "oak" / "out.usdz"), str(studio / "oak")),
        "no package": ((studio / "oak", *ar, *out), "must end with .usdz"),
        "no folder": ((studio / "oak", *plain, *package), "is the name of a file"),
        "nothing": ((studio / "none", *plain, *out), "does not exist"),
        "crown for unreal": ((studio / "ball", "--profile", "unreal", *out), "is exported without leaves"),
        "no leaves": ((studio / "ball", *plain, "--lod", "leaves", *out), "has no leaves"),
        "instances for ar": ((studio / "oak", *ar, "--leaves", "instances", *package), "AR shows no instances"),
        "sides of instances": (
            (studio / "oak", *plain, "--leaves", "instances", "--sides", 2, *out),
            "one face for both sides",
        ),
        "shapes": ((studio / "oak", *plain, "--shapes", 0, *out), "--shapes must be 1 to"),
        "old package kept": ((studio / "oak", *ar, "--keep-old", *package), "is not kept"),
    }


def change(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))


def test_bad_input_is_one_line_and_nothing_is_written(studio, tmp_path, capsys):
    for name, (words, text) in bad_inputs(studio, tmp_path).items():
        before = files(studio), files(tmp_path)
        for dry in ((), ("--dry-run",)):
            assert text in refused(capsys, "export", *words, *dry), name
            assert (files(studio), files(tmp_path)) == before, name
            assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")], name


def test_a_texture_outside_the_asset_is_not_handed_on(studio, tmp_path, capsys):
    write_whole_plant(tmp_path / "oak", leaves=False, branches=False)
    (tmp_path / "secret.png").write_bytes(b"secret")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "oak" / "payload" / "materials.usda"))
    stage = Usd.Stage.Open(layer)
    texture = next(prim for prim in stage.Traverse() if prim.GetAttribute("inputs:file"))
    texture.GetAttribute("inputs:file").Set(Sdf.AssetPath("../../secret.png"))
    layer.Save()
    line = refused(capsys, "export", tmp_path / "oak", "--profile", "standalone", "-o", tmp_path / "new")
    assert "secret.png" in line
    assert not (tmp_path / "new").exists()
