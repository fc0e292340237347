"""The worst files are as bad as they state, and what a command does wrong with one is found."""

import re
import struct
import subprocess
import sys
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd
from usdfoliage.__main__ import main

from tests.support.cloud_files import write_las, write_ply
from tools.bench.worst_files import WorstLimits, format_line, make_file, run_command
from tools.fuzz import isolation
from tools.fuzz.crates import ARRAY_LENGTH, COUNT, SECTIONS, state_array_counts, state_section_count
from tools.fuzz.worst_files import CLASSES, PARENTHESES, PRIMS, TEXT_BYTES, worst_files

BENCH = Path(__file__).resolve().parents[2] / "tools" / "bench" / "worst_files.py"
SCALE = 0.001
FILES = {file.name: file for file in worst_files()}
ALLOCATE = "import time; data = bytearray(300_000_000); time.sleep(4)"


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    """A cloud, a spray and a work folder, as small as they can be."""
    folder = tmp_path_factory.mktemp("seeds")
    for name in ("cloud", "work"):
        (folder / name).mkdir()
    points = np.random.default_rng(0).uniform(0, 1, (60, 3))
    write_ply(folder / "cloud" / "tree.ply", points)
    write_las(folder / "cloud" / "tree.las", points)
    np.savez(folder / "work" / "result.npz", points=points)
    (folder / "bed").mkdir()
    assert main(["scatter", "-n", "2", "-o", str(folder / "plants" / "spray")]) == 0
    return folder


@pytest.fixture
def made(seeds, tmp_path):
    """Makes one of the files, small, and returns its folder."""

    def make(name):
        folder = tmp_path / "made"
        folder.mkdir()
        make_file(FILES[name], seeds, folder, SCALE)
        return folder

    return make


@pytest.fixture
def run_fake(monkeypatch, tmp_path, capfd):
    """Runs another command than ours, and returns what is found of it."""

    def run(fake, limits=WorstLimits()):
        monkeypatch.setattr(isolation, "main", fake)
        (tmp_path / "given").mkdir(exist_ok=True)
        (tmp_path / "given" / "a.usda").write_text("#usda 1.0\n")
        with capfd.disabled():
            file = FILES["usda, a million prims"]
            return run_command(file, ("info", "a.usda"), tmp_path / "given", tmp_path / "run", limits)

    return run


def refuse():
    print("error: a.usda is too large; make it smaller", file=sys.stderr)
    return 2


def fail():
    raise RuntimeError("as it should not")


def print_traceback():
    print('Traceback (most recent call last):\n  File "x.py"\nerror: a.usda is bad', file=sys.stderr)
    return 2


def change_input():
    Path("a.usda").write_text("")
    return 0


def leave_half():
    Path("out.usda").write_text("#usda 1.0\n")
    return refuse()


def change_work():
    Path("work").mkdir()
    Path("work/task.json").write_text("{}")
    return refuse()


def be_ended():
    """As a box that ends its child, which had begun to write."""
    Path(".out.0123456789ab.usdfoliage-lock").write_text("")
    print("error: a.usda takes more than 2.0 GiB of memory to read; it is damaged", file=sys.stderr)
    return 2


def leave_hidden():
    Path(".out.0123456789ab.usdfoliage-lock").write_text("")
    return refuse()


def use_time():
    end = time.process_time() + 0.3
    while time.process_time() < end:
        pass
    return refuse()


def test_a_refusal_is_no_fault(run_fake, tmp_path):
    outcome = run_fake(refuse)
    assert outcome.faults == []
    assert outcome.line == "error: a.usda is too large; make it smaller"
    assert re.search(r"usda, a million prims +info +2 .* error: a.usda is too large", format_line(outcome))
    assert not (tmp_path / "run").exists()
    assert run_fake(change_work).faults == []
    assert run_fake(be_ended).faults == []


@pytest.mark.parametrize(
    ("fake", "fault"),
    [
        (fail, "exit code 1"),
        (fail, "Traceback"),
        (print_traceback, "Traceback"),
        (change_input, "input changed: a.usda"),
        (leave_half, "partial output: out.usda"),
        (leave_hidden, "left behind: .out.0123456789ab.usdfoliage-lock"),
        (lambda: 3, "exit code 3"),
        (lambda: 2, "0 messages"),
    ],
)
def test_what_a_command_does_wrong_is_a_fault(run_fake, fake, fault):
    assert any(each.startswith(fault) for each in run_fake(fake).faults)


def test_a_command_that_takes_too_long_has_a_fault(run_fake):
    assert run_fake(use_time).faults == []
    assert run_fake(use_time, WorstLimits(cpu_s=0.2)).faults == ["slow: 0 s"]
    (fault,) = run_fake(lambda: time.sleep(60), WorstLimits(clock_s=0.3)).faults
    assert fault.startswith("hang")


def test_the_memory_of_what_a_command_starts_counts(run_fake):
    def start_child():
        subprocess.run([sys.executable, "-c", ALLOCATE], check=True)
        return refuse()

    small = run_fake(refuse)
    large = run_fake(start_child)
    # What the process that was just forked shares with its parent counts twice for a moment, in some runs.
    limit_bytes = small.peak_bytes + 200e6
    assert large.peak_bytes > limit_bytes
    (fault,) = run_fake(start_child, WorstLimits(memory_bytes=limit_bytes)).faults
    assert fault.startswith("memory: ")
    stopped = run_fake(start_child, WorstLimits(stop_bytes=limit_bytes))
    assert stopped.faults[0].startswith("memory: ended at")
    assert stopped.ended.waited_s < large.ended.waited_s


def test_layers_are_as_large_as_they_state(made):
    text = (made("usda, 1 GB of text") / "a.usda").read_bytes()
    assert TEXT_BYTES * SCALE <= len(text) < TEXT_BYTES * SCALE + 100_000
    assert len(set(text.splitlines())) > 2000


def test_a_plant_has_a_million_prims(made):
    folder = made("plant, a million prims")
    layer = Sdf.Layer.OpenAsAnonymous(str(folder / "plants" / "spray" / "payload" / "payload.usda"))
    assert len(layer.GetPrimAtPath("/spray/a").nameChildren) == PRIMS * SCALE
    assert FILES["plant, a million prims"].commands[0] == ("info", "plants/spray")


def test_prims_double(made):
    stage = Usd.Stage.Open(str(made("usda, 2^30 prims by inheriting") / "a.usda"))
    depths = [prim.GetPath().pathElementCount for prim in Usd.PrimRange(stage.GetPrimAtPath("/a/all"))]
    assert max(depths) > 2
    assert [depths.count(depth) for depth in range(2, max(depths) + 1)] == [2**k for k in range(max(depths) - 1)]


def test_classes_inherit_each_other(made):
    stage = Usd.Stage.Open(str(made("usda, 20,000 classes") / "a.usda"))
    assert len(stage.GetPrimAtPath("/a/last").GetPrimStack()) == CLASSES * SCALE + 2


def test_parentheses_stand_in_parentheses(made):
    assert (made("usda, 100,000 parentheses") / "a.usda").read_bytes().count(b"(" * int(PARENTHESES * SCALE)) == 1


def test_counts_that_a_file_only_states_do_not_scale(made):
    assert b"element vertex 2147483648\n" in (made("PLY, text, 2^31 points") / "a.ply").read_bytes()


def test_a_las_file_states_as_many_points(made):
    data = (made("LAS, 2^31 points") / "cloud" / "tree.las").read_bytes()
    assert struct.unpack_from("<Q", data, 247) == (COUNT,)


def test_stored_arrays_state_as_many_numbers(made):
    with zipfile.ZipFile(made("NPZ of a work folder, 2^31") / "work" / "result.npz") as archive:
        assert b"(2147483648,)" in archive.read("points.npy")


def test_numbers_of_a_plant_are_the_largest(made):
    payload = made("plant, 2^31 in its numbers") / "plants" / "spray" / "payload"
    mesh = Sdf.Layer.OpenAsAnonymous(str(payload / "leaves_mesh.usdc"))
    counts = mesh.GetAttributeAtPath("/spray/geo/render/Leaves.faceVertexCounts").default
    assert set(counts) == {COUNT - 1}
    leaves = Sdf.Layer.OpenAsAnonymous(str(payload / "leaves.usdc"))
    assert leaves.GetAttributeAtPath("/spray/geo/render/Leaves.primvars:leaf:packed").default[0] == COUNT


def test_a_crate_states_counts_that_it_does_not_have(tmp_path):
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.ImportFromString(f'#usda 1.0\ndef "a" {{ int[] x = [{", ".join(map(str, range(ARRAY_LENGTH)))}]; }}')
    layer.Export(str(tmp_path / "good.usdc"))
    good = (tmp_path / "good.usdc").read_bytes()
    bad = state_array_counts(good)
    assert len(bad) == len(good)
    assert struct.pack("<Q", COUNT) in bad
    for section, numbers in SECTIONS.items():
        for number in range(len(numbers)):
            stated = state_section_count(good, section, number)
            assert sum(one != other for one, other in zip(good, stated, strict=True)) in range(1, 9)
    with pytest.raises(ValueError, match="no array has 12347 elements"):
        state_array_counts(bad)
    with pytest.raises(ValueError, match="no section NAMES"):
        state_section_count(good, "NAMES", 0)


def test_a_file_that_cannot_be_made_is_an_error(seeds, tmp_path):
    with pytest.raises(RuntimeError, match=r"LAS, 2\^31 points could not be made"):
        make_file(replace(FILES["LAS, 2^31 points"], trees=()), seeds, tmp_path, SCALE)


def test_the_benchmark_runs_and_prints_a_table():
    words = ["--scale", str(SCALE), "--only", "PLY, 2^31 points", "PLY, 2^31 points in holes"]
    ended = subprocess.run(
        [sys.executable, str(BENCH), *words, "--commands", "branches"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
    lines = ended.stdout.splitlines()
    assert [line.split()[0] for line in lines[:2]] == ["file", "PLY,"]
    assert "states 2,147,483,648 rows of vertex" in lines[1]
    assert "the others are holes" in lines[2]
    assert lines[-1].startswith("2 commands on 2 files, 0 with faults; at most ")


def test_a_scale_above_1_is_refused():
    ended = subprocess.run([sys.executable, str(BENCH), "--scale", "2"], capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert "--scale must be above 0 and at most 1" in ended.stderr
