"""A command writes the settings that remedies name as its user sets them."""

import argparse

import pytest
from usdfoliage.__main__ import build_parser
from usdfoliage.capture.folder.settings import CaptureSettings
from usdfoliage.cli.remarks import COMMANDS, LEAVES_OF_A_CLOUD, print_remarks, render_for
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.settings_file import list_settings
from usdfoliage.remarks import Argument, Remark, Setting


def options_of(command: str) -> dict[str, argparse.Action]:
    parser = build_parser()
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    return commands.choices[command]._option_string_actions


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_every_option_is_one_of_the_command_and_every_setting_one_of_a_build(command: str) -> None:
    own = COMMANDS[command]
    options = options_of("leaves" if command == LEAVES_OF_A_CLOUD else command)
    settings = {*list_settings(BuildSettings()), *(f"capture.toml:{name}" for name in CaptureSettings.__annotations__)}
    assert set(own.options.values()) <= set(options)
    assert set(own.options) <= settings
    assert set(own.arguments.values()) <= set(options)
    assert set(own.values) <= set(own.options)
    assert not own.table or "--settings" in options
    for name, words in own.values.items():
        choices = options[own.options[name]].choices
        assert choices is None or set(words.values()) <= set(choices)


@pytest.mark.parametrize(
    ("command", "setting", "text"),
    [
        ("capture", Setting(name="capture.world.up", value='"gps"'), "--up gps"),
        ("capture", Setting(name="capture.world.times"), "--scale"),
        (
            "capture",
            Setting(name="capture.toml:metres_per_unit", value="0.01"),
            "metres_per_unit = 0.01 in capture.toml",
        ),
        ("capture", Setting(name="capture.pose_estimation.one_camera", value='"yes"'), "--camera one"),
        (
            "capture",
            Setting(name="capture.uncertain_poses", value='"use"'),
            'uncertain_poses = "use" in the settings file',
        ),
        ("capture", Setting(name="isolation.make", value='"off"'), 'isolation.make = "off"'),
        ("capture", Argument(name="output", value="a_capture"), "-o a_capture"),
        ("crown", Argument(name="mask"), "--mask"),
        ("submit", Argument(name="force"), "--force"),
        ("leaves", Argument(name="mask"), "the argument mask"),
        ("build", Setting(name="capture.world.up", value='"gps"'), 'capture.world.up = "gps"'),
        ("branches", Setting(name="capture.toml:metres_per_unit", value="0.001"), "--unit mm"),
        ("branches", Setting(name="capture.toml:metres_per_unit"), "--unit m|cm|mm|ft"),
        (
            "crown",
            Setting(name="capture.toml:metres_per_unit", value="0.0254"),
            "metres_per_unit = 0.0254 in capture.toml",
        ),
        (
            "leaves",
            Setting(name="capture.toml:metres_per_unit", value="0.001"),
            "metres_per_unit = 0.001 in capture.toml",
        ),
        (LEAVES_OF_A_CLOUD, Setting(name="capture.toml:metres_per_unit", value="0.001"), "--unit mm"),
    ],
)
def test_a_setting_is_written_as_it_is_set(command: str, setting: Setting | Argument, text: str) -> None:
    assert render_for(command)(setting) == text


def test_a_remark_is_a_line_that_begins_with_its_severity(capsys: pytest.CaptureFixture[str]) -> None:
    high = Remark(code="x", severity="warning", subject="", text="it is high", remedy=("give ", Setting(name="seed")))
    print_remarks([Remark(code="x", severity="info", subject="", text="it is low"), high], "capture")
    assert capsys.readouterr().out == "warning: it is high: give --seed\nnote: it is low\n"
