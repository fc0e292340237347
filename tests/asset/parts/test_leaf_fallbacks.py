"""Leaves for applications without our shader: patches, a subdivision surface and a mesh of the same leaves."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
from scipy.interpolate import BSpline
from usdfoliage.asset.locate import find_leaves
from usdfoliage.asset.parts.hero_leaf import author_hero_leaf, read_hero_leaf
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.errors import AssetError, FitError
from usdfoliage.leaf.shape.edits import LeafEdits, apply_edits
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.mesh import LeafMeshSettings
from usdfoliage.leaf.shape.surface import evaluate_grid

from tests.support.leaves.assets import FLAT, random_leaves, two_leaves, write_spray

LEAVES = "/spray/geo/render/Leaves"
EDITS = LeafEdits(
    width=1.25, axis2=(0.125, 0, 0.25), curl=(0.125, 0, 0), jitter_amplitude=0.03125, jitter_frequency=0.5
)
EVERYTHING = ("bezier", "nurbs", "subdiv", "mesh")
U, V = np.linspace(-1, 1, 17), np.linspace(0, 1, 17)


def choose(interface, representation):
    stage = Usd.Stage.Open(str(interface))
    stage.GetDefaultPrim().GetVariantSets().SetSelection("representation", representation)
    return stage


def drawn_points_m(leaves, edits=LeafEdits(), u=U, v=V):
    """(N, V, U, 3), in the asset's frame, of the leaves as Storm shows them."""
    jitter = Jitter(amplitude=edits.jitter_amplitude, frequency=edits.jitter_frequency)
    parameters = apply_edits(leaves.parameters, edits)
    return evaluate_grid(parameters, u, v, jitter, leaves.phase, placements=leaves.asset_from_leaf()).points


def patch_points_m(prim, u=U, v=V):
    """(V, U, 3) of a NURBS patch, by its own orders and knots, where its matrix puts it."""
    patch = UsdGeom.NurbsPatch(prim)
    count = patch.GetVVertexCountAttr().Get(), patch.GetUVertexCountAttr().Get()
    net = np.array(patch.GetPointsAttr().Get(), np.float64).reshape(*count, 3)
    across = BSpline(np.array(patch.GetUKnotsAttr().Get()), net.swapaxes(0, 1), patch.GetUOrderAttr().Get() - 1)(u)
    points = BSpline(np.array(patch.GetVKnotsAttr().Get()), across.swapaxes(0, 1), patch.GetVOrderAttr().Get() - 1)(v)
    matrix = np.array(UsdGeom.Xformable(prim).GetLocalTransformation())
    return points @ matrix[:3, :3] + matrix[3, :3]


def test_patches_are_the_leaves_in_their_order(tmp_path):
    leaves = random_leaves(12, facts=True)
    stage = choose(write_spray(tmp_path, leaves), "nurbs")
    scope = stage.GetPrimAtPath(LEAVES)
    assert scope.GetTypeName() == "Scope"
    assert "jitter" in scope.GetDocumentation()
    assert [prim.GetName() for prim in scope.GetChildren()] == [f"leaf_{number:02}" for number in range(12)]
    for number, prim in enumerate(scope.GetChildren()):
        patch = UsdGeom.NurbsPatch(prim)
        for knots, points, order in (
            (patch.GetUKnotsAttr(), patch.GetUVertexCountAttr(), patch.GetUOrderAttr()),
            (patch.GetVKnotsAttr(), patch.GetVVertexCountAttr(), patch.GetVOrderAttr()),
        ):
            assert len(knots.Get()) == points.Get() + order.Get()
        exact = drawn_points_m(leaves.take([number]))[0]
        np.testing.assert_allclose(patch_points_m(prim), exact, rtol=0, atol=1e-6 * leaves.length_m[number])
        found = read_hero_leaf(prim)
        np.testing.assert_array_equal(found.leaves.parameters[0], leaves.parameters[number])
        assert found.leaves.view[0] == leaves.view[number]
        np.testing.assert_allclose(found.leaves.residual_m[0], leaves.residual_m[number], rtol=1e-6)


def test_patches_far_away_keep_their_shape(tmp_path):
    leaves = replace(random_leaves(1), base_m=np.array([[4096.0, 0.0, -8192.0]]))
    stage = choose(write_spray(tmp_path, leaves, representations=("nurbs",)), "nurbs")
    (prim,) = stage.GetPrimAtPath(LEAVES).GetChildren()
    exact = drawn_points_m(leaves)[0]
    np.testing.assert_allclose(patch_points_m(prim), exact, rtol=0, atol=1e-6 * leaves.length_m[0])


def test_edits_are_applied_and_slow_jitter_is_carried(tmp_path):
    leaves = random_leaves(6)
    stage = choose(write_spray(tmp_path, leaves, edits=EDITS), "nurbs")
    for number, prim in enumerate(stage.GetPrimAtPath(LEAVES).GetChildren()):
        exact = drawn_points_m(leaves.take([number]), EDITS)[0]
        plain = drawn_points_m(leaves.take([number]), replace(EDITS, jitter_amplitude=0))[0]
        off = np.abs(patch_points_m(prim) - exact).max()
        assert off < 0.4 * np.abs(plain - exact).max()
        found = read_hero_leaf(prim)
        edited = apply_edits(leaves.parameters[number : number + 1], EDITS)
        np.testing.assert_allclose(found.leaves.parameters, edited, rtol=0, atol=1e-6)
        assert found.edits == LeafEdits(jitter_amplitude=EDITS.jitter_amplitude, jitter_frequency=0.5)


def test_mesh_is_the_leaves_with_their_jitter(tmp_path):
    leaves = random_leaves(6)
    fast = replace(EDITS, jitter_frequency=5.0)
    mesh_settings = LeafMeshSettings(across=8, along=16)
    stage = choose(write_spray(tmp_path, leaves, edits=fast, mesh=mesh_settings), "mesh")
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(LEAVES))
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    assert mesh.GetNormalsInterpolation() == "vertex"
    points = np.array(mesh.GetPointsAttr().Get()).reshape(6, -1, 3)
    assert len(mesh.GetNormalsAttr().Get()) == points[..., 0].size
    st_of = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
    places = np.array(st_of.ComputeFlattened()).reshape(6, -1, 2)
    assert len(st_of.Get()) == points.shape[1]  # kept once
    for number in (0, 5):
        for point, (s, t) in zip(points[number, ::7], places[number, ::7], strict=True):
            exact = drawn_points_m(leaves.take([number]), fast, np.array([2 * s - 1]), np.array([t]))[0, 0, 0]
            np.testing.assert_allclose(point, exact, rtol=0, atol=2e-6)
    assert list(mesh.GetExtentAttr().Get()) == list(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))


def test_subdivision_surface_has_its_creases_and_boundary(tmp_path):
    stage = choose(write_spray(tmp_path, random_leaves(3)), "subdiv")
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(LEAVES))
    assert mesh.GetSubdivisionSchemeAttr().Get() == "catmullClark"
    assert mesh.GetInterpolateBoundaryAttr().Get() == "edgeAndCorner"
    assert "approximately" in mesh.GetPrim().GetDocumentation()
    count = len(mesh.GetPointsAttr().Get())
    corners, creases = mesh.GetCornerIndicesAttr().Get(), mesh.GetCreaseIndicesAttr().Get()
    assert len(corners) == len(mesh.GetCornerSharpnessesAttr().Get())
    lengths = np.array(mesh.GetCreaseLengthsAttr().Get(), int)
    assert lengths.sum() == len(creases)
    assert len(mesh.GetCreaseSharpnessesAttr().Get()) in (len(lengths), (lengths - 1).sum())
    for indices in (corners, creases):
        assert not len(indices) or (min(indices) >= 0 and max(indices) < count)
    assert UsdGeom.Mesh.ValidateTopology(
        mesh.GetFaceVertexIndicesAttr().Get(), mesh.GetFaceVertexCountsAttr().Get(), count
    )[0]
    assert len(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").ComputeFlattened()) == count


@pytest.mark.parametrize("representation", EVERYTHING)
def test_every_gprim_looks_the_same(tmp_path, representation):
    color = (0.25, 0.5, 0.125)
    stage = choose(write_spray(tmp_path, appearance=LeafAppearance(color=color)), representation)
    gprims = [prim for prim in Usd.PrimRange(stage.GetPrimAtPath(LEAVES)) if prim.IsA(UsdGeom.Gprim)]
    assert len(gprims) == (2 if representation == "nurbs" else 1)
    for prim in gprims:
        assert UsdGeom.Gprim(prim).GetDoubleSidedAttr().Get()
        display = UsdGeom.Gprim(prim).GetDisplayColorPrimvar()
        assert display.GetInterpolation() == "constant"
        assert list(display.Get()) == [Gf.Vec3f(*color)]
        assert UsdGeom.Gprim(prim).GetExtentAttr().HasAuthoredValue()
        material, relationship = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        assert relationship.GetPrim() == prim
        assert material.GetPath() == "/spray/mtl/Leaf"


@pytest.mark.parametrize("representation", EVERYTHING)
def test_hint_contains_every_representation(tmp_path, representation):
    stage = choose(write_spray(tmp_path, random_leaves(15), edits=EDITS), representation)
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"], useExtentsHint=False)
    bounds = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
    low, high = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint())[:2]
    assert (np.array(bounds.GetMin()) >= low - 1e-5).all()
    assert (np.array(bounds.GetMax()) <= high + 1e-5).all()


@pytest.mark.parametrize("representation", EVERYTHING)
def test_only_the_chosen_layer_is_opened(tmp_path, representation):
    interface = write_spray(tmp_path / "spray")
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    plant = shot.DefinePrim("/World/plant")
    plant.GetReferences().AddReference("./spray/spray.usda")
    plant.GetVariantSets().SetSelection("representation", representation)
    names = {Path(layer.realPath).name for layer in shot.GetUsedLayers() if layer.realPath}
    layers = {"bezier": "leaves", **{name: f"leaves_{name}" for name in EVERYTHING[1:]}}
    wanted = {"shot.usda", "spray.usda", "payload.usda", "materials.usda", f"{layers[representation]}.usdc"}
    guide = {"leaves_guide.usda", "leaves.usdc"} if representation != "bezier" else set()
    assert names == wanted | guide
    assert interface.is_file()


@pytest.mark.parametrize("representation", EVERYTHING[1:])
def test_a_fallback_keeps_the_leaves_as_a_guide(tmp_path, representation):
    leaves = random_leaves(4)
    stage = choose(write_spray(tmp_path, leaves, edits=EDITS), representation)
    flat = Usd.Stage.Open(stage.Flatten())  # what a shot is sent out as
    guide = flat.GetPrimAtPath("/spray/geo/guide/Leaves/geo/render/Leaves")
    assert UsdGeom.Imageable(guide).ComputePurpose() == "guide"
    read = read_leaves(guide)
    np.testing.assert_array_equal(read.leaves.parameters, leaves.parameters.astype(np.float32))
    assert read.edits.width == pytest.approx(EDITS.width)
    assert not find_leaves(flat) or representation == "nurbs"


@pytest.mark.parametrize("representation", EVERYTHING[1:])
def test_a_guide_holds_no_material(tmp_path, representation):
    stage = choose(write_spray(tmp_path), representation)
    guide = stage.GetPrimAtPath("/spray/geo/guide")
    below = list(Usd.PrimRange(guide, Usd.PrimAllPrimsPredicate))
    assert [prim.GetPath() for prim in below if prim.IsA(UsdShade.Material) or prim.IsA(UsdShade.Shader)] == []
    assert all(prim.IsDefined() for prim in below)
    prototype = stage.GetPrimAtPath("/spray/geo/guide/Leaves/geo/render/Leaves/Prototypes/Leaf")
    bound, _ = UsdShade.MaterialBindingAPI(prototype).ComputeBoundMaterial()
    assert bound.GetPath() == "/spray/mtl/Leaf"


def test_no_guide_without_the_instancer(tmp_path):
    stage = choose(write_spray(tmp_path, random_leaves(2), representations=("mesh",)), "mesh")
    assert not stage.GetPrimAtPath("/spray/geo/guide")


def test_default_is_the_first_that_was_written(tmp_path):
    for number, names in enumerate((("bezier", "mesh"), ("mesh",), ("subdiv", "nurbs"))):
        interface = write_spray(tmp_path / str(number), representations=names)
        stage = Usd.Stage.Open(str(interface))
        variants = stage.GetDefaultPrim().GetVariantSet("representation")
        assert variants.GetVariantSelection() == names[0]
        assert variants.GetVariantNames() == sorted(names)
        assert len(list((interface.parent / "payload").glob("*.usdc"))) == len(names)


@pytest.mark.parametrize("representation", EVERYTHING)
def test_no_leaves(tmp_path, representation):
    stage = choose(write_spray(tmp_path, random_leaves(0), edits=EDITS), representation)
    leaves = stage.GetPrimAtPath(LEAVES)
    assert leaves.GetTypeName() == ("PointInstancer" if representation == "bezier" else "Scope")
    assert not [prim for prim in leaves.GetChildren() if prim.IsA(UsdGeom.NurbsPatch)]


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), amplitude=st.sampled_from([0.0, 0.05]))
def test_an_unchanged_patch_is_the_leaf_that_was_written(seed, amplitude):
    leaves = random_leaves(3, seed)
    stage = Usd.Stage.CreateInMemory()
    author_hero_leaf(stage, Sdf.Path("/Leaf"), leaves, 1, jitter=Jitter(amplitude=amplitude, frequency=3.0))
    found = read_hero_leaf(stage.GetPrimAtPath("/Leaf")).leaves
    wanted = leaves.take([1])
    np.testing.assert_array_equal(found.parameters, wanted.parameters)
    np.testing.assert_array_equal(found.phase, wanted.phase)
    np.testing.assert_allclose(found.asset_from_leaf(), wanted.asset_from_leaf(), rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.length_m, wanted.length_m, rtol=1e-6)
    assert found.residual_m is None


@pytest.mark.parametrize("amplitude", [0.0, 0.05])
def test_a_modelled_patch_comes_back_as_a_leaf(amplitude):
    """A patch whose points are those of another leaf, as a modeller would drag them there."""
    before, after = two_leaves(), FLAT + 0.01
    jitter = Jitter(amplitude=amplitude, frequency=0.5)
    stage = Usd.Stage.CreateInMemory()
    patch = author_hero_leaf(stage, Sdf.Path("/Leaf"), before, 1, jitter=jitter)
    other = author_hero_leaf(stage, Sdf.Path("/Other"), replace(before, parameters=np.stack([after, after])), 1)
    plain = author_hero_leaf(stage, Sdf.Path("/Plain"), before, 1)
    nets = [np.array(mesh.GetPointsAttr().Get(), np.float64) for mesh in (patch, plain, other)]
    patch.GetPointsAttr().Set([Gf.Vec3f(*map(float, point)) for point in nets[0] - nets[1] + nets[2]])
    found = read_hero_leaf(patch.GetPrim()).leaves
    np.testing.assert_allclose(found.parameters[0], after, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.base_m[0], before.base_m[1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.length_m[0], 0.5, rtol=1e-6)
    assert found.residual_m[0] < 1e-6
    assert found.phase[0] == before.phase[1]


def test_a_stretched_patch_is_fitted_in_the_asset():
    stage = Usd.Stage.CreateInMemory()
    patch = author_hero_leaf(stage, Sdf.Path("/Leaf"), two_leaves(), 0)
    patch.MakeMatrixXform().Set(Gf.Matrix4d().SetScale(Gf.Vec3d(2, 4, 1)))
    found = read_hero_leaf(patch.GetPrim()).leaves
    np.testing.assert_allclose(found.length_m[0], 4.0, rtol=1e-6)
    np.testing.assert_allclose(found.parameters[0, 2:5, 1], FLAT[2:5, 1] / 2, rtol=0, atol=1e-5)


def test_a_patch_of_a_map_knows_it(tmp_path):
    image = tmp_path / "wave.png"
    cv2.imwrite(str(image), np.array([[0, 255, 128, 30]], np.uint8))
    edits = LeafEdits(jitter_amplitude=0.0625, jitter_frequency=1.0)
    stage = choose(write_spray(tmp_path / "spray", appearance=LeafAppearance(jitter_map=image), edits=edits), "nurbs")
    first, second = stage.GetPrimAtPath(LEAVES).GetChildren()
    for number, prim in enumerate((first, second)):
        found = read_hero_leaf(prim)
        assert found.jitter_map == tmp_path / "spray" / "maps" / "spray_leaf_jitter.png"
        written = two_leaves().parameters[number].astype(np.float32)
        np.testing.assert_array_equal(found.leaves.parameters[0], written)


def test_broken_patches_are_refused():
    stage = Usd.Stage.CreateInMemory()
    patch = author_hero_leaf(stage, Sdf.Path("/Leaf"), two_leaves(), 0)
    with pytest.raises(AssetError, match="no hero leaf"):
        read_hero_leaf(stage.DefinePrim("/Patch", "NurbsPatch"))
    with pytest.raises(AssetError, match="no leaves: a NurbsPatch"):
        read_leaves(patch.GetPrim())
    good = patch.GetPointsAttr().Get()
    patch.GetPointsAttr().Set([Gf.Vec3f(0)] * 35)
    with pytest.raises(FitError, match="apart"):
        read_hero_leaf(patch.GetPrim())
    patch.GetPointsAttr().Set([Gf.Vec3f(float("nan")), *good[1:]])
    with pytest.raises(AssetError, match="points is not finite in 1 of 35"):
        read_hero_leaf(patch.GetPrim())
    patch.GetUVertexCountAttr().Set(9)
    with pytest.raises(AssetError, match=r"9 × 5 control points where a leaf has 7 × 5"):
        read_hero_leaf(patch.GetPrim())


def test_colors_of_single_leaves_are_in_every_representation(tmp_path):
    colors = np.array([[0.1, 0.2, 0.05], [0.3, 0.2, 0.1], [0.05, 0.1, 0.02]])
    interface = write_spray(tmp_path, replace(random_leaves(3), color=colors))
    for representation in EVERYTHING:
        stage = choose(interface, representation)
        leaves = stage.GetPrimAtPath("/spray/geo/render/Leaves")
        if representation == "bezier":
            found = read_leaves(leaves).leaves.color
        elif representation == "nurbs":
            found = np.concatenate([read_hero_leaf(patch).leaves.color for patch in leaves.GetChildren()])
        else:
            of_faces = np.array(UsdGeom.PrimvarsAPI(leaves).GetPrimvar("displayColor").ComputeFlattened())
            assert len(of_faces) == len(UsdGeom.Mesh(leaves).GetFaceVertexCountsAttr().Get())
            found = of_faces[:: len(of_faces) // 3]
            np.testing.assert_array_equal(of_faces, np.repeat(found, len(of_faces) // 3, axis=0))
        np.testing.assert_allclose(found, colors, rtol=1e-6)


def test_one_color_for_all_is_not_read_as_colors_of_single_leaves(tmp_path):
    stage = choose(write_spray(tmp_path, random_leaves(3)), "bezier")
    prim = stage.GetPrimAtPath("/spray/geo/render/Leaves")
    assert read_leaves(prim).leaves.color is None
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "constant").Set(
        [Gf.Vec3f(1, 0, 0)]
    )
    assert read_leaves(prim).leaves.color is None
