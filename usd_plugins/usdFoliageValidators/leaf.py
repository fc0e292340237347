"""Validators of FoliageLeafAPI: the arrays, and the two forms of the orientations."""

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, count, error, warning, wrong_prim_type

PARAMETERS = ("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "inner", "outer")
WIDEST = 2.0  # leaf lengths from axis to silhouette; a leaf four times as wide as long is a slip
ORIENTATION_TOLERANCE = 2e-3  # a half of magnitude up to 1 is within 5e-4

# What may be known of a leaf besides its shape: least and greatest value, what to do about another.
FACTS = (
    ("phase", 0.0, 64.0, "author where on the wave each leaf begins, in cycles"),
    ("confidence", 0.0, 1.0, "measure it again"),
    ("residual", 0.0, np.inf, "measure it again"),
    ("view", -1.0, np.inf, "author the number of the photograph, -1 for none"),
    ("origin", 0.0, 3.0, "author 0 found, 1 completed, 2 filled in or 3 of the species"),
)


# The copy for Storm: its numbers are those of these primvars times these factors.
PACKED = "primvars:leaf:packed"
PACKED_OF = (("axis2", 2048.0), ("inner", 2048.0), ("outer", 2048.0))
PACKED_PHASE = 512.0
PACKED_AFTER = (("axis1", 2048.0), ("silhouette1", 2048.0), ("silhouette2", 2048.0))  # the phase
PACKED_PERIOD = 64.0


def check_leaf_arrays(prim: Usd.Prim, _time: object) -> Findings:
    """The seven parameters are there, one element a leaf, finite, and make a leaf; so are phase and facts."""
    findings = wrong_prim_type(prim, "FoliageLeafAPI", ("PointInstancer", "NurbsPatch"))
    if findings:
        return findings
    instancer = UsdGeom.PointInstancer(prim)
    if instancer:
        positions = values.numbers(prim, "positions", 3)
        if positions is None:
            return [error(prim, "PositionsMissing", "has no positions; author one a leaf, in metres", "positions")]
        leaves, measure, interpolation = len(positions), "one for each of positions", "varying"
        findings += _check_placement(prim, positions)
    else:
        leaves, measure, interpolation = 1, "one for the patch", "constant"

    parameters: dict[str, NDArray[np.float64]] = {}
    for name in PARAMETERS:
        primvar = f"primvars:leaf:{name}"
        array = values.numbers(prim, primvar, 3)
        if array is None:
            text = f"is not authored; author {leaves} float3, {measure}"
            findings.append(error(prim, "LeafArrayMissing", text, primvar))
        elif len(array) != leaves:
            text = f"has {len(array)} elements; author {leaves}, {measure}"
            findings.append(error(prim, "LeafArrayLength", text, primvar))
        else:
            findings += _check_interpolation(prim, primvar, interpolation)
            wrong = ~np.isfinite(array).all(axis=1)
            if wrong.any():
                text = f"is not finite in {count(wrong, 'leaves')}; drop these leaves or fit them again"
                findings.append(error(prim, "LeafArrayNotFinite", text, primvar))
            else:
                parameters[name] = array
    findings += _check_silhouette(prim, parameters)
    findings += _check_facts(prim, leaves, interpolation)
    if instancer and not findings:
        findings += _check_packed(prim, leaves, parameters)
    return findings


def check_leaf_orientations(prim: Usd.Prim, _time: object) -> Findings:
    """orientations (half, for older applications) and orientationsf (float, exact) are there and agree."""
    if not UsdGeom.PointInstancer(prim):
        return []
    findings: Findings = []
    positions = values.numbers(prim, "positions", 3)
    if positions is not None and not len(positions):
        return []
    arrays: dict[str, NDArray[np.float64]] = {}
    for name in ("orientations", "orientationsf"):
        array = values.numbers(prim, name, 4)
        if array is None or not len(array):
            text = "is not authored; author both orientations and orientationsf, from one source"
            findings.append(error(prim, "OrientationsMissing", text, name))
        elif positions is not None and len(array) != len(positions):
            text = f"has {len(array)} elements; author {len(positions)}, one for each of positions"
            findings.append(error(prim, "OrientationsLength", text, name))
        else:
            arrays[name] = array
            wrong = ~(np.abs(np.linalg.norm(array, axis=1) - 1) < ORIENTATION_TOLERANCE)
            if wrong.any():
                text = f"is no rotation in {count(wrong, 'leaves')}; normalise the quaternions"
                findings.append(error(prim, "OrientationsNotUnit", text, name))
    if len(arrays) == 2 and not findings:
        half, exact = arrays["orientations"], arrays["orientationsf"]
        # q and -q are one rotation.
        apart = np.minimum(np.abs(half - exact).max(axis=1), np.abs(half + exact).max(axis=1))
        wrong = apart > ORIENTATION_TOLERANCE
        if wrong.any():
            text = (
                f"is up to {apart.max():.2g} from orientationsf in {count(wrong, 'leaves')}, "
                f"{ORIENTATION_TOLERANCE:g} allowed; write both from the same rotations"
            )
            findings.append(error(prim, "OrientationsDiffer", text, "orientations"))
    return findings


def _check_placement(prim: Usd.Prim, positions: NDArray[np.float64]) -> Findings:
    findings: Findings = []
    wrong = ~np.isfinite(positions).all(axis=1)
    if wrong.any():
        text = f"is not finite in {count(wrong, 'leaves')}; drop these leaves"
        findings.append(error(prim, "PositionsNotFinite", text, "positions"))
    scales = values.numbers(prim, "scales", 3)
    if scales is None or len(scales) != len(positions):
        value = "no value" if scales is None else f"{len(scales)} elements"
        text = f"has {value}; author {len(positions)}, each leaf's length in metres for all three axes"
        findings.append(error(prim, "ScalesLength", text, "scales"))
    else:
        with np.errstate(invalid="ignore"):
            wrong = ~(np.isfinite(scales).all(axis=1) & (scales > 0).all(axis=1))
            uneven = ~wrong & (np.ptp(scales, axis=1) > 1e-5 * scales.max(axis=1, initial=0))
        if wrong.any():
            text = f"is not above 0 in {count(wrong, 'leaves')}; author each leaf's length in metres"
            findings.append(error(prim, "ScalesNotPositive", text, "scales"))
        elif uneven.any():
            text = f"differs between axes in {count(uneven, 'leaves')}; author one length; the silhouette has the width"
            findings.append(error(prim, "ScalesNotUniform", text, "scales"))
    return findings


def _check_interpolation(prim: Usd.Prim, primvar: str, needed: str) -> Findings:
    interpolation = UsdGeom.Primvar(prim.GetAttribute(primvar)).GetInterpolation()
    if interpolation == needed:
        return []
    text = f"has interpolation {interpolation}; author {needed} on a {prim.GetTypeName()}"
    return [error(prim, "LeafArrayInterpolation", text, primvar)]


def _check_silhouette(prim: Usd.Prim, parameters: dict[str, NDArray[np.float64]]) -> Findings:
    names = [f"silhouette{i}" for i in (1, 2, 3)]
    if not all(name in parameters for name in names):
        return []
    findings: Findings = []
    silhouette = np.stack([parameters[name] for name in names], axis=1)  # leaf, point, (v, x, z)
    v, x = silhouette[:, :, 0], silhouette[:, :, 1]
    wrong = ((v <= 0) | (v >= 1)).any(axis=1)
    if wrong.any():
        text = f"(v, the first number) is outside (0, 1) in {count(wrong, 'leaves')}; fit these leaves again"
        findings.append(error(prim, "SilhouetteRange", text, "primvars:leaf:silhouette1"))
    wrong = (np.diff(v, axis=1) <= 0).any(axis=1)
    if wrong.any():
        text = f"(v, the first number) does not rise from 1 to 3 in {count(wrong, 'leaves')}; fit these leaves again"
        findings.append(error(prim, "SilhouetteOrder", text, "primvars:leaf:silhouette1"))
    # At one point a leaf may have no width, as some do at a narrow base; at all of them it is a line.
    wrong = ((x < 0) | (x > WIDEST)).any(axis=1) | (x == 0).all(axis=1)
    if wrong.any():
        text = (
            f"(x, the second number) is outside [0, {WIDEST:g}] leaf lengths, or 0 at all points, in "
            f"{count(wrong, 'leaves')}; "
            "look whether these are leaves"
        )
        findings.append(warning(prim, "SilhouetteWidth", text, "primvars:leaf:silhouette1"))
    return findings


def _check_facts(prim: Usd.Prim, leaves: int, interpolation: str) -> Findings:
    findings: Findings = []
    for name, low, high, remedy in FACTS:
        primvar = f"primvars:leaf:{name}"
        if not values.is_authored(prim, primvar):
            continue
        array = values.numbers(prim, primvar)
        if array is None or len(array) != leaves:
            length = 0 if array is None else len(array)
            text = f"has {length} elements; author {leaves}, or none at all"
            findings.append(error(prim, "LeafArrayLength", text, primvar))
            continue
        findings += _check_interpolation(prim, primvar, interpolation)
        wrong = ~((array >= low) & (array <= high) & np.isfinite(array))
        if wrong.any():
            bound = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} or more"
            text = f"is not {bound} in {count(wrong, 'leaves')}; {remedy}"
            findings.append(error(prim, "LeafFactRange", text, primvar))
    return findings


def _check_packed(prim: Usd.Prim, leaves: int, parameters: dict[str, NDArray[np.float64]]) -> Findings:
    """What Storm reads agrees with the arrays: another application may have changed these alone."""
    remedy = "write the leaves again, with `usdfoliage bake` or author_packed_leaves"
    packed = values.numbers(prim, PACKED)
    if packed is None:
        text = f"is not authored, so that Storm draws straight cross-sections and symmetrical axes; {remedy}"
        return [warning(prim, "LeafPackedMissing", text, PACKED)]
    findings = _check_interpolation(prim, PACKED, "constant")
    if not leaves and not len(packed):
        return findings
    # Assets of earlier versions have ten numbers a leaf, and shaders that read the others elsewhere.
    if len(packed) not in (1 + 19 * leaves, 1 + 10 * leaves) or packed[0] != leaves:
        text = f"has {len(packed)} elements for {packed[0] if len(packed) else 0:g} leaves; "
        text += f"{1 + 19 * leaves} are needed, for {leaves}; {remedy}"
        return [*findings, error(prim, "LeafPackedLength", text, PACKED)]
    phase = values.numbers(prim, "primvars:leaf:phase") if values.is_authored(prim, "primvars:leaf:phase") else None
    turns = (np.zeros(leaves) if phase is None else phase % PACKED_PERIOD) * PACKED_PHASE
    if not leaves:
        return findings
    after = [parameters[name] * factor for name, factor in PACKED_AFTER]
    expected = np.column_stack([*(parameters[name] * factor for name, factor in PACKED_OF), turns, *after])
    found = packed[1:].reshape(-1, leaves).T
    wrong = ~(np.abs(found - expected[:, : found.shape[1]]) <= 1.0).all(axis=1)
    if wrong.any():
        text = f"differs from the arrays that it is a copy of in {count(wrong, 'leaves')}: Storm draws others; {remedy}"
        findings.append(error(prim, "LeafPackedDiffers", text, PACKED))
    return findings
