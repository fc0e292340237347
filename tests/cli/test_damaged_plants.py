"""Whole plants that somebody damaged: a command works, or refuses them in one line with the place and the remedy."""

import shutil

import numpy as np
import pytest
from pxr import Sdf, Vt

from tests.support.leaves.commands import refused, run
from tests.support.plant_assets import high_crown, write_whole_plant

LEAVES = "/oak/geo/render/Leaves"
BRANCHES = "/oak/geo/render/Branches"
CROWN = "/oak/geo/proxy/Crown"
CRATES = {LEAVES: "leaves", BRANCHES: "branches_order1", CROWN: "crown"}
STRING = (Sdf.ValueTypeNames.String, "x")


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return write_whole_plant(tmp_path_factory.mktemp("plant") / "oak", crown=high_crown()).parent


@pytest.fixture
def copy(plant, tmp_path):
    return shutil.copytree(plant, tmp_path / "oak")


def put(folder, prim, name, value_type, value):
    """Replace an attribute by one of another type, as layers may that no one checked."""
    layer = Sdf.Layer.FindOrOpen(str(folder / "payload" / f"{CRATES[prim]}.usdc"))
    spec = layer.GetPrimAtPath(prim)
    if name not in spec.attributes:  # a crown's geometry is in the variants of its forms
        spec = layer.GetPrimAtPath(prim.replace("/Crown", "{crown=mesh}Crown"))
    spec.RemoveProperty(spec.attributes[name])
    attribute = Sdf.AttributeSpec(spec, name, value_type)
    if value is not None:
        attribute.default = value
    layer.Save()


@pytest.mark.parametrize(
    ("prim", "name", "typed_value", "reason"),
    [
        (CROWN, "foliage:crown:center", STRING, "center holds x, 3 numbers are needed"),
        (CROWN, "foliage:crown:radiusRange", (Sdf.ValueTypeNames.Float, 1.0), "radiusRange holds 1.0, 2 numbers are"),
        (CROWN, "foliage:crown:reliefWeight", STRING, "reliefWeight holds x, a number is needed"),
        (LEAVES, "positions", STRING, "positions holds no numbers"),
        (LEAVES, "primvars:leaf:axis1", STRING, "axis1 holds no numbers, and 6 elements are needed"),
        (LEAVES, "primvars:leaf:edit:width", STRING, "width holds x, one number is needed"),
        (
            LEAVES,
            "primvars:leaf:edit:curl",
            (Sdf.ValueTypeNames.Float, 1.0),
            "curl holds 1.0, three numbers are needed",
        ),
    ],
)
def test_info_of_a_value_of_another_type(copy, capsys, prim, name, typed_value, reason):
    put(copy, prim, name, *typed_value)
    line = refused(capsys, "info", copy)
    assert reason in line
    assert f"<{prim}>" in line


@pytest.mark.parametrize("corners", [[], [(0, 0, 0)], [(0, 0, 0)] * 3], ids=["none", "one", "three"])
def test_info_of_a_hint_that_is_no_boxes(copy, capsys, corners):
    layer = Sdf.Layer.FindOrOpen(str(copy / "oak.usda"))
    for variant in layer.GetPrimAtPath("/oak").variantSets["lod"].variants.values():
        variant.primSpec.attributes["extentsHint"].default = Vt.Vec3fArray(corners)
    layer.Save()
    assert run("info", copy) == 0
    assert run("validate", copy) == 3
    assert "ExtentsHint" in capsys.readouterr().out


@pytest.mark.parametrize(
    "typed_value",
    [STRING, (Sdf.ValueTypeNames.Point3dArray, Vt.Vec3dArray([(0, 0, 0)])), (Sdf.ValueTypeNames.Point3fArray, None)],
    ids=["text", "double", "none"],
)
def test_validate_finds_points_that_are_none(copy, capsys, typed_value):
    put(copy, BRANCHES, "points", *typed_value)
    assert run("validate", copy) == 3
    streams = capsys.readouterr()
    assert "internal fault" not in streams.err
    assert "geo/render/Branches" in streams.out


@pytest.mark.parametrize("prim", [BRANCHES, CROWN])
@pytest.mark.parametrize(
    "typed_value",
    [
        STRING,
        *((Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray([(0, 0, 0)] * number)) for number in (0, 1, 3)),
        (Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray([(np.nan, 0, 0), (1, 1, 1)])),
    ],
    ids=["text", "none", "one", "three", "nan"],
)
def test_bake_of_an_extent_that_is_no_box(copy, tmp_path, capsys, prim, typed_value):
    put(copy, prim, "extent", *typed_value)
    line = refused(capsys, "bake", copy, "-o", tmp_path / "baked")
    assert f"{CRATES[prim]}.usdc <{prim}> is no two corners of a box" in line
    assert not (tmp_path / "baked").exists()


@pytest.mark.parametrize(
    "typed_value", [STRING, (Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray([(0, 0, 0)]))], ids=["text", "one"]
)
def test_edit_of_leaves_whose_extent_is_no_box(copy, tmp_path, typed_value):
    put(copy, LEAVES, "extent", *typed_value)
    assert run("edit", copy, "--width", 9, "-o", tmp_path / "look.usda") == 0


@pytest.mark.parametrize("name", ["points", "faceVertexCounts", "faceVertexIndices"])
def test_bake_of_a_surface_of_another_type_that_the_crown_is_to_pierce(copy, tmp_path, capsys, name):
    put(copy, BRANCHES, name, *STRING)
    payload = copy / "payload" / "payload.usda"
    payload.write_text("".join(line for line in payload.read_text().splitlines(True) if "bare" not in line))
    line = refused(capsys, "bake", copy, "-o", tmp_path / "baked")
    assert f"{copy}/payload/branches_order1.usdc: the mesh <{BRANCHES}> is broken (its points" in line


def test_bake_of_a_layer_that_is_empty(copy, tmp_path, capsys):
    for name in ("leaves_mesh", "leaves_subdiv"):
        crate = copy / "payload" / f"{name}.usdc"
        whole = crate.read_bytes()
        crate.write_bytes(b"")
        assert crate.name in refused(capsys, "bake", copy, "-o", tmp_path / "baked")
        crate.write_bytes(whole)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('variantSet "lod"', 'variantSet "dol"', "has no variant set lod"),
        ('["representation", "branches"]', '["representation", "branches", "rig"]', "has no variant set rig"),
    ],
)
def test_bake_of_a_payload_without_a_variant_set(copy, tmp_path, capsys, old, new, reason):
    payload = copy / "payload" / "payload.usda"
    assert old in payload.read_text()
    payload.write_text(payload.read_text().replace(old, new))
    line = refused(capsys, "bake", copy, "-o", tmp_path / "baked")
    assert reason in line
    assert "payload.usda" in line


@pytest.mark.parametrize("name", ["Größe 1", "🌳", "oak[1]", "a@b", "100%d #1"])
def test_names_of_folders_are_free(plant, tmp_path, name):
    folder = shutil.copytree(plant, tmp_path / name)
    assert run("info", folder) == 0
    assert run("edit", folder, "--width", 2, "-o", tmp_path / "look.usda") == 0
    assert run("bake", tmp_path / "look.usda", "-o", tmp_path / "baked") == 0
