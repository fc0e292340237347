"""Damaged files given to the commands that read them: a few of the cases of tools/bench/hostile_input.py."""

import subprocess
import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).resolve().parents[2] / "tools" / "bench" / "hostile_input.py"


def run_bench(tmp_path, *words):
    command = [sys.executable, str(BENCH), "-o", str(tmp_path / "faults"), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_case_or_two_of_every_kind(tmp_path):
    ended = run_bench(tmp_path, "--share", "0.07", "--no-named")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert not (tmp_path / "faults").exists()


@pytest.mark.parametrize(
    "kind",
    ["broken photographs", "toml made", "usd made", "usd texture", "found in", "small files", "TMPDIR", "other users"],
)
def test_input_that_is_made_on_purpose(tmp_path, kind):
    ended = run_bench(tmp_path, "--kind", kind)
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.mark.slow
def test_other_damage(tmp_path):
    ended = run_bench(tmp_path, "--seed", "1")
    assert ended.returncode == 0, ended.stdout + ended.stderr
