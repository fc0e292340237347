"""An asset of branches, by its composed values."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.packages.branch_package import write_branch_asset
from usdfoliage.asset.parts.branch_part import BranchAssetSettings
from usdfoliage.asset.parts.branches import SkeletonPrim, author_skeleton, read_skeleton
from usdfoliage.asset.parts.leaf_part import BranchLeaves
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.cage.surfaces import BranchSurfaces

from tests.support.branch_shapes import fork
from tests.support.leaves.assets import two_leaves


@pytest.fixture
def asset(tmp_path):
    plant = fork()
    surfaces = BranchSurfaces(whole=build_branch_cage(plant), by_order=((1, build_branch_cage(plant.up_to_order(1))),))
    moved = np.eye(4)
    moved[:3, 3] = 1, 2, 3
    return write_branch_asset(
        tmp_path,
        "fork",
        SkeletonPrim(skeleton=plant, growth={"internodeLength": 0.05}),
        surfaces,
        Provenance(capture="fork.ply", generator="test", seed=0, input_sha256=""),
        moved,
    )


def test_the_skeleton_is_a_guide_with_parents_orders_and_diameters(asset):
    stage = Usd.Stage.Open(str(asset))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/fork/geo/guide/Skeleton"))
    plant = fork()
    assert curves.ComputePurpose() == UsdGeom.Tokens.guide
    assert "FoliageSkeletonAPI" in curves.GetPrim().GetAppliedSchemas()
    assert np.array(curves.GetPointsAttr().Get()) == pytest.approx(plant.points_m)
    assert np.array(curves.GetWidthsAttr().Get()) == pytest.approx(2 * plant.radius_m)
    assert curves.GetWidthsInterpolation() == UsdGeom.Tokens.vertex
    prim = curves.GetPrim()
    assert list(prim.GetAttribute("foliage:parentCurve").Get()) == [-1, 0, 1]
    assert list(prim.GetAttribute("foliage:parentVertex").Get()) == [-1, 1, 4]
    assert list(prim.GetAttribute("foliage:order").Get()) == [0, 1, 2]
    assert prim.GetAttribute("foliage:growth:internodeLength").Get() == pytest.approx(0.05)
    targets = stage.GetDefaultPrim().GetRelationship("foliage:skeleton").GetTargets()
    assert targets == [Sdf.Path("/fork/geo/guide/Skeleton")]


def test_curves_that_nothing_shows_are_marked():
    stage = Usd.Stage.CreateInMemory()
    for name, inferred in (("shown", [False, False]), ("grown", [False, True])):
        skeleton = replace(fork(), inferred=np.array(inferred + [False] * (len(fork()) - 2)))
        prim = author_skeleton(stage, Sdf.Path(f"/{name}"), SkeletonPrim(skeleton=skeleton)).GetPrim()
        value = prim.GetAttribute("foliage:inferred").Get()
        assert value is None if name == "shown" else list(value) == [int(each) for each in skeleton.inferred]
        np.testing.assert_array_equal(read_skeleton(prim).inferred, skeleton.inferred)


def test_the_surface_is_subdivided_with_bark_and_metres(asset):
    stage = Usd.Stage.Open(str(asset))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/fork/geo/render/Branches"))
    assert mesh.GetSubdivisionSchemeAttr().Get() == UsdGeom.Tokens.catmullClark
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {4}
    assert mesh.ComputePurpose() == UsdGeom.Tokens.default_
    bound, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    assert bound.GetPath() == Sdf.Path("/fork/mtl/Bark")
    st = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
    assert st.GetInterpolation() == UsdGeom.Tokens.faceVarying
    along = np.array(st.Get())[:, 1]
    assert np.ptp(along) == pytest.approx(2, rel=0.1)  # the trunk is 2 m long


def test_a_variant_has_the_lower_orders_alone(asset):
    stage = Usd.Stage.Open(str(asset))
    plant = stage.GetDefaultPrim()
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/fork/geo/render/Branches"))
    branches = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("branch:curve")
    assert set(branches.Get()) == {0, 1, 2}
    plant.GetVariantSet("branches").SetVariantSelection("order1")
    assert set(branches.Get()) == {0, 1}


def test_the_asset_is_sound(asset):
    report = validate_asset(asset)
    assert [finding for finding in report.findings if finding.severity == "error"] == []


def test_the_capture_is_found_again(asset):
    stage = Usd.Stage.Open(str(asset))
    matrix = np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get())
    assert np.array([0, 0, 0, 1]) @ matrix == pytest.approx([1, 2, 3, 1])


@pytest.mark.parametrize("bad", [{"texture_m": 0.0}, {"color": (1.0, 2.0)}])
def test_bark_that_cannot_be_is_refused(tmp_path, bad):
    plant = fork()
    with pytest.raises(ValueError, match=r"texture_m|color"):
        write_branch_asset(
            tmp_path,
            "fork",
            SkeletonPrim(skeleton=plant),
            BranchSurfaces(whole=build_branch_cage(plant)),
            Provenance(capture="fork.ply", generator="test", seed=0, input_sha256=""),
            np.eye(4),
            BranchAssetSettings(**bad),
        )


@pytest.fixture(scope="module")
def leafy(tmp_path_factory):
    plant = fork()
    return write_branch_asset(
        tmp_path_factory.mktemp("leafy"),
        "fork",
        SkeletonPrim(skeleton=plant),
        BranchSurfaces(whole=build_branch_cage(plant)),
        Provenance(capture="fork.ply", generator="test", seed=0, input_sha256=""),
        np.eye(4),
        foliage=BranchLeaves(leaves=two_leaves()),
    )


def test_leaves_and_branches_are_one_plant(leafy):
    stage = Usd.Stage.Open(str(leafy))
    plant = stage.GetDefaultPrim()
    targets = {name: plant.GetRelationship(f"foliage:{name}").GetTargets() for name in ("leaves", "skeleton")}
    assert targets == {
        "leaves": [Sdf.Path("/fork/geo/render/Leaves")],
        "skeleton": [Sdf.Path("/fork/geo/guide/Skeleton")],
    }
    render = [child.GetName() for child in stage.GetPrimAtPath("/fork/geo/render").GetChildren()]
    assert sorted(render) == ["Branches", "Leaves"]
    assert [child.GetName() for child in stage.GetPrimAtPath("/fork/mtl").GetChildren()] == ["Leaf", "Bark"]
    leaves = UsdGeom.PointInstancer(stage.GetPrimAtPath("/fork/geo/render/Leaves"))
    assert np.array(leaves.GetPositionsAttr().Get()) == pytest.approx(two_leaves().base_m)
    assert np.array(leaves.GetScalesAttr().Get())[:, 0] == pytest.approx(two_leaves().length_m)
    assert leaves.ComputePurpose() == UsdGeom.Tokens.default_
    hint = np.array(UsdGeom.ModelAPI(plant).GetExtentsHint())
    for prim in ("Branches", "Leaves"):
        low, high = np.array(UsdGeom.Boundable(stage.GetPrimAtPath(f"/fork/geo/render/{prim}")).GetExtentAttr().Get())
        assert (hint[0] <= low + 1e-6).all()
        assert (hint[1] >= high - 1e-6).all()


@pytest.mark.parametrize("name", ["bezier", "nurbs", "subdiv", "mesh"])
def test_branches_stay_in_every_representation_of_the_leaves(leafy, name):
    stage = Usd.Stage.Open(str(leafy))
    plant = stage.GetDefaultPrim()
    plant.GetVariantSet("representation").SetVariantSelection(name)
    assert stage.GetPrimAtPath("/fork/geo/render/Branches").IsA(UsdGeom.Mesh)
    kind = stage.GetPrimAtPath("/fork/geo/render/Leaves").GetTypeName()
    assert kind == {"bezier": "PointInstancer", "nurbs": "Scope"}.get(name, "Mesh")
    assert bool(stage.GetPrimAtPath("/fork/geo/guide/Leaves")) == (name != "bezier")


def test_the_asset_with_leaves_is_sound(leafy):
    report = validate_asset(leafy)
    assert [str(finding) for finding in report.findings if finding.severity == "error"] == []
