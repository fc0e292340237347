"""Validator of FoliageSkeletonAPI: linear curves that hang together as a tree."""

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, count, error, warning, wrong_prim_type

# (property, smallest value, whether that itself is allowed, largest value)
GROWTH_RANGES = (
    ("internodeLength", 0.0, False, np.inf),
    ("divergenceAngle", 0.0, True, 360.0),
    ("branchingAngle", 0.0, True, 180.0),
    ("initialGrowthUnits", 0.0, False, np.inf),
    ("initialLength", 0.0, False, np.inf),
    ("maximumLength", 0.0, False, np.inf),
    ("cycles", 0.0, True, np.inf),
    ("attraction", 0.0, True, np.inf),
    ("tropism", -np.inf, False, np.inf),
    ("rootDiameter", 0.0, False, np.inf),
    ("allometryExponent", 0.0, False, np.inf),
    ("seed", 0.0, True, np.inf),
)


def check_skeleton(prim: Usd.Prim, _time: object) -> Findings:
    """Curves are linear, widths positive, and every curve springs from a vertex of its parent."""
    findings = wrong_prim_type(prim, "FoliageSkeletonAPI", ("BasisCurves",))
    if findings:
        return findings
    if values.value(prim, "type") != "linear":
        text = f"is {values.value(prim, 'type')}; author linear"
        findings.append(error(prim, "CurveType", text, "type"))
    points = values.numbers(prim, "points", 3)
    vertex_counts = values.indices(prim, "curveVertexCounts")
    if points is None or vertex_counts is None:
        return [*findings, error(prim, "CurvesMissing", "has no points or no curveVertexCounts; author both")]
    if (vertex_counts < 2).any() or vertex_counts.sum() != len(points):
        text = (
            f"sums to {vertex_counts.sum()} with a least of {vertex_counts.min(initial=0)}; a curve has 2 vertices or "
            f"more and together they are the {len(points)} points"
        )
        return [*findings, error(prim, "CurveVertexCounts", text, "curveVertexCounts")]
    wrong = ~np.isfinite(points).all(axis=1)
    if wrong.any():
        text = f"is not finite in {count(wrong, 'points')}; drop these curves"
        findings.append(error(prim, "PointsNotFinite", text, "points"))
    findings += _check_widths(prim, len(points))
    findings += _check_growth(prim)
    return findings + _check_tree(prim, points, vertex_counts)


def _check_widths(prim: Usd.Prim, vertices: int) -> Findings:
    widths = values.numbers(prim, "widths")
    if widths is None or len(widths) != vertices:
        value = "no value" if widths is None else f"{len(widths)} elements"
        text = f"has {value}; author {vertices} diameters in metres, one a point"
        return [error(prim, "WidthsLength", text, "widths")]
    findings: Findings = []
    interpolation = prim.GetAttribute("widths").GetMetadata("interpolation")
    if interpolation != "vertex":
        text = f"has interpolation {interpolation}; author vertex, one diameter a point"
        findings.append(error(prim, "WidthsInterpolation", text, "widths"))
    wrong = ~(np.isfinite(widths) & (widths > 0))
    if wrong.any():
        text = f"is not above 0 in {count(wrong, 'points')}; author diameters in metres"
        findings.append(error(prim, "WidthsNotPositive", text, "widths"))
    return findings


def _check_tree(prim: Usd.Prim, points: NDArray[np.float64], vertex_counts: NDArray[np.int64]) -> Findings:
    curves = len(vertex_counts)
    findings: Findings = []
    arrays: dict[str, NDArray[np.int64]] = {}
    for name in ("parentCurve", "parentVertex", "order"):
        array = values.indices(prim, f"foliage:{name}")
        if array is None or len(array) != curves:
            value = "no value" if array is None else f"{len(array)} elements"
            text = f"has {value}; author {curves} int, one a curve"
            findings.append(error(prim, "SkeletonArrayLength", text, f"foliage:{name}"))
        else:
            arrays[name] = array
    inferred = values.indices(prim, "foliage:inferred")
    if inferred is not None and (len(inferred) != curves or not np.isin(inferred, (0, 1)).all()):
        text = f"has {len(inferred)} elements, or others than 0 and 1; author {curves} int, 0 or 1, one a curve"
        findings.append(error(prim, "SkeletonArrayLength", text, "foliage:inferred"))
    if findings:
        return findings
    parent, vertex, order = arrays["parentCurve"], arrays["parentVertex"], arrays["order"]

    wrong = (parent < -1) | (parent >= curves)
    if wrong.any():
        text = f"is not -1 to {curves - 1} in {count(wrong, 'curves')}; name the curve it springs from, -1 for a root"
        return [error(prim, "ParentCurveRange", text, "foliage:parentCurve")]
    root = parent < 0
    if not root.any():
        findings.append(
            error(prim, "NoRoot", "has no -1; author -1 for each curve that is a root", "foliage:parentCurve")
        )
    wrong = _in_cycle(parent)
    if wrong.any():
        text = (
            f"leads round in a circle, never to a root, in {count(wrong, 'curves')}; author parents that lead to a root"
        )
        findings.append(error(prim, "ParentCycle", text, "foliage:parentCurve"))

    first = np.concatenate([[0], np.cumsum(vertex_counts)[:-1]])
    # A root's parent reads element -1 here and is masked out.
    inside = (vertex >= first[parent]) & (vertex < first[parent] + vertex_counts[parent])
    wrong = np.where(root, vertex != -1, ~inside)
    if wrong.any():
        text = (
            f"is no vertex of the parent curve in {count(wrong, 'curves')}; author its index in points, -1 for a root"
        )
        findings.append(error(prim, "ParentVertexRange", text, "foliage:parentVertex"))
    else:
        apart = np.abs(points[first] - points[vertex]).max(axis=1)
        wrong = ~root & ~(apart <= 1e-6 * max(1.0, float(np.abs(points).max(initial=0))))
        if wrong.any():
            text = (
                f"is up to {apart[wrong].max():.3g} m from the child's first point in {count(wrong, 'curves')}; "
                "a child's first point repeats it"
            )
            findings.append(error(prim, "ParentVertexApart", text, "foliage:parentVertex"))

    wrong = (order < 0) | (root & (order != 0))
    if wrong.any():
        text = f"is below 0, or not 0 at a root, in {count(wrong, 'curves')}; author 0 for a root, no number below 0"
        findings.append(error(prim, "OrderRange", text, "foliage:order"))
    else:
        step = order - order[parent]
        wrong = ~root & (step != 0) & (step != 1)
        if wrong.any():
            text = f"is not its parent's or one more in {count(wrong, 'curves')}; count the orders again"
            findings.append(warning(prim, "OrderStep", text, "foliage:order"))
    return findings


def _range_text(low: float, low_allowed: bool, high: float) -> str:
    if not np.isfinite(low):
        return "a finite number"
    if np.isfinite(high):
        return f"a number from {low:g} to {high:g}"
    return f"a number of {low:g} or more" if low_allowed else f"a number above {low:g}"


def _check_growth(prim: Usd.Prim) -> Findings:
    findings: Findings = []
    for name, low, low_allowed, high in GROWTH_RANGES:
        attribute = f"foliage:growth:{name}"
        if not values.is_authored(prim, attribute):
            continue
        number = values.number(prim, attribute)
        low_enough = number is not None and (number >= low if low_allowed else number > low)
        if number is None or not np.isfinite(number) or not low_enough or number > high:
            text = f"is {number}; author {_range_text(low, low_allowed, high)}"
            findings.append(error(prim, "GrowthRange", text, attribute))
    direction = "foliage:growth:tropismDirection"
    if values.is_authored(prim, direction):
        vector = values.tuple_of(prim, direction, 3)
        if vector is None or not abs(np.linalg.norm(vector) - 1) < 1e-3:
            findings.append(error(prim, "GrowthRange", "must have length 1; normalise it", direction))
    return findings


def _in_cycle(parent: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which curves never reach a root: after as many steps up as there are curves they still have a parent."""
    ancestor, steps = parent.copy(), 1
    while steps < len(parent) + 1:  # each round doubles the steps
        ancestor = np.where(ancestor < 0, -1, ancestor[ancestor])
        steps *= 2
    return np.asarray(ancestor >= 0)
