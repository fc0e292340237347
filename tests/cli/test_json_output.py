"""What commands print of what they made, as one JSON object."""

import json
import re
from pathlib import Path

import pytest
from usdfoliage.__main__ import build_parser, main
from usdfoliage.cli.json_output import format_json, format_made
from usdfoliage.jobs.report.table import Row
from usdfoliage.remarks import Setting, remark, remark_from_json

from tests.support.commands.json_output import SCHEMAS, find_fault, read_output
from tools.json_reference import PAGE, page

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
    parsed = read_output("scatter", capsys.readouterr().out)
    assert Path(parsed["asset"]).is_file()
    assert [each["code"] for each in parsed["remarks"]] == ["bezier-alone"]
    look = tmp_path / "look.usda"
    assert main(["edit", parsed["asset"], "--width", "1", "-o", str(look), "--json"]) == 0
    parsed = read_output("edit", capsys.readouterr().out)
    assert parsed["asset"] == str(look)
    assert [each["code"] for each in parsed["remarks"]] == ["edits-change-nothing"]
    assert parsed["changes"] == []
    assert main(["bake", str(look), "-o", str(tmp_path / "baked"), "--json"]) == 0
    assert Path(read_output("bake", capsys.readouterr().out)["asset"]).is_file()
    assert main(["export", parsed["asset"], "--profile", "usdz", "-o", str(tmp_path / "s.usdz"), "--json"]) == 0
    assert read_output("export", capsys.readouterr().out)["profile"] == "usdz"


def test_every_command_with_json_has_a_schema_and_the_version_first() -> None:
    (commands,) = (action.choices for action in build_parser()._actions if isinstance(action.choices, dict))
    with_json = {name for name, parser in commands.items() if re.search(r"^  --json", parser.format_help(), re.M)}
    assert set(SCHEMAS) == with_json
    assert PAGE.read_text(encoding="utf-8") == page(), "run tools/json_reference.py"
    assert next(iter(json.loads(format_json({"a": 1})))) == "schema"


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"schema": 2}, "$.schema is 2, not 1"),
        ({"asset": 1}, "$.asset is 1, not string or null"),
        ({"facts": [{"name": "leaves", "value": 3, "remark": ""}]}, "$.facts[0].value is 3, not string"),
        ({"remarks": [{}]}, "$.remarks[0] has no code"),
        ({"more": 1}, ""),
    ],
)
def test_a_schema_refuses_what_is_otherwise(change: dict[str, object], fault: str) -> None:
    good = json.loads(format_made(asset=None, report=None, facts=[], remarks=[HIGH]))
    assert find_fault(good, SCHEMAS["bake"]) == ""
    assert find_fault({**good, **change}, SCHEMAS["bake"]) == fault
