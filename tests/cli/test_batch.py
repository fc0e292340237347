"""Libraries: lists of captures, plants that fail, and what a second run does."""

import os
import shutil
from pathlib import Path

import pytest
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.plant.library import read_library

from tests.support.commands.json_output import read_output
from tests.support.leaves.commands import refused, run
from tests.support.small_builds import write_quick_plan, write_small_capture


def listed(path: Path, text: str) -> list[tuple[str, Path, Path | None]]:
    path.write_text(text, encoding="utf-8")
    return [(entry.name, entry.capture, entry.plan) for entry in read_library(path).entries]


def test_a_line_is_a_capture_and_if_need_be_its_name_and_plan(tmp_path):
    text = (
        "\ufeff# plants of today\noaks/one\n\n  \nelm cloud.ply\n/far/ash\tgreat ash\tplans/ash.toml\nfir\t\tfir.toml\n"
    )
    assert listed(tmp_path / "list.txt", text) == [
        ("one", tmp_path / "oaks/one", None),
        ("elm_cloud", tmp_path / "elm cloud.ply", None),
        ("great_ash", Path("/far/ash"), tmp_path / "plans/ash.toml"),
        ("fir", tmp_path / "fir", tmp_path / "fir.toml"),
    ]


def test_a_table_names_its_columns(tmp_path):
    text = 'name,capture\n"oak, the first",a/b\n# not this\n,elm\n'
    assert listed(tmp_path / "list.csv", text) == [
        ("oak__the_first", tmp_path / "a/b", None),
        ("elm", tmp_path / "elm", None),
    ]


def test_in_a_folder_plants_are_folders_of_photographs_and_clouds(tmp_path):
    for name in ("oak/images", "elm", "papers", ".hidden/images"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("elm/a.jpg", "ash.ply", "notes.txt"):
        (tmp_path / name).touch()
    found = read_library(tmp_path)
    assert [entry.name for entry in found.entries] == ["ash", "elm", "oak"]
    assert [plant.name for plant in found.skipped] == ["papers"]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("list.txt", "", "has no captures"),
        ("list.txt", "a\tb\tc\td", "list.txt:1 has 4 columns"),
        ("list.txt", "a\n\tb", "list.txt:2 names no capture"),
        ("list.txt", "here/oak\nthere/Oak", "list.txt:2: Oak and oak .*list.txt:1.* would both be called Oak"),
        ("list.csv", "photos,name\na,b", "the first line must name columns of capture, name, plan"),
        ("list.csv", f"capture\na\n{'x' * 200_000}", "list.csv:3 is no line of CSV: field larger than field limit"),
        ("list.csv", f"{'x' * 200_000}\na", "list.csv:1 is no line of CSV"),
        ("list.csv", "name,capture\nb", "list.csv:2 names no capture"),
        ("list.txt", "a\n~nobody_of_that_name/b", "list.txt:2: ~nobody_of_that_name/b cannot be found"),
        ("list.txt", "a\0b", "list.txt:1 has a zero byte"),
    ],
)
def test_a_list_that_cannot_be_understood_is_refused(tmp_path, name, text, message):
    with pytest.raises(CaptureError, match=message):
        listed(tmp_path / name, text)


def test_a_list_that_is_absent_or_no_text_is_refused(tmp_path, capsys):
    assert "cannot be read" in refused(capsys, "batch", tmp_path / "none.txt", "-o", tmp_path / "out")
    (tmp_path / "list.txt").write_bytes(b"\xff\xfe\x00")
    assert "no text in UTF-8" in refused(capsys, "batch", tmp_path / "list.txt", "-o", tmp_path / "out")
    os.mkfifo(tmp_path / "pipe.txt")
    assert "no regular file" in refused(capsys, "batch", tmp_path / "pipe.txt", "-o", tmp_path / "out")


def test_a_capture_whose_name_cannot_be_does_not_stop_the_others(tmp_path, capsys):
    (tmp_path / "list.txt").write_text(f"{'x' * 5000}\nnone\n")
    assert run("batch", tmp_path / "list.txt", "-o", tmp_path / "out", "--dry-run") == 2
    printed = capsys.readouterr().out
    assert "File name too long" in printed
    assert "none" in printed


@pytest.fixture(scope="module")
def plants(tmp_path_factory) -> Path:
    """A folder with the captures oak and elm, broken photographs, and an empty folder; and plan.toml."""
    folder = tmp_path_factory.mktemp("plants")
    for name in ("oak", "elm"):
        write_small_capture(folder / "all" / name)
    (folder / "all" / "elm" / "images" / "000.jpg").write_bytes(b"")  # one of four
    (folder / "all" / "broken").mkdir()
    (folder / "all" / "empty").mkdir()
    for name in ("a.jpg", "b.jpg"):
        (folder / "all" / "broken" / name).write_bytes(b"no photograph")
    write_quick_plan(folder / "plan.toml")
    return folder


def test_one_bad_capture_does_not_stop_the_others_and_a_second_run_does_nothing(plants, capsys, tmp_path):
    out = tmp_path / "library"
    command = ["batch", plants / "all", "-o", out, "--plan", plants / "plan.toml"]
    assert run(*command, "--dry-run") == 0
    assert not out.exists()
    capsys.readouterr()
    assert run(*command) == 2
    printed = capsys.readouterr().out
    assert "3 plants: 2 built, 1 failed, 1 skipped" in printed
    assert f"none of 2 photographs in {plants / 'all' / 'broken'} can be read" in printed
    page = (out / "index.html").read_text()
    for text in ("oak/report/index.html", "elm/elm.usda", "none of 2 photographs", "the folder has no photographs"):
        assert text in page
    for what in ("height", "leaves", "branches"):
        assert page.count(f"<dt>{what}</dt>") == 2  # of the plants that were built
    assert "still to come" not in page
    assert sorted(path.name for path in out.iterdir()) == [".usdfoliage", "elm", "index.html", "oak"]
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.suffix in (".json", ".usda", ".usdc")}
    assert before
    (plants / "all" / "broken2").mkdir()
    try:
        assert run(*command) == 2
    finally:
        shutil.rmtree(plants / "all" / "broken2")
    printed = capsys.readouterr().out
    assert printed.count("nothing to do") == 2
    assert run(*command, "--json") == 2
    made = read_output("batch", capsys.readouterr().out)
    assert made["asset"] is None
    assert Path(made["report"]) == out / "index.html"
    by_name = {plant["name"]: plant for plant in made["plants"]}
    verdicts = {"broken": "failed", "elm": "built", "empty": "skipped", "oak": "built"}
    assert {name: plant["verdict"] for name, plant in by_name.items()} == verdicts
    assert len({tuple(plant) for plant in by_name.values()}) == 1  # all have the same keys
    assert Path(by_name["oak"]["asset"]) == out / "oak" / "oak.usda"
    assert "none of 2 photographs" in by_name["broken"]["error"]
    assert by_name["empty"]["error"].startswith("the folder has no photographs; ")
    assert "photographs-unusable" in [each["code"] for each in by_name["elm"]["remarks"]]
    assert before == {path: path.stat().st_mtime_ns for path in before}


def test_a_plan_that_cannot_be_read_fails_its_plant_only(plants, capsys, tmp_path):
    (plants / "bad.toml").write_text("[leaves]\nspeed = 3\n")
    (plants / "list.txt").write_text("all/oak\toak\tbad.toml\nall/nowhere\n")
    assert run("batch", plants / "list.txt", "-o", tmp_path / "out", "--plan", plants / "plan.toml") == 2
    printed = capsys.readouterr().out
    assert "list.txt:1" in printed
    assert "nowhere does not exist" in printed
    assert "2 plants: 2 failed" in printed
    page = (tmp_path / "out" / "index.html").read_text()
    assert "speed" in page
    assert "nowhere does not exist" in page
