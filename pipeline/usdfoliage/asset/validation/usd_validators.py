"""The validators of USD's registry, ours and a studio's among them, on one composition of an asset."""

from collections.abc import Sequence
from typing import Any

from pxr import Tf, Usd, UsdValidation

from usdfoliage.asset.locate import first_reason
from usdfoliage.asset.validation.findings import Finding, one_line
from usdfoliage.asset.validation.instances import iterate_prims
from usdfoliage.asset.validation.known_findings import KnownFindings, PrimKey, key_prims
from usdfoliage.asset.validation.shader_parsers import without_parser

# The default predicate leaves out what is unloaded.
PRESENT = Usd.PrimIsActive & Usd.PrimIsDefined & ~Usd.PrimIsAbstract

# Validators of a stage that ask it for its root layer alone, and go on from there through the files.
OF_FILES = (
    "usdFoliageValidators:AssetPaths",
    "usdUtilsValidators:MissingReferenceValidator",
    "usdUtilsValidators:UsdzPackageValidator",
)
# Validators of a prim that ask it for its own properties alone, and whether it is a guide.
OF_PRIMS = (
    "usdFoliageValidators:LeafArrays",
    "usdFoliageValidators:LeafEdits",
    "usdFoliageValidators:LeafOrientations",
    "usdFoliageValidators:LeafPatch",
)


def run_usd_validators(stage: Usd.Stage, known: KnownFindings) -> list[Finding]:
    """What the registry's validators report of one composition.

    Args:
        stage: With its own session layer, which holds nothing but selections of variants.
        known: Their findings on other compositions of the same root layer; those on this one are added.
    """
    keyed = list(key_prims(Usd.PrimRange.Stage(stage, PRESENT)))
    in_instances = list(key_prims(prim for prim in iterate_prims(stage, PRESENT) if prim.IsInstanceProxy()))
    findings: list[Finding] = []
    for validator in UsdValidation.ValidationRegistry().GetOrLoadAllValidators():
        name = validator.GetMetadata().name
        context = UsdValidation.ValidationContext(validators=[validator])
        try:
            if name in OF_FILES:
                if name not in known.of_files:
                    known.of_files[name] = tuple(_findings(name, context.Validate(stage, PRESENT)))
                findings += known.of_files[name]
            elif name in OF_PRIMS:
                findings += _validate_prims(name, context, [*keyed, *in_instances], known)
            else:
                proxies = [prim for prim, _ in in_instances]
                problems = [*context.Validate(stage, PRESENT), *(context.Validate(proxies) if proxies else ())]
                findings += _findings(name, problems)
        except (Tf.ErrorException, UnicodeDecodeError) as error:
            message = f"could not finish ({first_reason(error)}); is a layer damaged? write the asset again"
            findings.append(Finding(severity="error", validator=name, error="Stopped", path="/", message=message))
    return findings


def _validate_prims(
    name: str, context: Any, keyed: Sequence[tuple[Usd.Prim, PrimKey]], known: KnownFindings
) -> list[Finding]:
    """What one validator of prims reports of prims that are not in known."""
    new = [(prim, key) for prim, key in keyed if (name, key) not in known.of_prims]
    by_prim: dict[str, list[Finding]] = {}
    for finding in _findings(name, context.Validate([prim for prim, _ in new]) if new else ()):
        by_prim.setdefault(finding.path.split(".", 1)[0], []).append(finding)
    known.of_prims.update(((name, key), tuple(by_prim.get(str(prim.GetPath()), ()))) for prim, key in new)
    return [finding for _, key in keyed for finding in known.of_prims[name, key]]


def _findings(name: str, problems: Sequence[Any]) -> list[Finding]:
    findings = []
    for problem in problems:
        severity = _usd_severity(problem.GetType())
        if severity:
            place = _usd_place(problem.GetSites())
            message = one_line(problem.GetMessage(), place)
            rule = problem.GetName()
            finding = Finding(severity=severity, validator=name, error=rule, path=place, message=message)
            findings.append(without_parser(finding))
    return findings


def _usd_severity(kind: UsdValidation.ValidationErrorType) -> str:
    kinds = UsdValidation.ValidationErrorType
    return {kinds.Error: "error", kinds.Warn: "warning", kinds.Info: "info"}.get(kind, "")


def _usd_place(sites: Sequence[Any]) -> str:
    for site in sites:
        if site.IsProperty():
            return str(site.GetProperty().GetPath())
        if site.IsPrim():
            return str(site.GetPrim().GetPath())
        if site.GetLayer():
            return str(site.GetLayer().GetDisplayName())
    return "/"
