"""What is known of one selection is used for another only where it holds there."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.validation import nvidia_rules
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.asset.validation.known_findings import KnownFindings, key_prims
from usdfoliage.asset.validation.usd_validators import run_usd_validators

from tests.support import plant_stages as stages

TENT = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]
SHAPES, SHADES = ("flat", "fan", "flat_again"), ("dark", "light")
SELECTIONS = [{"shape": shape, "shade": shade} for shape in SHAPES for shade in SHADES]


@pytest.fixture
def asset(tmp_path: Path) -> Path:
    """A mesh that one variant makes non-manifold, a leaf edit that another breaks, a layer with a bad spec."""
    interface = stages.write_asset(tmp_path / "oak")
    stage = Usd.Stage.Open(str(interface))
    plant = stage.GetDefaultPrim()
    mesh = UsdGeom.Mesh.Define(stage, plant.GetPath().AppendPath("geo/Flap"))
    mesh.CreatePointsAttr(TENT)
    for name, variants in (("shape", SHAPES), ("shade", SHADES)):
        variant_set = plant.GetVariantSets().AddVariantSet(name)
        for variant in variants:
            variant_set.AddVariant(variant)
            variant_set.SetVariantSelection(variant)
            with variant_set.GetVariantEditContext():
                if name == "shape":
                    faces = [0, 1, 2] if variant != "fan" else [0, 1, 2, 0, 1, 3, 0, 1, 4]
                    mesh.CreateFaceVertexIndicesAttr(faces)
                    mesh.CreateFaceVertexCountsAttr([3] * (len(faces) // 3))
                elif variant == "light":
                    leaves = stage.GetPrimAtPath(plant.GetPath().AppendPath("geo/render/Leaves"))
                    leaves.GetAttribute("primvars:leaf:edit:width").Set(-1)
    spec = stage.GetRootLayer().GetPrimAtPath(plant.GetPath())
    Sdf.AttributeSpec(spec, "userProperties:odd", Sdf.ValueTypeNames.Float).default = 1.0
    spec.SetInfo("prefix", "x")  # a field that NVIDIA's rule of layers takes for unsupported
    stage.GetRootLayer().Save()
    return interface


def compositions(interface: Path) -> Iterator[Usd.Stage]:
    root = Sdf.Layer.FindOrOpen(str(interface))
    for selection in SELECTIONS:
        session = Sdf.Layer.CreateAnonymous(".usda")
        for name, variant in selection.items():
            Sdf.CreatePrimInLayer(session, f"/{root.defaultPrim}").variantSelections[name] = variant
        yield Usd.Stage.Open(root, session)


def findings_of_the_engine(stage: Usd.Stage) -> set[Finding]:
    package = pytest.importorskip("usd_validation_nvidia")
    issues = package.ValidationEngine(variants=False).validate(stage).issues()
    return {nvidia_rules._with_our_rules(finding, stage) for finding in nvidia_rules._findings(issues)}


def test_rules_that_are_asked_apart_find_what_the_engine_finds_in_every_selection(asset: Path) -> None:
    known, seen = KnownFindings(), []
    for stage in compositions(asset):
        ours = set(run_usd_validators(stage, KnownFindings()))
        engine = findings_of_the_engine(stage)
        apart = set(nvidia_rules.run_nvidia_rules(stage, known))
        already = {(finding.severity, finding.message) for finding in ours}
        assert apart <= engine
        assert {(f.severity, f.message) for f in engine - apart} <= already  # by rules that ask USD's validators
        seen.append([f for f in apart if f.path.endswith("/geo/Flap") and "edges are non-manifold" in f.message])
        assert "nvidia:LayerSpecChecker" in {finding.validator for finding in apart}
    assert [len(found) for found in seen] == [0, 0, 1, 1, 0, 0]


def test_validators_of_usd_find_the_same_in_a_known_and_an_unknown_asset(asset: Path) -> None:
    known, ranges = KnownFindings(), []
    for stage in compositions(asset):
        findings = run_usd_validators(stage, known)
        assert findings == run_usd_validators(stage, KnownFindings())
        ranges.append(sum(finding.error == "EditRange" for finding in findings))
    assert ranges == [0, 1, 0, 1, 0, 1]
    assert known.of_files.keys() >= {"usdFoliageValidators:AssetPaths"}


def test_each_prim_is_asked_once_where_selections_share_it(asset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("usd_validation_nvidia")
    asked: list[str] = []
    check = nvidia_rules._check_prim
    monkeypatch.setattr(nvidia_rules, "_check_prim", lambda prim: (asked.append(str(prim.GetPath())), check(prim))[1])
    known = KnownFindings()
    for stage in compositions(asset):
        nvidia_rules.run_nvidia_rules(stage, known)
    assert len([path for path in asked if path.endswith("/geo/Flap")]) == 3  # one of each variant with opinions on it
    assert len([path for path in asked if path.endswith("/geo/proxy/Crown")]) == 1


def test_a_key_distinguishes_places_times_and_guides() -> None:
    stage = Usd.Stage.CreateInMemory()
    source = Sdf.Layer.CreateAnonymous(".usda")
    spec = Sdf.CreatePrimInLayer(source, "/Source")
    spec.specifier = Sdf.SpecifierDef
    source.defaultPrim = "Source"

    def key(path: str, offset: float = 0, purpose: str = "default") -> object:
        stage.RemovePrim("/Top")
        top = UsdGeom.Xform.Define(stage, "/Top")
        top.CreatePurposeAttr(purpose)
        prim = UsdGeom.Xform.Define(stage, path).GetPrim()
        prim.GetReferences().AddReference(source.identifier, Sdf.LayerOffset(offset))
        ((_, found),) = key_prims([prim])
        return found

    assert key("/Top/A") == key("/Top/A")
    assert len({key("/Top/A"), key("/Top/B"), key("/Top/A", 3), key("/Top/A", 0, "guide")}) == 4
