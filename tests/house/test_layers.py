"""The contracts of the layers hold, and a wrong import breaks them."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pipeline" / "usdfoliage"


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package's modules, to be spoilt."""
    root = tmp_path_factory.mktemp("tree")
    shutil.copytree(PACKAGE, root / "usdfoliage", ignore=lambda _, names: {n for n in names if n == "__pycache__"})
    return root


def check_layers(root: Path) -> "subprocess.CompletedProcess[str]":
    """What import-linter finds in the package in a folder.

    It runs without .pth files, which would show it the package that is installed; its own are found by the path.
    """
    run = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    packages = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root), *sorted(packages)])}
    return subprocess.run(
        [sys.executable, "-S", "-c", run, "--config", str(ROOT / "pyproject.toml"), "--no-cache"],
        cwd=root, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_the_tree_keeps_its_contracts(copied: Path) -> None:
    found = check_layers(copied)
    assert found.returncode == 0, found.stdout + found.stderr
    assert "0 broken" in found.stdout


def read_layers() -> list[str]:
    """The layers of the contract, from the top; those of one layer with a comma between them, in alphabetical order."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = settings["tool"]["importlinter"]["contracts"][0]["layers"]
    return [", ".join(sorted(re.split(r" \| ", layer))) for layer in layers]


def test_the_pages_have_the_layers_of_the_contract() -> None:
    named = re.search(r"`(cli, api → [^`]*)`", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    assert named is not None
    layers = [re.split(r",\s+", layer) for layer in re.split(r"\s+→\s+", named[1])]
    assert [", ".join(sorted(layer)) for layer in layers] == read_layers()

    _, _, page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").partition("```\n")
    lines = page.partition("```")[0].splitlines()
    words = [re.match(r" {3}(\w+(?: │ \w+)*)", line) for line in lines]
    assert [", ".join(sorted(word[1].split(" │ "))) for word in words if word] == read_layers()


@pytest.mark.parametrize(
    ("module", "line", "broken", "import_chain"),
    [
        (
            "geometry/pinhole.py",
            "import usdfoliage.jobs.info",
            "What a folder imports lies below it",
            "usdfoliage.geometry.pinhole -> usdfoliage.jobs.info",
        ),
        (
            "leaf/shape/surface.py",
            "from usdfoliage.branch.model import Skeleton",
            "What a folder imports lies below it",
            "usdfoliage.leaf.shape.surface -> usdfoliage.branch.model",
        ),
        (
            "leaf/model.py",
            "from pxr import Usd",
            "Only asset and what stands on it knows USD",
            "usdfoliage.leaf.model -> pxr",
        ),
        (
            "files/atomic.py",
            "from usdfoliage.files.npz import read_arrays",
            "No folder and no module imports its sibling in a circle",
            "usdfoliage.files",
        ),
    ],
)
def test_a_wrong_import_breaks_a_contract(copied: Path, module: str, line: str, broken: str, import_chain: str) -> None:
    path = copied / "usdfoliage" / module
    before = path.read_text(encoding="utf-8")
    path.write_text(f"{before}\n{line}\n", encoding="utf-8")
    try:
        found = check_layers(copied)
    finally:
        path.write_text(before, encoding="utf-8")
    assert found.returncode == 1
    assert f"{broken} BROKEN" in found.stdout
    assert import_chain in found.stdout.replace("\n", " ")
