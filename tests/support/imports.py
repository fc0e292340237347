"""Which modules of the package a module reaches."""

import ast
import re
from collections.abc import Container
from functools import cache
from pathlib import Path

from usdfoliage.files.code import PACKAGE


def reached_files(*modules: str, left_out: Container[str] = ()) -> set[str]:
    """The files that these modules import, and those that their imports do, by their paths in the package.

    Imports within functions count, as do modules that are named in a text, such as those that a process is started
    with. A file that holds nothing but its docstring does not.

    Args:
        modules: Paths in the package.
        left_out: Files that are not followed.
    """
    seen: set[str] = set()
    ahead = list(modules)
    while ahead:
        name = ahead.pop()
        if name not in seen and name not in left_out:
            seen.add(name)
            ahead += _imported(name)
    return seen


@cache
def _imported(file: str) -> frozenset[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse((PACKAGE / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.module, f"{file} imports by a relative name"
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names |= {node.value} if re.fullmatch(r"usdfoliage(\.\w+)+", node.value) else set()
    return frozenset(file for name in names for file in _files_of(name))


def _files_of(name: str) -> list[str]:
    """The file of a module, and those of the packages that it lies in, as far as they hold code."""
    parts = name.split(".")
    if parts[0] != "usdfoliage":
        return []
    places = [PACKAGE.joinpath(*parts[1:end], "__init__.py") for end in range(1, len(parts) + 1)]
    places.append(PACKAGE.joinpath(*parts[1:]).with_suffix(".py") if parts[1:] else PACKAGE / "__init__.py")
    return [path.relative_to(PACKAGE).as_posix() for path in places if path.is_file() and _has_code(path)]


def _has_code(path: Path) -> bool:
    return any(not isinstance(node, ast.Expr) for node in ast.parse(path.read_text(encoding="utf-8")).body)
