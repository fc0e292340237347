"""The pages that are made from the code are up to date with it."""

import ast
import dataclasses
from pathlib import Path

import pytest
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.work.field_comments import field_comments, split_comment
from usdfoliage.jobs.work.settings_file import format_settings
from usdfoliage.remark_codes import REMARK_KINDS

from tools.remark_reference import GUIDE, with_tables
from tools.schema_reference import SCHEMA_PAGE, schema_page, split_doc
from tools.settings_reference import ONCE, SETTINGS_PAGE, settings_page, walk_settings

ROOT = Path(__file__).parents[2]


def test_every_setting_of_a_build_is_described():
    bare = [
        f"{place}.{field.name}"
        for place, settings in walk_settings(BuildSettings())
        for field in dataclasses.fields(settings)
        if not dataclasses.is_dataclass(getattr(settings, field.name))
        if not (place and field.name in ONCE)
        if not field_comments(type(settings)).get(field.name)
    ]
    assert not bare, f"describe each in a comment beside the field: {', '.join(bare)}"


def test_the_meaning_of_every_setting_is_a_sentence_with_unit_and_range():
    wrong = []
    for place, settings in walk_settings(BuildSettings()):
        comments = field_comments(type(settings))
        for field in dataclasses.fields(settings):
            value = getattr(settings, field.name)
            if dataclasses.is_dataclass(value) or (place and field.name in ONCE):
                continue
            meaning, unit, allowed = split_comment(comments[field.name])
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            has_unit = bool(unit) or not field.name.endswith(("_px", "_m", "_deg"))
            if not meaning.endswith(".") or len(meaning.split()) < 4 or not has_unit or (is_number and not allowed):
                wrong.append(f"{place}.{field.name}: {comments[field.name]}")
    assert not wrong


def test_every_table_of_settings_is_described():
    # The doc that a dataclass without one gets begins with its name.
    bare = [
        place
        for place, settings in walk_settings(BuildSettings())
        if not settings.__doc__ or settings.__doc__.startswith(f"{type(settings).__name__}(")
    ]
    assert not bare


def test_the_printed_plan_describes_every_setting():
    lines = [line for line in format_settings(BuildSettings(), documented=True).splitlines() if " = " in line]
    assert len(lines) > 200
    assert not [line for line in lines if "  # " not in line]


def test_the_page_of_settings_is_up_to_date():
    assert SETTINGS_PAGE.read_text(encoding="utf-8") == settings_page(), "run tools/settings_reference.py"


def test_the_page_of_schemas_is_up_to_date():
    assert SCHEMA_PAGE.read_text(encoding="utf-8") == schema_page(), "run tools/schema_reference.py"


def test_the_guide_lists_every_code_of_a_remark():
    page = GUIDE.read_text(encoding="utf-8")
    assert page == with_tables(page), "run tools/remark_reference.py"


def test_meaning_and_action_of_every_code_are_sentences():
    texts = [text for kind in REMARK_KINDS.values() for text in (kind.meaning, kind.action)]
    assert not [text for text in texts if not text.endswith(".") or not text[0].isupper() or "|" in text]


@pytest.mark.parametrize(
    ("doc", "parts"),
    [
        ("Length; unit: metres; range: above 0.", {"meaning": "Length", "unit": "metres", "range": "above 0"}),
        ("Name; never a path; unit: none.", {"meaning": "Name; never a path", "unit": "none"}),
        (
            "Keys: (u, v); unit: none; range: 0 to 1; rising; length: 2.",
            {"meaning": "Keys: (u, v)", "unit": "none", "range": "0 to 1; rising", "length": "2"},
        ),
    ],
)
def test_a_doc_is_split_at_its_parts(doc: str, parts: dict[str, str]):
    assert split_doc(doc) == parts


def test_the_rez_package_needs_what_the_product_needs():
    assigned: dict[str, object] = {}
    for node in ast.parse((ROOT / "package.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            assigned[node.targets[0].id] = ast.literal_eval(node.value)
    requires = assigned["requires"]
    assert isinstance(requires, list)
    required = {_plain(text) for text in requires}
    lines = (ROOT / "requirements" / "product.in").read_text(encoding="utf-8").splitlines()
    needed = {_plain(line) for line in lines if line and not line.startswith("#")}
    assert needed <= required, f"package.py lacks {needed - required}"


def _plain(requirement: str) -> str:
    """The name of a requirement, of pip (opencv-contrib>=3) or of rez (opencv_contrib-3+)."""
    name = requirement.split(">=")[0].split("==")[0].strip()
    head, _, version = name.rpartition("-")
    if head and version.rstrip("+").replace(".", "").isdigit():
        name = head
    return name.replace("-", "_").lower()
