"""Builds whose stages do next to nothing: what is kept of a task, and what is not."""

import errno
import fcntl
import os
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from usdfoliage.errors import CaptureError, FoliageError, WriteError
from usdfoliage.jobs.plant import run as runs
from usdfoliage.jobs.plant import worker
from usdfoliage.jobs.plant.call import BuildRequest, StageCall
from usdfoliage.jobs.plant.executor_choice import ExecutorChoice
from usdfoliage.jobs.plant.executors import Done, TaskOrder
from usdfoliage.jobs.plant.finish import BuiltPlant, finish_plant
from usdfoliage.jobs.plant.inputs import find_inputs
from usdfoliage.jobs.plant.library import describe_built
from usdfoliage.jobs.plant.run import build_plants
from usdfoliage.jobs.plant.settings import BranchStageSettings, BuildSettings
from usdfoliage.jobs.plant.stages.assemble import assemble_asset, provenance_of
from usdfoliage.jobs.plant.store import ResultFile, Store
from usdfoliage.jobs.plant.summary import StageSummary, read_summary, write_summary
from usdfoliage.jobs.plant.tasks import BuildPlan
from usdfoliage.remarks import as_plan_setting, remark

Stage = Callable[[StageCall], None]


@pytest.fixture
def request_of_two(tmp_path: Path) -> BuildRequest:
    """A plant of two small photographs."""
    for number in range(2):
        write_photograph(tmp_path / "fern" / "images" / f"{number}.png", 9 * number)
    return BuildRequest(
        capture=tmp_path / "fern",
        output=tmp_path / "out",
        name="fern",
        settings=BuildSettings(),
        work=tmp_path / "work",
    )


@pytest.fixture
def set_stages(monkeypatch) -> Callable[..., None]:
    """Stages that only write an empty summary, but for those that are given; nothing is published."""

    def as_stage(body: Stage | None) -> Callable[[StageCall], tuple[ResultFile, ...]]:
        def stage(call: StageCall) -> tuple[ResultFile, ...]:
            write_summary(call.out, StageSummary())
            if body is not None:
                body(call)
            return ()

        return stage

    def set_stages(**bodies: Stage) -> None:
        monkeypatch.setattr(worker, "STAGES", {name: as_stage(bodies.get(name)) for name in worker.STAGES})
        monkeypatch.setattr(runs, "finish_plant", lambda made, plan, executor: made)

    return set_stages


def write_photograph(path: Path, grey: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((32, 32, 3), grey, np.uint8))


def build(request: BuildRequest) -> BuiltPlant:
    ((_, made),) = build_plants([request], ExecutorChoice())
    return made


@pytest.mark.parametrize("change", ["written", "replaced", "removed", "added", "unreadable"])
def test_of_a_photograph_that_changes_while_it_is_read_nothing_is_kept(request_of_two, set_stages, change):
    photograph = request_of_two.capture / "images" / "0.png"
    good, other = photograph.read_bytes(), photograph.with_name("2.png")
    is_copying = True

    def read(call: StageCall) -> None:
        for folder in (call.scratch, call.store.views(call.task.key)):
            folder.mkdir(parents=True)
        if is_copying and change == "written":
            write_photograph(photograph, 200)
        elif is_copying and change == "replaced":
            photograph.unlink()
            write_photograph(photograph, 200)
        elif is_copying and change == "added":
            write_photograph(other, 200)
        elif is_copying:
            photograph.unlink()
            if change == "unreadable":
                photograph.mkdir()
        (call.out / "seen.png").write_bytes(photograph.read_bytes())

    set_stages(poses=read)
    made = build(request_of_two)
    assert made.verdict == "failed"
    assert made.failed == "poses"
    assert f"{request_of_two.capture} changed while it was read: " in made.error
    assert ("2.png" if change == "added" else "0.png") in made.error or change in ("removed", "unreadable")
    for part in ("scratch", "views", "results"):
        assert not list((request_of_two.work / part).iterdir())

    is_copying = False
    if change == "unreadable":
        photograph.rmdir()
    other.unlink(missing_ok=True)
    photograph.write_bytes(good)  # the same input as at first
    assert build(request_of_two).verdict == "built"
    (seen,) = request_of_two.work.glob("results/*/seen.png")
    assert seen.read_bytes() == good


def test_an_unwritten_file_is_one_of_the_task_and_an_unread_file_one_of_the_capture(request_of_two, set_stages):
    places: list[Path] = []

    def fail(kind: type[FoliageError]) -> Stage:
        def stage(call: StageCall) -> None:
            places.append(call.scratch / "fern" / "cloud.ply")
            raise kind(f"something is wrong with {places[-1]}", f"look at {places[-1]}")

        return stage

    set_stages(poses=fail(WriteError))
    made = build(request_of_two)
    assert (made.error, made.remedy) == (f"something is wrong with {places[-1]}", (f"look at {places[-1]}",))
    set_stages(poses=fail(CaptureError))
    made = build(request_of_two)
    given = request_of_two.capture / "cloud.ply"
    assert (made.error, made.remedy) == (f"something is wrong with {given}", (f"look at {given}",))


def test_a_summary_has_the_capture_by_its_name_and_no_place_of_the_work_folder(request_of_two, set_stages):
    def summarize(call: StageCall) -> None:
        broken, cloud = call.store.folder / "views" / "a.npz", call.scratch / request_of_two.capture.name / "cloud.ply"
        failed = remark("part-failed", f"{cloud} is broken", remedy=(f"look at {broken}",))
        write_summary(call.out, StageSummary(failure=f"{broken} is broken", remarks=[failed]))

    set_stages(leaves=summarize)
    build(request_of_two)
    summaries = [read_summary(path.parent) for path in request_of_two.work.glob("results/*/summary.json")]
    (summary,) = (each for each in summaries if each.failure)
    assert summary.failure == "…/views/a.npz is broken"
    assert summary.remarks[0].text == f"{request_of_two.capture.name}/cloud.ply is broken"
    assert summary.remarks[0].remedy == ("look at …/views/a.npz",)


def make_poor(runs_of_it: list[str]) -> Stage:
    """An asset without thumbnail, with a file that only this one has."""

    def make(call: StageCall) -> None:
        runs_of_it.append(call.task.name)
        (call.out / f"{len(runs_of_it)}.bin").write_bytes(b"leaves")
        write_summary(call.out, StageSummary(poor=True))

    return make


def test_a_poor_result_that_appears_while_a_run_waits_for_it_is_good_for_that_run(
    request_of_two, set_stages, monkeypatch
):
    made: list[str] = []
    is_waiting, is_over = threading.Event(), threading.Event()
    ended: list[BuiltPlant] = []
    other = threading.Thread(target=lambda: ended.append(build(request_of_two)))

    def run(order: TaskOrder, *_: object) -> Done:
        is_others = threading.current_thread() is other and order.name == "asset"
        if is_others:
            is_waiting.set()
        done = worker.run_named_task(order)
        if is_others:
            is_over.set()
        return done

    def make(call: StageCall) -> None:
        make_poor(made)(call)
        if len(made) == 1:
            other.start()
            assert is_waiting.wait(60)

    def turn(call: StageCall) -> None:
        assert is_over.wait(60)  # the other run has seen the poor asset, and what does it do?
        (call.result_of("asset") / f"{len(made)}.bin").read_bytes()

    set_stages(asset=make, turntable=turn)
    monkeypatch.setattr(runs, "run_named_task", run)
    assert build(request_of_two).verdict == "built"
    other.join()
    assert [plant.verdict for plant in ended] == ["built"]
    assert made == ["asset"]
    assert build(request_of_two).verdict == "built"  # a run that begins when it is there makes it again
    assert made == ["asset", "asset"]


@pytest.mark.parametrize("is_read", [True, False])
def test_a_result_that_another_run_makes_anew_under_a_reader_is_read_again(request_of_two, set_stages, is_read):
    made: list[str] = []
    turned: list[str] = []

    def turn(call: StageCall) -> None:
        turned.append(call.task.name)
        if len(turned) == 1:
            assert build(replace(request_of_two, only=("asset",))).verdict == "built"  # poor, and so made again
        if is_read:
            (call.result_of("asset") / f"{len(turned)}.bin").read_bytes()

    set_stages(asset=make_poor(made), turntable=turn)
    result = build(request_of_two)
    assert result.verdict == "built", result.error
    assert made == ["asset", "asset"]
    assert turned == ["turntable", "turntable"]


def test_a_stage_that_fails_by_itself_is_not_tried_again(request_of_two, set_stages):
    turned: list[str] = []

    def turn(call: StageCall) -> None:
        turned.append(call.task.name)
        (call.out / "none" / "picture.png").read_bytes()

    set_stages(turntable=turn)
    assert build(request_of_two).failed == "turntable"
    assert turned == ["turntable"]


def test_a_report_that_vanishes_before_it_is_published_is_reported(request_of_two, set_stages, monkeypatch):
    def lose(made: BuiltPlant, plan: BuildPlan, executor: str) -> BuiltPlant:
        request_of_two.store.stamp(plan.tasks["report"].key).unlink()
        return finish_plant(made, plan, executor)

    set_stages()
    monkeypatch.setattr(runs, "finish_plant", lose)
    made = build(request_of_two)
    assert "vanished as soon as it was made; run the same command again" in made.explain(as_plan_setting)


def test_where_nothing_could_be_made_the_error_has_the_reasons_each_time(request_of_two, set_stages):
    summaries = {
        "branches": StageSummary(
            remarks=[remark("branches-left-out", "the plant has no branches: the cloud shows no stem at a root")]
        ),
        "leaves": StageSummary(failure="12 leaves are in the pictures, 20 needed", remedy=("take closer photographs",)),
        "crown": StageSummary(failure="the cloud has 3 points, 100 needed"),
    }

    def summarize(call: StageCall) -> None:
        write_summary(call.out, summaries[call.task.name])

    set_stages(branches=summarize, leaves=summarize, crown=summarize, asset=assemble_asset)
    first, second = build(request_of_two), build(request_of_two)
    for made in (first, second):
        assert made.failed == "asset"
        assert made.error == (
            f"neither branches nor leaves nor a crown could be made of {request_of_two.capture}. Branches: the plant "
            "has no branches: the cloud shows no stem at a root. Leaves: 12 leaves are in the pictures, 20 needed. "
            "Crown: the cloud has 3 points, 100 needed"
        )
        assert made.remedy == ("for the leaves, ", "take closer photographs")
        assert not made.is_fault
    assert set(second.seconds or {}) == set()
    described = describe_built(second, request_of_two.output.parent)
    assert (described.message, described.remedy) == (second.error, second.remedy)

    none = replace(request_of_two.settings, branches=BranchStageSettings(make="off"))
    assert "Branches: not asked for. Leaves: 12" in build(replace(request_of_two, settings=none)).error


@pytest.mark.parametrize("has_locks", [True, False])
def test_without_locks_every_run_has_a_scratch_folder_of_its_own(request_of_two, set_stages, monkeypatch, has_locks):
    used: list[Path] = []

    def find(call: StageCall) -> None:
        used.append(call.scratch)
        call.scratch.mkdir(parents=True)
        (call.scratch / "half.bin").write_bytes(b"poses")
        if len(used) == 1 and not has_locks:  # another run, from its beginning to its end
            assert build(replace(request_of_two, only=("poses",))).verdict == "built"
        assert (call.scratch / "half.bin").read_bytes() == b"poses"

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    if not has_locks:
        monkeypatch.setattr(fcntl, "flock", refuse)
    set_stages(poses=find)
    made = build(request_of_two)
    assert made.verdict == "built", made.error
    assert len(set(used)) == len(used) == (1 if has_locks else 2)
    if has_locks:
        assert used == [request_of_two.store.scratch(used[0].name)]  # the same for a run that goes on
    assert not list((request_of_two.work / "scratch").iterdir())


@pytest.mark.parametrize("name", ["images/a\\b.png", "images/masks\\2/a.png", os.fsdecode(b"images/\xff.png")])
@pytest.mark.parametrize("is_capture", [True, False])
def test_names_that_cannot_be_recorded_are_refused_before_anything_runs(request_of_two, set_stages, name, is_capture):
    if not is_capture:
        (request_of_two.capture / "images").rename(request_of_two.capture.with_name("photographs"))
        request_of_two = replace(request_of_two, capture=request_of_two.capture.with_name("photographs"))
        name = name.removeprefix("images/").replace("/", "_")
    write_photograph(request_of_two.capture / "new.png", 50)
    path = request_of_two.capture / name
    path.parent.mkdir(parents=True, exist_ok=True)
    (request_of_two.capture / "new.png").rename(path)
    set_stages(asset=provenance_of)
    made = build(request_of_two)
    assert made.error.startswith(str(path))
    assert made.explain(as_plan_setting).endswith("; rename it")
    assert not made.is_fault
    assert not made.seconds


@pytest.mark.parametrize("name", ["a\\b.ply", os.fsdecode(b"\xff.ply")])
def test_so_are_those_of_clouds(tmp_path, name):
    (tmp_path / name).write_bytes(b"ply")
    with pytest.raises(CaptureError, match="rename it"):
        find_inputs(tmp_path / name, Store(folder=tmp_path / "work"))
