"""Names and texts of files as a terminal, a log and a page can show them."""

import json
import logging
import unicodedata

_UNSEEN = {
    "Cc",
    "Cf",
    "Cs",
    "Zl",
    "Zp",
}  # control, format (they turn the direction of writing), half characters, breaks


def printable(text: object) -> str:
    r"""A text, or what names a file, in which nothing acts on a terminal and nothing is hidden.

    Control characters (with ESC, with which a terminal is steered), characters that turn the direction of writing,
    and bytes that are no Unicode are written as escapes: \x1b, \u202e, \xff. Everything else stays as it is.
    """
    written = str(text)
    if written.isprintable():
        return written
    return "".join(_escape(letter) if unicodedata.category(letter) in _UNSEEN else letter for letter in written)


def printable_json(text: str) -> str:
    """A text in JSON, in which the same characters are written as JSON's escapes: the same values for who reads it."""
    return "".join(
        json.dumps(letter)[1:-1] if letter != "\n" and unicodedata.category(letter) in _UNSEEN else letter
        for letter in text
    )


class PrintableFormatter(logging.Formatter):
    """Messages of the log, in which names of files do not act on a terminal."""

    def format(self, record: logging.LogRecord) -> str:
        """The message, with its lines."""
        return "\n".join(map(printable, super().format(record).split("\n")))


def _escape(letter: str) -> str:
    code = ord(letter)
    if 0xDC80 <= code <= 0xDCFF:  # a byte that is no Unicode, as Python holds those of file names
        return f"\\x{code - 0xDC00:02x}"
    return letter.encode("unicode_escape").decode("ascii") if code < 0xD800 or code > 0xDFFF else f"\\u{code:04x}"
