"""What validate_asset runs, how it marks what it finds, and what it refuses."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.locate import find_interface
from usdfoliage.asset.validation import validate as validation
from usdfoliage.asset.validation.findings import Acceptance, Finding
from usdfoliage.asset.validation.studio_profile import StudioProfile, default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.errors import AssetError

from tests.support import plant_stages as stages


@pytest.fixture
def asset(tmp_path: Path) -> Path:
    return stages.write_asset(tmp_path / "an oak").parent


def named(findings: tuple[Finding, ...], name: str) -> Finding:
    (found,) = [finding for finding in findings if finding.error == name]
    return found


def edit(asset: Path, change: Callable[[Usd.Prim], object]) -> None:
    stage = Usd.Stage.Open(str(find_interface(asset)))
    change(stage.GetDefaultPrim())
    stage.GetRootLayer().Save()


def test_good_asset_by_folder_and_by_layer(asset: Path) -> None:
    for name in (asset, asset / "oak.usda"):
        report = validate_asset(name)
        assert report.asset == asset / "oak.usda"
        assert report.open_errors == 0, report.findings
        assert not [finding for finding in report.findings if finding.validator.startswith("usdFoliage")]
        assert report.selections == ("as authored",)


def test_validators_of_usd_and_of_nvidia_run(asset: Path) -> None:
    pytest.importorskip("usd_validation_nvidia")

    def break_it(plant: Usd.Prim) -> None:
        stage = plant.GetStage()
        UsdGeom.Mesh.Define(stage, "/oak/Mesh")
        UsdGeom.Mesh.Define(stage, "/oak/Mesh/Inner")  # a gprim below a gprim
        Usd.ModelAPI(stage.DefinePrim("/oak/Group", "Xform")).SetKind("group")  # inside a component

    edit(asset, break_it)
    report = validate_asset(asset)
    assert report.nvidia
    assert {finding.path for finding in report.findings if finding.validator.startswith("usdGeomValidators:Encaps")}
    assert "/oak/Group" in {f.path for f in report.findings if f.validator == "nvidia:KindChecker"}
    assert report.open_errors


def test_a_finding_of_two_validators_is_reported_once(asset: Path) -> None:
    edit(asset, lambda plant: plant.GetReferences().AddReference("./missing.usda"))
    report = validate_asset(asset)
    messages = [finding.message for finding in report.findings]
    assert len([message for message in messages if "unresolvable external dependency" in message]) == 1


def test_finding_of_one_variant_selection_names_it(asset: Path) -> None:
    def add_variants(plant: Usd.Prim) -> None:
        lod = plant.GetVariantSets().AddVariantSet("lod")
        for variant in ("both", "crown"):
            lod.AddVariant(variant)
            lod.SetVariantSelection(variant)
            if variant == "crown":
                with lod.GetVariantEditContext():
                    plant.GetStage().OverridePrim("/oak/geo/render").SetActive(False)
        lod.SetVariantSelection("both")

    edit(asset, add_variants)
    report = validate_asset(asset)
    assert report.selections == ("lod=both", "lod=crown")
    finding = named(report.findings, "PurposeAlone")
    assert (finding.where, finding.path) == ("lod=crown", "/oak/geo/proxy.purpose")


def test_finding_of_every_selection_names_none(asset: Path) -> None:
    def add_variants(plant: Usd.Prim) -> None:
        for name in ("lod", "season"):
            chosen = plant.GetVariantSets().AddVariantSet(name)
            for variant in ("two", "one"):
                chosen.AddVariant(variant)
                chosen.SetVariantSelection(variant)
                with chosen.GetVariantEditContext():
                    plant.CreateAttribute(f"userProperties:{name}", Sdf.ValueTypeNames.String).Set(variant)
        plant.GetAttribute("foliage:generator").Set("")

    edit(asset, add_variants)
    report = validate_asset(asset)
    assert report.selections == ("lod=one season=one", "lod=one season=two", "lod=two season=one", "lod=two season=two")
    assert named(report.findings, "GeneratorMissing").where == ""


def test_many_variants_are_tried_one_by_one(asset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def add_variants(plant: Usd.Prim) -> None:
        for name in ("lod", "season"):
            for variant in ("one", "two"):
                plant.GetVariantSets().AddVariantSet(name).AddVariant(variant)
            plant.GetVariantSets().SetSelection(name, "one")

    edit(asset, add_variants)
    monkeypatch.setattr(validation, "MAX_SELECTIONS", 3)
    report = validate_asset(asset)
    assert report.selections == ("as authored", "lod=one", "lod=two", "season=one", "season=two")


def test_a_finding_of_the_unloaded_asset_is_labelled(asset: Path) -> None:
    """A prim whose type comes with the payload."""
    payload = Usd.Stage.Open(str(asset / "payload" / "payload.usda"))
    UsdGeom.Scope.Define(payload, "/oak/extra")
    payload.GetRootLayer().Save()

    def add_purpose(plant: Usd.Prim) -> None:
        spec = Sdf.CreatePrimInLayer(plant.GetStage().GetRootLayer(), "/oak/extra")
        spec.specifier = Sdf.SpecifierDef
        attribute = Sdf.AttributeSpec(spec, "purpose", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform)
        attribute.default = "guide"

    edit(asset, add_purpose)
    finding = named(validate_asset(asset).findings, "PurposeNotOnScope")
    assert (finding.where, finding.path) == ("unloaded", "/oak/extra.purpose")


def test_shaders_that_this_usd_cannot_judge_are_warnings(asset: Path) -> None:
    def add_shaders(plant: Usd.Prim) -> None:
        stage = plant.GetStage()
        stage.DefinePrim("/oak/mtl", "Scope")
        stage.DefinePrim("/oak/mtl/Leaf", "Material")
        for name, identifier in (("Mtlx", "ND_image_color3"), ("Wrong", "NoSuchShader")):
            shader = stage.DefinePrim(f"/oak/mtl/Leaf/{name}", "Shader")
            shader.CreateAttribute("info:id", Sdf.ValueTypeNames.Token, False, Sdf.VariabilityUniform).Set(identifier)

    edit(asset, add_shaders)
    report = validate_asset(asset, read_profile(default_profile()))
    found = {f.path: f for f in report.findings if f.error == "MissingShaderIdInRegistry"}
    assert found["/oak/mtl/Leaf/Wrong.info:id"].severity == "error"
    material_x = found["/oak/mtl/Leaf/Mtlx.info:id"]
    assert (material_x.severity, bool(material_x.accepted)) == ("warning", True)
    assert "usdMtlx" in material_x.message


def test_profile_accepts_warnings_and_never_errors(asset: Path) -> None:
    def break_it(plant: Usd.Prim) -> None:
        stage = plant.GetStage()
        crown = stage.OverridePrim("/oak/geo/proxy/Crown")
        crown.GetAttribute("foliage:crown:colorMap").Set(Sdf.AssetPath("maps/color.exr"))
        plant.GetAttribute("foliage:generator").Set("")

    edit(asset, break_it)
    profile = (
        Acceptance(validator="usdFoliageValidators:AssetPaths", error="PathSearched", path="/o*", reason="ours"),
        Acceptance(validator="usdFoliageValidators:Plant", reason="never"),
    )
    report = validate_asset(asset, StudioProfile(accepted=profile))
    assert named(report.findings, "PathSearched").accepted == "ours"
    assert named(report.findings, "GeneratorMissing").accepted == ""
    assert report.open_errors == 1
    assert report.findings[0].severity == "error"
    assert report.findings[-1].accepted

    elsewhere = Acceptance(validator="usdFoliageValidators:AssetPaths", error="PathSearched", path="/elm", reason="no")
    assert named(validate_asset(asset, StudioProfile(accepted=(elsewhere,))).findings, "PathSearched").accepted == ""


def test_shipped_profile_gives_a_reason_for_each_entry() -> None:
    accepted = read_profile(default_profile()).accepted
    assert accepted
    assert all(len(entry.reason) > 20 for entry in accepted)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("accepted = [", "cannot be read"),
        ("[other]", "other is not known"),
        ("[[accepted]]\nvalidator = 'x'", "reason must be given"),
        ("[[accepted]]\nvalidator = 'x'\nreason = ' '", "reason must be given"),
        ("[[accepted]]\nvalidator = 'x'\nreason = 'y'\nseverity = 'error'", "are known"),
        ("[[accepted]]\nvalidator = 1\nreason = 'y'", "are known"),
        ("accepted = 1", "must be"),
    ],
)
def test_wrong_profile(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "profile.toml"
    path.write_text(text)
    with pytest.raises(AssetError, match=complaint) as caught:
        read_profile(path)
    assert str(path) in str(caught.value)


def test_profile_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="cannot be read"):
        read_profile(tmp_path / "none.toml")


def test_missing_payload_is_an_error(asset: Path) -> None:
    (asset / "payload" / "payload.usda").unlink()
    report = validate_asset(asset)
    finding = named(report.findings, "CompositionError")
    assert (finding.severity, finding.path) == ("error", "/oak")
    assert "payload.usda" in finding.message


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_damaged_payload_is_an_error_and_no_traceback(asset: Path, suffix: str) -> None:
    payload = asset / "payload" / f"payload{suffix}"
    if suffix == ".usdc":
        Sdf.Layer.FindOrOpen(str(asset / "payload" / "payload.usda")).Export(str(payload))
        edit(asset, lambda plant: plant.GetPayloads().SetPayloads([Sdf.Payload("./payload/payload.usdc")]))
    damaged = payload.read_bytes()[: payload.stat().st_size // 2]
    copy = shutil.copytree(asset, asset.with_name("damaged"))  # USD keeps the layers that it has read
    (copy / "payload" / payload.name).write_bytes(damaged)
    report = validate_asset(copy)
    (finding,) = report.findings
    assert (finding.severity, finding.error, finding.path) == ("error", "LayerUnreadable", f"payload/payload{suffix}")
    assert "write the asset again" in finding.message


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "cannot be read as USD"),
        (b"#usda 1.0\ndef Xform ", "cannot be read as USD"),
        (b"PXR-USDC" + bytes(20), "cannot be read as USD"),
        (b'\xff\xfe\x00 no "text"', "byte 0 is no UTF-8"),
        (b'#usda 1.0\ndef Xform "o\xe9k" {\n}\n', "byte 22 is no UTF-8"),
        (b'#usda 1.0\ndef Xform "oak" {\n}\n', "holds no plant: no active prim of it has FoliagePlantAPI"),
    ],
)
def test_interface_that_is_none(tmp_path: Path, content: bytes, complaint: str) -> None:
    path = tmp_path / "oak" / "oak.usda"
    path.parent.mkdir()
    path.write_bytes(content)
    with pytest.raises(AssetError, match=complaint) as caught:
        validate_asset(path.parent)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_payload_that_is_no_text(asset: Path) -> None:
    payload = asset / "payload" / "payload.usda"
    copy = shutil.copytree(asset, asset.with_name("damaged"))
    damaged = payload.read_bytes().replace(b"Skeleton", b"Skel\xe9ton")
    (copy / "payload" / "payload.usda").write_bytes(damaged)
    assert "no UTF-8" in named(validate_asset(copy).findings, "LayerUnreadable").message


def test_truncated_crate_as_interface(asset: Path, tmp_path: Path) -> None:
    folder = tmp_path / "crate"
    folder.mkdir()
    Sdf.Layer.FindOrOpen(str(asset / "oak.usda")).Export(str(tmp_path / "whole.usdc"))
    (folder / "oak.usdc").write_bytes((tmp_path / "whole.usdc").read_bytes()[:-40])
    with pytest.raises(AssetError, match="cannot be read as USD"):
        validate_asset(folder)


def test_folders_that_are_no_asset(asset: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(AssetError, match="no USD file at its top"):
        find_interface(tmp_path / "empty")
    shutil.copy(asset / "oak.usda", asset / "second.usda")
    with pytest.raises(AssetError, match=r"2 USD files at its top \(oak.usda, second.usda\)"):
        find_interface(asset)
    with pytest.raises(AssetError, match="does not exist"):
        find_interface(tmp_path / "nothing")
    with pytest.raises(AssetError, match="is no USD file"):
        find_interface(Path(__file__))


def write_scene(asset: Path, name: str, edit: float | None = None, **metadata: object) -> Path:
    """Two placements deep in a scene, the second an instance; edit is the width of the first."""
    stage = Usd.Stage.CreateNew(str(asset.parent / f"{name}.usda"))
    UsdGeom.SetStageUpAxis(stage, str(metadata.get("upAxis", "Y")))
    UsdGeom.SetStageMetersPerUnit(stage, float(str(metadata.get("metersPerUnit", 1))))
    for placement in ("first", "second"):
        prim = UsdGeom.Xform.Define(stage, f"/World/plants/{placement}").GetPrim()
        prim.GetReferences().AddReference(str(asset / "oak.usda"))
        prim.SetInstanceable(placement == "second")
    if edit is not None:
        leaves = stage.GetPrimAtPath("/World/plants/first/geo/render/Leaves")
        leaves.GetAttribute("primvars:leaf:edit:width").Set(edit)
    stage.GetRootLayer().Save()
    return asset.parent / f"{name}.usda"


def test_bad_edit_in_a_scene(asset: Path) -> None:
    report = validate_asset(write_scene(asset, "shot", edit=-1))
    assert report.is_scene
    assert not report.nvidia
    (finding,) = [finding for finding in report.findings if finding.severity == "error"]
    assert (finding.error, finding.where) == ("EditRange", "")
    assert finding.path == "/World/plants/first/geo/render/Leaves.primvars:leaf:edit:width"


def test_clean_scene_in_centimetres_with_z_up(asset: Path) -> None:
    report = validate_asset(write_scene(asset, "shot", upAxis="Z", metersPerUnit=0.01))
    assert not [finding for finding in report.findings if finding.severity == "error"]
    assert not [finding for finding in report.findings if finding.validator.startswith("usdFoliage")]
    assert report.selections == ("as authored",)


def test_a_look_of_a_scene_is_found_once_in_equal_instances(asset: Path) -> None:
    """An edit that turns leaves inside out, of a class that two instances inherit."""
    scene = write_scene(asset, "shot")
    shot = Usd.Stage.CreateNew(str(asset.parent / "lit.usda"))
    shot.GetRootLayer().subLayerPaths.append(scene.name)
    UsdGeom.SetStageUpAxis(shot, "Y")
    UsdGeom.SetStageMetersPerUnit(shot, 1)
    shot.CreateClassPrim("/look")
    edit_of_look = shot.OverridePrim("/look/geo/render/Leaves")
    kind = Sdf.ValueTypeNames.Float3
    UsdGeom.PrimvarsAPI(edit_of_look).CreatePrimvar("leaf:edit:silhouette2", kind, "constant").Set((0, -1, 0))
    third = UsdGeom.Xform.Define(shot, "/World/plants/third").GetPrim()
    third.GetReferences().AddReference(str(asset / "oak.usda"))
    for prim in (shot.GetPrimAtPath("/World/plants/second"), third):
        prim.SetInstanceable(True)
        prim.GetInherits().AddInherit("/look")
    shot.GetRootLayer().Save()
    finding = named(validate_asset(asset.parent / "lit.usda").findings, "EditedSilhouetteWidth")
    assert finding.path == "/World/plants/second/geo/render/Leaves.primvars:leaf:edit:silhouette2"


def test_a_scene_without_its_asset_reports_the_missing_file(asset: Path) -> None:
    scene = write_scene(asset, "shot")
    shutil.move(asset, asset.with_name("elsewhere"))
    findings = validate_asset(shutil.copy(scene, scene.with_name("copy.usda"))).findings
    assert [finding for finding in findings if finding.error == "CompositionError" and "oak.usda" in finding.message]


def test_parts_of_a_plant_within_an_instance_may_be_in_another_variant(asset: Path) -> None:
    def add_variants(plant: Usd.Prim) -> None:
        lod = plant.GetVariantSets().AddVariantSet("lod")
        for variant in ("both", "crown"):
            lod.AddVariant(variant)
            lod.SetVariantSelection(variant)
            with lod.GetVariantEditContext():
                plant.GetStage().OverridePrim("/oak/geo/render").SetActive(variant == "both")
        lod.SetVariantSelection("both")

    edit(asset, add_variants)
    stage = Usd.Stage.Open(str(write_scene(asset, "shot")))
    stage.GetPrimAtPath("/World/plants/second").GetVariantSets().SetSelection("lod", "crown")
    stage.GetPrimAtPath("/World/plants").SetInstanceable(True)
    outer = UsdGeom.Xform.Define(stage, "/Outer").GetPrim()
    outer.GetReferences().AddInternalReference("/World/plants")
    outer.SetInstanceable(True)
    stage.GetRootLayer().Save()
    findings = validate_asset(asset.parent / "shot.usda").findings
    assert not [finding for finding in findings if finding.validator == "usdFoliageValidators:Plant"]


def test_selections_that_are_the_same_asset_are_looked_at_once(asset: Path) -> None:
    def add_variants(plant: Usd.Prim) -> None:
        chosen = plant.GetVariantSets().AddVariantSet("season")
        for variant in ("spring", "summer"):
            chosen.AddVariant(variant)
        chosen.SetVariantSelection("summer")

    edit(asset, add_variants)
    assert validate_asset(asset).selections == ("season=spring",)
