"""What commands print of what they made, as one JSON object."""

import json
from pathlib import Path

import pytest
from usdfoliage.__main__ import main
from usdfoliage.cli.json_output import format_made
from usdfoliage.jobs.report.table import Row
from usdfoliage.remarks import Setting, remark, remark_from_json

HIGH = remark(
    "plant-height-improbable", "it is high", remedy=("give ", Setting(name="capture.toml:metres_per_unit", value="1"))
)


def test_facts_and_remarks_can_be_read_back() -> None:
    text = format_made(asset=Path("a.usda"), report=None, facts=[Row(name="leaves", value="3")], remarks=[HIGH], more=1)
    parsed = json.loads(text)
    assert parsed["asset"] == "a.usda"
    assert parsed["report"] is None
    assert parsed["facts"] == [{"name": "leaves", "value": "3", "remark": ""}]
    assert [remark_from_json(each) for each in parsed["remarks"]] == [HIGH]
    assert parsed["more"] == 1


def test_a_spray_and_its_look_are_printed_as_json_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["scatter", "-n", "2001", "-o", str(tmp_path / "spray"), "--json"]
    assert main(words) == 0
    parsed = json.loads(capsys.readouterr().out)
    assert Path(parsed["asset"]).is_file()
    assert [each["code"] for each in parsed["remarks"]] == ["bezier-alone"]
    look = tmp_path / "look.usda"
    assert main(["edit", parsed["asset"], "--width", "1", "-o", str(look), "--json"]) == 0
    parsed = json.loads(capsys.readouterr().out)
    assert parsed["asset"] == str(look)
    assert [each["code"] for each in parsed["remarks"]] == ["edits-change-nothing"]
    assert parsed["changes"] == []
