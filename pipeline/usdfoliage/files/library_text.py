"""What libraries in C++ state of a file, which may quote any bytes of it."""

from collections.abc import Callable

from usdfoliage.files.printable import printable


def library_text(getter: Callable[..., str], *arguments: str) -> str:
    """A text of a library in one line that a terminal can show; "" where it is no Unicode, as of damaged headers.

    Args:
        getter: Returns the text, as OpenImageIO's geterror does, which forgets it then.
        arguments: Of getter.
    """
    try:
        return printable(" ".join(getter(*arguments).split()))
    except UnicodeDecodeError:
        return ""
