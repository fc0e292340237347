"""Folders that a reader can take in, tests where their subject is, and nothing that is found by accident."""

import ast
import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from _pytest.config import Config

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pipeline" / "usdfoliage"
MAX_FILES = 32  # in a folder
# Tests of what is no folder of the package.
OTHER_TESTS = {
    "bench": "tools/bench",
    "docs": "docs",
    "house": ".",
    "hydra_preview": "hydra_preview",
    "native": "pipeline/native",
    "schemas": "schemas",
    "tools": "tools",
    "usd_plugins": "usd_plugins",
}
NO_TESTS = {"golden", "support"}  # data and helpers
STAND_IN = Path("tests/usd_plugins/usdview")  # for usdview's own modules, found by their names


def tracked() -> list[Path]:
    """The files of the repository, by their paths in it; those that are new and not ignored too."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT, capture_output=True, check=False,
    )  # fmt: skip
    if listed.returncode:
        pytest.skip("this tree is no repository of git")
    paths = {Path(name) for name in listed.stdout.decode().split("\0") if name}
    return sorted(path for path in paths if (ROOT / path).is_file())


def test_no_folder_holds_more_files_than_one_takes_in() -> None:
    counts = Counter(path.parent for path in tracked())
    assert {str(folder): count for folder, count in counts.items() if count > MAX_FILES} == {}


def test_no_test_and_no_tool_touches_where_modules_are_looked_for() -> None:
    touching = [
        str(path)
        for path in tracked()
        if path.suffix == ".py" and path.parts[0] in ("tests", "tools")
        for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr == "path" and getattr(node.value, "id", "") == "sys"
    ]
    assert touching == []


def test_tests_lie_where_their_subject_does() -> None:
    folders = {
        path.relative_to("tests").parent for path in tracked() if re.fullmatch(r"tests/.*/test_\w+\.py", str(path))
    }
    for folder in sorted(folders):
        top = folder.parts[0]
        subject = ROOT / OTHER_TESTS[top] / folder.relative_to(top) if top in OTHER_TESTS else PACKAGE / folder
        assert subject.is_dir(), f"there is no {subject.relative_to(ROOT)} for tests/{folder}"
    assert {folder.parts[0] for folder in folders}.isdisjoint(NO_TESTS)
    assert all((ROOT / subject).is_dir() for subject in OTHER_TESTS.values())


def test_helpers_of_tests_lie_together() -> None:
    beside = [
        str(path)
        for path in tracked()
        if path.parts[0] == "tests" and path.suffix == ".py"
        if path.parts[1] not in NO_TESTS and not path.is_relative_to(STAND_IN)
        if not path.name.startswith("test_") and path.name != "conftest.py"
    ]
    assert beside == []


def test_pytest_leaves_no_folder_out_by_its_name(pytestconfig: Config) -> None:
    """A folder of one of these names would be passed over in silence."""
    left_out = [name for name in pytestconfig.getini("norecursedirs") if not name.startswith(".")]
    assert "build" in left_out
    folders = {part for path in tracked() for part in path.parent.parts}
    assert [folder for folder in folders for name in left_out if Path(folder).match(name)] == []


@pytest.mark.parametrize(
    ("words", "home"),
    [
        (r"\bhashlib\b", "files/hashing.py"),
        (r"\bflock\(", "files/locks.py"),
        (r"\bos\.fsync\b", "files/atomic.py"),
        (r"\btomllib\.loads?\b", "files/toml.py"),
        (r"\btestzip\b", "files/npz.py"),
        (r"Callable\[\[(int, int|str, float)\], None\]", "progress.py"),
    ],
)
def test_what_all_share_is_written_once(words: str, home: str) -> None:
    found = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if re.search(words, path.read_text(encoding="utf-8"))
    }
    assert found == {home}
