"""Kills and interrupts while an asset that was replaced is removed: all of it goes, or all of it is kept."""

import os
import signal
import subprocess
import sys
import textwrap

import pytest
from usdfoliage.asset import publish
from usdfoliage.asset.asset_record import FILES_LIST
from usdfoliage.asset.publish import publish_folder

from tests.asset.test_publish import left_over, publish_asset, which, write_asset

KILLED = """
import os, signal
from pathlib import Path
from usdfoliage.asset import publish
from tests.asset.test_publish import write_asset

retire, unlink = publish.retire, Path.unlink
left = {removed}

def remove(self, *words, **more):
    global left
    if not left:
        os.kill(os.getpid(), signal.SIGKILL)
    left -= 1
    unlink(self, *words, **more)

def begin_to_remove(*words, **more):
    Path.unlink = remove
    retire(*words, **more)

publish.retire = begin_to_remove
if {two_renames}:
    publish.exchange = lambda first, second: False
with publish.publish_folder(Path({out!r}), keep_old={keep}) as folder:
    write_asset(folder, "new")
    if {keep}:
        publish.retire = lambda *words, **more: os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def out(tmp_path):
    """An asset of an earlier run."""
    path = tmp_path / "assets" / "oak"
    publish_asset(path, "old")
    return path


def kill_a_run(out, removed, keep=False, two_renames=False):
    """Kill a run that replaces an asset, when it has removed so many of the old files, or keeps them."""
    program = textwrap.dedent(KILLED).format(out=str(out), removed=removed, keep=keep, two_renames=two_renames)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert which(out) == "new"


@pytest.mark.parametrize("two_renames", [False, True])
@pytest.mark.parametrize("removed", [0, 1, 2, 3])
def test_after_a_kill_in_the_middle_of_its_removal_the_rest_goes_too(out, removed, two_renames):
    kill_a_run(out, removed, two_renames=two_renames)
    publish_asset(out, "newer")
    assert which(out) == "newer"
    assert left_over(out) == []


def test_a_file_of_others_outlives_a_removal_that_was_broken_off(out):
    kill_a_run(out, 2)
    (rest,) = out.parent.glob(".*usdfoliage-new")
    assert (rest / FILES_LIST).exists()
    (rest / "mine.txt").write_text("precious")
    publish_asset(out, "newer")
    assert left_over(out) == ["oak.old-1"]
    assert [path.name for path in out.with_name("oak.old-1").rglob("*")] == ["mine.txt"]


def test_what_is_kept_on_request_is_kept_after_a_kill_too(out):
    kill_a_run(out, 0, keep=True)
    publish_asset(out, "newer")
    assert left_over(out) == ["oak.old-1"]
    assert which(out.with_name("oak.old-1")) == "old"


@pytest.mark.parametrize("moment", ["_take_place", "_why_not_whole", "retire"])
def test_an_interrupt_while_the_new_asset_takes_its_place_comes_after_it(out, monkeypatch, moment):
    done = getattr(publish, moment)

    def interrupt(*words, **more):
        signal.raise_signal(signal.SIGINT)
        return done(*words, **more)

    monkeypatch.setattr(publish, moment, interrupt)
    with pytest.raises(KeyboardInterrupt):
        publish_asset(out, "new")
    assert which(out) == "new"
    assert left_over(out) == []


def test_an_interrupt_while_the_rest_of_a_killed_run_goes_comes_after_it(out, monkeypatch):
    kill_a_run(out, 1)
    retire = publish.retire

    def interrupt(*words, **more):
        os.kill(os.getpid(), signal.SIGINT)
        return retire(*words, **more)

    monkeypatch.setattr(publish, "retire", interrupt)
    with pytest.raises(KeyboardInterrupt), publish_folder(out) as folder:
        write_asset(folder, "newer")
    assert which(out) == "new"
    assert left_over(out) == []
