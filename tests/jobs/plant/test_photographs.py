"""Trees of single photographs, each with strokes beside it, as builds and batches make them."""

import json
import shutil
from pathlib import Path

import pytest
from usdfoliage.jobs.plant.library import read_library

from tests.support.commands.json_output import read_output
from tests.support.leaves.commands import refused, run
from tests.support.photographs.drawn_trees import draw_bare, write_photograph
from tests.support.small_builds import digests

QUICK = """
[plant]
representations = ["bezier"]
[sketch]
max_leaves = 400
crown = false
leaves = "on"
[pictures]
make = false
"""


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    """A work folder that all share: equal photographs are built once."""
    return tmp_path_factory.mktemp("work")


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "plan.toml"
    path.write_text(QUICK)
    return path


def write_ash(folder: Path, trees: int = 1, name: str = "ash") -> tuple[Path, Path]:
    return write_photograph(folder, draw_bare(120, 150), name, trees)


def test_a_build_of_a_photograph_is_the_asset_that_sketch_makes(tmp_path, plan, work, capsys):
    photo, _ = write_ash(tmp_path)
    built = tmp_path / "built" / "ash"
    command = ["build", photo, "-o", built, "--plan", plan, "--work", work, "--reproducible"]
    assert run(*command, "--dry-run") == 0
    assert "trees 1" in capsys.readouterr().out
    assert not built.exists()
    assert run(*command, "--json") == 0
    read_output("build", capsys.readouterr().out)
    sketched = tmp_path / "sketched" / "ash"
    words = ["--no-preview", "--most-leaves", "400", "--leaves", "on", "--no-crown", "--reproducible"]
    assert run("sketch", photo, "-o", sketched, *words) == 0
    own, other = digests(built), digests(sketched)
    same = [name for name in other if name.startswith(("payload/", "maps/")) or name == "strokes.json"]
    same = [name for name in same if not name.startswith("payload/leaves_")]  # forms that the plan has not
    assert len(same) > 4
    differing = [name for name in same if own.get(name) != other[name]]
    assert set(differing) <= {"payload/payload.usda"}  # which lists the forms of leaves
    assert (built / "report" / "sketch" / "traced.jpg").is_file()
    record = (built / "report" / "provenance.json").read_text()
    assert "ash.strokes.json" in record
    assert "max_leaves" in record
    assert run(*command) == 0
    assert "1 of them done by an earlier run, 0 done now" in capsys.readouterr().out


def test_changed_strokes_are_another_input(tmp_path, plan, work, capsys):
    photo, strokes = write_ash(tmp_path)
    command = ["build", photo, "-o", tmp_path / "ash", "--plan", plan, "--work", work, "--dry-run"]
    assert run(*command) == 0
    before = capsys.readouterr().out
    content = json.loads(strokes.read_text())
    content["branches"][0][0][0] += 2
    strokes.write_text(json.dumps(content))
    assert run(*command) == 0
    after = capsys.readouterr().out
    assert (before.splitlines()[3].split()[2:4], after.splitlines()[3].split()[2:4]) == (["1", "0"], ["0", "1"])


def test_one_of_several_trees_is_built_and_none_unless_it_is_named(tmp_path, plan, capsys):
    photo, _ = write_ash(tmp_path, trees=2)
    words = ["build", photo, "-o", tmp_path / "out", "--plan", plan]
    assert "are of 2 trees, and an asset is one of them; set sketch.tree" in refused(capsys, *words)
    plan.write_text(QUICK.replace("[sketch]", "[sketch]\ntree = 3"))
    assert "tree 3 is asked for" in refused(capsys, *words)
    assert "none can be withheld" in refused(capsys, *words, "--hold-back", 2)
    plan.write_text(QUICK.replace("[sketch]", "[sketch]\ntree = 2"))
    assert "has no stage poses; its stages are sketch, report" in refused(capsys, *words, "--only", "poses")
    assert run(*words, "--dry-run") == 0
    assert not (tmp_path / "out").exists()


def test_a_farm_builds_a_photograph_step_by_step(tmp_path, plan, work, capsys):
    photo, _ = write_ash(tmp_path)
    words = ["task", photo, "-o", tmp_path / "ash", "--plan", plan, "--work", work, "--reproducible", "--step"]
    assert run(*words, "list", "--json") == 0
    steps = [step["step"] for step in json.loads(capsys.readouterr().out)["steps"]]
    assert steps == ["plan", "sketch", "report", "publish"]
    for step in steps:
        assert run(*words, step) == 0
    assert (tmp_path / "ash" / "ash.usda").is_file()
    assert run("submit", photo, "-o", tmp_path / "ash", "--template", tmp_path / "job.json") == 0
    template = json.loads((tmp_path / "job.json").read_text())
    assert "CaptureFile" in [each["name"] for each in template["parameterDefinitions"]]


def test_a_folder_of_photographs_is_a_library_of_their_trees(tmp_path):
    write_ash(tmp_path)
    write_ash(tmp_path, 2, "two elms")
    shutil.copy(tmp_path / "ash.png", tmp_path / "alone.png")
    (tmp_path / "lost.strokes.json").write_text("{}")
    (tmp_path / "broken.jpg").write_bytes(b"no photograph")
    (tmp_path / "broken.strokes.json").write_text("[")
    listed = read_library(tmp_path)
    assert [(entry.name, entry.tree) for entry in listed.entries] == [
        ("ash", None),
        ("broken", None),
        ("two_elms_tree_01", 1),
        ("two_elms_tree_02", 2),
    ]
    assert {plant.name: plant.message for plant in listed.skipped} == {
        "alone.png": "the photograph has no strokes beside it",
        "lost.strokes.json": "there is no photograph of these strokes",
    }
    (tmp_path / "list.txt").write_text("two elms.png\tpair\nalone.png\n")
    assert [entry.name for entry in read_library(tmp_path / "list.txt").entries] == [
        "pair_tree_01",
        "pair_tree_02",
        "alone",
    ]


def test_a_photograph_that_fails_does_not_stop_the_others_and_a_second_run_does_nothing(tmp_path, plan, work, capsys):
    folder = tmp_path / "photographs"
    folder.mkdir()
    write_ash(folder)
    _, strokes = write_ash(folder, name="bad")
    strokes.write_text(strokes.read_text().replace('"width": 120', '"width": 301'))
    command = ["batch", folder, "-o", tmp_path / "library", "--plan", plan, "--work", work, "--reproducible"]
    assert run(*command, "--dry-run") == 0
    capsys.readouterr()
    assert run(*command) == 2
    printed = capsys.readouterr().out
    assert "2 plants: 1 built, 1 failed" in printed
    assert "301 x 150" in printed
    assert (tmp_path / "library" / "ash" / "ash.usda").is_file()
    assert not (tmp_path / "library" / "bad").exists()
    assert "ash/report/index.html" in (tmp_path / "library" / "index.html").read_text()
    assert run(*command) == 2
    assert capsys.readouterr().out.count("nothing to do") == 1
