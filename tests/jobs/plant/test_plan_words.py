"""Remarks of stages name the settings of a plan, which must be there."""

import re
from pathlib import Path

import pytest
from usdfoliage.capture.poses.world_frame import UPS
from usdfoliage.jobs.plant.plan_words import in_words_of_the_plan
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.summary import StageSummary, read_summary, write_summary
from usdfoliage.jobs.work.settings_file import list_settings


@pytest.mark.parametrize(
    "remark",
    [
        "give --scale, its true length over that one; or say a known distance",
        *(f"gps is taken: say --up {up} for the other" for up in UPS if up != "auto"),
        "give focal_px under [registration] with --settings",
        'probably wrong (doubtful_poses = "use" with --settings goes on with them)',
    ],
)
def test_no_option_is_named_and_every_setting_that_is_exists(remark: str) -> None:
    said = in_words_of_the_plan(remark)
    assert said != remark
    assert "--" not in said
    held = {f"capture.{key}" for key in list_settings(BuildSettings().capture)}
    named = re.findall(r"capture\.[a-z_.]+[a-z]", said)
    assert all(name in held or any(key.startswith(f"{name}.") for key in held) for name in named)


def test_a_summary_is_kept_in_words_of_the_plan(tmp_path: Path) -> None:
    write_summary(tmp_path, StageSummary(notes=["say --roots"], warnings=["say --cloud-leaves on"], failure="--roots"))
    held = read_summary(tmp_path)
    assert held.notes == ("say branches.roots",)
    assert held.warnings == ('say branches.cloud_leaves = "on"',)
    assert held.failure == "branches.roots"
