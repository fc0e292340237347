"""Child processes that end with their parent."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from usdfoliage.files.children import bound_command

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux ends them")

PARENT = """
import subprocess, sys, time
from usdfoliage.files.children import bound_command
child = subprocess.Popen(bound_command([sys.executable, "-c", "import time; time.sleep(120)"]))
print(child.pid, flush=True)
time.sleep(120)
"""


def ends(pid: int) -> bool:
    for _ in range(200):
        state = Path(f"/proc/{pid}/stat")
        if not state.exists() or state.read_text().rsplit(")", 1)[1].split()[0] == "Z":
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_program_ends_when_its_parent_is_killed(number):
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True) as parent:
        child = int(parent.stdout.readline())
        assert Path(f"/proc/{child}").exists()
        parent.send_signal(number)
        parent.wait(timeout=30)
    assert ends(child)


def test_a_child_whose_parent_has_ended_already_does_nothing():
    words = bound_command([sys.executable, "-c", "print('at work')"])
    words[4] = str(os.getpid() + 1)  # nobody's parent
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")


def test_a_program_has_its_words_and_its_exit_code():
    words = bound_command([sys.executable, "-c", "import sys; print(sys.argv[1:]); sys.exit(7)", "a b", "-c"])
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (7, "['a b', '-c']\n")


def test_a_program_that_cannot_be_started_is_named(tmp_path):
    done = subprocess.run(bound_command([str(tmp_path / "none")]), capture_output=True, text=True, check=False)
    assert done.returncode == 127
    assert done.stderr == f"{tmp_path / 'none'} cannot be started: No such file or directory\n"
