"""What the fields of settings mean, read from the comments beside them in the code: one place for both."""

import ast
import dataclasses
import functools
import inspect
import re
import textwrap
from collections.abc import Hashable, Mapping


@functools.cache
def field_comments(settings: Hashable) -> Mapping[str, str]:
    """The comment of each field of a dataclass, its own or inherited; none for a field without one.

    A field's comment stands at the end of its line, or of its last, or in whole lines just above it.
    """
    found: dict[str, str] = {}
    assert isinstance(settings, type)
    for kind in reversed(settings.__mro__):
        if dataclasses.is_dataclass(kind):
            found.update(_own_comments(kind))
    return found


def _own_comments(kind: type) -> dict[str, str]:
    try:
        text = textwrap.dedent(inspect.getsource(kind))
    except (OSError, TypeError):  # installed without its sources
        return {}
    lines = text.splitlines()
    (definition,) = (node for node in ast.parse(text).body if isinstance(node, ast.ClassDef))
    found = {}
    for node in definition.body:
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name) or node.end_lineno is None:
            continue
        after = lines[node.end_lineno - 1].encode()[node.end_col_offset :].decode().strip()
        above: list[str] = []
        for line in reversed(lines[: node.lineno - 1]):
            if not line.strip().startswith("#"):
                break
            above.insert(0, line.strip().lstrip("# "))
        comment = " ".join([*above, *([after.lstrip("# ")] if after.startswith("#") else [])])
        if comment:
            found[node.target.id] = comment
    return found


def split_comment(comment: str) -> tuple[str, str, str]:
    """Meaning, unit and range of a comment such as "Patches have this size. Unit: pixels. Range: 1 or more."."""
    parts = re.split(r" (?=Unit: |Range: )", comment)
    found = {part.partition(": ")[0]: part.partition(": ")[2].rstrip(".") for part in parts[1:]}
    return parts[0], found.get("Unit", ""), found.get("Range", "")
