"""Names as a terminal can show them."""

import json
import os

import pytest
from usdfoliage.files.printable import printable, printable_json


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("leaf 1.png", "leaf 1.png"),
        ("Blätter/木.png", "Blätter/木.png"),
        ("a\x1b[31mb", "a\\x1b[31mb"),
        ("a\nb\tc\x07\x7f\x9b", "a\\nb\\tc\\x07\\x7f\\x9b"),
        ("\u202egnp.exe", "\\u202egnp.exe"),
        (os.fsdecode(b"\xff\xfe.png"), "\\xff\\xfe.png"),
        ("\ud800", "\\ud800"),
    ],
)
def test_nothing_of_a_name_acts_on_a_terminal(name, written):
    assert printable(name) == written
    assert printable(printable(name)) == printable(name)
    printable(name).encode("utf-8")


def test_json_keeps_its_values_and_shows_nothing_that_acts():
    value = {"a\x9b\u202e": ["\x1b[31m", "木", "\U000e0001", "a\nb\tc", os.fsdecode(b"\xff")]}
    text = printable_json(json.dumps(value, indent=1, ensure_ascii=False))
    assert json.loads(text) == value
    assert text.replace("\n", "").isprintable()
    assert "木" in text
