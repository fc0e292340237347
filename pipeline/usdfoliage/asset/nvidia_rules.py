"""NVIDIA's rules, usd-validation-nvidia, where it is installed."""

import importlib
import importlib.util
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdGeom, UsdSkel

from usdfoliage.asset.findings import Finding, one_line
from usdfoliage.asset.schema import LEAF_API
from usdfoliage.asset.shader_parsers import without_parser

PACKAGE = "usd_validation_nvidia"
MOST_CORNERS = 2_000_000  # of faces; the rules walk them in Python, some ten seconds a million


def nvidia_version() -> str:
    """The version of the package, empty where it is not installed."""
    return str(importlib.import_module(PACKAGE).__version__) if importlib.util.find_spec(PACKAGE) else ""


def run_nvidia_rules(stage: Usd.Stage) -> list[Finding]:
    """What the default rules say of one composition; nothing where they are not installed.

    Of a stage with more than MOST_CORNERS corners of faces they say nothing but that.
    """
    if importlib.util.find_spec(PACKAGE) is None:
        return []
    corners = _count_corners(stage)
    if corners > MOST_CORNERS:
        message = f"NVIDIA's rules did not run: {corners / 1e6:.0f} million corners of faces would take them too long"
        return [Finding(severity="info", validator="nvidia:engine", error="TooLarge", path="/", message=message)]
    package = importlib.import_module(PACKAGE)
    severities = package.IssueSeverity
    known = {severities.ERROR: "error", severities.FAILURE: "error", severities.WARNING: "warning"}
    findings = []
    for issue in package.ValidationEngine(variants=False).validate(stage).issues():
        if issue.severity == severities.NONE:
            continue
        places = issue.at if isinstance(issue.at, list) else [issue.at]
        for place in places:
            name = _place(place)
            finding = Finding(
                severity=known.get(issue.severity, "info"),
                validator=f"nvidia:{issue.rule.__name__ if issue.rule else 'engine'}",
                error=str(issue.code or ""),
                path=name,
                message=one_line(issue.message or "", name),
            )
            findings.append(_with_our_rules(without_parser(finding), stage))
    return list(dict.fromkeys(findings))


def _count_corners(stage: Usd.Stage) -> int:
    held = (UsdGeom.Mesh(prim).GetFaceVertexIndicesAttr().Get() for prim in stage.Traverse() if UsdGeom.Mesh(prim))
    return sum(len(indices) for indices in held if indices is not None)


def _with_our_rules(finding: Finding, stage: Usd.Stage) -> Finding:
    """The same finding, a warning where NVIDIA's rule does not hold for leaves and one of ours takes its place.

    A prototype that is displaced has an extent wider than its points, which the rule demands to be equal; an array of
    no elements it takes for one with wrong indices. A SkelRoot's extent holds what is drawn in every frame, while the
    rule demands what USD guesses from the joints at rest.
    """
    prim = stage.GetPrimAtPath(Sdf.Path(finding.path).GetPrimPath() if finding.path.startswith("/") else "/")
    if finding.severity == "error" and finding.validator == "nvidia:ExtentsChecker" and prim.IsA(UsdSkel.Root):
        ours = "it holds the surfaces in every frame, which is less than USD guesses from the joints"
        return replace(finding, severity="warning", message=f"{finding.message} ({ours})")
    leaves = next((p for p in _ancestors(prim) if LEAF_API in p.GetPrimTypeInfo().GetAppliedAPISchemas()), None)
    if finding.severity != "error" or leaves is None or not leaves.IsA(UsdGeom.PointInstancer):
        return finding
    if finding.validator == "nvidia:ExtentsChecker" and prim != leaves:
        ours = "leaves are displaced beyond the points; LeafShape tells whether the extent contains them"
    elif finding.validator == "nvidia:IndexedPrimvarChecker" and not UsdGeom.PointInstancer(leaves).GetInstanceCount():
        ours = "an asset of no leaves has empty arrays; LeafArrays tells whether they are right"
    else:
        return finding
    return replace(finding, severity="warning", message=f"{finding.message} ({ours})")


def _ancestors(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    while prim:
        yield prim
        prim = prim.GetParent()


def _place(place: Any) -> str:
    path = getattr(place, "path", None)
    if path is not None:
        return str(path)
    identifier = getattr(place, "identifier", None)  # of a layer
    return Path(identifier).name if identifier else "/"
