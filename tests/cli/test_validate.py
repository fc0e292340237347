"""The command `usdfoliage validate`: its lines, its JSON, its exit codes."""

from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.__main__ import main

from tests.support import plant_stages as stages
from tests.support.commands.json_output import read_output


@pytest.fixture
def asset(tmp_path: Path) -> Path:
    return stages.write_asset(tmp_path / "an oak")


def break_asset(asset: Path) -> None:
    stage = Usd.Stage.Open(str(asset))
    stage.GetDefaultPrim().GetAttribute("foliage:generator").Set("")
    crown = stage.OverridePrim("/oak/geo/proxy/Crown")
    crown.GetAttribute("foliage:crown:colorMap").Set(Sdf.AssetPath("maps/color.exr"))
    stage.GetRootLayer().Save()


def test_good_asset(asset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(asset.parent)]) == 0
    captured = capsys.readouterr()
    assert f"{asset}: 0 errors, " in captured.out
    assert captured.err == ""


def test_findings_are_lines_and_the_exit_code_is_3(asset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    break_asset(asset)
    assert main(["validate", str(asset)]) == 3
    lines = capsys.readouterr().out.splitlines()
    wanted = "error: usdFoliageValidators:Plant.GeneratorMissing /oak.foliage:generator: is empty; author the tool"
    assert [line for line in lines if line.startswith(wanted)]
    assert [line for line in lines if line.startswith("warning: usdFoliageValidators:AssetPaths.PathSearched /oak: ")]
    assert lines[-1].startswith(f"{asset}: 1 error, ")


def test_scene(asset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shot = Usd.Stage.CreateNew(str(asset.parent.parent / "shot.usda"))
    UsdGeom.SetStageUpAxis(shot, "Y")
    UsdGeom.SetStageMetersPerUnit(shot, 1)
    UsdGeom.Xform.Define(shot, "/World/oak").GetPrim().GetReferences().AddReference(str(asset))
    shot.GetRootLayer().Save()
    assert main(["validate", str(asset.parent.parent / "shot.usda")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2].startswith("note: this is a scene; ")
    assert ": 0 errors, " in lines[-1]
    assert lines[-1].endswith(", as selected")


def test_json(asset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    break_asset(asset)
    assert main(["validate", str(asset), "--json"]) == 3
    report = read_output("validate", capsys.readouterr().out)
    assert report["errors"] == 1
    assert report["asset"] == str(asset)
    (finding,) = [each for each in report["findings"] if each["severity"] == "error"]
    assert (finding["error"], finding["path"]) == ("GeneratorMissing", "/oak.foliage:generator")


def test_profile_of_a_studio(asset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    break_asset(asset)
    profile = tmp_path / "studio.toml"
    profile.write_text(
        "[[accepted]]\nvalidator = 'usdFoliageValidators:AssetPaths'\nreason = 'our resolver'\n"
        "[[accepted]]\nvalidator = 'usdFoliageValidators:Plant'\nreason = 'errors stay errors'\n"
    )
    assert main(["validate", str(asset), "--profile", str(profile)]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert not [line for line in lines if line.startswith("accepted: ")]
    assert " 1 accepted (-v shows them), " in lines[-1]
    assert main(["validate", str(asset), "--profile", str(profile), "-v"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert " 1 accepted, " in lines[-1]
    assert [line for line in lines if line.startswith("accepted: ") and line.endswith("(accepted: our resolver)")]
    assert not [line for line in lines if "errors stay errors" in line]


@pytest.mark.parametrize("what", ["nothing", "empty", "two", "text", "profile", "scene"])
def test_what_is_no_asset_gives_one_line_and_exit_2(
    asset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "text").mkdir()
    (tmp_path / "text" / "a.usda").write_text("no USD")
    (tmp_path / "scene.usda").write_text('#usda 1.0\ndef Xform "World" {}\n')
    arguments = {
        "nothing": [str(tmp_path / "nothing")],
        "empty": [str(tmp_path / "empty")],
        "two": [str(asset.parent)],
        "text": [str(tmp_path / "text")],
        "scene": [str(tmp_path / "scene.usda")],
        "profile": [str(asset), "--profile", str(tmp_path / "none.toml")],
    }[what]
    if what == "two":
        (asset.parent / "b.usd").write_bytes(asset.read_bytes())
    assert main(["validate", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert line.startswith("error: ")
    assert "; " in line or "cannot be read" in line
