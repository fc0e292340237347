"""Joints for a plant of an asset: its rig, and which joints its wood and its leaves follow."""

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom
from scipy.spatial import cKDTree

from usdfoliage.asset.export.nanite import AssemblyRig
from usdfoliage.branch.axis_places import find_places
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.motion.rig import RigSettings, build_rig, skin_places

_SPACING = 0.25  # of the median length between points of an axis: samples that decide on which branch a leaf is


def rig_assembly(
    skeleton: Skeleton, wood: Usd.Prim, leaf_base_m: NDArray[np.float64], settings: RigSettings = RigSettings()
) -> AssemblyRig:
    """Build the joints of a plant.

    Args:
        skeleton: Of its branches, in the plant's frame.
        wood: Their surface as polygons with the number of the branch on each face (primvars:branch:curve).
        leaf_base_m: (N, 3), in the same frame.
        settings: Of the rig.
    """
    mesh = UsdGeom.Mesh(wood)
    points_m = np.array(mesh.GetPointsAttr().Get(), np.float64).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(), np.int64)
    vertices = np.array(mesh.GetFaceVertexIndicesAttr().Get(), np.int64)
    numbers = UsdGeom.PrimvarsAPI(wood).GetPrimvar("branch:curve").ComputeFlattened()
    of_face = np.zeros(len(counts), np.int32) if numbers is None else np.array(numbers, np.int32)
    of_face = np.clip(of_face, 0, len(skeleton) - 1)
    curve = np.full(len(points_m), len(skeleton) - 1, np.int32)
    np.minimum.at(curve, vertices, np.repeat(of_face, counts))  # where two meet, the one that carries the other
    rig = build_rig(skeleton, settings, drawn=np.isin(np.arange(len(skeleton)), of_face))
    places = find_places(skeleton, points_m, curve)
    on = find_places(skeleton, leaf_base_m, nearest_branches(skeleton, leaf_base_m))
    return AssemblyRig(
        rig=rig,
        order=skeleton.order[rig.curve].astype(np.int32),
        wood=skin_places(rig, places.curve, places.arc_m),
        leaves=skin_places(rig, on.curve, on.arc_m),
    )


def nearest_branches(skeleton: Skeleton, points_m: NDArray[np.float64]) -> NDArray[np.int32]:
    """The branch (N,) whose bark is nearest to each point (N, 3): a leaf stands on bark."""
    if not len(points_m):
        return np.zeros(0, np.int32)
    samples_m, radius_m, curves = _sample(skeleton)
    found = cKDTree(samples_m).query(points_m, k=min(8, len(samples_m)))
    distance_m, index = (np.asarray(each).reshape(len(points_m), -1) for each in found)
    best = np.abs(distance_m - radius_m[index]).argmin(axis=1)
    return np.asarray(curves[index[np.arange(len(points_m)), best]], np.int32)


def _sample(skeleton: Skeleton) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32]]:
    """Points of all axes (S, 3), close together, their radii and their branches."""
    start = np.flatnonzero(np.diff(skeleton.curve, append=-1) == 0)
    step_m = skeleton.points_m[start + 1] - skeleton.points_m[start]
    length_m = np.linalg.norm(step_m, axis=1)
    spacing_m = max(_SPACING * float(np.median(length_m)), 1e-9)
    parts = np.clip(np.ceil(length_m / spacing_m), 1, 64).astype(np.int64)
    row = np.repeat(np.arange(len(start)), parts)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[row]
    points_m = skeleton.points_m[start[row]] + share[:, None] * step_m[row]
    radius_m = skeleton.radius_m
    radii_m = radius_m[start[row]] + share * (radius_m[start[row] + 1] - radius_m[start[row]])
    tips = skeleton.first + skeleton.counts - 1
    curves = np.concatenate([skeleton.curve[start[row]], np.arange(len(skeleton))])
    return np.concatenate([points_m, skeleton.points_m[tips]]), np.concatenate([radii_m, radius_m[tips]]), curves
