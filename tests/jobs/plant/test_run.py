"""Whole builds whose processes are killed, whose results are damaged, and that meet."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.executor_choice import ExecutorChoice
from usdfoliage.jobs.plant.executors import Done, TaskOrder
from usdfoliage.jobs.plant.finish import BuiltPlant
from usdfoliage.jobs.plant.plant_settings import PlantSettings
from usdfoliage.jobs.plant.run import build_plants
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.worker import run_named_task
from usdfoliage.jobs.work.settings_file import read_settings_file
from usdfoliage.remarks import as_plan_setting, warnings_of

from tests.support.dask_clusters import dask_cluster
from tests.support.fake_builds import is_alive, wait_until
from tests.support.small_builds import digests, spawned_by, write_quick_plan, write_small_capture

IN_PROCESS = ExecutorChoice()


@pytest.fixture(scope="module")
def given(tmp_path_factory) -> Path:
    """With capture, plan.toml, and built/plant."""
    folder = tmp_path_factory.mktemp("given")
    write_small_capture(folder / "capture")
    write_quick_plan(folder / "plan.toml")
    assert build(request_of(folder, folder / "built")).verdict == "built"
    return folder


def request_of(given: Path, folder: Path) -> BuildRequest:
    return BuildRequest(
        capture=given / "capture",
        output=folder / "plant",
        name="plant",
        settings=read_settings_file(given / "plan.toml", BuildSettings()),
        work=folder / "work",
    )


def build(request: BuildRequest, where: ExecutorChoice = IN_PROCESS) -> BuiltPlant:
    ((_, made),) = build_plants([request], where)
    return made


def start(given: Path, folder: Path, *options: str) -> subprocess.Popen[bytes]:
    """The same build by the command line, in a process group of its own."""
    words = [
        "build",
        given / "capture",
        "-o",
        folder / "plant",
        "--plan",
        given / "plan.toml",
        "--work",
        folder / "work",
    ]
    return subprocess.Popen(
        [sys.executable, "-m", "usdfoliage", *map(str, words), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def stamps(folder: Path) -> dict[Path, int]:
    """Of the finished tasks: a glob finds the files that a killed run was writing as well."""
    files = (folder / "work" / "tasks").glob("[!.]*.json")
    return {path: path.stat().st_mtime_ns for path in files}


@pytest.mark.parametrize("finished", [1, pytest.param(5, marks=pytest.mark.slow)])
def test_a_killed_build_goes_on_where_it_was(given, tmp_path, finished):
    process = start(given, tmp_path)
    wait_until(lambda: len(stamps(tmp_path)) >= finished or process.poll() is not None)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    before = stamps(tmp_path)
    assert before
    made = build(request_of(given, tmp_path))
    assert made.verdict == "built"
    assert {path: mark for path, mark in stamps(tmp_path).items() if path in before} == before
    assert digests(tmp_path / "plant") == digests(given / "built" / "plant")
    assert not list((tmp_path / "work" / "results").glob(".*"))


def damage_result(folder: Path) -> None:
    """An altered byte, of the same length."""
    path = next((folder / "work" / "results").glob("*/capture/*/cloud.ply"))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def cut_result(folder: Path) -> None:
    path = next((folder / "work" / "results").glob("*/capture/*/cloud.ply"))
    path.write_bytes(path.read_bytes()[:-100])


def cut_view(folder: Path) -> None:
    """A file that several tasks share."""
    path = next((folder / "work" / "views").glob("*/planes/0/*.npz"))
    path.write_bytes(path.read_bytes()[:50])


def damage_stamp(folder: Path) -> None:
    for path in (folder / "work" / "tasks").glob("*.json"):
        path.write_text(path.read_text().replace('"seconds": ', '"seconds": 1'))


@pytest.mark.parametrize(
    "damage", [damage_result, pytest.param(cut_result, marks=pytest.mark.slow), cut_view, damage_stamp]
)
def test_damage_is_found_and_made_good(given, tmp_path, damage: Callable[[Path], None]):
    request = request_of(given, tmp_path)
    process = start(given, tmp_path, "--only", "cloud")
    assert process.wait() == 0, process.stderr.read()
    process.stderr.close()
    damage(tmp_path)
    assert build(request).verdict == "built"
    assert digests(tmp_path / "plant") == digests(given / "built" / "plant")


def test_two_builds_at_once_share_their_work(given, tmp_path):
    other = start(given, tmp_path)
    made = build(request_of(given, tmp_path))
    assert other.wait() == 0, other.stderr.read()
    other.stderr.close()
    assert made.verdict == "built"
    assert digests(tmp_path / "plant") == digests(given / "built" / "plant")
    assert not list((tmp_path / "work" / "results").glob(".*"))


def test_a_farm_that_ends_a_build_gets_it_ended_in_good_order(given, tmp_path):
    process = start(given, tmp_path, "--jobs", "2")
    wait_until(lambda: bool(stamps(tmp_path)))
    workers = spawned_by(process.pid)
    process.terminate()
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.decode().strip().splitlines()[-1] == "error: interrupted; the same command goes on from here"
    assert workers
    assert not any(is_alive(pid) for pid in workers)


def test_a_worker_that_is_killed_costs_its_task_only(given, tmp_path):
    killed: list[int] = []

    def kill_one() -> None:
        wait_until(lambda: bool(stamps(tmp_path)))
        killed.append(spawned_by(os.getpid())[0])
        os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill_one)
    killer.start()
    made = build(request_of(given, tmp_path), ExecutorChoice(jobs=2))
    killer.join()
    assert killed
    assert made.verdict == "built", made.error
    assert digests(tmp_path / "plant") == digests(given / "built" / "plant")


@pytest.mark.slow
@pytest.mark.parametrize("nanny", ["--nanny", "--no-nanny"])
def test_a_dask_worker_that_is_killed_costs_its_task_only(given, tmp_path, nanny):
    with dask_cluster(tmp_path, 2, nanny) as cluster:
        killed: list[int] = []

        def kill_one() -> None:
            wait_until(lambda: bool(stamps(tmp_path)))
            pid = cluster.workers[0].pid
            killed.append(spawned_by(pid)[0] if nanny == "--nanny" else pid)
            os.kill(killed[0], signal.SIGKILL)

        killer = threading.Thread(target=kill_one)
        killer.start()
        made = build(request_of(given, tmp_path), ExecutorChoice(scheduler=cluster.address))
        killer.join()
        assert killed
        assert made.verdict == "built", made.error
    assert digests(tmp_path / "plant") == digests(given / "built" / "plant")


def test_an_asset_that_is_in_its_place_is_left_alone_and_one_that_was_changed_is_not(given, tmp_path):
    request = request_of(given, tmp_path)
    assert build(request).verdict == "built"
    interface = tmp_path / "plant" / "plant.usda"
    before = interface.stat().st_mtime_ns
    made = build(request)
    assert made.asset == interface
    assert interface.stat().st_mtime_ns == before
    layer = tmp_path / "plant" / "payload" / "payload.usda"
    layer.write_text(layer.read_text() + "# touched\n")
    assert build(request).verdict == "built"
    assert digests(tmp_path / "plant") == digests(given / "built" / "plant")


def test_two_tasks_that_fail_at_once_end_their_plant_once(given, tmp_path, monkeypatch):
    def fail(order: TaskOrder, *_: object) -> Done:
        if order.name.startswith("matching"):
            time.sleep(0.2)
            return Done(name=order.name, seconds=0.0, was_run=True, error=f"{order.name} cannot be")
        return run_named_task(order)

    from concurrent.futures import ThreadPoolExecutor
    from contextlib import contextmanager

    from usdfoliage.jobs.plant import run as runs
    from usdfoliage.jobs.plant import workers
    from usdfoliage.jobs.plant.executors import Workers

    @contextmanager
    def open_threads(jobs):
        yield Workers(open_executor=lambda: ThreadPoolExecutor(jobs), count=lambda: jobs)

    monkeypatch.setattr(runs, "run_named_task", fail)
    monkeypatch.setattr(workers, "open_processes", open_threads)
    ended = list(build_plants([request_of(given, tmp_path)], ExecutorChoice(jobs=2)))
    assert len(ended) == 1
    assert "cannot be" in ended[0][1].explain(as_plan_setting)


def test_results_that_vanish_while_others_are_made_are_made_again_but_not_for_ever(given, tmp_path, monkeypatch):
    from usdfoliage.jobs.plant import run as runs

    lost: list[str] = []

    def lose(order: TaskOrder, *_: object) -> Done:
        if order.name == "cloud" and len(lost) < max_lost:
            lost.append(order.name)
            return Done(name=order.name, seconds=0.0, was_run=False, lost=True)
        return run_named_task(order)

    monkeypatch.setattr(runs, "run_named_task", lose)
    max_lost = 99
    assert "vanish as soon as they are made" in build(request_of(given, tmp_path)).explain(as_plan_setting)
    assert len(lost) == runs.MAX_PLANS
    lost.clear()
    max_lost = 2
    assert build(request_of(given, tmp_path)).verdict == "built"


def test_on_a_full_disk_nothing_is_half_there_and_with_room_the_build_goes_on(given, tmp_path, small_disk):
    made = build(request_of(given, small_disk))
    assert made.verdict == "failed"
    assert "No space left on device" in made.explain(as_plan_setting)
    assert "the same command goes on from here" in made.explain(as_plan_setting)
    assert not (small_disk / "plant").exists()
    subprocess.run(["mount", "-o", "remount,size=3m", str(small_disk)], check=True)
    made = build(request_of(given, small_disk))  # leaves were found, and could not be written: they are not left out
    assert made.verdict == "failed"
    assert "No space left on device" in made.explain(as_plan_setting)
    before = stamps(small_disk)
    subprocess.run(["mount", "-o", "remount,size=100m", str(small_disk)], check=True)
    assert build(request_of(given, small_disk)).verdict == "built"
    assert {path: mark for path, mark in stamps(small_disk).items() if path in before} == before
    assert digests(small_disk / "plant") == digests(given / "built" / "plant")


def test_warnings_name_photographs_as_the_capture_does(given, tmp_path):
    capture = write_small_capture(tmp_path / "oak")
    (capture / "images" / "000.jpg").write_bytes(b"no photograph")
    made = build(replace(request_of(given, tmp_path), capture=capture))
    (warning,) = [each.text for each in warnings_of(made.remarks) if "left out" in each.text]
    assert "1 of 4 photographs are left out: 000.jpg: oak/images/000.jpg is not an image" in warning
    page = (tmp_path / "plant" / "report" / "index.html").read_text()
    assert "000.jpg" in page
    assert str(tmp_path) not in page


def test_a_photograph_that_is_withheld_makes_nothing_and_measures_the_asset(given, tmp_path):
    request = request_of(given, tmp_path)
    request = replace(request, settings=replace(request.settings, plant=PlantSettings(hold_back=2)))
    made = build(request)
    assert made.verdict == "built"
    assert [view["name"] for view in made.withheld["views"]] == ["002.jpg"]
    assert made.withheld["mean"]["precision"] > 0.9  # of the few leaves that three photographs show
    stored = json.loads((tmp_path / "plant" / "report" / "withheld.json").read_text())
    assert stored == made.withheld
    page = (tmp_path / "plant" / "report" / "index.html").read_text()
    assert "002.jpg, of which nothing was made" in page
    results = tmp_path / "work" / "results"
    for used in results.glob("*/capture/*/images"):
        assert sorted(path.name for path in used.iterdir()) == ["000.jpg", "001.jpg", "003.jpg"]
    for masks in results.glob("*/capture/*/masks"):
        assert "002.jpg.png" not in {path.name for path in masks.iterdir()}
    assert [path.name for path in results.glob("*/withheld/*/images/*")] == ["002.jpg"]
    assert not any("002" in path.name for path in results.glob("*/capture/*/given_depth/*"))
    before = stamps(tmp_path)
    assert not build(request).seconds
    assert stamps(tmp_path) == before
