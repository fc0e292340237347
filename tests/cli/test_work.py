"""The command that looks after the work folder of builds."""

from pathlib import Path

import pytest

from tests.support.leaves.commands import run
from tests.support.small_builds import digests, write_quick_plan, write_small_capture


def size_below(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and path.suffix != ".lock")


def test_a_pruned_work_folder_builds_the_same_again(tmp_path, capsys, monkeypatch):
    write_small_capture(tmp_path / "shrub")
    write_quick_plan(tmp_path / "plan.toml")
    work = tmp_path / "work"
    build = ["build", tmp_path / "shrub", "-o", tmp_path / "plant", "--plan", tmp_path / "plan.toml", "--work", work]
    assert run(*build) == 0
    before, size = digests(tmp_path / "plant"), size_below(work)

    capsys.readouterr()
    monkeypatch.setenv("USDFOLIAGE_WORK", str(work))
    assert run("work") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["capture", "task", "count", "size", "last", "used"]
    assert next(line.split()[0:3] for line in lines if "not needed" in line) == [
        str(tmp_path / "shrub"),
        "matching",
        "4",
    ]
    assert "not needed (--prune removes that)" in lines[-1]

    assert run("work", work, "--prune", "--dry-run") == 0
    assert "4 tasks" in capsys.readouterr().out.splitlines()[-1]
    assert size_below(work) == size
    assert run("work", work, "--prune", "--keep-days", "1") == 0
    assert size_below(work) == size
    assert run("work", work, "--prune") == 0
    assert size_below(work) < size
    capsys.readouterr()

    # Other leaves ask for the cloud and what is below it, but not for matching.
    (tmp_path / "plan.toml").write_text((tmp_path / "plan.toml").read_text() + "[plant]\nspecies = 'oak'\n")
    assert run(*build) == 0
    assert run("work", work, "--dry-run", "--prune") == 0
    assert not [line for line in capsys.readouterr().out.splitlines() if " matching " in line]

    # Back to the first plan, whose matching, cloud and asset are gone.
    write_quick_plan(tmp_path / "plan.toml")
    assert run("work", work, "--prune") == 0
    for path in work.glob("tasks/*.json"):
        path.unlink()
    assert run(*build, "--force") == 0
    assert digests(tmp_path / "plant") == before


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--dry-run"], "add --prune"),
        (["--keep-days", "-1"], "must be 0 or more"),
        (["--keep-days", "nan"], "must be 0 or more"),
        ([], "is no work folder of builds"),
    ],
)
def test_an_impossible_request_is_reported(tmp_path, capsys, arguments, complaint):
    assert run("work", tmp_path, *arguments) == 2
    assert complaint in capsys.readouterr().err


def test_a_work_folder_that_nothing_names_is_asked_for(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("USDFOLIAGE_WORK", raising=False)
    assert run("work") == 2
    assert "give FOLDER, or set USDFOLIAGE_WORK" in capsys.readouterr().err
    monkeypatch.setenv("USDFOLIAGE_WORK", str(tmp_path))
    assert run("work") == 2
    assert f"{tmp_path} is no work folder of builds" in capsys.readouterr().err
