"""What the pages name is there: options and settings."""

import argparse
import dataclasses
import re
from pathlib import Path

import pytest
from usdfoliage.__main__ import build_parser
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.renamed_settings import RENAMED_SETTINGS

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pipeline" / "usdfoliage"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
OF_OTHERS = {
    "--install",
    "--manylinux",
    "--no-isolation",
    "--leaves",
    "--views",
    "--size",
    "--framed",
    "--up",
    "--scales",
    "--scaling",
}  # rez, tools/
TABLES = tuple(field.name for field in dataclasses.fields(BuildSettings))


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def known_options() -> set[str]:
    (commands,) = (action for action in build_parser()._actions if isinstance(action, argparse._SubParsersAction))
    return {
        option
        for command in commands.choices.values()
        for action in command._actions
        for option in action.option_strings
    }


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_options_exist(page: Path) -> None:
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", text_of(page)))
    assert named <= known_options() | OF_OTHERS


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_settings_exist(page: Path) -> None:
    pattern = rf"`((?:{'|'.join(TABLES)})(?:\.(?!toml|py)[a-z_]+)+)(?: = [^`]*)?`"
    for name in set(re.findall(pattern, text_of(page))) - set(RENAMED_SETTINGS):  # their page names the old ones too
        value: object = BuildSettings()
        for part in name.split("."):
            assert hasattr(value, part), f"there is no setting {name}"
            value = getattr(value, part)
