"""Remarks of stages name the settings of a plan, which must be there."""

import re
from pathlib import Path

import pytest
from usdfoliage.capture.poses.world_frame import UPS
from usdfoliage.jobs.branches.warnings import doubt_stems, doubt_surface
from usdfoliage.jobs.plant.plan_words import in_words_of_the_plan
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.summary import StageSummary, read_summary, write_summary
from usdfoliage.jobs.work.settings_file import list_settings, read_settings_file


@pytest.mark.parametrize(
    "remark",
    [
        *doubt_stems(0.01, 0.0, 0.0123),
        *doubt_surface(100, 50, 0),
        "points are leaves; say --cloud-leaves off if that is wrong",
        "give --scale, its true length over that one; or say a known distance",
        *(f"gps is taken: say --up {up} for the other" for up in UPS if up != "auto"),
        "give focal_px under [registration] with --settings",
        'probably wrong (doubtful_poses = "use" with --settings goes on with them)',
        "say --leaf-length if their capture had no scale",
    ],
)
def test_no_option_is_named_and_every_setting_that_is_exists(remark: str) -> None:
    said = in_words_of_the_plan(remark)
    assert said != remark
    assert "--" not in said
    settings = BuildSettings()
    held = {
        f"{stage}.{key}"
        for stage in ("branches", "foliage", "capture")
        for key in list_settings(getattr(settings, stage))
    }
    named = re.findall(r"(?:branches|foliage|capture)\.[a-z_.]+[a-z]", said)
    assert all(name in held or any(key.startswith(f"{name}.") for key in held) for name in named)


def test_values_that_are_said_can_be_put_into_a_plan(tmp_path: Path) -> None:
    (remark,) = doubt_surface(100, 50, 0)
    (line,) = re.findall(r'branches\.(cloud_leaves = "\w+")', in_words_of_the_plan(remark))
    plan = tmp_path / "plan.toml"
    plan.write_text(f"[branches]\n{line}\n")
    assert read_settings_file(plan, BuildSettings()).branches.cloud_leaves == "on"


def test_a_summary_is_kept_in_words_of_the_plan(tmp_path: Path) -> None:
    write_summary(tmp_path, StageSummary(notes=["say --roots"], warnings=["say --cloud-leaves on"], failure="--roots"))
    held = read_summary(tmp_path)
    assert held.notes == ("say branches.roots",)
    assert held.warnings == ('say branches.cloud_leaves = "on"',)
    assert held.failure == "branches.roots"
