"""Settings from TOML and back."""

import tomllib
from dataclasses import dataclass, field
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.work.settings_file import format_settings, list_settings, read_settings_file


@dataclass(frozen=True, kw_only=True)
class Inner:
    gate: float | None = None
    turns: int = 3
    sizes: tuple[float, ...] = (1.0, 2.5)
    pair: tuple[int, int] = (1, 2)

    def __post_init__(self) -> None:
        if self.turns < 1:
            raise ValueError(f"turns must be 1 or more, not {self.turns}")


@dataclass(frozen=True, kw_only=True)
class Outer:
    method: Literal["one", "two"] = "one"
    weight: float = 0.5
    strict: bool = False
    note: str = ""
    inner: Inner = field(default_factory=Inner)


@given(
    settings=st.builds(
        Outer,
        method=st.sampled_from(["one", "two"]),
        weight=st.floats(allow_nan=False, allow_infinity=False),
        strict=st.booleans(),
        note=st.text(st.characters(exclude_categories=["Cs"]), max_size=20),
        inner=st.builds(
            Inner,
            gate=st.none() | st.floats(allow_nan=False, allow_infinity=False),
            turns=st.integers(1, 10**9),
            sizes=st.lists(st.floats(0, 1e9), max_size=4).map(tuple),
            pair=st.tuples(st.integers(-5, 5), st.integers(-5, 5)),
        ),
    )
)
def test_what_is_printed_is_read_back(settings, tmp_path_factory):
    file = tmp_path_factory.mktemp("settings") / "my settings.toml"
    file.write_text(format_settings(settings), encoding="utf-8")
    assert read_settings_file(file, Outer()) == settings
    assert read_settings_file(file, settings) == settings


def test_what_a_file_leaves_out_stays(tmp_path):
    (tmp_path / "a.toml").write_text("weight = 2\n[inner]\nturns = 7\n")
    changed = read_settings_file(tmp_path / "a.toml", Outer(strict=True))
    assert changed == Outer(weight=2.0, strict=True, inner=Inner(turns=7))
    assert isinstance(changed.weight, float)


def test_tables_are_tables_and_none_is_auto():
    parsed = tomllib.loads(format_settings(Outer()))
    assert parsed["inner"] == {"gate": "auto", "turns": 3, "sizes": [1.0, 2.5], "pair": [1, 2]}


def test_a_list_for_the_record():
    listed = list_settings(Outer())
    assert listed["method"] == "one"
    assert listed["inner.gate"] == "auto"
    assert listed["inner.sizes"] == "[1.0, 2.5]"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wieght = 1", r"no setting wieght; there are method, weight"),
        ("[inner]\nturn = 1", r"no setting inner\.turn; \[inner\] has gate, turns"),
        ("[outer]\n", r"no setting outer"),
        ("inner = 3", r"inner is a table"),
        ("weight = 'much'", r"weight must be a number, not 'much'"),
        ("weight = true", r"weight must be a number"),
        ("weight = nan", r"weight must be a finite number, not nan"),
        ("[inner]\nsizes = [1, inf]", r"inner\.sizes must be a finite number"),
        ("strict = 1", r"strict must be true or false, not 1"),
        ("note = 1", r"note must be a text"),
        ("method = 'three'", r"method must be one of one, two, not 'three'"),
        ("[inner]\nturns = 2.5", r"inner\.turns must be a whole number, not 2\.5"),
        ("[inner]\nturns = 1000000001", r"inner\.turns must be -1,000,000,000 to 1,000,000,000, not 1,000,000,001"),
        ("[inner]\nturns = 0", r"\[inner\] turns must be 1 or more, not 0"),
        ("[inner]\ngate = 'none'", r"inner\.gate must be a number or \"auto\", not 'none'"),
        ("[inner]\nsizes = 2", r"inner\.sizes must be a list"),
        ("[inner]\npair = [1, 2, 3]", r"inner\.pair must be a list of 2"),
        ("[inner]\npair = [1, 'a']", r"inner\.pair must be a whole number"),
        ("[inner\nturns = 2", r"no TOML"),
    ],
)
def test_a_mistake_names_file_and_key(tmp_path, text, message):
    file = tmp_path / "my settings.toml"
    file.write_text(text)
    with pytest.raises(FoliageError, match=message) as caught:
        read_settings_file(file, Outer())
    assert str(file) in str(caught.value)


def test_no_file(tmp_path):
    with pytest.raises(FoliageError, match=r"cannot be read: No such file .*gone\.toml"):
        read_settings_file(tmp_path / "gone.toml", Outer())
