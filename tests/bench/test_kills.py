"""What a kill may leave, and what it may not: judged on made-up outcomes, and on commands that do wrong on purpose."""

import random
import signal
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import pytest

from tools.bench import kills
from tools.bench.kills import Known, digest_tree, find_left_over, judge_output, judge_words, kill_once, kill_rounds
from tools.fuzz.writing import INPUT, Subject

BENCH = Path(__file__).resolve().parents[2] / "tools" / "bench" / "kills.py"
OLD, NEW = {"out/a": "1", "out/b": "2"}, {"out/a": "3", "out/b": "4"}
KNOWN = Known(new=NEW, old=OLD, earlier=Path(), seconds=0.2)
WHOLE = Subject(words=("make",), other=(), outputs=("out",))
APART = replace(WHOLE, apart=True)
# A command in place of ours: what it does before and after the moment in which it is killed.
FAKE = """
import os, subprocess, sys, time
from pathlib import Path

def write(folder, names):
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).write_text(name)

kind = {kind!r}
marker = Path("{marker}")
is_killed = not marker.exists()  # the first run waits until it is
marker.touch()
if kind == "half":
    write(Path("out"), "a")
if kind == "changes input" and is_killed:
    Path("in/photo.txt").write_text("changed")
if kind == "leaves a child" and is_killed:
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(20)"], start_new_session=True)
if kind == "leaves a file":
    Path("out.usdfoliage-new").write_text("half")
if is_killed:
    time.sleep(20)
if kind == "other bytes":
    write(Path("out"), "abc")
else:
    write(Path("out"), "ab")
"""


@pytest.mark.parametrize(
    ("subject", "found", "had_old", "state", "fault"),
    [
        (WHOLE, NEW, True, "new", ""),
        (WHOLE, OLD, True, "old", ""),
        (WHOLE, {}, False, "absent", ""),
        (WHOLE, {}, True, "other", "neither old nor new: ['out/a', 'out/b'] of 2"),
        (WHOLE, OLD, False, "other", "neither old nor new"),
        (WHOLE, {"out/a": "3"}, False, "other", "neither old nor new: ['out/b'] of 1"),
        (WHOLE, {**NEW, "out/c": "5"}, True, "other", "neither old nor new: ['out/c'] of 1"),
        (WHOLE, {"out/a": "3", "out/b": "2"}, True, "other", "neither old nor new: ['out/b'] of 1"),
        (APART, {"out/a": "3", "out/b": "2"}, True, "between", ""),
        (APART, {"out/a": "3", "out/b": "half"}, True, "other", "half: ['out/b']"),
        (APART, {"out/a": "of the input"}, False, "between", ""),
    ],
)
def test_an_output_is_the_old_or_the_new_one_whole(subject, found, had_old, state, fault):
    judged, text = judge_output(subject, found, KNOWN, had_old, ["of the input"])
    assert judged == state
    assert text.startswith(fault)
    assert bool(text) == bool(fault)


@pytest.mark.parametrize(
    ("victim", "number", "code", "out", "err", "fault"),
    [
        ("command", signal.SIGKILL, -9, "", "", ""),
        ("all", signal.SIGTERM, 130, "", "error: interrupted; nothing that is half written stays\n", ""),
        ("all", signal.SIGTERM, 130, "", "", "exit 130 with 0 lines of error"),
        ("child", signal.SIGKILL, 2, "", "error: the process that drew was killed\n", ""),
        ("child", signal.SIGKILL, 2, "", "error: one\nerror: two\n", "exit 2 with 2 lines of error"),
        ("child", signal.SIGKILL, 1, "", "error: internal fault: KeyError\n", "traceback"),
        ("child", signal.SIGKILL, -9, "", "", "exit -9 with 0 lines of error"),
        ("command", signal.SIGTERM, 1, "", "Traceback (most recent call last):\n", "traceback"),
        ("child", signal.SIGTERM, 2, "", "error: one\nSegmentation fault\n", "other words on stderr"),
        ("child", signal.SIGTERM, 0, "", "", "exit 0 after a kill, with another result: ['out/a', 'out/b']"),
        ("child", signal.SIGTERM, 0, "WARNING: no pictures of the asset\n", "", ""),
    ],
)
def test_what_a_command_prints_is_one_line(victim, number, code, out, err, fault):
    text = judge_words(victim, number, code, out, err, OLD, KNOWN)
    assert text.startswith(fault)
    assert bool(text) == bool(fault)


def test_a_command_that_ends_well_has_the_new_output():
    assert judge_words("child", signal.SIGTERM, 0, "", "", NEW, KNOWN) == ""


@pytest.mark.parametrize(
    "name", ["out.old-1/a", "out/.out.usdfoliage-new.0123/a", "out/maps/a.tmp", "tmp/usdfoliage-x/a", "other.txt"]
)
def test_what_no_undisturbed_run_leaves_is_found(tmp_path, name):
    for each in ("out/a", "tmp", "in/report.tmp"):
        path = tmp_path / each
        (path if each == "tmp" else path.parent).mkdir(exist_ok=True)
        if each != "tmp":
            path.write_text("")
    assert find_left_over(WHOLE, tmp_path, NEW) == []
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_text("")
    assert find_left_over(WHOLE, tmp_path, NEW) != []


def test_an_output_that_names_its_place_is_the_same_elsewhere(tmp_path):
    for name in ("old", "round"):
        (tmp_path / name / "out").mkdir(parents=True)
        (tmp_path / name / "out" / "job.yaml").write_text(f"work: {tmp_path / 'old'}/work")
    old = digest_tree(tmp_path / "old", ["out"])
    assert digest_tree(tmp_path / "round", ["out"], tmp_path / "old") == old
    assert digest_tree(tmp_path / "round", ["out"]) != old


@pytest.fixture
def fake(monkeypatch, tmp_path):
    """Puts another command in the place of ours, which is killed in its middle, and kills it."""
    monkeypatch.setattr(kills, "VICTIMS", ("command",))
    monkeypatch.setattr(kills, "SIGNALS", (signal.SIGKILL,))
    monkeypatch.setattr(kills, "_ENDING_S", 0.3)
    given = tmp_path / INPUT
    given.mkdir()
    (given / "photo.txt").write_text("green")
    new = tmp_path / "known" / "out"
    new.mkdir(parents=True)
    for name in "ab":
        (new / name).write_text(name)
    old = tmp_path / "earlier" / "out"
    old.mkdir(parents=True)
    (old / "a").write_text("old")
    trees = (digest_tree(each.parent, ["out"]) for each in (new, old))
    known = Known(new=next(trees), old=next(trees), earlier=old.parent, seconds=1.0)

    def run(kind):
        script = tmp_path / "fake.py"
        script.write_text(textwrap.dedent(FAKE).format(kind=kind, marker=tmp_path / "killed"))
        monkeypatch.setattr(kills, "command", lambda words: [sys.executable, str(script)])
        return kill_rounds("fake", WHOLE, 1, known, given, tmp_path / "rounds", tmp_path / "kept", 0)

    return run


def test_a_command_that_writes_whole_has_no_fault(fake, tmp_path):
    tally = fake("good")
    assert tally.faults == []
    assert (tally.kills, tally.codes) == ({"command SIGKILL": 1}, {-9: 1})
    assert tally.states in ({"absent": 1}, {"old": 1})
    assert not (tmp_path / "kept").exists()


@pytest.mark.parametrize(
    ("kind", "fault"),
    [
        ("half", "neither old nor new: ['out/b'] of 1"),
        ("changes input", "the input changed"),
        ("leaves a child", "1 children are left"),
        ("leaves a file", "the next run leaves ['out.usdfoliage-new'"),
        ("other bytes", "the next run: OTHER BYTES: ['out/c'] of 1"),
    ],
)
def test_what_a_killed_command_does_wrong_is_found_and_kept(fake, tmp_path, kind, fault):
    tally = fake(kind)
    assert any(fault in each for each in tally.faults), tally.faults
    assert fault in (tmp_path / "kept" / "fake-1" / "faults.txt").read_text()


def test_a_child_is_killed_where_there_is_one(tmp_path, monkeypatch):
    monkeypatch.setattr(kills, "VICTIMS", ("child",))
    # SIGINT ends a Python that has just begun with the code 1, or by the signal.
    monkeypatch.setattr(kills, "SIGNALS", (signal.SIGKILL, signal.SIGTERM))
    wait = (
        "import subprocess, sys; sys.exit(50 + subprocess.call([sys.executable, '-c', 'import time; time.sleep(9)']))"
    )
    (tmp_path / "tmp").mkdir()
    for code, killed in ((wait, "child"), ("pass", "none")):
        monkeypatch.setattr(kills, "command", lambda words, code=code: [sys.executable, "-c", code])
        victim, number, ended, *_, alive = kill_once(WHOLE, tmp_path, KNOWN, random.Random(0))
        assert victim == killed
        assert alive == []
        assert ended == (50 - number if killed == "child" else 0)


def test_a_real_command_is_killed():
    words = ["--kills", "1", "--only", "scatter", "--seed", "3"]
    ended = subprocess.run([sys.executable, str(BENCH), *words], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stdout.startswith("scatter              good    1 kills")
    assert "; 0 faults; seed 3" in ended.stdout.splitlines()[-1]
