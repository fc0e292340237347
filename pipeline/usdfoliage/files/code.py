"""Which code a result was made by: files of the package, and its native extension."""

from functools import cache
from pathlib import Path

from usdfoliage import _native
from usdfoliage.files.hashing import hash_files

PACKAGE = Path(__file__).parents[1]
_SUFFIXES = (".py", ".html", ".css", ".js", ".toml", ".glslfx", ".usda")


def is_code(path: Path) -> bool:
    """Whether a file is of a kind that decides results, by its suffix."""
    return path.suffix in _SUFFIXES


def list_code(patterns: tuple[str, ...]) -> list[tuple[str, Path]]:
    """The files of code that match these patterns, each once, in the order of their names, and the extension.

    Args:
        patterns: As Path.glob takes them, from the folder of the package.

    Returns:
        Name, which is the path in the package, and path of each.
    """
    files = {path for pattern in patterns for path in PACKAGE.glob(pattern) if is_code(path)}
    named = sorted((path.relative_to(PACKAGE).as_posix(), path) for path in files)
    return [*named, ("_native", Path(_native.__file__))]


@cache
def digest_code(patterns: tuple[str, ...]) -> str:
    """The hash of that code, in 64 hexadecimal digits.

    Raises:
        OSError: A file cannot be read.
    """
    return hash_files(list_code(patterns)).hex()
