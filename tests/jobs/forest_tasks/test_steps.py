"""A forest step by step, as farms make it, and as a job of Open Job Description."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.support.commands.json_output import read_output
from tests.support.forests.shots import PATH_M, forest_words, write_shot
from tests.support.leaves.commands import refused, run
from tests.support.small_builds import digests

OPENJD = Path(sys.executable).with_name("openjd")
USDFOLIAGE = Path(sys.executable).with_name("usdfoliage")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('it\'s a "farm" {{Param.Name}}; $HOME')
    write_shot(folder / "shot010.usda", [(0, 40, z) for z in PATH_M])
    return folder


@pytest.fixture(scope="module")
def words(folder) -> list[str]:
    options = ["--camera", str(folder / "shot010.usda"), "--lod-distance", "30", "70", "--sky", "120", "40"]
    return [*forest_words(folder), *options, "--tile", "40", "--seed", "3"]


@pytest.fixture(scope="module")
def plain(folder, words) -> dict[str, str]:
    """The digests of what one process writes."""
    assert run(*words, "-o", folder / "plain" / "valley") == 0
    return digests(folder / "plain" / "valley")


def steps_of(capsys, *command: object) -> dict[str, dict[str, object]]:
    capsys.readouterr()
    assert run(*command, "--step", "list", "--json") == 0
    return {step["step"]: step for step in read_output("forest", capsys.readouterr().out)["steps"]}


def test_the_steps_in_their_order_make_what_one_process_makes(folder, words, plain, capsys):
    command = [*words, "-o", folder / "farm" / "valley"]
    steps = steps_of(capsys, *command)
    assert list(steps) == ["plan", "planting", "tiles", "publish"]
    assert [step["needs"] for step in steps.values()] == [[], ["plan"], ["planting"], ["tiles"]]
    count = steps["tiles"]["chunks"]
    assert count >= 4
    for name in steps:
        chunks = [["--chunk", f"1/{count}"], ["--chunks", f"2-{count}"]] if name == "tiles" else [[]]
        for chosen in chunks:
            assert run(*command, "--step", name, *chosen, "--openjd") == 0
            lines = capsys.readouterr().out.splitlines()
            shares = [float(line.split()[1]) for line in lines if line.startswith("openjd_progress: ")]
            assert (shares[0], shares[-1]) == (0, 100)
            assert shares == sorted(shares)
            assert not any(line.startswith("openjd_fail") for line in lines)
    assert digests(folder / "farm" / "valley") == plain
    assert steps_of(capsys, *command)["tiles"]["chunks"] == count  # read from what was planted
    assert run(*command, "--step", "tiles") == 0
    assert capsys.readouterr().out.count("was done before") == count


def test_a_step_whose_needs_are_not_there_names_the_step_to_run(folder, words, capsys):
    command = [*words, "-o", folder / "early" / "valley"]
    assert run(*command, "--step", "tiles", "--openjd") == 2
    streams = capsys.readouterr()
    assert "cannot run: what it needs is not done; run planting first" in streams.err
    assert "run usdfoliage forest with the same options" in streams.err
    assert re.search(r"^openjd_fail: tiles/1 cannot run", streams.out, re.MULTILINE)
    assert run(*command, "--step", "publish") == 2
    assert "run planting and tiles first" in capsys.readouterr().err
    assert not (folder / "early" / "valley").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--step", "grow"], "this forest has no step grow; it has plan, planting, tiles, publish"),
        (["--step", "tiles", "--chunk", "1/3"], "chunks, not 3"),
        (["--step", "tiles", "--chunks", "2-99"], "not 2 to 99"),
        (["--step", "publish", "--chunk", "1/2"], "publish has no chunks"),
        (["--chunk", "1/2"], "give --step"),
        (["--openjd"], "give --step"),
        (["--step", "tiles", "--jobs", "2"], "leave --jobs and --scheduler out"),
        (["--step", "tiles", "--bundle", "job"], "give one of them"),
        (["--step", "tiles", "--json"], "leave --json out"),
        (["--template", "job.yaml", "--json"], "leave --json out"),
        (["--jobs", "0"], "jobs must be at least 1"),
        (["--jobs", "2", "--scheduler", "tcp://127.0.0.1:1"], "name one of them"),
        (["--work", "valley/work"], "which would be replaced"),
    ],
)
def test_what_cannot_be_is_refused(folder, words, capsys, options, message, monkeypatch):
    monkeypatch.chdir(folder)
    assert message in refused(capsys, *words, "-o", "valley", *options)
    assert not (folder / "valley").exists()


def submit(folder: Path, words: list[str], *options: object) -> tuple[Path, list[str]]:
    """The template of a job, and the command that runs it here."""
    job = folder / "job"
    shutil.rmtree(job, ignore_errors=True)
    template = job / "job.yaml"
    command = [*words, "-o", folder / "openjd" / "valley", "--executable", USDFOLIAGE, *options]
    assert run(*command, "--template", template, "--bundle", job / "bundle") == 0
    return template, [str(OPENJD), "run", str(template), "-p", f"file://{template.with_name('job.parameters.yaml')}"]


@pytest.mark.parametrize("options", [[], ["--no-chunking", "--force", "--no-find-vegetation", "--trees-per-ha", "20"]])
def test_the_template_passes_the_check_and_names_no_file(folder, words, options):
    template, _ = submit(folder, words, *options)
    for path in (template, template.parent / "bundle" / "template.yaml"):
        checked = subprocess.run([OPENJD, "check", path], capture_output=True, text=True, check=False)
        assert checked.returncode == 0, checked.stdout + checked.stderr
    text = template.read_text()
    assert str(folder) not in text
    job = yaml.safe_load(text)
    assert [step["name"] for step in job["steps"]] == ["plan", "planting", "tiles", "publish"]
    assert ("extensions" in job) == (not options)
    assert not (folder / "openjd").exists()  # nothing is planted, and no work folder made
    for step in job["steps"]:
        arguments = step["script"]["actions"]["onRun"]["args"]
        assert arguments[:2] == ["forest", "{{Param.Dem}}"]
        assert ("--force" in arguments) == (bool(options) and step["name"] == "publish")
        assert ("--no-find-vegetation" in arguments) == bool(options)
    flows = {each["name"]: each.get("dataFlow") for each in job["parameterDefinitions"]}
    assert (flows["Dem"], flows["Camera1"], flows["AssetDir"], flows["WorkDir"]) == ("IN", "IN", "OUT", "INOUT")


def test_openjd_makes_what_one_process_makes(folder, words, plain):
    shutil.rmtree(folder / "openjd", ignore_errors=True)
    _, command = submit(folder, words)
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "Session ended successfully" in ended.stdout
    assert digests(folder / "openjd" / "valley") == plain
