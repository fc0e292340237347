"""How --help is laid out: a short line of usage, filled paragraphs, whole sentences."""

import argparse
import shutil
import textwrap

MAX_WIDTH = 100  # characters of a line


class HelpFormatter(argparse.HelpFormatter):
    """Fills each paragraph of a description, and leaves indented lines as they are."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=26, width=min(shutil.get_terminal_size().columns - 2, MAX_WIDTH))

    def _split_lines(self, text: str, width: int) -> list[str]:
        return textwrap.wrap(" ".join(text.split()), width, break_on_hyphens=False)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = textwrap.dedent(text).strip("\n").split("\n\n")
        return "\n\n".join(
            textwrap.indent(
                paragraph if paragraph.startswith(" ") else textwrap.fill(paragraph, width, break_on_hyphens=False),
                indent,
            )
            for paragraph in paragraphs
        )


def shorten_usage(parser: argparse.ArgumentParser) -> None:
    """Let the line of usage name what must be given; the options are listed below it."""
    words = [parser.prog]
    for action in parser._actions:
        if not action.option_strings:
            name = _name(action)
            words.append(f"[{name}]" if action.nargs == "?" else name)
        elif action.required:
            words.append(f"{action.option_strings[0]} {_name(action)}")
    parser.usage = " ".join([*words, "[OPTION ...]"])


def _name(action: argparse.Action) -> str:
    return action.metavar if isinstance(action.metavar, str) else action.dest.upper()
