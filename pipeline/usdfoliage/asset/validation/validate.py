"""Whether an asset is sound: every validator that is there, over every variant selection, loaded and unloaded.

It runs validators: ours are in usd_plugins/usdFoliageValidators, but for what measures the wood. Beside them run those
of USD's registry, a studio's, and NVIDIA's usd-validation-nvidia where it is installed. A scene that has plants is
looked at as it is selected, by the registry's validators alone, and without what concerns only a file that others refer
to.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pxr import Sdf, Usd, UsdUtils

from usdfoliage.asset.locate import MISSING, find_interface, is_assembly, log_diagnostics, lost_layers
from usdfoliage.asset.looks.look import open_root_layer
from usdfoliage.asset.packages.contents import interface_of, irregular_files
from usdfoliage.asset.packed_files import display_name
from usdfoliage.asset.schema import PLANT_API, SCHEMAS, require_schemas
from usdfoliage.asset.validation.findings import SEVERITIES, Finding
from usdfoliage.asset.validation.instances import iterate_prims
from usdfoliage.asset.validation.known_findings import KnownFindings
from usdfoliage.asset.validation.nvidia_rules import nvidia_version, run_nvidia_rules
from usdfoliage.asset.validation.studio_profile import StudioProfile, StudioRules
from usdfoliage.asset.validation.studio_rules import check_composition, check_files
from usdfoliage.asset.validation.usd_validators import PRESENT, run_usd_validators
from usdfoliage.asset.validation.wood import check_wood
from usdfoliage.errors import AssetError

MAX_SELECTIONS = 64  # beyond it the variants of one set are tried while the others stay as they are

# Rules for a file that others refer to; ours of that kind look only at a root layer that is an asset.
NOT_FOR_SCENES = {("usdValidation:StageMetadataChecker", "MissingDefaultPrim")}
Selection = tuple[tuple[Sdf.Path, str, str], ...]  # prim, variant set, variant


@dataclass(frozen=True, kw_only=True)
class ValidationReport:
    """All findings of one asset or scene, errors first, and what was looked at.

    Attributes:
        asset: The interface layer or the scene.
        is_scene: Whether it refers to assets and is none itself.
        findings: What was found, those that nobody has accepted first.
        selections: The variant selections that were tried, as text.
        nvidia: The version of NVIDIA's rules; empty where they did not run.
    """

    asset: Path
    is_scene: bool
    findings: tuple[Finding, ...]
    selections: tuple[str, ...]
    nvidia: str

    @property
    def open_errors(self) -> int:
        """How many errors there are, none of which can be accepted."""
        return self.count("error")

    def count(self, severity: str) -> int:
        """How many findings of that severity nobody has accepted."""
        return sum(finding.severity == severity and not finding.accepted for finding in self.findings)


def validate_asset(asset: Path, profile: StudioProfile = StudioProfile()) -> ValidationReport:
    """Run every validator on an asset, or on a scene as it is selected.

    Args:
        asset: Its folder or its interface layer; a look, which is validated over its asset; or a scene with plants.
        profile: Warnings to mark as accepted, and a studio's own rules, for assets alone.

    Raises:
        AssetError: It has no plant, or it cannot be read.
    """
    require_schemas()
    path = find_interface(asset).absolute()
    # USD's diagnostics go to stderr unless somebody takes them; what matters of them is found by the validators.
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    root = open_root_layer(path)
    is_scene = not root.anonymous and not _is_interface(root)  # a look over its asset is anonymous
    findings: dict[Finding, list[str]] = {finding: [] for finding in _unreadable_layers(root, path.parent)}
    if not findings:  # who opens what is no regular file waits for ever, and validators open all files
        findings = {finding: [] for finding in _irregular_files(path, is_scene)}
    selections: list[Selection] = []
    if not findings:  # with a damaged layer neither USD nor its validators get far
        selections = [()] if is_scene else _selections(root)
        findings = _validate_scene(root, path) if is_scene else _validate_interface(root, selections, profile.rules)
        interface, _ = interface_of(path)
        findings |= {} if is_scene else {finding: [] for finding in check_files(interface, profile.rules)}
    log_diagnostics(diagnostics)

    finished = []
    for finding, labels in findings.items():
        shared = not labels or len([label for label in labels if label != "unloaded"]) == len(selections)
        finding = replace(finding, where="" if shared else ", ".join(dict.fromkeys(labels)))
        reason = next((entry.reason for entry in profile.accepted if entry.accepts(finding)), "")
        finished.append(replace(finding, accepted=reason))
    finished.sort(key=lambda f: (bool(f.accepted), SEVERITIES.index(f.severity), f.validator, f.path, f.message))
    return ValidationReport(
        asset=path,
        is_scene=is_scene,
        findings=tuple(finished),
        selections=tuple(_label(selection) for selection in selections),
        nvidia=nvidia_version() if selections and not is_scene else "",
    )


def _is_interface(layer: Sdf.Layer) -> bool:
    """Whether a root prim of that very layer is a plant."""
    applied = [spec.GetInfo("apiSchemas") for spec in layer.rootPrims]
    return any(items and PLANT_API in items.GetAppliedItems() for items in applied)


def _validate_interface(
    root: Sdf.Layer, selections: Sequence[Selection], rules: StudioRules
) -> dict[Finding, list[str]]:
    """What is found in every selection, and in the asset while it is unloaded, with the labels of where."""
    findings: dict[Finding, list[str]] = {}
    more: dict[Finding, list[str]] = {}
    known = KnownFindings()
    wood: list[Finding] | None = None
    for selection in selections:
        stage = _compose(root, selection, Usd.Stage.LoadAll)
        for finding in (*run_usd_validators(stage, known), *check_composition(stage, rules)):
            findings.setdefault(finding, []).append(_label(selection))
        wood = check_wood(stage) if wood is None else wood  # once, for it is the same in all that show it
        for finding in run_nvidia_rules(stage, known):
            more.setdefault(finding, []).append(_label(selection))
    for finding in run_usd_validators(_compose(root, (), Usd.Stage.LoadNone), known):
        findings.setdefault(finding, []).append("unloaded")
    findings |= {finding: [] for finding in wood or ()}
    reported = {(finding.severity, finding.message) for finding in findings}
    # NVIDIA's package runs some of USD's validators again.
    return findings | {
        finding: at for finding, at in more.items() if (finding.severity, finding.message) not in reported
    }


def _validate_scene(root: Sdf.Layer, path: Path) -> dict[Finding, list[str]]:
    """What is found in a scene as it is selected.

    Raises:
        AssetError: It has no plant.
    """
    stage = Usd.Stage.Open(root)
    # Where something cannot be composed, plants may be missing for that reason; the validators report it.
    if not _has_plants(stage) and not stage.GetCompositionErrors():
        raise AssetError(
            f"{path} holds no plant: no active prim of it has {PLANT_API} or another schema of usdFoliage",
            "name an asset's folder, its .usda, a look, or a scene that refers to assets",
        )
    findings = run_usd_validators(stage, KnownFindings())
    return {finding: [_label(())] for finding in findings if (finding.validator, finding.error) not in NOT_FOR_SCENES}


def _has_plants(stage: Usd.Stage) -> bool:
    return any(not set(SCHEMAS).isdisjoint(prim.GetAppliedSchemas()) for prim in iterate_prims(stage, PRESENT))


def _unreadable_layers(root: Sdf.Layer, folder: Path) -> Iterator[Finding]:
    """Files below the asset's folder that the asset needs and that are no USD; missing ones USD itself reports."""
    for path, reason in lost_layers(root):
        if reason != MISSING:
            yield Finding(
                severity="error",
                validator="usdfoliage:LayerReadable",
                error="LayerUnreadable",
                path=str(path.relative_to(folder) if path.is_relative_to(folder) else path),
                message=f"cannot be read as USD ({reason}); write the asset again. No validator was run",
            )


def _irregular_files(path: Path, is_scene: bool) -> Iterator[Finding]:
    """Files that the asset or scene needs and that are pipes, devices or circles of links."""
    layers = [path] if is_scene else dict.fromkeys((path, interface_of(path)[0].absolute()))
    found = dict.fromkeys(each for layer in layers for each in irregular_files(layer))
    for file, reason in found:
        yield Finding(
            severity="error",
            validator="usdfoliage:FileReadable",
            error="FileIrregular",
            path=display_name(file, path.parent),
            message=f"cannot be read ({reason}); put a regular file there. No validator was run",
        )


def _selections(root: Sdf.Layer) -> list[Selection]:
    """Every choice of variants that the asset offers; one empty choice, as authored, where it has none.

    Of choices that are the same asset only the first: in the lod crown there are no representations of leaves. Those
    of prims below the root are tried while the root's stay as they are. The assets in a forest have choices of their
    own, which are looked at where these are validated.
    """
    stage = Usd.Stage.Open(root)
    forest = is_assembly(stage.GetDefaultPrim())
    every = [
        [(prim.GetPath(), name, variant) for variant in prim.GetVariantSets().GetVariantSet(name).GetVariantNames()]
        for prim in stage.Traverse(Usd.PrimIsActive & ~Usd.PrimIsAbstract)  # what a class offers shows where it is used
        if not forest or prim == stage.GetDefaultPrim()
        for name in prim.GetVariantSets().GetNames()
    ]
    offered = [choices for choices in every if choices and choices[0][0].IsRootPrimPath()]
    below: list[Selection] = [
        (choice,)
        for choices in every
        for choice in choices
        if not choice[0].IsRootPrimPath() and not _is_selected(stage, choice)
    ]
    count = 1
    for choices in offered:
        count *= len(choices)
    if count <= MAX_SELECTIONS:
        different: dict[object, Selection] = {}
        for selection in itertools.product(*offered):
            different.setdefault(_signature(root, selection), selection)
        return [*different.values(), *below]
    return [(), *((choice,) for choices in offered for choice in choices), *below]


def _is_selected(stage: Usd.Stage, choice: tuple[Sdf.Path, str, str]) -> bool:
    path, name, variant = choice
    return bool(stage.GetPrimAtPath(path).GetVariantSets().GetVariantSet(name).GetVariantSelection() == variant)


def _signature(root: Sdf.Layer, selection: Selection) -> object:
    """Equal for two selections that give the same asset: the layers in use, and the specs with something in them of the
    prims whose variants they select."""
    stage = _compose(root, selection, Usd.Stage.LoadAll)
    layers = frozenset(layer.identifier for layer in stage.GetUsedLayers() if layer != stage.GetSessionLayer())
    specs = [
        (spec.layer.identifier, str(spec.path))
        for path in dict.fromkeys(path for path, _, _ in selection)
        if (prim := stage.GetPrimAtPath(path))
        for spec in prim.GetPrimStack()
        if spec.layer != stage.GetSessionLayer() and not spec.isInert
    ]
    return layers, tuple(specs)


def _label(selection: Selection) -> str:
    labels = [
        f"{name}={variant}" if path.IsRootPrimPath() else str(path.AppendVariantSelection(name, variant))
        for path, name, variant in selection
    ]
    return " ".join(labels) or "as authored"


def _compose(root: Sdf.Layer, selection: Selection, load: Usd.Stage.InitialLoadSet) -> Usd.Stage:
    session = Sdf.Layer.CreateAnonymous(".usda")
    for path, name, variant in selection:
        Sdf.CreatePrimInLayer(session, path).variantSelections[name] = variant
    return Usd.Stage.Open(root, session, load)
