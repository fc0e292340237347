"""What the pages name is there: options, settings, exit codes, and the warnings that the guide explains."""

import argparse
import ast
import dataclasses
import functools
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from usdfoliage.__main__ import build_parser
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.renamed_settings import RENAMED_SETTINGS

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pipeline" / "usdfoliage"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
OF_OTHERS = {"--install", "--leaves", "--views", "--size", "--framed", "--up", "--scales", "--scaling"}  # rez, tools/
TABLES = tuple(field.name for field in dataclasses.fields(BuildSettings))
LETTERS = r"(?<![\w.])[NMKXYAB](?![\w.])"  # what stands for a number or a name in a warning


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
        held: object = BuildSettings()
        for part in name.split("."):
            assert hasattr(held, part), f"there is no setting {name}"
            held = getattr(held, part)


@functools.cache
def said() -> str:
    """Every text in the package's code, one a line; NUL where a value stands."""
    texts = []
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = (each.value if isinstance(each, ast.Constant) else "\0" for each in node.values)
                texts.append("".join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
    return "\n".join(texts)


def warnings_of_the_guide() -> Iterator[str]:
    text = text_of(ROOT / "docs" / "input_guide.md")
    for line in text[text.index("## What the warnings mean") :].splitlines():
        if line.startswith("| ") and not line.startswith(("| it says", "| ---")):
            yield line.split("|")[1].strip()


@pytest.mark.parametrize("warning", list(warnings_of_the_guide()))
def test_the_warnings_that_are_explained_are_those_of_the_code(warning: str) -> None:
    for way in re.split(r" / |; ", re.sub(r" \([^)]*\)", "", warning)):
        pieces = [piece.strip(" .,:…") for piece in re.split(rf"{LETTERS}|…|%|°", way)]
        for piece in pieces:
            assert len(piece) < 4 or piece in said(), f"{piece!r} is said nowhere in the code any more"
