"""The names of usdfoliage.api and their types are promised: a change of them is a change of this golden file too."""

import dataclasses
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from numpy.typing import ArrayLike
from usdfoliage import api

from tests.support.usd_values import compare_text_with_golden

GOLDEN = Path(__file__).parents[1] / "golden" / "api.txt"
_ARRAY = re.compile(r"numpy\.ndarray\[tuple\[(?:typing\.)?Any, \.\.\.\], numpy\.dtype\[([\w.]+)\]\]")
_MODULE = re.compile(r"\b(?:[a-z_]\w*\.)+(?=[A-Za-z_])")


def signature(function: object) -> str:
    """Arguments, types and defaults, without the modules that the types come from."""
    call = inspect.signature(function)  # type: ignore[arg-type]
    parameters = []
    for parameter in call.parameters.values():
        default = parameter.default
        if dataclasses.is_dataclass(default):
            parameter = parameter.replace(default=_Default(type(default).__name__))
        parameters.append(parameter)
    text = str(call.replace(parameters=parameters)).replace(str(ArrayLike), "ArrayLike")
    return _MODULE.sub("", _ARRAY.sub(r"NDArray[\1]", text))


class _Default:
    """The default settings of a class."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return f"{self._name}()"


def promise() -> Iterator[str]:
    for name in sorted(api.__all__):
        entry = getattr(api, name)
        if not callable(entry):
            yield f"{name}: {type(entry).__name__}"
            continue
        yield f"{name}{'' if is_error(entry) else signature(entry)}"
        if not inspect.isclass(entry):
            continue
        for member, value in sorted(vars(entry).items()):
            if member.startswith("_") or (dataclasses.is_dataclass(entry) and member in entry.__dataclass_fields__):
                continue
            if inspect.isfunction(value):
                yield f"{name}.{member}{signature(value)}"
            else:
                yield f"{name}.{member}"


def is_error(entry: object) -> bool:
    return inspect.isclass(entry) and issubclass(entry, Exception)


def test_names_and_signatures_are_those_that_were_promised() -> None:
    compare_text_with_golden(list(promise()), GOLDEN)


@pytest.mark.parametrize("name", [name for name in api.__all__ if callable(getattr(api, name))])
def test_every_name_is_documented(name: str) -> None:
    entry = getattr(api, name)
    text = vars(entry).get("__doc__") if inspect.isclass(entry) else entry.__doc__
    assert text
    if not inspect.isclass(entry):
        assert "Args:" in text or "Arguments" in text
        assert "Raises:" in text or name == "bake_leaves"  # its arguments have been checked when they were made
        return
    fields = getattr(entry, "__dataclass_fields__", {})
    if entry is not api.BuildSettings:  # whose tables docs/settings.md describes
        assert not [field for field in fields if f"\n        {field}: " not in text]
    members = [value for member, value in vars(entry).items() if not member.startswith("_") and member not in fields]
    assert all(member.__doc__ for member in members)


def test_the_page_lists_every_name() -> None:
    page = (Path(__file__).parents[2] / "docs" / "python_api.md").read_text(encoding="utf-8")
    table = page[page.index("## All names") :]
    assert set(re.findall(r"`(\w+)`", table[table.index("| --- |") : table.rindex("|")])) == set(api.__all__)
