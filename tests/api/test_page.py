"""The examples of docs/python_api.md run."""

import subprocess
import sys
from pathlib import Path

from tools.page_code import python_program

PAGE = Path(__file__).parents[2] / "docs" / "python_api.md"


def test_the_examples_run_in_their_order(tmp_path: Path) -> None:
    program = python_program(PAGE)
    assert "api.write_asset(" in program
    assert "api.build(" in program
    (tmp_path / "page.py").write_text(program, encoding="utf-8")
    command = [sys.executable, "-W", "error", "page.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "maple.usda" in done.stdout


def test_blocks_stand_on_their_lines_of_the_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Title\n\n```python\na = 1\n```\n\nText\n\n```toml\nb = 2\n```\n\n```python\nc = 3\n```\n")
    lines = python_program(page).splitlines()
    assert (lines[3], lines[13]) == ("a = 1", "c = 3")
    assert [line for line in lines if line] == ["a = 1", "c = 3"]
