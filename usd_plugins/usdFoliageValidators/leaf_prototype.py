"""Validator of FoliageLeafAPI: what an instancer of leaves draws in place of each leaf."""

import numpy as np
from pxr import Usd, UsdGeom

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, error


def check_leaf_prototype(prim: Usd.Prim, _time: object) -> Findings:
    """Every prototype exists below the instancer, is used rightly, and its gprims have an extent."""
    instancer = UsdGeom.PointInstancer(prim)
    if not instancer:
        return []
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    used = values.indices(prim, "protoIndices")
    if not targets:
        positions = values.numbers(prim, "positions", 3)
        if positions is not None and not len(positions):
            return []
        text = "has no prototype; point the relationship prototypes at a leaf mesh below the instancer"
        return [error(prim, "PrototypeMissing", text, "prototypes")]
    findings: Findings = []
    for target in targets:
        prototype = prim.GetStage().GetPrimAtPath(target)
        if not prototype:
            text = f"targets <{target}>, which does not exist; point it at a leaf mesh below the instancer"
            findings.append(error(prim, "PrototypeMissing", text, "prototypes"))
            continue
        if not target.HasPrefix(prim.GetPath()):
            text = f"targets <{target}>, which is not below the instancer and so misses its edits; move it below"
            findings.append(error(prim, "PrototypeElsewhere", text, "prototypes"))
        findings += _check_extents(prototype)
    if used is None or (len(used) and not (used.min() >= 0 and used.max() < len(targets))):
        text = f"must name one of the {len(targets)} prototypes, 0 to {len(targets) - 1}, for each leaf"
        findings.append(error(prim, "PrototypeIndex", text, "protoIndices"))
    return findings


def _check_extents(prototype: Usd.Prim) -> Findings:
    findings: Findings = []
    drawn = 0
    for prim in Usd.PrimRange(prototype):
        if UsdGeom.PointInstancer(prim):
            text = "is a PointInstancer inside a prototype; leaves have one level of instancing, flatten it"
            findings.append(error(prim, "NestedInstancer", text))
        if not UsdGeom.Gprim(prim):
            continue
        drawn += 1
        extent = values.numbers(prim, "extent", 3) if values.is_authored(prim, "extent") else None
        if extent is None or len(extent) != 2:
            text = "is not authored; a leaf is culled or never framed without it: author the displaced leaf's bounds"
            findings.append(error(prim, "PrototypeExtent", text, "extent"))
            continue
        points = values.numbers(prim, "points", 3)
        if points is not None and len(points):
            slack = 1e-5 * max(1.0, float(np.abs(points).max()))
            if (points.min(axis=0) < extent[0] - slack).any() or (points.max(axis=0) > extent[1] + slack).any():
                text = "does not contain the prim's own points; author the displaced leaf's bounds"
                findings.append(error(prim, "PrototypeExtent", text, "extent"))
    if not drawn:
        text = "is a prototype with nothing to draw; put a leaf mesh below it"
        findings.append(error(prototype, "PrototypeEmpty", text))
    return findings
