"""A lobed leaf as a Mesh: its points follow from its numbers."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.parts.lobed_leaf import author_lobed_leaf
from usdfoliage.leaf.lobed.branches import LobedShape
from usdfoliage.leaf.lobed.deformation import BranchFunctions, deform_leaves
from usdfoliage.leaf.lobed.model import model_lobed_leaf
from usdfoliage.leaf.lobed.placed import LobedLeaf, place_leaf
from usdfoliage.leaf.lobed.turtle import TurtleTies, ties_from_turtle

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
    prim = mesh.GetPrim()
    nodes = read(prim, "skeletonPoints")[:, :2].astype(np.float64)
    parents, branches = read(prim, "skeletonParents"), read(prim, "skeletonBranches")
    turtle = TurtleTies(
        branches=read(prim, "tie:branch"),
        k_length=read(prim, "tie:kLength").astype(np.float64),
        k_turn_rad=np.radians(read(prim, "tie:kTurn").astype(np.float64)),
        t_length=read(prim, "tie:tLength").astype(np.float64),
        t_turn_rad=np.radians(read(prim, "tie:tTurn").astype(np.float64)),
    )
    begins, ends = ties_from_turtle(nodes, parents, branches, turtle)
    tie_nodes = np.linalg.norm(begins[:, None] - nodes, axis=2).argmin(axis=1)
    shape = LobedShape(
        nodes=nodes,
        parents=parents,
        branches=branches,
        tie_nodes=tie_nodes,
        feet=ends,
        faces=np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4),
    )
    lists = {}
    for name in ("turn", "bend", "twist"):
        counts, keys = read(prim, f"{name}:keyCounts"), read(prim, f"{name}:keys").reshape(-1, 2) * [1, np.radians(1)]
        lists[name] = tuple(np.split(keys, np.cumsum(counts)[:-1])) if len(counts) else ()
    points = deform_leaves(shape, [BranchFunctions(**lists)])[0]
    width = np.ptp(points[:, 0])
    assert np.abs(points - np.array(mesh.GetPointsAttr().Get())).max() < 1e-5 * width


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
