"""Validator of FoliageLeafAPI: a hero leaf, one leaf as a NURBS patch."""

import numpy as np
from pxr import Usd, UsdGeom

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, error

# Of a leaf's exact net: the silhouette, outer and inner curve of either half and the axis, each a quartic.
U_COUNT, V_COUNT = 7, 5
U_ORDER, V_ORDER = 4, 5
U_KNOTS = np.array([-1.0] * 4 + [0.0] * 3 + [1.0] * 4)
V_KNOTS = np.array([0.0] * 5 + [1.0] * 5)
EXTENT_SLACK = 1e-5  # leaf lengths


def check_leaf_patch(prim: Usd.Prim, _time: object) -> Findings:
    """A hero leaf's patch has 7 x 5 finite points, the orders and knots of a leaf, and an extent that contains it."""
    if not UsdGeom.NurbsPatch(prim):
        return []
    findings: Findings = []
    for name, needed in (
        ("uVertexCount", U_COUNT),
        ("vVertexCount", V_COUNT),
        ("uOrder", U_ORDER),
        ("vOrder", V_ORDER),
    ):
        number = values.value(prim, name)
        if number != needed:
            text = f"is {number}; a leaf's patch has {needed}, author that"
            findings.append(error(prim, "PatchShape", text, name))
    for name, knots in (("uKnots", U_KNOTS), ("vKnots", V_KNOTS)):
        array = values.numbers(prim, name)
        if array is None or array.shape != knots.shape or (array != knots).any():
            text = f"is not that of a leaf; author {', '.join(f'{knot:g}' for knot in knots)}"
            findings.append(error(prim, "PatchKnots", text, name))
    points = values.numbers(prim, "points", 3)
    if points is None or len(points) != U_COUNT * V_COUNT:
        length = 0 if points is None else len(points)
        text = f"has {length} elements; author {U_COUNT * V_COUNT}, {V_COUNT} rows of {U_COUNT}"
        return [*findings, error(prim, "PatchPoints", text, "points")]
    if not np.isfinite(points).all():
        return [*findings, error(prim, "PatchPoints", "is not finite; fit the leaf again", "points")]
    extent = values.numbers(prim, "extent", 3) if values.is_authored(prim, "extent") else None
    contained = extent is not None and len(extent) == 2
    contained = contained and bool(((points >= extent[0] - EXTENT_SLACK) & (points <= extent[1] + EXTENT_SLACK)).all())
    if not contained:
        text = "does not contain the patch's points; author their bounds"
        findings.append(error(prim, "PatchExtent", text, "extent"))
    return findings
