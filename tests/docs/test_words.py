"""One word a thing: the words that the glossary gives up are in no page, no help, and nothing that the code states.

The glossary's last table is the one list of these words.
"""

import argparse
import functools
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest
from usdfoliage.__main__ import build_parser
from usdfoliage.jobs.work.renamed_settings import RENAMED_SETTINGS

ROOT = Path(__file__).parents[2]
GLOSSARY = ROOT / "docs" / "glossary.md"
PAGES = (
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *(
        path
        for folder in ("schemas", "usd_plugins", "hydra_preview", "tools")
        for path in sorted((ROOT / folder).rglob("*.md"))
    ),
)
PACKAGE = ROOT / "pipeline" / "usdfoliage"
NATIVE = ROOT / "pipeline" / "native"
PYTHON_FOLDERS = (
    *sorted(path for path in PACKAGE.iterdir() if path.is_dir()),
    ROOT / "usd_plugins",
    ROOT / "hydra_preview",
    ROOT / "tools",
    ROOT / "tests",
)
ABOUT_WORDS = {ROOT / "tests" / "docs" / name for name in ("test_words.py", "test_help.py")}  # they quote the words
OF_OTHERS = {  # names of libraries and of Python
    "least_squares": "scipy.optimize",
    "most_common": "collections.Counter",
    "tell": "files of Python",
}
EARLIER_NAMES = {  # settings of plans of earlier versions
    "pipeline/usdfoliage/jobs/work/renamed_settings.py": frozenset(RENAMED_SETTINGS)
}
_TEXT_TOKENS = (tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING))
_HEADING = "## Words that are not used"
_CODE = re.compile(r"^```.*?^```$|`[^`]*`|\]\([^)]*\)", re.MULTILINE | re.DOTALL)
_CPP_PART = re.compile(
    r"""(?P<text>//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*")|(?P<name>[A-Za-z_]\w*)""",
    re.DOTALL,
)


@functools.cache
def words_not_used(where: str) -> tuple[str, ...]:
    """The words that the glossary's last table gives up in texts or in names.

    Args:
        where: text or names.
    """
    _, _, table = GLOSSARY.read_text(encoding="utf-8").partition(_HEADING)
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines() if line.startswith("| ")]
    return tuple(
        word.strip() for cells in rows[2:] if where in cells[2].split(", ") for word in cells[0].split(",") if word
    )


def count_words(text: str) -> dict[str, int]:
    """How often a text has each word that texts give up; what stands in code marks is not counted."""
    pattern = re.compile(rf"\b(?:{'|'.join(words_not_used('text'))})\b", re.IGNORECASE)
    counts: dict[str, int] = {}
    for found in pattern.findall(_CODE.sub(" ", text)):
        counts[found.lower()] = counts.get(found.lower(), 0) + 1
    return counts


def commands() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    (actions,) = (action for action in build_parser()._actions if isinstance(action, argparse._SubParsersAction))
    yield from actions.choices.items()


def test_the_table_is_read():
    assert {"told", "doubt", "usual"} <= set(words_not_used("text"))
    assert {"least", "registration", "told"} <= set(words_not_used("names"))
    assert "least" not in words_not_used("text")


def test_words_are_counted():
    assert count_words("It is Told twice: told. `told` is code, [a page](told.md) a link.") == {"told": 2}


@pytest.mark.parametrize(("name", "parser"), [*commands()], ids=lambda value: value if isinstance(value, str) else "")
def test_a_help_has_none_of_them(name: str, parser: argparse.ArgumentParser):
    assert count_words(parser.format_help()) == {}, f"usdfoliage {name} --help"


@pytest.mark.parametrize(
    "page",
    PAGES,
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_a_page_has_none_of_them(page: Path):
    text, _, _ = page.read_text(encoding="utf-8").partition(_HEADING if page == GLOSSARY else "\0")
    assert count_words(text) == {}


def texts_of(path: Path) -> Iterator[tuple[int, str]]:
    """Every comment, docstring and other string of a module, with the number of its first line."""
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type in _TEXT_TOKENS:
                yield token.start[0], token.string


def modules_in(folder: Path) -> list[Path]:
    """The Python modules below a folder."""
    return [path for suffix in ("py", "pyi") for path in folder.rglob(f"*.{suffix}") if path not in ABOUT_WORDS]


def words_in_texts(path: Path, earlier_names: frozenset[str] = frozenset()) -> set[str]:
    """Where the texts of a module have a word that texts give up.

    Args:
        earlier_names: Strings that may have them.
    """
    return {
        f"{path.name}:{line}: {', '.join(words)}"
        for line, text in texts_of(path)
        if text.strip("\"'") not in earlier_names and (words := count_words(text))
    }


@pytest.mark.parametrize(
    "line",
    ["x = 1  # told", '"""What it says."""', 'x = "no doubt"', 'x = f"{x} is held"', '"""One.\n\nThey are alike.\n"""'],
)
def test_words_in_texts_of_code_are_found(line: str, tmp_path: Path):
    path = tmp_path / "module.py"
    path.write_text(f"a = 0\n{line}\n", encoding="utf-8")
    (found,) = words_in_texts(path)
    assert found.startswith("module.py:2: ")


def test_names_and_code_marks_are_no_texts_of_code(tmp_path: Path):
    path = tmp_path / "module.py"
    path.write_text('said = 0  # `told` is code\nx = "isolation.strays"\n', encoding="utf-8")
    assert words_in_texts(path, frozenset({"isolation.strays"})) == set()
    assert words_in_texts(path) == {"module.py:2: strays"}


@pytest.mark.parametrize(
    "place",
    [*PYTHON_FOLDERS, *sorted(path for path in PACKAGE.iterdir() if path.suffix in (".py", ".pyi"))],
    ids=lambda path: path.name,
)
def test_no_text_in_python_has_one_of_them(place: Path):
    found: set[str] = set()
    for module in modules_in(place) if place.is_dir() else (place,):
        found |= words_in_texts(module, EARLIER_NAMES.get(module.relative_to(ROOT).as_posix(), frozenset()))
    assert found == set()


def names_of(path: Path) -> Iterator[str]:
    """Every identifier in a module, and the words of its file's name."""
    yield path.stem
    with path.open("rb") as file:
        yield from (token.string for token in tokenize.tokenize(file.readline) if token.type == tokenize.NAME)


def words_in_name(name: str) -> set[str]:
    """The words of an identifier that names give up."""
    snake = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", name).lower().strip("_")
    given_up = words_not_used("names")
    return {word for word in given_up if f"_{word}_" in f"_{snake}_"}


def test_words_in_a_name_are_found():
    assert words_in_name("least_views") == {"least"}
    assert words_in_name("_MOST_SURE") == {"most"}
    assert words_in_name("UsualLeaf") == {"usual"}
    assert words_in_name("unusual") == words_in_name("always") == set()


@pytest.mark.parametrize("folder", PYTHON_FOLDERS, ids=lambda path: path.name)
def test_no_name_in_python_has_one_of_them(folder: Path):
    found = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in modules_in(folder)
        for name in set(names_of(path)) - set(OF_OTHERS)
        if words_in_name(name)
    }
    assert found == set()


def unfit_parts(source: str) -> set[str]:
    """The identifiers, comments and strings of a C++ source that have a word which is given up."""
    parts = {(found["name"], found["text"]) for found in _CPP_PART.finditer(source)}
    return {name or text for name, text in parts if (words_in_name(name) if name else count_words(text))}


def test_words_in_cpp_are_found():
    source = """
        // At most so many are told.
        int kMostSteps = 3, at_most /* usual */ = 4;  // at least one
        f("least", "is held\\"");
    """
    assert unfit_parts(source) == {
        "// At most so many are told.",
        "kMostSteps",
        "at_most",
        "/* usual */",
        '"is held\\""',
    }


@pytest.mark.parametrize("folder", sorted({path.parent for path in NATIVE.rglob("*.h")}), ids=lambda path: path.name)
def test_no_part_of_the_native_code_has_one_of_them(folder: Path):
    found = {
        f"{path.relative_to(ROOT)}: {part}"
        for path in (*folder.glob("*.h"), *folder.glob("*.cpp"))
        for part in unfit_parts(f"{path.stem} {path.read_text(encoding='utf-8')}")
    }
    assert found == set()
