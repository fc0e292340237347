"""Processes of this machine that are interrupted while they start."""

import subprocess
import sys
from pathlib import Path

SCRIPT = """
import os
import signal
import threading
import time
from multiprocessing import util

from usdfoliage.cli.interrupts import handle_interrupts
from usdfoliage.jobs.plant.processes import open_processes

spawn = util.spawnv_passfds

def spawn_and_interrupt(path, args, passed):
    pid = spawn(path, args, passed)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.1)
    return pid

if __name__ == "__main__":
    handle_interrupts()
    ended = threading.Event()
    threading.Thread(target=ended.wait, daemon=True).start()  # it takes the signals that the main thread blocks
    with open_processes(1) as workers:  # the tracker of resources starts with its pipe
        executor = workers.open_executor()
        util.spawnv_passfds = spawn_and_interrupt
        try:
            executor.submit(os.getpid)
            print("no interrupt came")
        except KeyboardInterrupt:
            print("interrupted")
    ended.set()
"""


def test_an_interrupt_waits_until_a_process_has_started(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60, check=True)
    assert ended.stdout.strip() == "interrupted"
    assert "Traceback" not in ended.stderr


TRACKER = """
import os
import signal
import time

from usdfoliage.jobs.plant.processes import open_processes

if __name__ == "__main__":
    from multiprocessing.resource_tracker import _resource_tracker as tracker
    for _ in range(2):
        with open_processes(1) as workers:
            executor = workers.open_executor()
            os.kill(tracker._pid, signal.SIGKILL)
            time.sleep(0.5)
            print(executor.submit(abs, -7).result())
"""


def test_a_helper_of_multiprocessing_that_is_killed_is_no_matter(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(TRACKER)
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=True)
    assert ended.stdout.split() == ["7", "7"]
    assert "resource_tracker: process died" not in ended.stderr
