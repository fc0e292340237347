"""A change of any module that a result is made by changes the key of the result."""

import sys

import pytest
from usdfoliage.capture.poses.settings import CODE_OF_POSES
from usdfoliage.files import code, hashing
from usdfoliage.files.code import PACKAGE, digest_code, list_code
from usdfoliage.jobs.plant.tasks import STAGES as NAMES
from usdfoliage.jobs.plant.tasks import build_code_version, code_of
from usdfoliage.jobs.plant.worker import STAGES
from usdfoliage.jobs.work.keys import CODE_OF_RESULTS

from tests.support.imports import reached_files

# What a result may reach and is not made by, with the reason.
NOT_COUNTED = {
    "__init__.py": "it registers the schemas with USD and has the name of the package",
}
NOT_OF_DEPTH = {
    **NOT_COUNTED,
    "jobs/plant/call.py": "it hands a task its settings and inputs, which are in the key themselves",
    "jobs/plant/store.py": "it puts results in their places, and reads their stamps",
    "jobs/plant/tasks.py": "it makes the keys",
}


def module_of(stage: str) -> str:
    module = sys.modules[STAGES[stage].__module__]
    assert module.__file__ is not None
    return str(module.__file__).removeprefix(f"{PACKAGE}/")


@pytest.mark.parametrize("stage", NAMES)
def test_every_module_of_a_stage_is_counted(stage: str) -> None:
    counted = {name for name, _ in list_code(code_of(stage))}
    left_out = NOT_OF_DEPTH if stage in ("poses", "matching", "depth") else NOT_COUNTED
    reached = reached_files(module_of(stage), left_out=left_out)
    assert len(reached) > 30
    assert reached <= counted


@pytest.mark.parametrize(
    ("modules", "patterns"),
    [
        (("jobs/capture/depth_tasks.py", "jobs/capture/maps.py"), CODE_OF_RESULTS),
        (("capture/poses/register.py", "capture/poses/worker.py"), CODE_OF_POSES),
    ],
)
def test_every_module_that_makes_results_of_a_capture_is_counted(
    modules: tuple[str, ...], patterns: tuple[str, ...]
) -> None:
    counted = {name for name, _ in list_code(patterns)}
    reached = reached_files(*modules, left_out=NOT_COUNTED)
    assert len(reached) > 15
    assert reached <= counted


def test_what_is_left_out_is_still_there() -> None:
    assert all((PACKAGE / name).is_file() for name in NOT_OF_DEPTH)


def test_the_worker_of_poses_is_found_though_it_is_named_in_a_text() -> None:
    assert "capture/poses/worker.py" in reached_files("capture/poses/register.py", left_out=NOT_COUNTED)


@pytest.fixture
def change(monkeypatch: pytest.MonkeyPatch):
    """Makes a file look changed; nothing that was hashed before is remembered."""
    read = hashing.hash_file

    def change(name: str | None) -> None:
        for remembered in (digest_code, build_code_version):
            remembered.cache_clear()
        changed = None if name is None else PACKAGE / name
        monkeypatch.setattr(hashing, "hash_file", lambda path: b"changed" if path == changed else read(path))

    yield change
    monkeypatch.undo()
    change(None)


@pytest.mark.parametrize("stage", NAMES)
def test_a_change_changes_the_key(stage: str, change) -> None:
    change(None)
    before = build_code_version(stage)
    for name in (module_of(stage), "capture/mvs/rounds.py", "files/atomic.py", "progress.py"):
        change(name)
        assert build_code_version(stage) != before
    change("jobs/report/page.py")
    assert (build_code_version(stage) == before) == (stage in ("poses", "matching", "depth"))
    change(None)
    assert build_code_version(stage) == before


def test_the_native_extension_counts() -> None:
    assert [name for name, _ in list_code(())] == ["_native"]
    assert list_code(())[0][1].suffix == ".so"
    assert code.is_code(PACKAGE / "jobs" / "report" / "templates" / "page.html")
