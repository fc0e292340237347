"""Old names of settings are read for a version."""

import logging

import pytest
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.capture.settings import CaptureRunSettings
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.renamed_settings import RENAMED_SETTINGS, has_setting
from usdfoliage.jobs.work.settings_file import read_settings_file


def test_every_new_name_is_a_setting_and_no_old_one_is():
    settings = BuildSettings()
    assert [new for new in RENAMED_SETTINGS.values() if not has_setting(settings, new)] == []
    assert [old for old in RENAMED_SETTINGS if has_setting(settings, old)] == []


def test_a_plan_with_old_names_is_read_with_warnings(tmp_path, caplog):
    plan = tmp_path / "plant.toml"
    plan.write_text("[capture.cloud]\nleast_views = 3\n[branches]\nmost_points = 1000\n[foliage]\nmost_leaves = 7\n")
    with caplog.at_level(logging.WARNING):
        settings = read_settings_file(plan, BuildSettings())
    assert settings.capture.cloud.min_views == 3
    assert settings.branches.max_points == 1000
    assert settings.foliage.max_leaves == 7
    assert len(caplog.messages) == 3
    assert any("capture.cloud.least_views is called capture.cloud.min_views now" in line for line in caplog.messages)


def test_the_settings_file_of_a_stage_may_have_old_names_too(tmp_path, caplog):
    file = tmp_path / "capture.toml"
    file.write_text("[cloud]\nleast_views = 2\n[depth.agreement]\nleast_likelihood = 0.1\n")
    with caplog.at_level(logging.WARNING):
        settings = read_settings_file(file, CaptureRunSettings())
    assert settings.cloud.min_views == 2
    assert settings.depth.agreement.min_likelihood == 0.1
    assert any("cloud.least_views is called cloud.min_views now" in line for line in caplog.messages)


def test_a_table_of_another_name_is_read_with_what_is_in_it(tmp_path, caplog):
    plan = tmp_path / "plant.toml"
    plan.write_text(
        '[capture]\ndoubtful_poses = "use"\n[capture.registration]\nleast_matches = 20\nmapper = "global"\n'
    )
    with caplog.at_level(logging.WARNING):
        settings = read_settings_file(plan, BuildSettings())
    assert settings.capture.uncertain_poses == "use"
    assert settings.capture.pose_estimation.min_matches == 20
    assert settings.capture.pose_estimation.mapper == "global"
    assert any("capture.registration is called capture.pose_estimation now" in line for line in caplog.messages)


def test_new_names_come_without_a_warning(tmp_path, caplog):
    file = tmp_path / "plant.toml"
    file.write_text("[foliage]\nmax_leaves = 7\n")
    with caplog.at_level(logging.WARNING):
        assert read_settings_file(file, BuildSettings()).foliage.max_leaves == 7
    assert not caplog.messages


def test_both_names_of_a_setting_are_refused(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text("[foliage]\nmost_leaves = 7\nmax_leaves = 8\n")
    with pytest.raises(FoliageError, match=r"foliage\.most_leaves is the old name of foliage\.max_leaves"):
        read_settings_file(file, BuildSettings())


def test_a_wrong_value_under_an_old_name_is_named_by_the_new_one(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text('[foliage]\nmost_leaves = "many"\n')
    with pytest.raises(FoliageError, match=r"foliage\.max_leaves must be a whole number"):
        read_settings_file(file, BuildSettings())
