"""The numbers of FoliageLobedLeafAPI, read back: what a lobed leaf is made of."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usdfoliage.asset.parts.leaf_primvars import place
from usdfoliage.asset.schema import LOBED_LEAF_API
from usdfoliage.errors import AssetError
from usdfoliage.leaf.lobed.branches import LobedShape
from usdfoliage.leaf.lobed.deformation import FUNCTIONS, BranchFunctions
from usdfoliage.leaf.lobed.placed import LobedLeaf
from usdfoliage.leaf.lobed.turtle import TurtleTies, ties_from_turtle

_ADVICE = "write the leaf again with usdfoliage lobed, or drop the layer that changed it"


def read_lobed_leaf(prim: Usd.Prim, asset_from_picture: NDArray[np.float64]) -> LobedLeaf:
    """The leaf that a Mesh with FoliageLobedLeafAPI is made of; its points follow from the result.

    Args:
        prim: The mesh.
        asset_from_picture: (4, 4) for column vectors, which its plant has.

    Raises:
        AssetError: The prim is no such leaf, or its numbers do not fit together.
    """
    mesh = UsdGeom.Mesh(prim)
    if not mesh or LOBED_LEAF_API not in prim.GetAppliedSchemas():
        raise AssetError(f"no lobed leaf: a Mesh with {LOBED_LEAF_API} is needed ({place(prim)})")
    nodes = _numbers(prim, "skeletonPoints", 3)[:, :2]
    parents, branches = _integers(prim, "skeletonParents", len(nodes)), _integers(prim, "skeletonBranches", len(nodes))
    own = np.arange(len(nodes))
    _require(prim, len(nodes) >= 2 and parents[0] == -1, "skeletonParents", "has no base")
    _require(prim, bool(((parents[1:] >= 0) & (parents[1:] < own[1:])).all()), "skeletonParents", "is no tree")
    steps = np.diff(branches)
    _require(prim, branches[0] == 0 and bool(np.isin(steps, (0, 1)).all()), "skeletonBranches", "does not rise by 1")
    # Within a branch each node follows the one before.
    _require(prim, bool((parents[1:][steps == 0] == own[:-1][steps == 0]).all()), "skeletonParents", "leaves a branch")
    tie_branches = _integers(prim, "tie:branch")
    count = int(branches[-1]) + 1
    in_range = bool(((tie_branches >= 0) & (tie_branches < count)).all())
    _require(prim, len(tie_branches) > 0 and in_range, "tie:branch", f"is not 0 to {count - 1}")
    k_length, k_turn, t_length, t_turn = (
        _numbers(prim, f"tie:{name}", 1, len(tie_branches)) for name in ("kLength", "kTurn", "tLength", "tTurn")
    )
    turtle = TurtleTies(
        branches=tie_branches,
        k_length=k_length,
        k_turn_rad=np.radians(k_turn),
        t_length=t_length,
        t_turn_rad=np.radians(t_turn),
    )
    _, feet = ties_from_turtle(nodes, parents, branches, turtle)
    tie_nodes = _tie_nodes(nodes, parents, branches, turtle)
    faces = np.asarray(mesh.GetFaceVertexIndicesAttr().Get() or (), np.int64)
    total = len(nodes) + len(feet)
    quads = len(faces) % 4 == 0 and bool(((faces >= 0) & (faces < total)).all())
    if not quads or len(mesh.GetPointsAttr().Get() or ()) != total:
        raise AssetError(f"the mesh has not the {total} points, or the quads, of its ties ({place(prim)})", _ADVICE)
    st = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st")
    coordinates = np.asarray(st.ComputeFlattened() if st else (), np.float64)
    if coordinates.shape != (total, 2) or not np.isfinite(coordinates).all():
        raise AssetError(f"st has not a finite place for each of {total} points ({place(prim)})", _ADVICE)
    shape = LobedShape(
        nodes=nodes, parents=parents, branches=branches, tie_nodes=tie_nodes, feet=feet, faces=faces.reshape(-1, 4)
    )
    return LobedLeaf(
        silhouette_m=_numbers(prim, "silhouettePoints", 3)[:, :2],
        shape=shape,
        st=coordinates,
        asset_from_picture=asset_from_picture,
        functions=_functions(prim, count),
    )


def _tie_nodes(
    nodes: NDArray[np.float64], parents: NDArray[np.int64], branches: NDArray[np.int64], turtle: TurtleTies
) -> NDArray[np.int64]:
    """(T,) the node of its branch that each tie begins at, by the length of the branch until there."""
    length = np.concatenate([[0.0], np.linalg.norm(nodes[1:] - nodes[parents[1:]], axis=1)])
    found = np.zeros(len(turtle.branches), np.int64)
    for branch in range(int(branches[-1]) + 1):
        own = np.flatnonzero(branches == branch)
        ties = np.flatnonzero(turtle.branches == branch)
        at, walked = np.cumsum(length[own]), np.cumsum(turtle.k_length[ties])
        after = (
            np.clip(np.searchsorted(at, walked), 1, max(len(own) - 1, 1))
            if len(own) > 1
            else np.zeros(len(walked), int)
        )
        before = np.maximum(after - 1, 0)
        found[ties] = own[np.where(np.abs(at[after] - walked) < np.abs(at[before] - walked), after, before)]
    return found


def _functions(prim: Usd.Prim, branches: int) -> BranchFunctions:
    lists: dict[str, Sequence[NDArray[np.float64]]] = {}
    for name in FUNCTIONS:
        counts, keys = _integers(prim, f"{name}:keyCounts"), _numbers(prim, f"{name}:keys", 2)
        fits = len(counts) in (0, branches) and bool((counts >= 0).all()) and counts.sum() == len(keys)
        _require(prim, fits, f"{name}:keyCounts", "does not fit the branches and the keys")
        in_rad = keys * [1.0, np.radians(1.0)]
        lists[name] = tuple(np.split(in_rad, np.cumsum(counts)[:-1])) if len(counts) else ()
    try:
        return BranchFunctions(**lists)
    except ValueError as error:
        raise AssetError(f"{error} ({place(prim)})", _ADVICE) from error


def _numbers(prim: Usd.Prim, name: str, width: int, count: int | None = None) -> NDArray[np.float64]:
    """Finite numbers (N, width), or (N,) of width 1."""
    value = prim.GetAttribute(f"foliage:lobed:{name}").Get()
    numbers = np.zeros((0, width) if width > 1 else 0) if value is None else np.asarray(value)
    numbers = numbers.reshape(-1, width) if width > 1 and not numbers.size else numbers
    right = numbers.dtype.kind in "iuf" and numbers.shape[1:] == ((width,) if width > 1 else ()) and numbers.ndim > 0
    _require(prim, right and count in (None, len(numbers)), name, "has not the numbers that are needed")
    _require(prim, bool(np.isfinite(numbers).all()), name, "is not finite")
    return numbers.astype(np.float64)


def _integers(prim: Usd.Prim, name: str, count: int | None = None) -> NDArray[np.int64]:
    return _numbers(prim, name, 1, count).astype(np.int64)


def _require(prim: Usd.Prim, holds: bool, name: str, what: str) -> None:
    if not holds:
        raise AssetError(f"foliage:lobed:{name} {what} ({place(prim)})", _ADVICE)
