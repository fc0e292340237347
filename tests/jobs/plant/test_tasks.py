"""The plan of a build: which tasks there are, and which settings and files touch which."""

import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from usdfoliage.asset.resources import plugin_path_folders
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.capture.video_frames import VideoFrames
from usdfoliage.jobs.plant import outside_tools
from usdfoliage.jobs.plant.inputs import BuildInputs
from usdfoliage.jobs.plant.settings import BuildSettings, TaskSettings, with_seed
from usdfoliage.jobs.plant.steps import list_steps
from usdfoliage.jobs.plant.store import Stamp, Store, fill_result, list_files, write_stamp
from usdfoliage.jobs.plant.tasks import STAGES, BuildPlan, find_wanted, plan_build

PHOTOGRAPHS = 9


def make_inputs(changed: str = "") -> BuildInputs:
    photographs = {f"{number}.jpg": Path(f"/captures/fern/images/{number}.jpg") for number in range(PHOTOGRAPHS)}
    files = {f"images/{name}": path for name, path in photographs.items()}
    digests = tuple((name, f"digest {'changed ' if name == changed else ''}of {name}") for name in sorted(files))
    return BuildInputs(
        source=Path("/captures/fern"),
        name="fern",
        photographs=photographs,
        has_cameras=True,
        has_depth=False,
        files=files,
        digests=digests,
        megapixels=2.0,
    )


def test_a_plan_names_the_frames_that_its_photographs_are() -> None:
    folder = Path("/cache/views/frames") / ("0a" * 16)
    taken = VideoFrames(video=Path("/captures/fern.mp4"), folder=folder, photos={}, remarks=())
    assert plan_build(make_inputs(), BuildSettings(), "fern").frames == ""
    assert plan_build(replace(make_inputs(), frames=taken), BuildSettings(), "fern").frames == folder.name


def stages_that_change(first: BuildPlan, second: BuildPlan) -> set[str]:
    assert first.tasks.keys() == second.tasks.keys()
    return {task.stage for name, task in first.tasks.items() if task.key != second.tasks[name].key}


def changed(**tables: Any) -> BuildSettings:
    """The default settings with other values in some tables."""
    settings = BuildSettings()
    return replace(settings, **{name: replace(getattr(settings, name), **values) for name, values in tables.items()})


PLAN = plan_build(make_inputs(), BuildSettings(), "fern")
WITHHELD = plan_build(make_inputs(), changed(plant={"hold_back": 4}), "fern")
OF_CAPTURES = set(STAGES) - {"sketch"}  # that is the stage of a single photograph
AFTER_PARTS = {"asset", "turntable", "comparisons", "variants", "report"}
AFTER_ISOLATION = {"branches", "leaves", "crown", *AFTER_PARTS}
AFTER_CLOUD = {"isolation", *AFTER_ISOLATION}


def test_every_task_comes_after_those_that_it_needs() -> None:
    seen: set[str] = set()
    for name, task in PLAN.tasks.items():
        assert set(task.needs) <= seen
        seen.add(name)
    assert {task.stage for task in PLAN.tasks.values()} == OF_CAPTURES - {"withheld"}
    assert {task.stage for task in WITHHELD.tasks.values()} == OF_CAPTURES


@pytest.mark.parametrize("photographs_a_task", [4, 100])
def test_the_chunks_of_a_stage_or_of_a_round_are_one_step(photographs_a_task: int) -> None:
    settings = changed(tasks={"photographs_a_task": photographs_a_task})
    plan = plan_build(make_inputs(), settings, "fern", only=("leaves",))
    chunks = 3 if photographs_a_task == 4 else 1
    assert {task.step for task in plan.tasks.values()} == {name.partition("/")[0] for name in plan.tasks}
    assert [task.step for task in plan.tasks.values()].count("matching-2") == chunks
    assert plan.tasks["leaves-asset"].step == "leaves-asset"
    steps = {step.name: step for step in list_steps(plan, ("report",))}
    assert (steps["matching-2"].stage, steps["leaves-asset"].stage) == ("matching", "part-asset")
    assert steps["depth"].chunks == chunks
    assert len({task.key for task in PLAN.tasks.values()}) == len(PLAN.tasks)
    assert PLAN.last == ("report",)


@pytest.mark.parametrize(
    ("only", "last"),
    [
        (("leaves",), ("leaves", "leaves-asset")),
        (("branches", "crown"), ("branches", "crown", "branches-asset", "crown-asset")),
        (("cloud",), ("cloud",)),
        (("leaves", "asset"), ("leaves", "leaves-asset", "asset")),
    ],
)
def test_parts_after_which_a_build_stops_get_assets_of_their_own(only: tuple[str, ...], last: tuple[str, ...]) -> None:
    plan = plan_build(make_inputs(), BuildSettings(), "fern", only)
    assert plan.last == last
    for name in last:
        if name.endswith("-asset"):
            assert plan.tasks[name].needs == (name.removesuffix("-asset"),)
    others = {name: task for name, task in plan.tasks.items() if not name.endswith("-asset")}
    assert others == dict(PLAN.tasks)  # which are the same whatever is asked for
    renamed = plan_build(make_inputs(), BuildSettings(), "ivy", only)
    assert all(renamed.tasks[name].key != plan.tasks[name].key for name in last if name.endswith("-asset"))


def test_depth_is_cut_into_chunks_of_photographs() -> None:
    rounds = len(BuildSettings().capture.depth.rounds)
    assert sum(task.stage == "matching" for task in PLAN.tasks.values()) == rounds * 3  # of 9 photographs, 4 each
    assert sum(task.stage == "depth" for task in PLAN.tasks.values()) == 3


@pytest.mark.parametrize(
    ("tables", "expected"),
    [
        ({"pictures": {"comparisons": 2}}, AFTER_PARTS),
        ({"foliage": {"max_leaves": 17}}, AFTER_PARTS),
        ({"isolation": {"container": False}}, AFTER_CLOUD),
        ({"crown": {"size": 64}}, {"crown", *AFTER_PARTS}),
        ({"leaves": {"min_confidence": 0.3}}, {"leaves", "branches", "crown", *AFTER_PARTS}),
        ({"branches": {"max_points": 1000}}, {"branches", "crown", *AFTER_PARTS}),
        ({"plant": {"species": "oak"}}, {"branches", "leaves", "crown", *AFTER_PARTS}),
    ],
)
def test_a_setting_touches_what_it_decides_and_nothing_else(tables: Any, expected: set[str]) -> None:
    touched = stages_that_change(PLAN, plan_build(make_inputs(), changed(**tables), "fern"))
    assert touched == expected


@pytest.mark.parametrize("part", ["branches", "leaves", "crown"])
def test_a_species_is_written_into_each_part_by_itself(part: str) -> None:
    off: dict[str, Any] = {"branches": {"make": "off"}, "leaves": {"make": False}, "crown": {"make": False}}
    del off[part]
    before = plan_build(make_inputs(), changed(**off), "fern")
    after = plan_build(make_inputs(), changed(**off, plant={"species": "oak"}), "fern")
    assert stages_that_change(before, after) == {part, *AFTER_PARTS}


@pytest.fixture
def segment_again() -> Iterator[None]:
    """What is looked at once in a process is looked at in each plan, before and after the test."""
    outside_tools.forget()
    yield
    outside_tools.forget()


def test_validators_of_the_place_touch_the_report_alone(
    segment_again: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def plan() -> BuildPlan:
        outside_tools.forget()
        return plan_build(make_inputs(), BuildSettings(), "fern")

    monkeypatch.delenv("PXR_PLUGINPATH_NAME", raising=False)
    plans = [plan()]
    plugins = tmp_path / "studio"
    (plugins / "studioRules").mkdir(parents=True)
    info = plugins / "studioRules" / "plugInfo.json"
    info.write_text('# of the studio\n{"Plugins": [{"Type": "python", "Name": "studioRules"}]}')
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", str(plugins / "studioRules"))
    plans.append(plan())
    rules = plugins / "studioRules" / "__init__.py"
    rules.write_text("def check(stage): return []\n")
    plans.append(plan())
    rules.write_text("def check(stage): return [1]\n")
    plans.append(plan())
    monkeypatch.setattr(outside_tools, "VALIDATION_PACKAGES", ("jinja2",))  # another package than before
    plans.append(plan())
    for first, second in pairwise(plans):
        assert stages_that_change(first, second) == {"report"}
    assert stages_that_change(plans[-1], plan()) == set()


def test_validators_are_identified_by_their_content_and_not_by_their_place(
    segment_again: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    descriptions = []
    for place in ("here", "there"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "plugInfo.json").write_text("{}")
        monkeypatch.setenv("PXR_PLUGINPATH_NAME", str(tmp_path / place / "plugInfo.json"))
        descriptions.append(outside_tools.describe_validators())
    assert descriptions[0] == descriptions[1]
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", str(tmp_path / "nowhere"))
    assert outside_tools.describe_validators() != descriptions[0]
    own = [str(folder) for folder in plugin_path_folders()]
    nothing = outside_tools.describe_validators()
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", os.pathsep.join(own))  # as `usdfoliage env` sets it
    assert outside_tools.describe_validators() == nothing


def test_the_module_of_a_plug_in_counts_wherever_it_lies(
    segment_again: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plugin").mkdir()
    (tmp_path / "plugin" / "plugInfo.json").write_text('{"Plugins": [{"Type": "python", "Name": "studio_rules_x"}]}')
    (tmp_path / "python" / "studio_rules_x").mkdir(parents=True)
    rules = tmp_path / "python" / "studio_rules_x" / "__init__.py"
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", str(tmp_path / "plugin"))
    monkeypatch.syspath_prepend(tmp_path / "python")
    descriptions = set()
    for text in ("a = 1\n", "a = 2\n"):
        rules.write_text(text)
        outside_tools.forget()
        descriptions.add(outside_tools.describe_validators())
    assert len(descriptions) == 2
    assert "studio_rules_x" not in sys.modules


def test_another_interpreter_draws_again_and_validates_again(
    segment_again: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python = tmp_path / "bin" / "python"
    python.parent.mkdir()
    python.write_text("#!/bin/sh\n")
    python.chmod(0o755)
    packages = tmp_path / "lib" / "python3.11" / "site-packages"
    packages.mkdir(parents=True)
    plans = []

    def plan() -> None:
        outside_tools.forget()
        plans.append(plan_build(make_inputs(), BuildSettings(), "fern"))

    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(tmp_path / "absent"))
    plan()
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(python))
    plan()
    (packages / "bpy-5.0.1.dist-info").mkdir()
    plan()
    (packages / "bpy-5.0.1.dist-info").rename(packages / "bpy-5.1.0.dist-info")
    plan()
    for first, second in pairwise(plans):
        assert stages_that_change(first, second) == AFTER_PARTS
    (packages / "requests-2.0.dist-info").mkdir()  # which draws nothing
    plan()
    assert stages_that_change(*plans[-2:]) == set()


def test_without_pictures_nobody_asks_what_draws(
    segment_again: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = changed(pictures={"make": False})
    before = plan_build(make_inputs(), settings, "fern")
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(tmp_path / "absent"))
    assert stages_that_change(before, plan_build(make_inputs(), settings, "fern")) == set()


def test_what_is_believed_of_depth_costs_no_matching() -> None:
    settings = BuildSettings()
    agreement = replace(settings.capture.depth.agreement, **_other(settings.capture.depth.agreement))
    depth = replace(settings.capture.depth, agreement=agreement)
    other = replace(settings, capture=replace(settings.capture, depth=depth))
    assert stages_that_change(PLAN, plan_build(make_inputs(), other, "fern")) == {"depth", "cloud", *AFTER_CLOUD}


def _other(settings: Any) -> dict[str, Any]:
    """Another value of some number among settings."""
    name, value = next((n, v) for n, v in vars(settings).items() if isinstance(v, float))
    return {name: value * 1.01}


def test_a_seed_or_a_photograph_touches_everything() -> None:
    everything = OF_CAPTURES - {"withheld"}
    assert stages_that_change(PLAN, plan_build(make_inputs(), with_seed(BuildSettings(), 3), "fern")) == everything
    assert stages_that_change(PLAN, plan_build(make_inputs("images/4.jpg"), BuildSettings(), "fern")) == everything


def test_threads_and_the_size_of_tasks_decide_nothing() -> None:
    asset = plan_build(make_inputs(), replace(BuildSettings(), tasks=TaskSettings(photographs_a_task=2)), "fern")
    assert asset.tasks["poses"].key == PLAN.tasks["poses"].key
    settings = BuildSettings()
    threaded = replace(
        settings,
        capture=replace(settings.capture, pose_estimation=replace(settings.capture.pose_estimation, threads=7)),
    )
    assert stages_that_change(PLAN, plan_build(make_inputs(), threaded, "fern")) == set()


def test_stages_that_are_switched_off_are_not_planned() -> None:
    settings = changed(
        branches={"make": "off"}, leaves={"make": False}, crown={"make": False}, pictures={"make": False}
    )
    stages = {task.stage for task in plan_build(make_inputs(), settings, "fern").tasks.values()}
    assert stages == {"poses", "matching", "depth", "cloud", "isolation", "asset", "report"}


def test_parts_are_made_of_the_isolated_plant_or_of_everything() -> None:
    for part in ("branches", "leaves", "crown"):
        assert "isolation" in PLAN.tasks[part].needs
        assert "cloud" not in PLAN.tasks[part].needs
    everything = plan_build(make_inputs(), changed(isolation={"make": "off"}), "fern")
    assert "isolation" not in everything.tasks
    for part in ("branches", "leaves", "crown"):
        assert "cloud" in everything.tasks[part].needs
    assert "cloud" in PLAN.tasks["report"].needs  # whose summary it shows
    # Compared with the photographs is what the parts are made of, with its masks.
    assert set(PLAN.tasks["comparisons"].needs) == {"isolation", "asset"}
    assert set(everything.tasks["comparisons"].needs) == {"cloud", "asset"}


def test_a_cloud_needs_no_capture() -> None:
    cloud = replace(make_inputs(), photographs={}, files={"fern.ply": Path("/fern.ply")}, digests=(("fern.ply", "d"),))
    stages = {task.stage for task in plan_build(cloud, BuildSettings(), "fern").tasks.values()}
    assert stages.isdisjoint({"poses", "matching", "depth", "cloud", "comparisons"})
    assert "leaves" in stages  # which are found in the cloud alone
    assert "branches" in stages


def finish(plan: BuildPlan, store: Store, *names: str) -> None:
    for name in names:
        task = plan.tasks[name]
        key = task.key
        with fill_result(store, key) as folder:
            (folder / "result.txt").write_text(name)
        files = list_files(store, store.result(key))
        stamp = Stamp(key=key, name=name, stage=task.stage, step=task.step, seconds=1, estimate_s=1, files=files)
        write_stamp(store, stamp)


def test_what_only_finished_tasks_need_is_not_wanted(tmp_path: Path) -> None:
    store = Store(folder=tmp_path)
    wanted, finished = find_wanted(PLAN, store, thorough=True)
    assert wanted.keys() == PLAN.tasks.keys()
    assert not finished
    finish(PLAN, store, "cloud")
    wanted, finished = find_wanted(PLAN, store, thorough=True)
    assert {task.stage for task in wanted.values()} == {"poses", *AFTER_CLOUD}  # the report shows cameras
    assert finished.keys() == {"cloud"}
    finish(PLAN, store, "report")
    assert find_wanted(PLAN, store, thorough=True)[0] == {}


def test_a_build_can_stop_at_a_stage(tmp_path: Path) -> None:
    plan = plan_build(make_inputs(), BuildSettings(), "fern", ["cloud", "branches"])
    wanted, _ = find_wanted(plan, Store(folder=tmp_path), thorough=True)
    expected = {"poses", "matching", "depth", "cloud", "isolation", "leaves", "branches", "part-asset"}
    assert {task.stage for task in wanted.values()} == expected


def test_photographs_that_are_withheld_measure_the_asset_and_make_none_of_it() -> None:
    assert WITHHELD.tasks["withheld"].needs == ("poses", "asset")
    assert "withheld" in WITHHELD.tasks["report"].needs
    assert "withheld" not in PLAN.tasks
    one_each = plan_build(
        make_inputs(), changed(plant={"hold_back": 4}, tasks={"photographs_a_task": 1}), "fern", only=("depth",)
    )
    assert sum(task.stage == "depth" for task in one_each.tasks.values()) == PHOTOGRAPHS - 2
    for stage in ("poses", "matching-1/1", "depth/1", "cloud", "isolation", "branches", "leaves", "crown", "asset"):
        assert WITHHELD.tasks[stage].key != PLAN.tasks[stage].key
    same_set = plan_build(make_inputs(), changed(plant={"hold_back": 5}), "fern")  # the third and the eighth
    assert same_set.tasks["matching-1/1"].key != WITHHELD.tasks["matching-1/1"].key
    both = [
        plan_build(make_inputs(), changed(plant={"hold_back": every}), "fern") for every in (7, 8)
    ]  # the third alone
    assert both[0].tasks["depth/1"].key == both[1].tasks["depth/1"].key


def test_two_photographs_and_a_cloud_have_none_to_hold_back() -> None:
    inputs = make_inputs()
    two = replace(inputs, photographs=dict(list(inputs.photographs.items())[:2]))
    with pytest.raises(CaptureError, match="no photograph can be withheld: there are 2 photographs"):
        plan_build(two, changed(plant={"hold_back": 2}), "fern")
    with pytest.raises(CaptureError, match="has no photographs, and none can be withheld"):
        plan_build(replace(inputs, photographs={}), changed(plant={"hold_back": 2}), "fern")
