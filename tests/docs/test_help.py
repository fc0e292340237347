"""The help of every command: whole sentences with unit and default, in options that are grouped."""

import argparse
import subprocess
import sys
from collections.abc import Iterator

import pytest
from usdfoliage.__main__ import COMMANDS, build_parser
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.cli.help_format import HelpFormatter
from usdfoliage.cli.options.setting_help import describe_setting, state_default
from usdfoliage.jobs.leaves.settings import LeavesSettings
from usdfoliage.jobs.plant.settings import BuildSettings

from tests.docs.test_words import commands, count_words

UNITS_OF_NAMES = {"_m": "metres", "_px": "pixels", "_s": "seconds", "_deg": "degrees", "_mib": "MiB", "_days": "days"}
UNITS_OF_METAVARS = {"METRES": "metres", "FRAMES": "frames", "TEXELS": "texels", "DAYS": "days", "MIB": "MiB"}
MAX_OPTIONS_A_GROUP = 10


def find_faults(action: argparse.Action) -> list[str]:
    """What is wrong with the help of an option or an argument; nothing where it is hidden."""
    if action.help == argparse.SUPPRESS:
        return []
    if not action.help:
        return ["there is no help"]
    text = HelpFormatter("usdfoliage")._expand_help(action)
    faults = []
    first = text.split()[0].rstrip(":,;")
    if not (text[0].isupper() or first.startswith("--") or first in (action.choices or ())):
        faults.append("it begins with no capital letter")
    if not text.endswith("."):
        faults.append("it ends without a full stop")
    faults.extend(f"it has the word {word}" for word in count_words(text))
    if action.type in (int, float) or action.metavar in UNITS_OF_METAVARS:
        for end, unit in UNITS_OF_NAMES.items():
            if action.dest.endswith(end) and unit not in text:
                faults.append(f"it names no unit: {unit}")
        unit_of_metavar = UNITS_OF_METAVARS.get(str(action.metavar), "")
        if unit_of_metavar not in text:
            faults.append(f"it names no unit: {unit_of_metavar}")
    default = tuple(action.default) if isinstance(action.default, list) else action.default
    if default not in (None, False, (), "", argparse.SUPPRESS) and state_default(default) not in text:
        faults.append(f"it names no default: {state_default(default)}")
    return faults


def all_actions() -> Iterator[tuple[str, argparse.Action]]:
    yield from (("", action) for action in build_parser()._actions if action.option_strings)
    for name, parser in commands():
        yield from ((name, action) for action in parser._actions)


def test_the_help_of_every_option_is_a_sentence_with_unit_and_default():
    faults = [
        f"usdfoliage {name} {'/'.join(action.option_strings) or action.metavar}: {fault}"
        for name, action in all_actions()
        for fault in find_faults(action)
    ]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("option", "fault"),
    [
        ({"help": None}, "there is no help"),
        ({"help": "the asset's folder."}, "it begins with no capital letter"),
        ({"help": "The asset is written here"}, "it ends without a full stop"),
        ({"help": "The folder is told here."}, "it has the word told"),
        ({"dest": "length_m", "type": float, "help": "A leaf is this long."}, "it names no unit: metres"),
        ({"metavar": "METRES", "help": "A leaf is this long."}, "it names no unit: metres"),
        ({"dest": "side_px", "type": int, "help": "A side is this long."}, "it names no unit: pixels"),
        ({"type": int, "default": 12, "help": "So many are used."}, "it names no default: 12"),
        ({"type": int, "nargs": 2, "default": (8, 16), "help": "So many are used."}, "it names no default: 8 16"),
    ],
)
def test_wrong_help_is_found(option, fault):
    assert find_faults(argparse.ArgumentParser().add_argument("--planted", **option)) == [fault]


@pytest.mark.parametrize(
    "option",
    [
        {"help": "The asset is written to this folder."},
        {"help": argparse.SUPPRESS},
        {"choices": ("auto", "on"), "default": "auto", "help": "on: it is there; the default is %(default)s."},
        {
            "dest": "length_m",
            "type": float,
            "default": 0.5,
            "help": "It has this many metres; by default %(default)g.",
        },
    ],
)
def test_right_help_passes(option):
    assert find_faults(argparse.ArgumentParser().add_argument("--planted", **option)) == []


@pytest.mark.parametrize(("name", "parser"), [*commands()], ids=lambda value: value if isinstance(value, str) else "")
def test_a_description_has_a_summary_and_whole_sentences(name: str, parser: argparse.ArgumentParser):
    paragraphs = (parser.description or "").strip().split("\n\n")
    summary = paragraphs[0]
    assert "\n" not in summary, f"usdfoliage {name}: the summary is one line"
    assert len(summary) <= 86, f"usdfoliage {name}: usdfoliage --help shows the summary in one line of 100 columns"
    for paragraph in paragraphs:
        assert paragraph.startswith(" ") or (paragraph[0] == "-" or paragraph[0].isupper())
        assert paragraph.startswith(" ") or paragraph.endswith((".", ":")), f"usdfoliage {name}: {paragraph}"


@pytest.mark.parametrize(("name", "parser"), [*commands()], ids=lambda value: value if isinstance(value, str) else "")
def test_many_options_are_in_groups(name: str, parser: argparse.ArgumentParser):
    for group in parser._action_groups:
        shown = [action for action in group._group_actions if action.help != argparse.SUPPRESS]
        assert len(shown) <= MAX_OPTIONS_A_GROUP, f"usdfoliage {name} --help: divide the group {group.title}"


@pytest.mark.parametrize(("name", "parser"), [*commands()], ids=lambda value: value if isinstance(value, str) else "")
def test_every_option_is_in_a_group_of_ours(name: str, parser: argparse.ArgumentParser):
    shown = {
        str(group.title): [action for action in group._group_actions if action.help != argparse.SUPPRESS]
        for group in parser._action_groups
    }
    theirs = [title for title in ("positional arguments", "options") if shown.pop(title)]
    assert not theirs, f"usdfoliage {name} --help: give what is below {theirs} a group"


@pytest.mark.parametrize("command", ["build", "batch", "submit", "task"])
def test_the_help_of_a_build_loads_no_stage(command: str):
    """Reading the settings of all stages takes seconds."""
    loaded = "import sys; from usdfoliage.__main__ import build_parser; build_parser(sys.argv[1]); print(*sys.modules)"
    ended = subprocess.run(
        [sys.executable, "-c", loaded, command], capture_output=True, text=True, check=True
    )  # fmt: skip
    heavy = {"usdfoliage.jobs.plant.settings", "usdfoliage.jobs.plant.run", "scipy", "cv2", "pycolmap"}
    assert not heavy & set(ended.stdout.split())


def test_only_the_named_command_gets_its_arguments():
    (found,) = (action for action in build_parser("info")._actions if isinstance(action, argparse._SubParsersAction))
    assert "ASSET" in found.choices["info"].format_help()
    assert "CAPTURE" not in found.choices["build"].format_usage()
    assert set(found.choices) == set(COMMANDS)


def test_help_of_a_setting_is_made_from_its_comment():
    assert describe_setting(LeavesSettings(), "min_confidence") == (
        "The asset has the fitted leaves of at least this confidence. The value is from 0 to 1; the default is 0."
    )
    assert describe_setting(BuildSettings().branches, "internode_m").endswith(
        "The value is in metres, above 0; the default is auto."
    )
    assert describe_setting(BuildSettings().plant, "species").endswith("leaves.")
    assert "%" not in describe_setting(BranchSettings(), "leaves").replace("%%", "")


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "auto"), (400_000, "400000"), (0.12, "0.12"), (5.0, "5"), ((8, 16), "8 16"), ("trace", "trace"), ("", "")],
)
def test_a_default_is_stated_as_the_command_line_takes_it(value, text):
    assert state_default(value) == text


def test_a_help_is_filled_and_breaks_no_option(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    parser = argparse.ArgumentParser(
        prog="p", description="One. Two.\n\n    p  code\n\nThree\nfour.", formatter_class=HelpFormatter
    )
    parser.add_argument("--long", help="Words before " + "--print-settings " * 5 + "end.")
    lines = parser.format_help().splitlines()
    assert "    p  code" in lines
    assert "Three four." in lines
    assert all(len(line) <= 60 for line in lines)
    assert not [line for line in lines if line.endswith("-")]
