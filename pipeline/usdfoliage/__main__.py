"""The command line of usdfoliage: ``usdfoliage COMMAND …`` or ``python -m usdfoliage COMMAND …``."""

import argparse
import errno
import importlib
import io
import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from usdfoliage import __version__
from usdfoliage.cli.box import BOXED, refuse_harmful, run_in_box
from usdfoliage.cli.help_format import HelpFormatter, shorten_usage
from usdfoliage.cli.noise import divert_libraries
from usdfoliage.cli.remarks import render_for
from usdfoliage.errors import FoliageError
from usdfoliage.files.free_space import is_full_disk
from usdfoliage.files.printable import PrintableFormatter, printable
from usdfoliage.files.reading import explain_refusal, refuse_circle
from usdfoliage.files.temporary_folder import remove_abandoned
from usdfoliage.files.unwritten import advise, explain_unwritten
from usdfoliage.files.write_gate import check_access
from usdfoliage.remarks import explain_error

COMMANDS = (
    "build",
    "batch",
    "task",
    "submit",
    "work",
    "capture",
    "branches",
    "crown",
    "sketch",
    "leaves",
    "lobed",
    "scatter",
    "forest",
    "edit",
    "bake",
    "export",
    "info",
    "preview",
    "view",
    "validate",
    "env",
)
EPILOG = """\
To begin, build a plant from a folder of photographs, and read its report:

    usdfoliage build photographs/ -o assets/plant

'usdfoliage COMMAND --help' describes a command and its options."""
MAX_CHARACTERS = 1000  # of a message


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """The command line; each command's module in usdfoliage.cli adds its own arguments.

    Args:
        only: The command that gets its arguments; the others keep their summaries. A command's arguments need its
            settings classes, and reading those of all commands takes seconds. None: every command gets them.
    """
    parser = argparse.ArgumentParser(
        prog="usdfoliage",
        description="Make editable OpenUSD foliage assets from photographs and point clouds of real plants.",
        epilog=EPILOG,
        formatter_class=HelpFormatter,
        add_help=False,
    )
    commands = parser.add_subparsers(title="commands", dest="command", required=True, metavar="COMMAND")
    for name in COMMANDS:
        module = importlib.import_module(f"usdfoliage.cli.{name}")
        summary = (module.__doc__ or "").strip().splitlines()[0]
        command = commands.add_parser(
            name, help=summary, description=module.__doc__, formatter_class=HelpFormatter, add_help=False
        )
        if only in (None, name):
            module.add_arguments(command)
        general = command.add_argument_group("general")
        _add_help(general)
        general.add_argument("-v", "--verbose", action="store_true", help="Print what each stage does.")
        general.add_argument("--debug", action="store_true", help="Print a traceback with every error.")
        shorten_usage(command)
        command.set_defaults(run=module.run, declare=module.declare)
    general = parser.add_argument_group("general")
    _add_help(general)
    general.add_argument(
        "--version", action="version", version=f"usdfoliage {__version__}", help="Print the version, and stop."
    )
    return parser


def _add_help(parser: argparse._ActionsContainer) -> None:
    parser.add_argument("-h", "--help", action="help", default=argparse.SUPPRESS, help="Print this help, and stop.")


def main(
    arguments: Sequence[str] | None = None,
    prepare: Callable[[argparse.Namespace], None] | None = None,
    conclude: Callable[[], None] | None = None,
) -> int:
    """Run one command; returns the exit code: 0 good, 2 bad input, 3 a finding of validate, 1 an internal fault.

    Args:
        arguments: The words after the program's name. None: those of this process, which then is a command line's; a
            command that opens USD runs in a child of it (usdfoliage.cli.box), or lets a child open the asset first.
        prepare: Called with the options before the command runs.
        conclude: Called before an error is printed.
    """
    # A daemon may have closed them, and printing must not fail then.
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: PTH123, SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: PTH123, SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # file names may be any bytes
    words = sys.argv[1:] if arguments is None else arguments
    if arguments is None and os.name == "posix" and words and words[0] in BOXED:
        try:
            return run_in_box(words)
        except FoliageError as error:
            print(f"error: {_one_line(str(error))}", file=sys.stderr)
            return 2
    if arguments is None and os.name == "posix":
        noise = divert_libraries()
        try:
            return _run(words, prepare or _check_leaves, conclude)
        finally:
            if not {"-v", "--verbose"}.isdisjoint(words):
                for line in noise.lines():
                    print(f"INFO: library: {line}", file=sys.stderr)
    return _run(words, prepare, conclude)


def _run(
    words: Sequence[str], prepare: Callable[[argparse.Namespace], None] | None, conclude: Callable[[], None] | None
) -> int:
    """Run one command in this process; returns the exit code."""

    def complain(line: str) -> None:
        if conclude is not None:
            conclude()
        print(f"error: {line}", file=sys.stderr)

    try:
        options = build_parser(next((word for word in words if word in COMMANDS), "")).parse_args(words)
    except KeyboardInterrupt:
        complain("interrupted; nothing that is half written stays")
        return 130
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(PrintableFormatter("%(levelname)s: %(message)s"))
    logging.basicConfig(level=logging.INFO if options.verbose else logging.WARNING, handlers=[handler])
    try:
        for value in vars(options).values():
            if isinstance(value, Path):
                refuse_circle(value)
        if prepare is not None:
            prepare(options)
        remove_abandoned()
        check_access(options.declare(options))
        code = int(options.run(options) or 0)
        sys.stdout.flush()
        return code
    except FoliageError as error:
        if options.debug:
            raise
        complain(_one_line(explain_error(error, render_for(options.command))))
        return 2
    except KeyboardInterrupt:
        complain("interrupted; nothing that is half written stays")
        return 130
    except BrokenPipeError:  # the reader of stdout left, as with `| head`
        _discard_stdout()
        return 0
    except Exception as error:  # the last resort of the command line
        if options.debug:
            raise
        refusal = _explain(error, options)
        if refusal is not None:
            complain(_one_line("; ".join(refusal)))
            return 2
        if isinstance(error, OSError) and error.filename is None and error.errno in (errno.ENOSPC, errno.EIO):
            _discard_stdout()
            complain(f"the result could not be printed: {error.strerror}; redirect stdout elsewhere")
            return 1
        complain(
            f"internal fault: {type(error).__name__}: {_one_line(str(error))}; run again with --debug and report it"
        )
        return 1


def _check_leaves(options: argparse.Namespace) -> None:
    """See first whether a command that is in no box may open the asset that it takes leaves from."""
    if options.command == "branches" and options.leaves is not None:
        refuse_harmful(options.leaves)


def _one_line(message: str) -> str:
    """A message without line breaks and, as files hold texts of any length, without its middle where it is long."""
    line = printable(" ".join(message.split()))
    return line if len(line) <= MAX_CHARACTERS else f"{line[: MAX_CHARACTERS // 2]} … {line[-MAX_CHARACTERS // 2 :]}"


def _explain(error: Exception, options: argparse.Namespace) -> tuple[str, str] | None:
    """What is wrong with what the command was given, and what to do; None where it is a fault of ours."""
    if isinstance(error, OSError):
        return _explain_system(error)
    if isinstance(error, MemoryError):
        advice = "give it less, choose smaller settings, or run it where there is more memory"
        return f"this needs more memory than there is: {error or 'no more is left'}", advice
    return _explain_usd(error, options)


def _explain_system(error: OSError) -> tuple[str, str] | None:
    """What the system refuses of which file and what to do; None where no file is the reason."""
    if error.filename is not None and is_full_disk(error):
        path = Path(os.fsdecode(error.filename2 or error.filename))
        return f"{path} was not written: {explain_unwritten(error, path)}", advise(error)
    return explain_refusal(error)


def _explain_usd(error: Exception, options: argparse.Namespace) -> tuple[str, str] | None:
    """What USD could not read and what to do; None for an error of another kind.

    USD reads the values of a crate when they are asked for, at any place of a command. What it then raises is of the
    run's data; its coding errors are ours.
    """
    tf = sys.modules.get("pxr.Tf")
    if tf is None or not isinstance(error, tf.ErrorException):
        return None
    data = [each for each in error.args if each.errorCode == tf.TF_DIAGNOSTIC_RUNTIME_ERROR_TYPE]
    if not data or len(data) < len(error.args):
        return None
    given = getattr(options, "asset", None) or getattr(options, "leaves", None)
    text = f"USD cannot read all of it: {data[0].commentary}"
    return f"{given}: {text}" if given else text, "write the asset again, or copy it again"


def _discard_stdout() -> None:
    """Let what stdout still holds go nowhere, so that Python does not fail again at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
