"""The pages cannot rot: their links lead somewhere, and their command lines are understood by the program."""

import argparse
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from usdfoliage.__main__ import COMMANDS, build_parser
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.capture.folder.settings import read_capture_settings
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.settings_file import read_settings_file

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pipeline" / "usdfoliage"
PAGES = (*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md")))
READMES = tuple(
    path
    for folder in ("schemas", "usd_plugins", "hydra_preview", "tools")
    for path in sorted((ROOT / folder).rglob("README.md"))
)
COMING: tuple[str, ...] = ()  # described before they exist; their lines are checked once they are there
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
_PROGRAMS = ("usdfoliage", ".venv/bin/usdfoliage")
_PATH = re.compile(r"`((?:docs|pipeline|schemas|usd_plugins|hydra_preview|tools|tests)/[\w./-]+)`")


def code_lines(text: str) -> Iterator[str]:
    """The lines of code blocks, fenced or indented, with continued lines joined and their comments gone."""
    code = ""
    fenced = False
    for line in text.splitlines():
        if line.startswith("```"):
            fenced = not fenced
            continue
        if not fenced and not line.startswith("    "):
            continue
        code += line.strip()
        if code.endswith("\\"):
            code = code[:-1]
            continue
        yield re.sub(r"(^|\s)#.*$", "", code).strip()
        code = ""


def inline_code(text: str) -> Iterator[str]:
    """Code within sentences, which may go on over a line's end."""
    blocks = re.sub(r"^(    .*|```.*?^```)$", "", text, flags=re.MULTILINE | re.DOTALL)
    yield from (" ".join(code.split()) for code in re.findall(r"`([^`]+)`", blocks))


def command_lines(text: str) -> Iterator[list[str]]:
    """What is given to usdfoliage, in code blocks and in code within sentences."""
    for line in (*code_lines(text), *inline_code(text)):
        # eval "$(usdfoliage env)", 2>&1, > file, | less, two commands on a line
        for part in re.split(r"&&|\|\||[|;)]|2?>", line.replace('eval "$(', "")):
            try:
                words = shlex.split(part)
            except ValueError:
                continue
            while words and "=" in words[0] and not words[0].startswith("-"):  # NAME=VALUE before a command
                words = words[1:]
            for number, word in enumerate(words):
                if word in _PROGRAMS:
                    if number == 0:
                        yield words[1:]
                    break


def every_command() -> list[tuple[str, str]]:
    return [
        (page.relative_to(ROOT).as_posix(), shlex.join(words))
        for page in (*PAGES, *READMES)
        for words in command_lines(page.read_text(encoding="utf-8"))
        if words and "…" not in shlex.join(words)
    ]


@pytest.fixture(scope="module")
def parser() -> argparse.ArgumentParser:
    return build_parser()


@pytest.mark.parametrize(("page", "line"), sorted(set(every_command())))
def test_a_quoted_command_is_one_of_the_program(
    page: str, line: str, parser: argparse.ArgumentParser, capsys: pytest.CaptureFixture[str]
) -> None:
    words = shlex.split(line)
    if len(words) == 1 and words[0] in (*COMMANDS, *COMING):
        return  # the name of a command in a sentence
    if words[0] in COMING and words[0] not in COMMANDS:
        pytest.skip(f"usdfoliage {words[0]} is not in this version yet")
    try:
        parser.parse_args(words)
    except SystemExit:
        pytest.fail(f"{page}: usdfoliage {line}: {capsys.readouterr().err.splitlines()[-1]}")


def test_commands_were_found() -> None:
    quoted = {line.split()[0] for _, line in every_command()}
    assert quoted >= set(COMMANDS) - {"env"}
    assert ("docs/pipeline_integration.md", "env") in every_command()  # within eval "$(…)"


@pytest.mark.parametrize("page", [*PAGES, *READMES], ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files_and_headings(page: Path) -> None:
    lost = []
    for target in _LINK.findall(page.read_text(encoding="utf-8")):
        if "://" in target or target.startswith("mailto:"):
            continue
        name, _, heading = target.partition("#")
        there = (page.parent / name).resolve() if name else page
        if not there.exists() or (heading and heading not in headings(there.read_text(encoding="utf-8"))):
            lost.append(target)
    assert not lost


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_files_of_the_repository_that_are_named_exist(page: Path) -> None:
    named = _PATH.findall(page.read_text(encoding="utf-8"))
    assert not [name for name in named if "NAME" not in name and not (ROOT / name).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_modules_of_the_package_that_are_named_exist(page: Path) -> None:
    folders = "|".join(path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name[0] != "_")
    named = re.findall(rf"`((?:{folders})/[\w/]*(?:\.\w+)?)`", page.read_text(encoding="utf-8"))
    assert page.name == "CHANGELOG.md" or not [name for name in named if not (PACKAGE / name).exists()]


def glossary_homes() -> list[tuple[str, str]]:
    """The files and the names in them that the glossary's third columns hold, as `FILE`: `NAME`."""
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    return re.findall(r"`([\w/]+\.py)`: `(\w+)`", text)


@pytest.mark.parametrize(("file", "name"), glossary_homes())
def test_the_glossary_names_what_is_there(file: str, name: str) -> None:
    text = (PACKAGE / file).read_text(encoding="utf-8")
    assert re.search(rf"^(?:class {name}\b|{name}\b.*=)", text, flags=re.MULTILINE)


def toml_blocks(page: Path) -> list[str]:
    return re.findall(r"^```toml\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("number", range(len(toml_blocks(ROOT / "docs" / "input_guide.md"))))
def test_capture_toml_of_the_guide_is_read(number: int, tmp_path: Path) -> None:
    (tmp_path / "capture.toml").write_text(toml_blocks(ROOT / "docs" / "input_guide.md")[number], encoding="utf-8")
    _, remarks = read_capture_settings(tmp_path)
    assert not remarks


@pytest.mark.parametrize(
    ("page", "number"),
    [
        (page, number)
        for page in ("quick_start.md", "methods.md")
        for number in range(len(toml_blocks(ROOT / "docs" / page)))
    ],
)
def test_plans_of_the_pages_are_read(page: str, number: int, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(toml_blocks(ROOT / "docs" / page)[number], encoding="utf-8")
    assert read_settings_file(plan, BuildSettings()) != BuildSettings()


def test_profiles_of_the_pages_are_read(tmp_path: Path) -> None:
    (block,) = toml_blocks(ROOT / "docs" / "pipeline_integration.md")
    profile = tmp_path / "studio.toml"
    profile.write_text(block, encoding="utf-8")
    assert read_profile(profile) != read_profile(default_profile())


def test_python_of_the_pages_is_python() -> None:
    blocks = [
        (page, block)
        for page in PAGES
        for block in re.findall(
            r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL
        )
    ]
    assert blocks
    for page, block in blocks:
        compile(block, page.name, "exec")


def headings(text: str) -> set[str]:
    """What a page's headings are called in links, as GitHub does it."""
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in _HEADING.findall(text)}
