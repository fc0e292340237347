"""NVIDIA's rules, usd-validation-nvidia, where it is installed."""

import importlib
import importlib.util
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Usd, UsdGeom, UsdSkel

from usdfoliage.asset.parts.crown_leaves import CROWN_LEAVES
from usdfoliage.asset.schema import LEAF_API
from usdfoliage.asset.validation.findings import Finding, one_line
from usdfoliage.asset.validation.known_findings import KnownFindings, key_prims
from usdfoliage.asset.validation.shader_parsers import without_parser

PACKAGE = "usd_validation_nvidia"
MAX_CORNERS = 2_000_000  # of faces; the rules walk them in Python, some ten seconds a million

# Rules that look at a layer and at nothing else of the asset, and take long for it.
OF_LAYERS = ("LayerSpecChecker", "UnicodeNameChecker", "UsdAsciiPerformanceChecker")
# Rules that look at nothing but the properties of one prim.
OF_PRIMS = (
    "IndexedPrimvarChecker",
    "ManifoldChecker",
    "NormalsExistChecker",
    "NormalsValidChecker",
    "NormalsWindingsChecker",
    "SubdivisionSchemeChecker",
    "UnusedMeshTopologyChecker",
    "UnusedPrimvarChecker",
    "ValidateTopologyChecker",
    "WeldChecker",
    "ZeroAreaFaceChecker",
)
# What a rule may have of its own.
_HOOKS = (
    "CheckStage",
    "CheckDiagnostics",
    "CheckUnresolvedPaths",
    "CheckDependencies",
    "CheckLayer",
    "CheckZipFile",
    "CheckFormatDependency",
    "CheckPrim",
    "ResetCaches",
)


def nvidia_version() -> str:
    """The version of the package, empty where it is not installed."""
    return str(importlib.import_module(PACKAGE).__version__) if importlib.util.find_spec(PACKAGE) else ""


def run_nvidia_rules(stage: Usd.Stage, known: KnownFindings) -> list[Finding]:
    """What the default rules report of one composition; nothing where they are not installed.

    A stage with more than MAX_CORNERS corners of faces is not checked; the one finding states that.

    Args:
        stage: With its own session layer, which holds nothing but selections of variants.
        known: Their findings on other compositions of the same root layer; those on this one are added.
    """
    if importlib.util.find_spec(PACKAGE) is None:
        return []
    corners = _count_corners(stage)
    if corners > MAX_CORNERS:
        message = f"NVIDIA's rules did not run: {corners / 1e6:.0f} million corners of faces would take them too long"
        return [Finding(severity="info", validator="nvidia:engine", error="TooLarge", path="/", message=message)]
    if PACKAGE not in known.of_files:
        known.of_files[PACKAGE] = tuple(_findings(_engine(_rules().of_layers).validate(stage).issues()))
    found = [
        *known.of_files[PACKAGE],
        *_check_prims(stage, known),
        *_findings(_engine(_rules().of_stages).validate(stage).issues()),
    ]
    return list(dict.fromkeys(_with_our_rules(finding, stage) for finding in found))


@dataclass(frozen=True, kw_only=True)
class _Rules:
    """The default rules, classes of theirs, by what they look at."""

    of_layers: tuple[Any, ...]
    of_prims: tuple[Any, ...]
    of_stages: tuple[Any, ...]


@cache
def _rules() -> _Rules:
    """The default rules, apart; a rule of both layers and prims becomes two of its name.

    A rule that a newer version of the package lets look at more is no rule of prims. Rules that only ask a validator
    of USD's registry are left out: all of these run on their own, on more prims than the rules ask them of.
    """
    package = importlib.import_module(PACKAGE)
    nothing = package.BaseRuleChecker
    of_layers, of_prims, of_stages = [], [], []
    for rule in sorted(package.ValidationEngine(variants=False).rules, key=lambda each: str(each.__name__)):
        if hasattr(rule, "validator_name") and rule.is_implemented():
            continue
        own_hooks = {hook for hook in _HOOKS if getattr(rule, hook) is not getattr(nothing, hook)}
        if rule.__name__ in OF_PRIMS and own_hooks == {"CheckPrim"} and rule.__init__ is nothing.__init__:
            of_prims.append(rule)
        elif rule.__name__ in OF_LAYERS and own_hooks == {"CheckLayer"}:
            of_layers.append(rule)
        elif rule.__name__ in OF_LAYERS and "CheckLayer" in own_hooks:
            others = {hook: getattr(nothing, hook) for hook in own_hooks - {"CheckLayer"}}
            of_layers.append(type(rule.__name__, (rule,), others))
            of_stages.append(type(rule.__name__, (rule,), {"CheckLayer": nothing.CheckLayer}))
        else:
            of_stages.append(rule)
    return _Rules(of_layers=tuple(of_layers), of_prims=tuple(of_prims), of_stages=tuple(of_stages))


def _engine(rules: Sequence[Any]) -> Any:
    engine = importlib.import_module(PACKAGE).ValidationEngine(init_rules=False, variants=False)
    for rule in rules:
        engine.enable_rule(rule)
    return engine


def _check_prims(stage: Usd.Stage, known: KnownFindings) -> list[Finding]:
    """What the rules of prims report of prims that are not in known, called as the engine calls them."""
    findings: list[Finding] = []
    with Ar.ResolverContextBinder(stage.GetPathResolverContext()), Ar.ResolverScopedCache():
        for prim, key in key_prims(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())):
            if (PACKAGE, key) not in known.of_prims:
                known.of_prims[PACKAGE, key] = tuple(_check_prim(prim))
            findings += known.of_prims[PACKAGE, key]
    return findings


def _check_prim(prim: Usd.Prim) -> Iterator[Finding]:
    for rule in _rules().of_prims:
        checker = rule()
        try:
            checker.CheckPrim(prim)
        except Exception as error:  # noqa: BLE001 (the engine's way, and its words: the other rules have their turn)
            name, message = f"nvidia:{rule.__name__}", one_line(f"Uncaught error: {error}", "/")
            yield Finding(severity="error", validator=name, error="", path="/", message=message)
        yield from _findings(checker.GetIssues())


def _findings(issues: Iterable[Any]) -> Iterator[Finding]:
    severities = importlib.import_module(PACKAGE).IssueSeverity
    known = {severities.ERROR: "error", severities.FAILURE: "error", severities.WARNING: "warning"}
    for issue in issues:
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
            yield without_parser(finding)


def _count_corners(stage: Usd.Stage) -> int:
    all_indices = (
        UsdGeom.Mesh(prim).GetFaceVertexIndicesAttr().Get() for prim in stage.Traverse() if UsdGeom.Mesh(prim)
    )
    return sum(len(indices) for indices in all_indices if indices is not None)


def _with_our_rules(finding: Finding, stage: Usd.Stage) -> Finding:
    """The same finding, a warning where NVIDIA's rule does not hold for leaves and one of ours takes its place.

    A prototype that is displaced has an extent wider than its points, which the rule demands to be equal; an array of
    no elements it takes for one with wrong indices. A SkelRoot's extent holds what is drawn in every frame, while the
    rule demands what USD guesses from the joints at rest.
    """
    prim = stage.GetPrimAtPath(Sdf.Path(finding.path).GetPrimPath() if finding.path.startswith("/") else "/")
    if not prim:  # of the asset as a whole, or of a rule that came to grief over what is damaged
        return finding
    if finding.severity == "error" and finding.validator == "nvidia:ExtentsChecker" and prim.IsA(UsdSkel.Root):
        ours = "it holds the surfaces in every frame, which is less than USD guesses from the joints"
        return replace(finding, severity="warning", message=f"{finding.message} ({ours})")
    if finding.severity == "error" and finding.validator == "nvidia:ExtentsChecker" and _is_crown_cluster(prim):
        ours = "in Storm its leaves face the camera, and reach beyond the points"
        return replace(finding, severity="warning", message=f"{finding.message} ({ours})")
    leaves = next((p for p in _ancestors(prim) if LEAF_API in p.GetPrimTypeInfo().GetAppliedAPISchemas()), None)
    if finding.severity != "error" or leaves is None or not leaves.IsA(UsdGeom.PointInstancer):
        return finding
    if finding.validator == "nvidia:ExtentsChecker" and prim != leaves:
        ours = "leaves are displaced beyond the points; LeafShape checks whether the extent contains them"
    elif finding.validator == "nvidia:IndexedPrimvarChecker" and not UsdGeom.PointInstancer(leaves).GetInstanceCount():
        ours = "an asset of no leaves has empty arrays; LeafArrays checks whether they are right"
    else:
        return finding
    return replace(finding, severity="warning", message=f"{finding.message} ({ours})")


def _is_crown_cluster(prim: Usd.Prim) -> bool:
    """Whether a prim is a prototype of the leaves of a crown."""
    above = next((p for p in _ancestors(prim) if p.IsA(UsdGeom.PointInstancer)), None)
    return above is not None and above != prim and above.GetName() == CROWN_LEAVES


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
