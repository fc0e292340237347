"""Print the environment variables with which other USD programs find the plug-ins.

PXR_PLUGINPATH_NAME names the foliage schemas, the validators and the plug-in of usdview; PYTHONPATH names the folders
of their modules. Both keep the values that they have. In a POSIX shell:

    eval "$(usdfoliage env)"
"""

import argparse
import json
import os
import shlex
from collections.abc import Callable, Mapping

from usdfoliage.files.write_gate import Access

VALIDATORS_SINCE = (26, 8)  # the version of USD that has a way to register validators of Python
SHELLS = ("sh", "csh", "fish", "powershell", "json")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument_group("printed output").add_argument(
        "--shell",
        choices=SHELLS,
        default=SHELLS[0],
        help="The lines are in the syntax of this shell; the default is %(default)s.",
    )
    parser.add_argument_group("program").add_argument(
        "--usd",
        type=read_version,
        metavar="VERSION",
        help=(
            "The program has this version of USD, such as 25.8. Before 26.8 it cannot load validators of Python, and "
            "they are left out. Without this option they are announced."
        ),
    )


def declare(options: argparse.Namespace) -> Access:
    return Access()  # it reads no file of the user, and writes none


def run(options: argparse.Namespace) -> int:
    from usdfoliage.asset.resources import plugin_path_folders, python_folders

    has_validators = options.usd is None or options.usd >= VALIDATORS_SINCE
    variables = {
        "PXR_PLUGINPATH_NAME": [str(folder) for folder in plugin_path_folders(validators=has_validators)],
        "PYTHONPATH": [str(folder) for folder in python_folders()],
    }
    print(FORMATS[options.shell](variables))
    return 0


def read_version(text: str) -> tuple[int, int]:
    """Year and month of a version of USD: 25.08, 25.8 and 0.25.8 are the same."""
    numbers = [int(part) if part.isdecimal() else -1 for part in text.removeprefix("v").split(".")]
    numbers = numbers[1:] if numbers[0] == 0 else numbers
    if not 2 <= len(numbers) <= 3 or min(numbers) < 0 or numbers[0] < 19:
        raise argparse.ArgumentTypeError(f"{text!r} is no version of USD, such as 25.8")
    return numbers[0], numbers[1]


def format_sh(variables: Mapping[str, list[str]]) -> str:
    """Exports for sh, bash, dash, zsh."""
    lines = []
    for name, folders in variables.items():
        joined = shlex.quote(os.pathsep.join(folders))
        lines.append(f'export {name}={joined}"${{{name}:+{os.pathsep}${name}}}"')
    return "\n".join(lines)


def format_csh(variables: Mapping[str, list[str]]) -> str:
    """Settings for csh and tcsh; every line also stands alone in eval "`usdfoliage env --shell csh`"."""
    lines = []
    for name, folders in variables.items():
        # An exclamation mark is history in csh, even inside quotes.
        joined = shlex.quote(os.pathsep.join(folders)).replace("!", "\\!")
        lines.append(f"if ( ! $?{name} ) setenv {name} '' ;")
        lines.append(f'if ( "${name}" != \'\' ) setenv {name} {joined}{os.pathsep}"${name}" ;')
        lines.append(f"if ( \"${name}\" == '' ) setenv {name} {joined} ;")
    return "\n".join(lines)


def format_fish(variables: Mapping[str, list[str]]) -> str:
    """Settings for fish, as in usdfoliage env --shell fish | source."""
    lines = []
    for name, folders in variables.items():
        joined = os.pathsep.join(folders).replace("\\", "\\\\").replace("'", "\\'")
        before = f"set -gx {name} '{joined}{os.pathsep}'\"${name}\""
        lines.append(f"if test -n \"${name}\"; {before}; else; set -gx {name} '{joined}'; end")
    return "\n".join(lines)


def format_powershell(variables: Mapping[str, list[str]]) -> str:
    """Settings for PowerShell."""
    lines = []
    for name, folders in variables.items():
        joined = os.pathsep.join(folders).replace("'", "''")
        old = f"$(if ($env:{name}) {{ '{os.pathsep}' + $env:{name} }})"
        lines.append(f"$env:{name} = '{joined}' + \"{old}\"")
    return "\n".join(lines)


def format_json(variables: Mapping[str, list[str]]) -> str:
    """Lists of folders to put before what the variables hold."""
    return json.dumps(variables, indent=2)


FORMATS: Mapping[str, Callable[[Mapping[str, list[str]]], str]] = {
    "sh": format_sh,
    "csh": format_csh,
    "fish": format_fish,
    "powershell": format_powershell,
    "json": format_json,
}
