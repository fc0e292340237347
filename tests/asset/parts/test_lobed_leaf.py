"""A lobed leaf as a Mesh: its points follow from its numbers."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.parts.lobed_leaf import author_lobed_leaf
from usdfoliage.asset.parts.lobed_numbers import read_lobed_leaf
from usdfoliage.errors import AssetError
from usdfoliage.leaf.lobed.deformation import BranchFunctions
from usdfoliage.leaf.lobed.model import model_lobed_leaf
from usdfoliage.leaf.lobed.placed import LobedLeaf, place_leaf

from tests.support.leaves.lobed import lobed_mask


@pytest.fixture(scope="module")
def leaf() -> LobedLeaf:
    placed = place_leaf(model_lobed_leaf(lobed_mask()), (240, 240), 0.0005)
    bend = tuple(np.array([[0.0, 0.2], [1.0, 0.9 - 0.3 * branch]]) for branch in range(placed.shape.branch_count))
    twist = tuple(np.zeros((0, 2)) if branch else np.array([[0.5, 0.4]]) for branch in range(len(bend)))
    return replace(placed, functions=BranchFunctions(bend=bend, twist=twist))


def read(prim: Usd.Prim, name: str) -> np.ndarray:
    return np.array(prim.GetAttribute(f"foliage:lobed:{name}").Get())


def test_the_points_follow_from_the_numbers(leaf):
    stage = Usd.Stage.CreateInMemory()
    mesh = author_lobed_leaf(stage, Sdf.Path("/Leaf"), leaf)
    back = read_lobed_leaf(mesh.GetPrim(), leaf.asset_from_picture)
    assert np.array_equal(back.shape.tie_nodes, leaf.shape.tie_nodes)
    assert np.array_equal(back.shape.nodes, leaf.shape.nodes)
    width = np.ptp(leaf.shape.places[:, 0])
    assert np.abs(back.shape.feet - leaf.shape.feet).max() < 1e-6 * width
    assert np.abs(back.points_m() - np.array(mesh.GetPointsAttr().Get())).max() < 1e-5 * width
    assert np.abs(back.silhouette_m - leaf.silhouette_m).max() < 1e-6 * width
    assert back.functions.bend[2] == pytest.approx(leaf.functions.bend[2])


BROKEN = [
    ("skeletonParents", lambda value: [0, *value[1:]], "has no base"),
    ("skeletonParents", lambda value: [*value[:-1], len(value) + 5], "is no tree"),
    ("skeletonParents", lambda value: value[:-1], "has not the numbers"),
    ("skeletonParents", lambda value: [*value[:9], 0, *value[10:]], "leaves a branch"),
    ("skeletonBranches", lambda value: [*value[:-1], 99], "does not rise by 1"),
    ("skeletonPoints", lambda value: [], "has not the numbers"),
    ("tie:branch", lambda value: [], "is not 0 to 4"),
    ("tie:branch", lambda value: [*value[:-1], 77], "is not 0 to 4"),
    ("tie:kLength", lambda value: value[1:], "has not the numbers"),
    ("tie:tTurn", lambda value: [np.nan, *value[1:]], "is not finite"),
    ("bend:keyCounts", lambda value: value[1:], "does not fit"),
    ("bend:keys", lambda value: [(2.0, 1.0), *value[1:]], "positions of bend"),
]


@pytest.mark.parametrize(("name", "change", "reason"), BROKEN)
def test_broken_numbers_are_refused(leaf, name, change, reason):
    stage = Usd.Stage.CreateInMemory()
    prim = author_lobed_leaf(stage, Sdf.Path("/Leaf"), leaf).GetPrim()
    attribute = prim.GetAttribute(f"foliage:lobed:{name}")
    attribute.Set(change(list(attribute.Get())))
    with pytest.raises(AssetError, match=reason):
        read_lobed_leaf(prim, leaf.asset_from_picture)


def test_a_mesh_that_is_no_lobed_leaf_or_has_other_points_is_refused(leaf):
    stage = Usd.Stage.CreateInMemory()
    with pytest.raises(AssetError, match="no lobed leaf"):
        read_lobed_leaf(UsdGeom.Mesh.Define(stage, "/Mesh").GetPrim(), np.eye(4))
    mesh = author_lobed_leaf(stage, Sdf.Path("/Leaf"), leaf)
    mesh.GetPointsAttr().Set(mesh.GetPointsAttr().Get()[:-1])
    with pytest.raises(AssetError, match="has not the"):
        read_lobed_leaf(mesh.GetPrim(), np.eye(4))


def test_all_that_the_schema_names_is_authored(leaf):
    stage = Usd.Stage.CreateInMemory()
    prim = author_lobed_leaf(stage, Sdf.Path("/Leaf"), leaf).GetPrim()
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition("FoliageLobedLeafAPI")
    for name in definition.GetPropertyNames():
        assert prim.GetAttribute(name).HasAuthoredValue(), name
    assert read(prim, "turn:keyCounts").size == 0


def test_a_subdivision_surface_has_the_midrib_as_a_crease(leaf):
    stage = Usd.Stage.CreateInMemory()
    mesh = author_lobed_leaf(stage, Sdf.Path("/Leaf"), leaf, subdivision=True)
    assert mesh.GetSubdivisionSchemeAttr().Get() == UsdGeom.Tokens.catmullClark
    crease = np.array(mesh.GetCreaseIndicesAttr().Get())
    assert np.array_equal(crease, np.flatnonzero(leaf.shape.branches == 0))
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    edges = {frozenset(edge) for side in range(4) for edge in np.roll(faces, -side, axis=1)[:, :2].tolist()}
    assert all(frozenset(edge) in edges for edge in zip(crease[:-1].tolist(), crease[1:].tolist(), strict=True))
