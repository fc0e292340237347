"""Commands that open USD of strangers: a child with limits, whose death is one line and exit code 2."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from usdfoliage.cli.box import BoxLimits, allow, usage
from usdfoliage.cli.composition import measure_composition
from usdfoliage.errors import FoliageError

from tests.support.branch_clouds import cloud_of, small_tree
from tests.support.cloud_files import write_ply
from tests.support.leaves.commands import run

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a box follows its child by /proc")


def start(*words, **environment):
    return subprocess.Popen(
        [sys.executable, "-m", "usdfoliage", *map(str, words)],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def end(*words, **environment):
    process = start(*words, **environment)
    printed, complaints = process.communicate(timeout=120)
    return process.returncode, printed, complaints


@pytest.fixture
def parentheses(tmp_path):
    """USD's parser needs 100 kB of memory for each."""
    path = tmp_path / "deep.usda"
    path.write_text('#usda 1.0\ndef Xform "a" { custom int x = ' + "(" * 100_000 + ")" * 100_000 + "}\n")
    return path


@pytest.fixture
def chain(tmp_path):
    """USD composes for longer than anybody waits."""
    path, count = tmp_path / "chain.usda", 20_000
    classes = "".join(f'class "c{k}" (inherits = </c{k + 1}>) {{}}\n' for k in range(count))
    plant = f'class "c{count}" {{}}\ndef Xform "a" (inherits = </c0>) {{}}\n'
    path.write_text(f'#usda 1.0\n(defaultPrim = "a")\n{classes}{plant}')
    return path


@pytest.mark.parametrize("command", ["info", "validate"])
def test_what_takes_all_memory_is_refused_in_one_line(parentheses, command):
    code, printed, complaints = end(command, parentheses, USDFOLIAGE_MEMORY_LIMIT_GIB="0.6")
    assert (code, printed) == (2, "")
    assert complaints.startswith(f"error: {parentheses} takes more than 0.6 GiB of memory")
    assert "USDFOLIAGE_MEMORY_LIMIT_GIB" in complaints
    assert complaints.count("\n") == 1


def test_what_does_not_end_is_refused_in_one_line(chain):
    began = time.monotonic()
    code, printed, complaints = end("info", chain, USDFOLIAGE_TIME_LIMIT_S="4")
    assert time.monotonic() - began < 20
    assert (code, printed) == (2, "")
    assert complaints.startswith(f"error: {chain} was not read within 4 s")
    assert "USDFOLIAGE_TIME_LIMIT_S" in complaints
    assert complaints.count("\n") == 1


def test_what_takes_the_processor_is_refused_in_one_line(chain):
    code, printed, complaints = end("info", chain, USDFOLIAGE_CPU_LIMIT_S="3")
    assert (code, printed) == (2, "")
    assert complaints.startswith(f"error: {chain} takes more than 3 s of the processor to read")
    assert "USDFOLIAGE_CPU_LIMIT_S" in complaints
    assert complaints.count("\n") == 1


@pytest.mark.parametrize("command", ["info", "validate", "bake", "edit", "export"])
def test_a_text_without_end_is_refused_before_it_is_read(tmp_path, command):
    with (tmp_path / "long.usda").open("wb") as file:
        file.write(b"#usda 1.0\n")
        file.truncate(1 << 31)
    (tmp_path / "a.usda").write_text("#usda 1.0\n( subLayers = [@long.usda@] )\n")
    more = {
        "bake": ("-o", tmp_path / "out"),
        "edit": ("--width", 2, "-o", tmp_path / "out.usda"),
        "export": ("--profile", "standalone", "-o", tmp_path / "out"),
    }.get(command, ())
    code, printed, complaints = end(command, tmp_path / "a.usda", *more)
    assert (code, printed) == (2, "")
    assert complaints.startswith(f"error: {tmp_path / 'long.usda'} is a layer of 2,048 MiB of text, more than 64;")
    assert "USDFOLIAGE_TEXT_LIMIT_MIB" in complaints
    assert complaints.count("\n") == 1


def test_a_preview_is_timed_until_its_interpreter_begins(chain, tmp_path):
    words = ("preview", chain, "-o", tmp_path / "x.png")
    for variable in ("USDFOLIAGE_TIME_LIMIT_S", "USDFOLIAGE_CPU_LIMIT_S"):
        code, printed, complaints = end(*words, **{variable: "3"})
        assert (code, printed) == (2, "")
        assert complaints.startswith(f"error: {chain} ")
        assert variable in complaints
    spray = tmp_path / "spray"
    assert run("scatter", "-n", 3, "-o", spray) == 0
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\n(ulimit -t 5; while true; do :; done)\nsleep 8\necho it drew >&2\n")
    python.chmod(0o755)
    code, _, complaints = end(
        *("preview", spray, "-o", tmp_path / "x.png"),
        USDFOLIAGE_HYDRA_PYTHON=str(python),
        USDFOLIAGE_TIME_LIMIT_S="12",
        USDFOLIAGE_CPU_LIMIT_S="4",
    )
    assert code == 2
    assert "it drew" in complaints  # for longer than both limits


def children(pid):
    return [
        int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()
    ]


def is_started(pid):
    """Until it has its own program, a child shares its parent's memory, and every signal waits."""
    return "boxed.py" in Path(f"/proc/{pid}/cmdline").read_text()


def child_at_work(process):
    """The child of a command, once it reads."""
    for _ in range(600):
        for child in children(process.pid):
            if is_started(child) and usage(child).memory_bytes > 60 << 20:
                return child
        time.sleep(0.05)
    raise AssertionError("no child works")


@pytest.mark.parametrize("name", ["SIGSEGV", "SIGABRT", "SIGKILL", "SIGTERM"])
def test_a_child_that_dies_is_one_line(chain, name):
    process = start("info", chain)
    os.kill(child_at_work(process), getattr(signal, name))
    printed, complaints = process.communicate(timeout=60)
    assert (process.returncode, printed) == (2, "")
    assert complaints.startswith("error: ")
    assert str(chain) in complaints
    assert name in complaints
    assert ("damaged" in complaints) == (name in ("SIGSEGV", "SIGABRT"))
    assert complaints.count("\n") == 1


def is_gone(pid):
    for _ in range(200):
        state = Path(f"/proc/{pid}/stat")
        if not state.exists() or state.read_text().rsplit(")", 1)[1].split()[0] == "Z":
            return True
        time.sleep(0.05)
    return False


def test_leaves_of_an_asset_are_opened_in_a_box_before_branches_take_them(chain, parentheses, tmp_path):
    cloud, spray = tmp_path / "tree.ply", tmp_path / "spray"
    write_ply(cloud, cloud_of(small_tree(), per_m2=1000))
    assert run("scatter", "-n", 3, "-o", spray) == 0
    words = ("branches", cloud, "--no-preview", "-o", tmp_path / "out", "--leaves")
    for asset, environment, what in (
        (chain, {"USDFOLIAGE_CPU_LIMIT_S": "3"}, f"error: {chain} "),  # USD's stack ends, or its time
        (parentheses, {"USDFOLIAGE_MEMORY_LIMIT_GIB": "0.6"}, f"error: {parentheses} takes more than 0.6 GiB"),
    ):
        code, printed, complaints = end(*words, asset, **environment)
        assert (code, printed) == (2, "")
        assert complaints.startswith(what)
        assert complaints.count("\n") == 1
        assert not (tmp_path / "out").exists()
    code, printed, complaints = end(*words, chain, USDFOLIAGE_TEXT_LIMIT_MIB="0.1")
    assert (code, printed) == (2, "")
    assert "is a layer of 1 MiB of text, more than 0" in complaints
    assert complaints.count("\n") == 1
    code, printed, complaints = end(*words, tmp_path / "none.usda")
    assert (code, complaints) == (
        2,
        f"error: {tmp_path / 'none.usda'} does not exist; name an asset's folder or its .usda\n",
    )
    code, printed, complaints = end(*words, spray)
    assert (code, complaints) == (0, "")
    assert "asset: " in printed


def blocked_signals(pid):
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("SigBlk:")).split()[1], 16)


def is_interruptible(pid):
    for _ in range(200):  # every signal waits for moments, whenever a process starts another
        if not blocked_signals(pid) & 1 << signal.SIGINT - 1:
            return True
        time.sleep(0.05)
    return False


def test_interrupts_wait_until_the_child_can_be_interrupted(chain):
    process = start("info", chain)
    while not children(process.pid):
        assert process.poll() is None
    (child,) = children(process.pid)
    assert blocked_signals(child) & 1 << signal.SIGINT - 1  # Python would end with a traceback while it starts
    assert child_at_work(process) == child
    assert is_interruptible(child)
    os.kill(child, signal.SIGINT)
    process.send_signal(signal.SIGINT)  # Ctrl-C where both are in the terminal's group
    _, complaints = process.communicate(timeout=60)
    assert process.returncode in (-signal.SIGINT, 2, 130)
    assert "Traceback" not in complaints


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGKILL])
def test_the_child_ends_with_its_parent(chain, number):
    process = start("info", chain)
    child = child_at_work(process)
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode in (-number, 130)
    assert is_gone(child)


def test_a_good_asset_is_described_as_before(tmp_path):
    spray = tmp_path / "spray"
    assert run("scatter", "-n", 3, "-o", spray) == 0
    code, printed, complaints = end("info", spray)
    assert (code, complaints) == (0, "")
    assert "leaves" in printed
    code, printed, _ = end("validate", spray)
    assert code == 0
    assert "0 errors" in printed
    assert end("edit", spray, "--width", 2, "-o", tmp_path / "look.usda")[0] == 0
    assert end("bake", tmp_path / "look.usda", "-o", tmp_path / "baked")[0] == 0
    assert end("info", "--help")[0] == 0
    assert end("info")[0] == 2


def test_limits_that_are_no_numbers_are_refused(tmp_path):
    for value in ("much", "-1", "nan", "inf", "0"):
        code, _, complaints = end("info", tmp_path, USDFOLIAGE_MEMORY_LIMIT_GIB=value)
        assert code == 2
        assert complaints.startswith(f"error: USDFOLIAGE_MEMORY_LIMIT_GIB is '{value}'")


def test_larger_files_may_take_more(monkeypatch):
    for name in ("USDFOLIAGE_MEMORY_LIMIT_GIB", "USDFOLIAGE_TIME_LIMIT_S"):
        monkeypatch.delenv(name, raising=False)
    small, large = allow("a", "info", 0), allow("a", "info", 40 << 20)
    assert small.memory_bytes == 2 << 30
    assert large.memory_bytes > small.memory_bytes
    assert large.seconds > small.seconds == BoxLimits().base_s
    assert large.cpu_s > small.cpu_s == BoxLimits().base_cpu_s
    million = allow("a", "info", 23_000_000)  # prims, in text; a crate of them is smaller
    assert million.cpu_s < 57
    assert million.memory_bytes < 2.9e9
    assert large.output_bytes == small.output_bytes == 16 << 30
    assert small.memory_bytes < small.drawing_bytes < large.drawing_bytes
    assert allow("a", "view", 0).until_drawing  # its user closes it
    assert not small.until_drawing
    machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    assert allow("a", "info", 1 << 50).memory_bytes < machine
    monkeypatch.setenv("USDFOLIAGE_MEMORY_LIMIT_GIB", "3")
    assert allow("a", "info", 1 << 50).memory_bytes == 3 << 30
    monkeypatch.setenv("USDFOLIAGE_TIME_LIMIT_S", "x")
    with pytest.raises(FoliageError, match="USDFOLIAGE_TIME_LIMIT_S"):
        allow("a", "info", 0)


def test_files_with_holes_count_for_what_they_take(tmp_path):
    with (tmp_path / "large.usdc").open("wb") as file:
        file.truncate(1 << 40)
    (tmp_path / "pipe").symlink_to("/dev/zero")
    assert measure_composition(tmp_path).size_bytes < 1 << 20
    assert measure_composition(tmp_path / "large.usdc").size_bytes < 1 << 20


def test_an_asset_is_named_also_before_the_child_has_begun(tmp_path):
    asset = tmp_path / "plant.usda"
    asset.write_text("#usda 1.0\n")
    words = [sys.executable, "-m", "usdfoliage", "info", "--json", str(asset)]
    environment = {**os.environ, "USDFOLIAGE_TIME_LIMIT_S": "0.001"}
    ended = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"error: {asset} was not read within")


def test_a_child_that_has_printed_its_result_takes_nothing_down(tmp_path):
    """A large stage takes seconds for that; a limit or a signal then would put an error below a result."""
    spray = tmp_path / "spray"
    assert run("scatter", "-n", 3, "-o", spray) == 0
    (tmp_path / "sitecustomize.py").write_text(
        "import atexit, sys, time\n"
        "if any('boxed.py' in word for word in sys.orig_argv): atexit.register(time.sleep, 90)\n"
    )
    paths = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH"))))
    code, printed, complaints = end("info", spray, PYTHONPATH=paths, USDFOLIAGE_TIME_LIMIT_S="60")
    assert (code, complaints) == (0, "")
    assert "leaves" in printed
    code, printed, complaints = end(
        "info", tmp_path / "sitecustomize.py", PYTHONPATH=paths, USDFOLIAGE_TIME_LIMIT_S="60"
    )
    assert (code, printed, complaints.count("error: ")) == (2, "", 1)


def test_a_limit_that_is_passed_below_an_error_adds_none(tmp_path):
    """What a stage takes while an error is printed, or while it is taken down after that, ends the child no more."""
    broken = tmp_path / "broken.usda"
    broken.write_text("#usda 1.0\n{")
    (tmp_path / "sitecustomize.py").write_text(
        "import builtins, sys, time\n"
        "def print_slowly(text='', *more, before=print, **settings):\n"
        "    taken = bytearray(b'a') * (900 << 20) if str(text).startswith('error: ') else b''\n"
        "    time.sleep(1 if taken else 0)\n"
        "    before(text, *more, **settings)\n"
        "if any('boxed.py' in word for word in sys.orig_argv): builtins.print = print_slowly\n"
    )
    paths = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH"))))
    code, printed, complaints = end("info", broken, PYTHONPATH=paths, USDFOLIAGE_MEMORY_LIMIT_GIB="0.6")
    assert (code, printed, complaints.count("error: ")) == (2, "", 1)
    assert "of memory" not in complaints
