"""A whole plant in scenes: layered over, flattened, packed, instanced."""

import zipfile
from pathlib import Path

import pytest
from pxr import Ar, Sdf, Usd, UsdGeom, UsdShade, UsdUtils, UsdValidation
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset

from tests.support.layered_scenes import MOVED, ONE, TWO, WIDTH, new_scene, place, write_layered_scene


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_layered_scene(tmp_path_factory.mktemp("shot"))


def material_of(stage, path):
    bound, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path)).ComputeBoundMaterial()
    return str(bound.GetPath())


def assert_layered(stage):
    """The opinions of the scene reach its two plants."""
    one, two = (stage.GetPrimAtPath(f"{path}/geo/render/Leaves") for path in (ONE, TWO))
    assert one.IsA(UsdGeom.PointInstancer)
    assert UsdGeom.PointInstancer(one).GetInstanceCount() == 12
    assert two.IsA(UsdGeom.Mesh)
    assert one.GetAttribute("primvars:leaf:edit:width").Get() == WIDTH
    assert not stage.GetPrimAtPath(f"{ONE}/geo/proxy")
    assert stage.GetPrimAtPath(f"{TWO}/geo/proxy/Crown")
    assert UsdGeom.Imageable(one).ComputePurpose() == "default"
    assert UsdGeom.Imageable(two).ComputePurpose() == "render"
    assert UsdGeom.Imageable(stage.GetPrimAtPath(f"{TWO}/geo/proxy/Crown")).ComputePurpose() == "proxy"
    world = UsdGeom.XformCache().GetLocalToWorldTransform(two)
    assert tuple(world.ExtractTranslation()) == MOVED
    assert material_of(stage, f"{TWO}/geo/render/Leaves") == "/set/mtl/Autumn"
    assert material_of(stage, f"{TWO}/geo/render/Branches") == f"{TWO}/mtl/Bark"
    assert material_of(stage, f"{ONE}/geo/render/Branches") == f"{ONE}/mtl/Bark"


def values(stage):
    """Every attribute and relationship of what a scene draws, by path; files by where they are."""
    authored = {}
    for prim in stage.Traverse():
        authored[prim.GetPath()] = (prim.GetTypeName(), tuple(prim.GetAppliedSchemas()))
        for attribute in prim.GetAuthoredAttributes():
            value = attribute.Get()
            if isinstance(value, Sdf.AssetPath):
                value = value.resolvedPath
            authored[attribute.GetPath()] = (value, str(attribute.GetTypeName()), tuple(attribute.GetConnections()))
        for relationship in prim.GetAuthoredRelationships():
            authored[relationship.GetPath()] = tuple(relationship.GetTargets())
    return authored


def test_two_placements_differ_in_variants_and_overrides(scene):
    assert_layered(Usd.Stage.Open(str(scene)))


def test_the_look_is_gone_where_it_is_muted(scene):
    stage = Usd.Stage.Open(str(scene))
    stage.MuteLayer(str(scene.with_name("look.usda")))
    assert stage.GetPrimAtPath(f"{ONE}/geo/render/Leaves").GetAttribute("primvars:leaf:edit:width").Get() == 1


def test_the_scene_is_sound(scene):
    report = validate_asset(scene, read_profile(default_profile()))
    assert report.is_scene
    assert [finding for finding in report.findings if not finding.accepted] == []


def test_flattened_it_composes_to_the_same_values(scene, tmp_path):
    stage = Usd.Stage.Open(str(scene))
    stage.Flatten().Export(str(tmp_path / "flat.usdc"))
    flat = Usd.Stage.Open(str(tmp_path / "flat.usdc"))
    assert {layer.realPath for layer in flat.GetUsedLayers()} <= {str(tmp_path / "flat.usdc"), ""}  # and its session
    assert_layered(flat)
    before, after = values(stage), values(flat)
    assert before.keys() == after.keys()
    assert {path for path in before if before[path] != after[path]} == set()


def test_packed_it_opens_from_the_package_with_its_textures(scene, tmp_path):
    package = tmp_path / "scene.usdz"
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(scene)), str(package))
    stage = Usd.Stage.Open(str(package))
    assert_layered(stage)
    layers, files, missing = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(package)))
    assert missing == []
    assert all(Ar.IsPackageRelativePath(layer.identifier) or layer.identifier == str(package) for layer in layers)
    assert all(str(file).startswith(f"{package}[") for file in files)
    with zipfile.ZipFile(package) as archive:
        inside = archive.namelist()
    named = {Path(name).name for name in inside}
    assert {"oak_crown_color.exr", "oak_crown_radius.exr", "fork_bark.png", "oak.png"} <= named  # and the thumbnail
    texture = stage.GetPrimAtPath(f"{TWO}/mtl/Crown/ColorMap").GetAttribute("inputs:file").Get()
    assert Ar.IsPackageRelativePath(texture.resolvedPath)
    names = ("usdUtilsValidators:UsdzPackageValidator", "usdUtilsValidators:MissingReferenceValidator")
    registry = UsdValidation.ValidationRegistry()
    validators = [registry.GetOrLoadValidatorByName(name) for name in names]
    assert all(validators)
    problems = UsdValidation.ValidationContext(validators=validators).Validate(stage)
    assert [problem.GetMessage() for problem in problems] == []


def test_instances_share_a_prototype_for_each_selection(scene):
    stage = new_scene(scene.with_name("stand.usda"))
    asset = scene.parent / "oak" / "oak.usda"
    for number in range(6):
        lod = ("leaves", "crown")[number % 2]
        place(stage, f"/set/tree{number}", asset, lod=lod).SetInstanceable(True)
    assert len(stage.GetPrototypes()) == 2
    for number in range(6):
        tree = stage.GetPrimAtPath(f"/set/tree{number}")
        assert tree.IsInstance()
        hint = UsdGeom.ModelAPI(tree).GetExtentsHint()
        assert len(hint) == (2 if number % 2 else 8)
        leaves = stage.GetPrimAtPath(f"/set/tree{number}/geo/render/Leaves")
        assert bool(leaves) == (number % 2 == 0)
        if leaves:
            assert leaves.IsInstanceProxy()
            assert UsdGeom.PointInstancer(leaves).GetInstanceCount() == 12
    flat = Usd.Stage.Open(stage.Flatten())
    assert sum(prim.IsInstance() for prim in flat.Traverse()) == 6
    assert len(flat.GetPrototypes()) == 2


def test_one_point_instancer_of_plants_stays_one(scene):
    stage = new_scene(scene.with_name("scatter.usda"))
    asset = scene.parent / "oak" / "oak.usda"
    forest = UsdGeom.PointInstancer.Define(stage, "/set/forest")
    place(stage, "/set/forest/Prototypes/oak", asset, lod="crown")
    forest.CreatePrototypesRel().SetTargets(["/set/forest/Prototypes/oak"])
    forest.CreateProtoIndicesAttr([0] * 4)
    forest.CreatePositionsAttr([(20.0 * x, 0, 0) for x in range(4)])
    flat = Usd.Stage.Open(stage.Flatten())
    instancers = [prim for prim in flat.Traverse() if prim.IsA(UsdGeom.PointInstancer)]
    assert [prim.GetPath() for prim in instancers] == [forest.GetPath()]
    box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(instancers[0]).ComputeAlignedRange()
    low, high = UsdGeom.Mesh(flat.GetPrimAtPath("/set/forest/Prototypes/oak/geo/proxy/Crown")).GetExtentAttr().Get()
    assert box.GetSize()[0] == pytest.approx(60 + high[0] - low[0], abs=1e-3)
    assert high[0] - low[0] == pytest.approx(2 * 5.8965335, rel=0.03)  # the crown's cage is a little wider than it
