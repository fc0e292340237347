"""A build step by step, as farms run it, and as a job of Open Job Description."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from usdfoliage.cli.options.build import read_chunk, read_chunks

from tests.support.commands.json_output import read_output
from tests.support.leaves.commands import run
from tests.support.small_builds import digests, write_quick_plan, write_small_capture

OPENJD = Path(sys.executable).with_name("openjd")
USDFOLIAGE = Path(sys.executable).with_name("usdfoliage")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """With capture, plan.toml, and built/plant: what a build in one process makes."""
    folder = tmp_path_factory.mktemp('it\'s a "farm" {{Param.Name}}; $HOME')
    write_small_capture(folder / "capture")
    write_quick_plan(folder / "plan.toml")
    built = folder / "built" / "plant"
    assert run("build", folder / "capture", "-o", built, "--plan", folder / "plan.toml") == 0
    return folder


def steps_of(capsys, *command: object) -> dict[str, dict[str, object]]:
    capsys.readouterr()
    assert run(*command, "--step", "list", "--json") == 0
    return {step["step"]: step for step in read_output("task", capsys.readouterr().out)["steps"]}


def test_chunks_are_read():
    assert read_chunks("3-5") == range(3, 6)
    assert read_chunks("4") == range(4, 5)
    assert read_chunk("3/10") == (range(3, 4), 10)


def test_the_steps_in_their_order_make_what_a_build_makes(folder, capsys):
    plant = folder / "farm" / "plant"
    command = ["task", folder / "capture", "-o", plant, "--plan", folder / "plan.toml"]
    steps = steps_of(capsys, *command)
    assert next(iter(steps)) == "plan"
    assert [*steps][-1] == "publish"
    assert steps["matching-2"] == {**steps["matching-2"], "chunks": 2, "needs": ["matching-1"]}
    seen: list[str] = []
    for name, step in steps.items():
        assert set(step["needs"]) <= set(seen)
        if step["chunks"] == 1:
            assert run(*command, "--step", name, "--openjd") == 0
        else:
            assert run(*command, "--step", name, "--chunk", f"1/{step['chunks']}", "--openjd") == 0
            assert run(*command, "--step", name, "--chunks", f"2-{step['chunks']}", "--openjd") == 0
        lines = capsys.readouterr().out.splitlines()
        shares = [float(line.split()[1]) for line in lines if line.startswith("openjd_progress: ")]
        assert shares[0] == 0
        assert shares[-1] == 100
        assert all(0 <= share <= 100 for share in shares)
        assert any(line.startswith(f"openjd_status: plant: {name}") for line in lines) or name in ("plan", "publish")
        assert not any(line.startswith("openjd_fail") for line in lines)
        seen.append(name)
    assert digests(plant) == digests(folder / "built" / "plant")
    # Another time nothing is done.
    stamps = {path: path.stat().st_mtime_ns for path in (folder / "farm" / ".usdfoliage" / "tasks").glob("*.json")}
    assert run(*command, "--step", "leaves") == 0
    assert "was done before" in capsys.readouterr().out
    assert run(*command, "--step", "publish") == 0
    assert stamps == {path: path.stat().st_mtime_ns for path in stamps}


def test_a_step_whose_needs_are_not_there_names_the_step_to_run(folder, capsys):
    command = ["task", folder / "capture", "-o", folder / "early" / "plant", "--plan", folder / "plan.toml"]
    assert run(*command, "--step", "cloud", "--openjd") == 2
    streams = capsys.readouterr()
    assert "error: cloud cannot run: what it needs is not done; run poses and depth first" in streams.err
    assert re.search(r"^openjd_fail: cloud cannot run", streams.out, re.MULTILINE)
    assert run(*command, "--step", "publish") == 2
    assert "run report first" in capsys.readouterr().err


def test_what_was_pruned_may_be_retried(folder, capsys):
    """A farm runs chunks again whose planes are gone: that is no failure, unless something is to be made of them."""
    shutil.copytree(folder / "built", folder / "pruned")
    work = folder / "pruned" / ".usdfoliage"
    assert run("work", work, "--prune") == 0
    command = ["task", folder / "capture", "-o", folder / "pruned" / "plant", "--plan", folder / "plan.toml", "--step"]
    stamps = sorted((work / "tasks").glob("*.json"))
    capsys.readouterr()
    for step in ("matching-1", "matching-2", "depth"):
        assert run(*command, step) == 0
    out = capsys.readouterr().out
    assert out.count("is gone, and not needed") == 4
    assert out.count("was done before") == 2
    assert sorted((work / "tasks").glob("*.json")) == stamps

    # The cloud is to be made again, and one of its depths was altered.
    key = {json.loads(path.read_text())["stamp"]["name"]: path.stem for path in stamps}
    for name, each in key.items():
        if not name.startswith(("poses", "depth")):
            (work / "tasks" / f"{each}.json").unlink()
    stamp = json.loads((work / "tasks" / f"{key['depth/1']}.json").read_text())["stamp"]
    depth = work / stamp["files"][0]["path"]
    depth.write_bytes(depth.read_bytes()[:-1] + bytes([depth.read_bytes()[-1] ^ 1]))
    assert run(*command, "depth", "--chunk", "1/2") == 2
    assert "run matching-2 first" in (complaint := capsys.readouterr().err)
    assert "if it was done and then pruned, submit the job again, or run usdfoliage build" in complaint
    for step in ("matching-1", "matching-2", "depth"):
        assert run(*command, step) == 0
    assert "gone" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--step", "grow"], "this plant has no step grow; it has plan, poses"),
        (["--step", "depth", "--chunk", "1/3"], "depth has 2 chunks, not 3"),
        (["--step", "depth", "--chunks", "2-3"], "depth has chunks 1 to 2, not 2 to 3"),
        (["--step", "publish", "--chunk", "1/2"], "publish has no chunks"),
        (["--step", "depth", "--threads", "-1"], "--threads must be 0 or more"),
    ],
)
def test_steps_and_chunks_that_are_not_there_are_refused(folder, capsys, options, message):
    assert run("task", folder / "capture", "-o", folder / "x" / "plant", "--plan", folder / "plan.toml", *options) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b"])
def test_a_chunk_that_cannot_be_is_refused(folder, text):
    with pytest.raises(SystemExit):
        run("task", folder / "capture", "-o", folder / "x", "--step", "depth", "--chunk", text)


def submit(folder: Path, *options: object) -> tuple[Path, list[str]]:
    """The template of a job, and the command that runs it here."""
    job = folder / "job"
    shutil.rmtree(job, ignore_errors=True)
    words = ["submit", folder / "capture", "-o", folder / "openjd" / "plant", "--plan", folder / "plan.toml"]
    template = job / "job.yaml"
    assert run(*words, "--template", template, "--bundle", job / "bundle", "--executable", USDFOLIAGE, *options) == 0
    return template, [str(OPENJD), "run", str(template), "-p", f"file://{template.with_name('job.parameters.yaml')}"]


@pytest.mark.parametrize("options", [[], ["--no-chunking", "--seed", "3", "--species", "maple", "--force"]])
def test_the_template_passes_the_check_and_names_no_file(folder, options):
    template, _ = submit(folder, *options)
    for path in (template, template.parent / "bundle" / "template.yaml"):
        checked = subprocess.run([OPENJD, "check", path], capture_output=True, text=True, check=False)
        assert checked.returncode == 0, checked.stdout + checked.stderr
    text = template.read_text()
    assert str(folder) not in text
    job = yaml.safe_load(text)
    assert job["steps"][-1]["name"] == "publish"
    assert ("extensions" in job) == (not options)
    known = set()
    for step in job["steps"]:
        assert {each["dependsOn"] for each in step.get("dependencies", ())} <= known
        known.add(step["name"])
        assert step["script"]["actions"]["onRun"]["command"] == "{{Param.Executable}}"
    flows = {each["name"]: each.get("dataFlow") for each in job["parameterDefinitions"]}
    assert flows["CaptureDir"] == "IN"
    assert flows["AssetDir"] == "OUT"
    assert flows["WorkDir"] == "INOUT"


def test_the_bundle_gives_deadline_every_parameter(folder):
    template, _ = submit(folder)
    bundle = template.parent / "bundle"
    values = {
        each["name"]: each["value"]
        for each in yaml.safe_load((bundle / "parameter_values.yaml").read_text())["parameterValues"]
    }
    defined = yaml.safe_load((bundle / "template.yaml").read_text())["parameterDefinitions"]
    assert {each["name"] for each in defined if "default" not in each} <= values.keys() <= {e["name"] for e in defined}
    assert values["CaptureDir"] == str(folder / "capture")
    assert (
        yaml.safe_load((bundle / "asset_references.yaml").read_text())["assetReferences"]["inputs"]["filenames"] == []
    )


def test_openjd_runs_the_first_steps(folder):
    shutil.rmtree(folder / "openjd", ignore_errors=True)
    _, command = submit(folder)
    command += ["--step", "matching-1", "--run-dependencies"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "openjd_progress: 100" in ended.stdout
    assert "openjd_status: plant: matching-1/2" in ended.stdout
    assert "Session ended successfully" in ended.stdout


@pytest.mark.slow
@pytest.mark.parametrize("options", [[], ["--no-chunking"]])
def test_openjd_makes_what_a_build_makes(folder, options):
    shutil.rmtree(folder / "openjd", ignore_errors=True)
    _, command = submit(folder, *options)
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert digests(folder / "openjd" / "plant") == digests(folder / "built" / "plant")


def test_a_template_is_json_where_its_name_ends_so(folder):
    template, _ = submit(folder)
    words = ["submit", folder / "capture", "-o", folder / "openjd" / "plant", "--plan", folder / "plan.toml"]
    as_json = template.with_name("job.json")
    assert run(*words, "--template", as_json, "--executable", USDFOLIAGE) == 0
    values = as_json.with_name("job.parameters.json")
    assert json.loads(as_json.read_text()) == yaml.safe_load(template.read_text())
    assert json.loads(values.read_text()) == yaml.safe_load(template.with_name("job.parameters.yaml").read_text())
    checked = subprocess.run([OPENJD, "check", as_json], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stderr


@pytest.mark.parametrize("left_kb", [0, 4, 20, 24, 32])
def test_a_template_and_a_bundle_appear_together_or_not_at_all(folder, small_disk, capsys, left_kb):
    with (small_disk / "filling").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, shutil.disk_usage(small_disk).free - 1024 * left_kb - 1)
    words = ["submit", folder / "capture", "-o", folder / "plant", "--plan", folder / "plan.toml"]
    places = ["--template", small_disk / "jobs" / "plant.yaml", "--bundle", small_disk / "bundle"]
    capsys.readouterr()
    assert run(*words, *places) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith(f"error: {small_disk}/")
    assert "No space left on device, 0 MB are free there; what was there is unchanged; make room there" in complaint
    assert [path.name for path in small_disk.iterdir()] == ["filling"]
    (small_disk / "filling").unlink()
    assert run(*words, *places) == 0
    assert len([path for path in small_disk.rglob("*") if path.is_file()]) == 5


def test_submit_must_know_where_the_job_goes(folder, capsys):
    assert run("submit", folder / "capture") == 2
    assert "--template JOB.yaml, --bundle FOLDER" in capsys.readouterr().err
    assert run("submit", folder / "capture", "--template", folder / "a.yaml", "--cores", "0") == 2
    assert "--cores must be at least 1, not 0" in capsys.readouterr().err


def test_submit_replaces_jobs_alone(folder, capsys):
    mine = folder / "mine.yaml"
    mine.write_text("notes of my own")
    assert run("submit", folder / "capture", "--template", mine) == 2
    assert f"{mine} is there and no job template" in capsys.readouterr().err
    assert mine.read_text() == "notes of my own"
    bundle = folder / "mine"
    bundle.mkdir()
    (bundle / "notes.txt").write_text("of my own")
    assert run("submit", folder / "capture", "--bundle", bundle) == 2
    assert "holds something else than a bundle" in capsys.readouterr().err
    assert [path.name for path in bundle.iterdir()] == ["notes.txt"]
    assert run("submit", folder / "capture", "--template", mine, "--force") == 0
    assert run("submit", folder / "capture", "--template", mine) == 0
