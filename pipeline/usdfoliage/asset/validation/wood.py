"""Whether the wood of an asset is in one piece, as it is drawn."""

import numpy as np
from pxr import Usd, UsdGeom

from usdfoliage.asset.packages.contents import find_branches, find_skeleton
from usdfoliage.asset.parts.branch_part import ALL_ORDERS
from usdfoliage.asset.parts.branches import read_skeleton
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.branch.whole_wood import measure_wholeness
from usdfoliage.errors import AssetError
from usdfoliage.geometry.smooth_mesh import choose_levels, refine_smooth

VALIDATOR = "usdfoliage:WoodChecker"
MAX_BARE = 0.002  # share of the axes' length
_MAX_FACES = 1_000_000  # of the surface, refined


def check_wood(stage: Usd.Stage) -> list[Finding] | None:
    """What is wrong with the branches' surface; None where the selected variants do not show all branches at rest."""
    plant = stage.GetDefaultPrim()
    if not plant:
        return None
    sets = plant.GetVariantSets()
    if "branches" in sets.GetNames() and sets.GetVariantSelection("branches") != ALL_ORDERS:
        return None
    curves, surface = find_skeleton(plant), find_branches(plant)
    if curves is None or surface is None:
        return None
    if any(UsdGeom.PointBased(prim).GetPointsAttr().ValueMightBeTimeVarying() for prim in (curves, surface)):
        return None  # a plant that grows is whole at last alone
    try:
        skeleton = read_skeleton(curves)
    except AssetError:
        return None  # which other validators report
    mesh = UsdGeom.Mesh(surface)
    read = [
        each.Get() for each in (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    ]
    if any(value is None for value in read):
        return None
    points, counts, corners = (np.array(value) for value in read)
    whole = len(counts) and np.isfinite(points).all() and corners.min() >= 0 and corners.max() < len(points)
    if not whole or not len(skeleton) or (counts != counts[0]).any() or counts[0] not in (3, 4):
        return None
    points, faces = points.astype(np.float64), corners.reshape(-1, counts[0])
    if counts[0] == 4 and mesh.GetSubdivisionSchemeAttr().Get() == UsdGeom.Tokens.catmullClark:
        points, faces = refine_smooth(points, faces, choose_levels(len(faces), _MAX_FACES))
    unit_m = UsdGeom.GetStageMetersPerUnit(stage)
    found = measure_wholeness(skeleton, points, faces)
    findings = []
    if found.afloat:
        findings.append(
            _finding(
                "PieceAfloat",
                surface,
                f"{found.afloat} of {found.pieces} pieces of the branches' surface touch no other one, "
                f"up to {1000 * unit_m * found.widest_gap_m:.2g} mm; build the asset again",
            )
        )
    if found.bare > MAX_BARE:
        findings.append(
            _finding(
                "BareAxis",
                curves,
                f"{found.bare:.2%} of the branches' length has no surface; build the asset again",
            )
        )
    return findings


def _finding(error: str, prim: Usd.Prim, message: str) -> Finding:
    return Finding(severity="error", validator=VALIDATOR, error=error, path=str(prim.GetPath()), message=message)
