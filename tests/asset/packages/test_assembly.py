"""The fold of an asset over its parts: a part that nobody knew of, and branches written from models or copied."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt
from usdfoliage.asset.layer import author_scopes, export_layer, new_layer
from usdfoliage.asset.packages.assembly import Origin, begin_asset, write_asset
from usdfoliage.asset.packages.other_parts import find_other_parts, read_other_parts
from usdfoliage.asset.packages.plant_package import write_plant_asset
from usdfoliage.asset.parts.branch_part import BranchAssetSettings, PlantBranches, write_branch_part
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.parts.leaf_part import write_leaf_part
from usdfoliage.asset.parts.part import AssetPlace, Part
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.jobs.branches.motion import BranchMotion, rig_branches

from tests.support.branch_motions import write_moving
from tests.support.branch_shapes import fork
from tests.support.plant_assets import RUN, fork_branches, high_crown, round_crown, some_leaves
from tools.compare_assets import compare_assets

ORIGIN = Origin(provenance=RUN)
AT_M = np.array([[9.0, 0.0, 0.0], [10.0, 1.0, 1.0]])


def write_fruit_part(place: AssetPlace) -> Part:
    """A part of its own kind: a cube far from the others, with a material."""
    path = Sdf.Path(f"/{place.name}/geo/render/Fruit")
    stage = new_layer(place.payload / "fruit.usda", place.name)
    author_scopes(stage, path.GetParentPath())
    mesh = UsdGeom.Cube.Define(stage, path)
    UsdGeom.XformCommonAPI(mesh).SetTranslate((9.5, 0.5, 0.5))
    mesh.CreateSizeAttr(1.0)
    mesh.CreateExtentAttr(Vt.Vec3fArray([(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)]))
    binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    binding.Bind(UsdShade.Material(stage.OverridePrim(Sdf.Path(f"/{place.name}/mtl/Fruit"))))
    export_layer(stage, place.payload / "fruit.usda")

    def author(stage: Usd.Stage, root: Sdf.Path) -> None:
        UsdShade.Material.Define(stage, root.AppendPath("mtl/Fruit"))

    return Part(
        near=["./fruit.usda"],
        near_m=[AT_M],
        materials=[author],
        collections={"fruit": ["geo/render/Fruit"]},
        relationships={"foliage:fruit": "geo/render/Fruit"},
    )


def test_a_new_part_is_in_an_asset_of_one_lod(tmp_path):
    place = begin_asset(tmp_path, "tree")
    interface = write_asset(place, [write_leaf_part(place, some_leaves(3)), write_fruit_part(place)], ORIGIN)
    stage = Usd.Stage.Open(str(interface))
    bound, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/tree/geo/render/Fruit")).ComputeBoundMaterial()
    assert bound.GetPath() == Sdf.Path("/tree/mtl/Fruit")
    hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint())
    assert (hint[1] >= AT_M[1]).all()


def write_sign_part(place: AssetPlace) -> Part:
    """A part that stands for the plant from afar."""
    stage = new_layer(place.payload / "sign.usda", place.name)
    path = Sdf.Path(f"/{place.name}/geo/proxy/Sign")
    author_scopes(stage, path.GetParentPath())
    sign = UsdGeom.Cube.Define(stage, path)
    sign.CreateSizeAttr(4.0)
    sign.CreateExtentAttr(Vt.Vec3fArray([(-2, -2, -2), (2, 2, 2)]))
    export_layer(stage, place.payload / "sign.usda")
    return Part(far=["./sign.usda"], far_m=[np.array([[-2.0] * 3, [2.0] * 3])])


def write_tree_with_fruit(folder, **parts):
    folder.mkdir()
    return write_plant_asset(
        folder,
        "oak",
        provenance=RUN,
        asset_from_capture=np.eye(4),
        foliage=some_leaves(),
        crown=round_crown(),
        more=[write_fruit_part, write_sign_part],
        **parts,
    )


def copy_tree_with_fruit(interface, folder):
    folder.mkdir()
    return write_plant_asset(
        folder,
        "oak",
        provenance=RUN,
        asset_from_capture=np.eye(4),
        branches=read_other_parts(interface),
        foliage=some_leaves(),
    )


@pytest.mark.parametrize("is_copied", [False, True])
@pytest.mark.parametrize(("lod", "has_fruit"), [("leaves", True), ("both", True), ("auto", True), ("crown", False)])
def test_a_new_part_is_in_the_lods_that_show_it(tmp_path, lod, has_fruit, is_copied):
    interface = write_tree_with_fruit(tmp_path / "given")
    if is_copied:
        interface = copy_tree_with_fruit(interface, tmp_path / "copied")
    layer = Sdf.Layer.FindOrOpen(str(interface))
    session = Sdf.Layer.CreateAnonymous(".usda")
    Sdf.CreatePrimInLayer(session, "/oak").variantSelections["lod"] = lod
    stage = Usd.Stage.Open(layer, session)
    fruit = stage.GetPrimAtPath("/oak/geo/render/Fruit")
    assert bool(fruit) == has_fruit
    assert bool(stage.GetPrimAtPath("/oak/geo/proxy/Sign")) == (lod != "leaves")
    if has_fruit:
        bound, _ = UsdShade.MaterialBindingAPI(fruit).ComputeBoundMaterial()
        assert bound.GetPath() == Sdf.Path("/oak/mtl/Fruit")
        assert stage.GetDefaultPrim().GetRelationship("foliage:fruit").GetTargets() == [fruit.GetPath()]
    plant = stage.GetDefaultPrim()
    assert plant.GetAppliedSchemas()[-3:] == ["CollectionAPI:leaves", "CollectionAPI:crown", "CollectionAPI:fruit"]
    hint = np.array(UsdGeom.ModelAPI(plant).GetExtentsHint()).reshape(-1, 2, 3)
    assert (hint[:, 1, 0].max() > 9.9) == has_fruit
    errors = [each for each in validate_asset(interface, read_profile(default_profile())).findings if not each.accepted]
    assert [each for each in errors if each.severity == "error"] == []


@pytest.mark.parametrize(
    ("parts", "more", "lods"),
    [
        ({"foliage": some_leaves()}, [write_sign_part], {"leaves", "both", "crown", "auto"}),
        ({"crown": round_crown()}, [write_fruit_part], {"leaves", "both", "crown", "auto"}),
        ({}, [write_fruit_part], {"leaves"}),
        ({}, [write_sign_part], {"crown"}),
        ({}, [write_fruit_part, write_sign_part], {"leaves", "both", "crown", "auto"}),
    ],
)
def test_lods_are_those_that_the_parts_need(tmp_path, parts, more, lods):
    interface = write_plant_asset(tmp_path, "oak", provenance=RUN, asset_from_capture=np.eye(4), more=more, **parts)
    stage = Usd.Stage.Open(str(interface))
    plant = stage.GetDefaultPrim()
    variants = plant.GetVariantSet("lod")
    assert set(variants.GetVariantNames()) == lods
    found = set()
    for lod in lods:
        variants.SetVariantSelection(lod)
        found |= {prim.GetName() for prim in Usd.PrimRange(plant)}
    assert ("Fruit" in found, "Sign" in found) == (write_fruit_part in more, write_sign_part in more)


@pytest.mark.parametrize("has_branches", [False, True])
def test_new_parts_that_are_copied_are_those_that_were_written(tmp_path, has_branches):
    given = write_tree_with_fruit(tmp_path / "given", branches=models() if has_branches else None)
    copied = copy_tree_with_fruit(given, tmp_path / "copied")
    compared = compare_assets(given.parent, copied.parent)
    assert {each.where.rpartition("/")[2] for each in compared.differences} == {"mtl"}  # another order of materials
    assert compared.selections >= 4


def models(color=(0.4, 0.3, 0.2), **fields):
    skeleton = fork()
    surfaces = BranchSurfaces(
        whole=build_branch_cage(skeleton), by_order=((1, build_branch_cage(skeleton.up_to_order(1))),)
    )
    prim = SkeletonPrim(skeleton=skeleton, growth={"internodeLength": 0.02, "rootDiameter": 0.1})
    return PlantBranches(skeleton=prim, surfaces=surfaces, settings=BranchAssetSettings(color=color), **fields)


@pytest.mark.parametrize("crown", [None, round_crown(), high_crown()], ids=["none", "round", "high"])
@pytest.mark.parametrize("count", [0, 5])
def test_branches_of_models_are_those_that_are_copied_from_their_asset(tmp_path, crown, count):
    branches = models()
    (tmp_path / "branches").mkdir()
    own = begin_asset(tmp_path / "branches", "fork")
    interface = write_asset(own, [write_branch_part(own, branches)], ORIGIN)
    stage = Usd.Stage.Open(str(interface))  # which prims do not keep
    copied = find_other_parts(stage.GetDefaultPrim(), interface)
    for name, parts in (("copied", copied), ("models", branches)):
        (tmp_path / name).mkdir()
        write_plant_asset(
            tmp_path / name,
            "oak",
            provenance=RUN,
            asset_from_capture=np.eye(4),
            branches=parts,
            foliage=some_leaves(count, "bezier", "mesh") if count else None,
            crown=crown,
        )
    compared = compare_assets(tmp_path / "copied", tmp_path / "models")
    assert compared.differences == {}
    assert compared.selections >= 2
    bare = [(tmp_path / name / "payload" / "branches_bare.usdc").is_file() for name in ("copied", "models")]
    assert bare == [crown is not None] * 2 or (crown is not None and not any(bare))
    if crown is not None and crown.radius_m.max() < 1:
        assert all(bare)


def test_copied_parts_give_the_lod_that_they_had_and_their_picture_of_bark(tmp_path):
    parts = replace(fork_branches(tmp_path / "fork"), lod="crown")
    (tmp_path / "oak").mkdir()
    interface = write_plant_asset(
        tmp_path / "oak",
        "oak",
        provenance=RUN,
        asset_from_capture=np.eye(4),
        branches=parts,
        crown=round_crown(),
    )
    assert Usd.Stage.Open(str(interface)).GetDefaultPrim().GetVariantSet("lod").GetVariantSelection() == "crown"
    assert (tmp_path / "oak" / "maps" / "fork_bark.png").is_file()


def test_what_moves_in_models_moves_in_the_plant(tmp_path):
    motion = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=3, swing_rad=0.3))
    moving = write_moving(tmp_path / "fork", "fork", fork(), motion)
    still = models()
    rig = rig_branches(fork(), still.surfaces, motion, seed=0)
    (tmp_path / "oak").mkdir()
    interface = write_plant_asset(
        tmp_path / "oak",
        "oak",
        provenance=RUN,
        asset_from_capture=np.eye(4),
        branches=replace(still, rig=rig),
        crown=round_crown(),
    )
    stages = []
    for layer in (moving, interface):
        session = Sdf.Layer.CreateAnonymous(".usda")
        root = Sdf.Layer.FindOrOpen(str(layer))
        Sdf.CreatePrimInLayer(session, f"/{root.defaultPrim}").variantSelections["rig"] = "skel"
        stages.append(Usd.Stage.Open(root, session))
    assert (stages[1].GetStartTimeCode(), stages[1].GetEndTimeCode()) == (1, 3)
    turns = [
        stage.GetPrimAtPath(f"{stage.GetDefaultPrim().GetPath()}/geo/render/Rig/Animation").GetAttribute("rotations")
        for stage in stages
    ]
    assert turns[0].GetTimeSamples() == turns[1].GetTimeSamples() == [1, 2, 3]
    assert all(turns[0].Get(time) == turns[1].Get(time) for time in (1, 2, 3))
