"""Validator of FoliageLeafAPI: the collective edits and the jitter's map."""

import numpy as np
from pxr import Usd, UsdGeom

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, error, warning

VECTOR_EDITS = ("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "curl")
NUMBER_EDITS = {"width": "width", "jitterAmplitude": "jitter_amplitude", "jitterFrequency": "jitter_frequency"}
JITTER_MAP = "foliage:leaf:jitterMap"


def check_leaf_edits(prim: Usd.Prim, _time: object) -> Findings:
    """Every edit is one finite value in its range for all leaves, none is blocked; the jitter's map is there."""
    findings: Findings = []
    for name in VECTOR_EDITS:
        primvar = f"primvars:leaf:edit:{name}"
        vector = values.tuple_of(prim, primvar, 3)
        if values.is_authored(prim, primvar) and (vector is None or not np.isfinite(vector).all()):
            findings.append(error(prim, "EditNotFinite", "must be three finite numbers; (0, 0, 0) is neutral", primvar))
    for name in NUMBER_EDITS:
        primvar = f"primvars:leaf:edit:{name}"
        if not values.is_authored(prim, primvar):
            continue
        number, above_zero = values.number(prim, primvar), name == "jitterFrequency"
        if number is None or not np.isfinite(number) or number < 0 or (above_zero and number == 0):
            needed = "above 0" if above_zero else "0 or more"
            findings.append(error(prim, "EditRange", f"is {number}; it must be {needed}", primvar))
    for name in (*VECTOR_EDITS, *NUMBER_EDITS):
        primvar = f"primvars:leaf:edit:{name}"
        attribute = prim.GetAttribute(primvar)
        if attribute and attribute.GetResolveInfo().ValueIsBlocked():
            neutral = prim.GetPrimDefinition().GetAttributeFallbackValue(primvar)
            text = f"is blocked, which undoes the edit but leaves a renderer no value for it; author {neutral} instead"
            findings.append(warning(prim, "EditBlocked", text, primvar))
        if values.is_authored(prim, primvar):
            interpolation = UsdGeom.Primvar(prim.GetAttribute(primvar)).GetInterpolation()
            if interpolation != UsdGeom.Tokens.constant:
                text = f"has interpolation {interpolation}; an edit is one value for all leaves, constant"
                findings.append(error(prim, "EditInterpolation", text, primvar))
    jitter_map = values.asset_path(prim, JITTER_MAP)
    if jitter_map is not None and not jitter_map.resolvedPath:
        text = f"names {jitter_map.path}, which is not there; put the file beside the layer or correct the path"
        findings.append(error(prim, "JitterMapMissing", text, JITTER_MAP))
    return findings
