"""Builds whose stages do next to nothing: what is kept of a task, and what is not."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from usdfoliage.jobs.build import run as runs
from usdfoliage.jobs.build import worker
from usdfoliage.jobs.build.call import BuildRequest, StageCall
from usdfoliage.jobs.build.finish import BuiltPlant
from usdfoliage.jobs.build.run import ExecutorChoice, build_plants
from usdfoliage.jobs.build.settings import BuildSettings
from usdfoliage.jobs.build.store import ResultFile
from usdfoliage.jobs.build.summary import StageSummary, write_summary

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
    """Stages that only say something, but for those that are given; nothing is published."""

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
        for folder in (call.store.scratch(call.task.key), call.store.views(call.task.key)):
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
