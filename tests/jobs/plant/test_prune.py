"""What a work folder holds, and what of it is removed: a store made by hand, no task is run."""

import json
import multiprocessing
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from multiprocessing.synchronize import Event
from pathlib import Path

import pytest
from usdfoliage.errors import FoliageError
from usdfoliage.files.locks import is_locked
from usdfoliage.jobs.plant.call import BuildRequest
from usdfoliage.jobs.plant.prune import StoredTask, prune_work, survey_work
from usdfoliage.jobs.plant.record import PRUNING, note_build, note_task, plant_key, read_record, use_plant
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.store import (
    Stamp,
    Store,
    describe_files,
    fill_result,
    find_finished,
    hold_work_lock,
    list_files,
    lock_task,
    write_stamp,
)
from usdfoliage.jobs.plant.tasks import BuildPlan, Task

NEEDS = {
    "poses": (),
    "matching-1": ("poses",),
    "matching-2": ("matching-1",),
    "depth": ("matching-2",),
    "cloud": ("poses", "depth"),
    "report": ("cloud",),
}


def key_of(*parts: str) -> str:
    return sha256(" ".join(parts).encode()).hexdigest()[:32]


def plan_of(version: str, shared: str = "") -> BuildPlan:
    """A plan whose keys are of a version; those of poses to depth of another one, where it is named."""
    tasks = {}
    for name, needs in NEEDS.items():
        own = shared if shared and name not in ("cloud", "report") else version
        stage = name.split("-")[0]
        tasks[name] = Task(name=name, stage=stage, needs=needs, key=key_of(own, name))
    return BuildPlan(tasks=tasks, last=("report",))


@pytest.fixture
def request_of_shrub(tmp_path: Path) -> BuildRequest:
    return BuildRequest(
        capture=tmp_path / "shrub",
        output=tmp_path / "assets" / "shrub",
        name="shrub",
        settings=BuildSettings(),
        work=tmp_path / "work",
    )


def finish(request: BuildRequest, plan: BuildPlan, names: Iterator[str] | tuple[str, ...] = tuple(NEEDS)) -> None:
    """As tasks leave it: results, stamps, locks, and planes and depth in the folder of the views."""
    store = request.store
    views = store.views(plan.tasks["poses"].key)
    for name in names:
        task = plan.tasks[name]
        with lock_task(store, task.key):
            with fill_result(store, task.key) as out:
                (out / "result.txt").write_text(name * 100)
            others = ()
            if task.stage in ("poses", "matching", "depth"):
                views.mkdir(parents=True, exist_ok=True)
                file = views / f"{task.key}.npz"
                file.write_bytes(b"p" * 1000)
                others = describe_files(store, [file])
            files = (*list_files(store, store.result(task.key)), *others)
            stamp = Stamp(
                key=task.key,
                name=name,
                stage=task.stage,
                step=task.step,
                seconds=1.0,
                estimate_s=1.0,
                files=files,
            )
            write_stamp(store, stamp)


def lay_frames(request: BuildRequest, name: str, hours: float = 2.0) -> Path:
    """Frames of a video that were taken, and last used so many hours ago."""
    folder = request.store.folder / "views" / "frames" / name
    folder.mkdir(parents=True)
    for each in ("frame_00001.jpg", "frames.json"):
        (folder / each).write_bytes(b"f" * 500)
    for path in (folder / "frames.json", folder):
        os.utime(path, (time.time() - 3600 * hours,) * 2)
    return folder


def built(request: BuildRequest, version: str, shared: str = "") -> BuildPlan:
    plan = plan_of(version, shared)
    note_build(request, plan)
    finish(request, plan)
    return plan


def is_done(store: Store, plan: BuildPlan) -> dict[str, bool]:
    return {name: find_finished(store, task.key, thorough=True) is not None for name, task in plan.tasks.items()}


def states(stored: tuple[StoredTask, ...]) -> dict[str, str]:
    return {task.key: task.state for task in stored}


def test_of_the_latest_build_all_stays_but_matching_whose_depth_is_done(request_of_shrub: BuildRequest) -> None:
    plan = built(request_of_shrub, "a")
    removed = prune_work(request_of_shrub.work)
    assert [task.stage for task in removed] == ["matching", "matching"]
    assert {task.capture for task in removed} == {str(request_of_shrub.capture)}
    assert sum(task.size_bytes for task in removed) > 2 * 2000
    done = is_done(request_of_shrub.store, plan)
    assert done == {name: not name.startswith("matching") for name in NEEDS}
    assert len(list(request_of_shrub.store.views(plan.tasks["poses"].key).iterdir())) == 2  # of poses and depth
    assert prune_work(request_of_shrub.work) == ()


def test_matching_stays_while_depth_is_not_done(request_of_shrub: BuildRequest) -> None:
    plan = plan_of("a")
    note_build(request_of_shrub, plan)
    finish(request_of_shrub, plan, ("poses", "matching-1", "matching-2"))
    prune_work(request_of_shrub.work)
    done = is_done(request_of_shrub.store, plan)
    assert (done["poses"], done["matching-1"], done["matching-2"]) == (True, False, True)


def test_what_was_removed_is_made_again_and_stays(request_of_shrub: BuildRequest) -> None:
    first = built(request_of_shrub, "a")
    second = built(request_of_shrub, "b")
    prune_work(request_of_shrub.work)
    assert not any(is_done(request_of_shrub.store, first).values())
    assert is_done(request_of_shrub.store, second)["report"]
    built(request_of_shrub, "a")
    prune_work(request_of_shrub.work)
    assert is_done(request_of_shrub.store, first)["report"]
    assert not any(is_done(request_of_shrub.store, second).values())


def test_earlier_builds_of_a_plant_go_and_what_both_read_stays(request_of_shrub: BuildRequest) -> None:
    first = built(request_of_shrub, "a")
    second = built(request_of_shrub, "b", shared="a")
    found = {(task.stage, task.state) for task in survey_work(request_of_shrub.work)}
    assert ("cloud", "needed") in found
    assert ("cloud", "not needed") in found
    prune_work(request_of_shrub.work)
    store = request_of_shrub.store
    assert is_done(store, second) == {name: not name.startswith("matching") for name in NEEDS}
    assert not is_done(store, first)["cloud"]
    assert not store.result(first.tasks["report"].key).exists()


def test_each_plant_has_a_latest_build(request_of_shrub: BuildRequest, tmp_path: Path) -> None:
    other = replace(request_of_shrub, output=tmp_path / "assets" / "small_shrub")
    first, second = built(request_of_shrub, "a"), built(other, "b")
    prune_work(request_of_shrub.work)
    assert is_done(request_of_shrub.store, first)["report"]
    assert is_done(request_of_shrub.store, second)["report"]


def test_what_nobody_remembers_goes_unless_it_is_recent(request_of_shrub: BuildRequest) -> None:
    plan = plan_of("old")
    finish(request_of_shrub, plan)
    assert set(states(survey_work(request_of_shrub.work, keep_days=1)).values()) == {"recent"}
    assert prune_work(request_of_shrub.work, keep_days=1) == ()
    two_days_ago = time.time() - 2 * 86400
    for path in request_of_shrub.work.rglob("*"):
        os.utime(path, (two_days_ago, two_days_ago))
    assert {task.capture for task in prune_work(request_of_shrub.work, keep_days=1)} == {""}
    left = [path for path in request_of_shrub.work.rglob("*") if path.is_file() and path.suffix != ".lock"]
    assert left == []


def test_a_build_that_finds_a_result_uses_it(request_of_shrub: BuildRequest) -> None:
    plan = built(request_of_shrub, "a")
    lock = request_of_shrub.store.lock(plan.tasks["cloud"].key)
    os.utime(lock, (1, 1))
    note_build(request_of_shrub, plan)
    assert time.time() - lock.stat().st_mtime < 60


def test_scratch_of_dead_runs_goes_but_not_what_the_latest_build_goes_on_from(request_of_shrub: BuildRequest) -> None:
    store, plan = request_of_shrub.store, plan_of("a")
    note_build(request_of_shrub, plan)
    waiting, dead, torn = store.scratch(plan.tasks["poses"].key), store.scratch(key_of("dead")), key_of("torn")
    for folder in (waiting, dead, store.result(torn)):
        folder.mkdir(parents=True)
        (folder / "half").write_text("…")
    (store.folder / "tasks").mkdir()
    assert {task.stage for task in prune_work(request_of_shrub.work)} == {"unfinished"}
    assert (waiting / "half").exists()
    assert not dead.exists()
    assert not store.result(torn).exists()


def test_nothing_is_removed_in_a_survey(request_of_shrub: BuildRequest) -> None:
    plan = built(request_of_shrub, "a")
    assert "not needed" in states(survey_work(request_of_shrub.work)).values()
    assert all(is_done(request_of_shrub.store, plan).values())


def test_a_survey_writes_nothing_and_lets_builds_go_on(
    request_of_shrub: BuildRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    built(request_of_shrub, "a")
    store, key = request_of_shrub.store, plant_key(request_of_shrub)
    with use_plant(request_of_shrub):
        pass
    before = {path: path.stat().st_mtime_ns for path in store.folder.rglob("*")}
    true_open = os.open

    def read_only(path: str, flags: int, *mode: int, **where: int) -> int:
        if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            raise PermissionError(30, "Read-only file system")
        return true_open(path, flags, *mode, **where)

    monkeypatch.setattr(os, "open", read_only)
    assert "not needed" in states(survey_work(store.folder)).values()
    with another_process(request_of_shrub, "plant"):
        assert is_locked(store.plant_lock(key))
    assert {path: path.stat().st_mtime_ns for path in store.folder.rglob("*")} == before
    store.plant_lock(key).unlink()
    survey_work(store.folder)
    assert not store.plant_lock(key).exists()


def hold(request: BuildRequest, what: str, locked: Event, over: Event) -> None:
    store, plan = request.store, plan_of("a")
    locks = {
        "plant": use_plant(request),
        "task": lock_task(store, plan.tasks["cloud"].key),
        "pruning": hold_work_lock(store.plant_lock(PRUNING), shared=True),
    }
    with locks[what]:
        locked.set()
        over.wait(30)


@contextmanager
def another_process(request: BuildRequest, what: str) -> Iterator[None]:
    context = multiprocessing.get_context("spawn")
    locked, over = context.Event(), context.Event()
    process = context.Process(target=hold, args=(request, what, locked, over))
    process.start()
    try:
        assert locked.wait(30)
        yield
    finally:
        over.set()
        process.join(30)


def test_of_a_plant_that_is_being_built_nothing_goes(request_of_shrub: BuildRequest, tmp_path: Path) -> None:
    first, second = built(request_of_shrub, "a"), built(request_of_shrub, "b")
    other = built(replace(request_of_shrub, capture=tmp_path / "tree"), "c")
    with another_process(request_of_shrub, "plant"):
        found = states(survey_work(request_of_shrub.work))
        assert found[first.tasks["cloud"].key] == "in use"
        removed = prune_work(request_of_shrub.work)
    assert {task.key for task in removed} == {other.tasks[name].key for name in ("matching-1", "matching-2")}
    assert all(is_done(request_of_shrub.store, first).values())
    assert all(is_done(request_of_shrub.store, second).values())
    assert len(prune_work(request_of_shrub.work)) == len(NEEDS) + 2


def test_a_task_that_runs_is_left_alone(request_of_shrub: BuildRequest) -> None:
    plan = plan_of("a")
    finish(request_of_shrub, plan)
    with another_process(request_of_shrub, "task"):
        removed = prune_work(request_of_shrub.work)
    assert len(removed) == len(NEEDS) - 1
    assert is_done(request_of_shrub.store, plan)["cloud"]


def test_while_a_build_begins_nobody_prunes(request_of_shrub: BuildRequest) -> None:
    built(request_of_shrub, "a")
    with another_process(request_of_shrub, "pruning"), pytest.raises(FoliageError, match="try again"):
        prune_work(request_of_shrub.work)


def test_nothing_outside_of_the_folder_goes(request_of_shrub: BuildRequest, tmp_path: Path) -> None:
    plan = built(request_of_shrub, "old")
    built(request_of_shrub, "new")
    store = request_of_shrub.store
    outside = tmp_path / "outside"
    (outside / "deeper").mkdir(parents=True)
    precious = [outside / "precious.npz", outside / "deeper" / "precious.npz"]
    for path in precious:
        path.write_bytes(b"mine")
    store.result(key_of("link")).symlink_to(outside)
    (store.folder / "scratch").mkdir()
    store.scratch(key_of("link")).symlink_to(outside)
    (store.folder / "results" / "..hidden").mkdir()
    (store.folder / "results" / "my notes; $(rm -rf .)\n").mkdir()
    (store.result(plan.tasks["cloud"].key) / "way out").symlink_to(outside)
    (store.views(plan.tasks["poses"].key) / "way out").symlink_to(outside)
    paths = [
        f"views/{plan.tasks['poses'].key}/way out/precious.npz",
        f"views/{plan.tasks['poses'].key}/../../../outside/precious.npz",
        str(precious[0]),
        "capture.toml",
    ]
    (store.folder / "capture.toml").write_text("mine")
    forged = json.loads(store.stamp(plan.tasks["matching-1"].key).read_text())["stamp"]
    forged["files"] = [{"path": path, "size_bytes": 4, "sha256": "0" * 64} for path in paths]
    seal = sha256(json.dumps(forged, sort_keys=True).encode()).hexdigest()
    store.stamp(plan.tasks["matching-1"].key).write_text(json.dumps({"stamp": forged, "seal": seal}))
    assert plan.tasks["matching-1"].key in {task.key for task in prune_work(request_of_shrub.work)}
    assert not store.result(plan.tasks["cloud"].key).exists()
    assert not store.views(plan.tasks["poses"].key).exists()
    assert all(path.read_bytes() == b"mine" for path in precious)
    assert (store.folder / "capture.toml").read_text() == "mine"
    assert (store.folder / "results" / "..hidden").is_dir()
    assert (store.folder / "results" / "my notes; $(rm -rf .)\n").is_dir()


@pytest.mark.parametrize("part", ["tasks", "results", "views", "scratch", "builds"])
def test_a_part_that_is_a_link_is_refused(request_of_shrub: BuildRequest, tmp_path: Path, part: str) -> None:
    built(request_of_shrub, "a")
    (request_of_shrub.work / "scratch").mkdir(exist_ok=True)
    (request_of_shrub.work / part).rename(tmp_path / "elsewhere")
    (request_of_shrub.work / part).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(FoliageError, match=f"{part} is a link"):
        prune_work(request_of_shrub.work)


def test_folders_that_are_no_work_folder(request_of_shrub: BuildRequest, tmp_path: Path) -> None:
    with pytest.raises(FoliageError, match="it has no tasks/; name the work folder itself"):
        prune_work(tmp_path / "nothing")
    built(replace(request_of_shrub, work=tmp_path / "assets" / ".usdfoliage"), "a")
    with pytest.raises(FoliageError, match=r"did you mean .*/assets/\.usdfoliage\?"):
        survey_work(tmp_path / "assets")


def test_where_a_record_is_damaged_nothing_goes(
    request_of_shrub: BuildRequest, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    plan = built(request_of_shrub, "a")
    other = built(replace(request_of_shrub, capture=tmp_path / "tree"), "b")
    path = request_of_shrub.store.record(plant_key(request_of_shrub))
    path.write_text('{"tasks": 3}')
    with pytest.raises(FoliageError, match=f"{path} cannot be read .*: nothing is removed; build the plant again"):
        prune_work(request_of_shrub.work)
    assert all(is_done(request_of_shrub.store, plan).values())
    assert all(is_done(request_of_shrub.store, other).values())
    found = states(survey_work(request_of_shrub.work))
    assert set(found.values()) == {"needed", "unclear"}
    assert found[plan.tasks["report"].key] == "unclear"
    assert f"{path} cannot be read" in caplog.text
    path.unlink()
    assert len(prune_work(request_of_shrub.work)) == len(NEEDS) + 2


def test_where_the_record_of_a_running_plant_is_gone_nothing_goes(request_of_shrub: BuildRequest) -> None:
    plan = built(request_of_shrub, "a")
    request_of_shrub.store.record(plant_key(request_of_shrub)).unlink()
    with another_process(request_of_shrub, "plant"), pytest.raises(FoliageError, match="locked by a running build"):
        prune_work(request_of_shrub.work)
    assert all(is_done(request_of_shrub.store, plan).values())


def test_a_damaged_record_is_written_anew(request_of_shrub: BuildRequest) -> None:
    plan = built(request_of_shrub, "a")
    request_of_shrub.store.record(plant_key(request_of_shrub)).write_text('{"tasks": 3}')
    note_task(request_of_shrub, plan, plan.tasks["poses"])
    record = read_record(request_of_shrub.store, plant_key(request_of_shrub))
    assert record is not None
    assert [task.key for task in record.tasks] == [task.key for task in plan.tasks.values()]


def test_a_task_of_another_plan_than_the_latest_makes_that_the_latest(request_of_shrub: BuildRequest) -> None:
    old, new = built(request_of_shrub, "a"), built(request_of_shrub, "b")
    note_task(request_of_shrub, new, new.tasks["cloud"])  # it is
    assert states(survey_work(request_of_shrub.work))[new.tasks["report"].key] == "needed"
    note_task(request_of_shrub, old, old.tasks["cloud"])
    assert states(survey_work(request_of_shrub.work))[new.tasks["report"].key] == "not needed"


def test_what_results_share_is_counted_once(request_of_shrub: BuildRequest) -> None:
    plan = built(request_of_shrub, "a")
    old = built(request_of_shrub, "b")
    built(request_of_shrub, "a")
    store = request_of_shrub.store
    before = {task.key: task.size_bytes for task in survey_work(request_of_shrub.work)}
    os.link(store.result(plan.tasks["cloud"].key) / "result.txt", store.result(old.tasks["cloud"].key) / "linked")
    assert {task.key: task.size_bytes for task in survey_work(request_of_shrub.work)} == before


def test_frames_of_a_video_stay_where_the_latest_build_was_made_of_them(request_of_shrub: BuildRequest) -> None:
    before, now = key_of("frames", "before"), key_of("frames", "now")
    note_build(request_of_shrub, replace(plan_of("old"), frames=before))
    note_build(request_of_shrub, replace(plan_of("new"), frames=now))
    finish(request_of_shrub, plan_of("new"))
    folders = [lay_frames(request_of_shrub, name) for name in (before, now)]
    surveyed = {each.key: each for each in survey_work(request_of_shrub.work) if each.stage == "frames"}
    assert (surveyed[before].state, surveyed[before].capture, surveyed[before].size_bytes) == ("not needed", "", 1000)
    assert (surveyed[now].state, surveyed[now].capture) == ("needed", str(request_of_shrub.capture))
    removed = prune_work(request_of_shrub.work)
    assert [each.key for each in removed if each.stage == "frames"] == [before]
    assert [folder.exists() for folder in folders] == [False, True]


def test_frames_stay_for_another_plant_that_is_made_of_them(request_of_shrub: BuildRequest, tmp_path: Path) -> None:
    shared = key_of("frames")
    other = replace(request_of_shrub, output=tmp_path / "assets" / "other")
    for request in (request_of_shrub, other):
        note_build(request, replace(plan_of("1"), frames=shared))
    finish(request_of_shrub, plan_of("1"), ("poses",))
    note_build(request_of_shrub, plan_of("2"))  # of photographs now
    folder = lay_frames(request_of_shrub, shared)
    prune_work(request_of_shrub.work)
    assert folder.is_dir()
    note_build(other, plan_of("2"))
    prune_work(request_of_shrub.work)
    assert not folder.exists()


def test_frames_that_were_just_used_stay_since_their_build_may_begin(request_of_shrub: BuildRequest) -> None:
    built(request_of_shrub, "1")
    folders = [lay_frames(request_of_shrub, key_of(str(hours)), hours) for hours in (0.5, 30.0, 72.0)]
    assert prune_work(request_of_shrub.work, keep_days=2)[0].paths == (folders[2],)
    prune_work(request_of_shrub.work)
    assert [folder.exists() for folder in folders] == [True, False, False]


def test_what_a_killed_run_took_of_a_video_is_removed(request_of_shrub: BuildRequest) -> None:
    built(request_of_shrub, "1")
    killed = lay_frames(request_of_shrub, f".{key_of('a')}.0123456789ab.new")
    runs = lay_frames(request_of_shrub, f".{key_of('b')}.0123456789ab.new", hours=0.1)
    strange = lay_frames(request_of_shrub, "of mine")
    prune_work(request_of_shrub.work)
    assert (killed.exists(), runs.exists(), strange.exists()) == (False, True, True)


def test_frames_are_unclear_while_a_record_does_not_have_them(request_of_shrub: BuildRequest) -> None:
    built(request_of_shrub, "1")
    folder = lay_frames(request_of_shrub, key_of("frames"))
    record = request_of_shrub.store.record(plant_key(request_of_shrub))
    stored = json.loads(record.read_text())
    del stored["frames"]
    record.write_text(json.dumps(stored))
    assert [each.state for each in survey_work(request_of_shrub.work) if each.stage == "frames"] == ["unclear"]
    prune_work(request_of_shrub.work)
    assert folder.is_dir()
    built(request_of_shrub, "1")
    prune_work(request_of_shrub.work)
    assert not folder.exists()
