"""Remarks are values: written, read back, rendered by whoever shows them; every code is used and every use listed."""

import ast
import json
import re
from pathlib import Path

import pytest
import usdfoliage
from usdfoliage.capture.folder.settings import CaptureSettings
from usdfoliage.cli.remarks import COMMANDS, OF_A_RUN
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.settings_file import list_settings, read_settings_file
from usdfoliage.remark_codes import REMARK_KINDS, SECTIONS, SEVERITIES
from usdfoliage.remarks import (
    Setting,
    as_plan_setting,
    merge_remarks,
    remark,
    remark_from_json,
    rename_in,
    warnings_of,
)

PACKAGE = Path(usdfoliage.__file__).parent
HIGH = remark(
    "plant-height-improbable",
    "the plant is 900 m high",
    subject="oak.ply",
    remedy=("give ", Setting(name="branches.cloud.unit", value='"mm"')),
)


def test_a_remark_survives_json() -> None:
    assert remark_from_json(json.loads(json.dumps(HIGH.as_json()))) == HIGH


def test_a_front_end_writes_settings_in_its_own_form() -> None:
    assert HIGH.sentence(as_plan_setting) == 'the plant is 900 m high: give branches.cloud.unit = "mm"'
    assert HIGH.sentence(lambda setting: f"--unit {setting.value}") == 'the plant is 900 m high: give --unit "mm"'


def test_a_remark_without_a_remedy_is_its_text() -> None:
    assert remark("plant-height-improbable", "it is high").sentence(as_plan_setting) == "it is high"


def test_a_remark_is_listed_once() -> None:
    other = remark("plant-height-improbable", "another")
    assert merge_remarks([HIGH, other], [HIGH]) == (HIGH, other)
    assert warnings_of([HIGH]) == (HIGH,)


def test_files_are_renamed_everywhere_in_it() -> None:
    assert rename_in(HIGH, lambda text: text.replace("oak", "elm")).subject == "elm.ply"


def test_an_unknown_code_is_refused() -> None:
    with pytest.raises(KeyError):
        remark("no-such-code", "text")


@pytest.mark.parametrize("code", ["plant-at-border", "mask-ignored", "up-uncertain", "leaves-guessed"])
def test_what_puts_the_result_in_question_is_a_warning(code: str) -> None:
    assert remark(code, "text").severity == "warning"


def test_a_code_is_listed_in_one_section() -> None:
    assert sum(len(section.kinds) for section in SECTIONS) == len(REMARK_KINDS)
    assert {kind.severity for kind in REMARK_KINDS.values()} <= set(SEVERITIES)


def codes_in_use() -> set[str]:
    """The first arguments of all calls of remark() in the package."""
    codes: set[str] = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "remark":
                code = node.args[0]
                assert isinstance(code, ast.Constant), f"{path}:{node.lineno}: a code is a text, not computed"
                codes.add(code.value)
    return codes


def settings_in_use(kind: str) -> list[tuple[str, str]]:
    """Names and constant values, empty for others, of all calls of Setting() or Argument() in the package."""
    settings = []
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == kind:
                given = {each.arg: each.value for each in node.keywords}
                name, value = given.get("name"), given.get("value")
                if isinstance(name, ast.Constant):
                    settings.append((str(name.value), str(value.value) if isinstance(value, ast.Constant) else ""))
    assert settings
    return sorted(set(settings))


@pytest.mark.parametrize("name", sorted({name for name, _ in settings_in_use("Argument")}))
def test_every_argument_of_a_remedy_is_an_option_of_a_command(name: str) -> None:
    assert name in {*OF_A_RUN, *(key for command in COMMANDS.values() for key in command.arguments)}


@pytest.mark.parametrize(("name", "value"), settings_in_use("Setting"))
def test_every_setting_of_a_remedy_can_be_set(name: str, value: str, tmp_path: Path) -> None:
    of_file = {f"capture.toml:{field}" for field in CaptureSettings.__annotations__}
    of_plan = list_settings(BuildSettings())
    assert name in {*of_plan, *of_file}
    if value and name in of_plan:
        table, _, key = name.partition(".")
        (tmp_path / "plan.toml").write_text(f"[{table}]\n{key} = {value}\n")
        read_settings_file(tmp_path / "plan.toml", BuildSettings())


ABOVE = ("__main__.py", "cli/")  # the command line itself, whose texts name its options
WRITES_OPTIONS = {"jobs/plant/openjd_template.py": "the template of a farm's job holds command lines"}


def options_in_texts(path: Path) -> list[str]:
    """Texts of a module that name an option, without its docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    return [
        f"{path.relative_to(PACKAGE).as_posix()}:{node.lineno}: {node.value}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings
        if re.search(r"--[a-z]", node.value)
    ]


def test_no_text_below_the_command_line_names_an_option() -> None:
    texts_of = {path.relative_to(PACKAGE).as_posix(): options_in_texts(path) for path in PACKAGE.rglob("*.py")}
    found = {name: texts for name, texts in texts_of.items() if texts}
    assert found.keys() >= WRITES_OPTIONS.keys()
    assert not [
        text
        for name, texts in found.items()
        if not name.startswith(ABOVE) and name not in WRITES_OPTIONS
        for text in texts
    ]


def test_every_code_is_used_and_every_use_is_listed() -> None:
    assert codes_in_use() == set(REMARK_KINDS)
