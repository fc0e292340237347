"""The licence goes with a wheel, and the page of others' software names everything that pip installs."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NEEDED = [*PROJECT["dependencies"], *(name for names in PROJECT["optional-dependencies"].values() for name in names)]


def test_the_files_that_go_with_a_wheel_are_there():
    assert PROJECT["license"] == "Apache-2.0"
    assert set(PROJECT["license-files"]) == {"LICENSE", "NOTICE", "THIRD_PARTY.md"}
    assert "Apache License\n                           Version 2.0" in (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert "OpenSubdiv" in (ROOT / "NOTICE").read_text(encoding="utf-8")


@pytest.mark.parametrize("requirement", NEEDED)
def test_a_dependency_has_its_licence_on_the_page(requirement: str):
    name = re.split(r"[<>=~!\[; ]", requirement)[0]
    rows = [
        line.split("|")
        for line in (ROOT / "THIRD_PARTY.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    ]
    named = {part.strip().lower(): row[2].strip() for row in rows for part in re.split(r"[,(]", row[1])}
    assert named.get(name.lower()), f"{name} is not on the page"
