import re
from dataclasses import replace

import pytest
from usdfoliage.jobs.plant.pages.library_page import Library, LibraryPlant, write_library_page

from tests.support.plant_reports import Tags, flat_picture

HOLLY = LibraryPlant(
    name="holly",
    state="built",
    thumbnail=flat_picture((20, 120, 40), (512, 512)),
    height_m=2.345,
    leaves=12_345,
    size_bytes=2_000_000,
    report="holly/report/index.html",
    asset="holly/holly.usda",
)
FAILED = LibraryPlant(name="box", state="failed", message="2 photographs, 3 are needed", remedy=("Take more.",))


def test_each_plant_is_listed_with_its_state_and_links(tmp_path):
    page = write_library_page(tmp_path, Library(title="coast", plants=[HOLLY, FAILED], generator="usdfoliage"))
    text = page.read_text(encoding="utf-8")
    assert page == tmp_path / "index.html"
    for words in ("holly", "2.35 m", "12,345", "2 MB", "3 are needed", "Take more.", "2 plants", "1 failed", "1 built"):
        assert words in text
    assert set(re.findall(r'href="(\./[^"]*)"', text)) == {"./holly/report/index.html", "./holly/holly.usda"}
    assert text.count("data:image/webp") == 1


def test_the_same_plants_in_any_order_give_the_same_bytes(tmp_path):
    plants = [replace(HOLLY, name=name) for name in ("b", "a", "C", "Ä")]
    first = write_library_page(tmp_path / "a", Library(title="t", plants=plants)).read_bytes()
    assert write_library_page(tmp_path / "b", Library(title="t", plants=plants[::-1])).read_bytes() == first


@pytest.mark.parametrize("name", ["</ul><script>alert(1)</script>", "a\udcff", '" onload="x'])
def test_whatever_names_hold_is_text(tmp_path, name):
    nasty = replace(HOLLY, name=name, capture=name, species=name, message=name, remedy=(name,), report=name, asset=name)
    text = write_library_page(tmp_path, Library(title=name, plants=[nasty], notes=[name])).read_text(encoding="utf-8")
    tags = Tags(text).tags
    assert [tag for tag, _ in tags].count("script") == 1
    assert not any("onload" in attributes for _, attributes in tags)


def test_a_library_without_plants_is_reported_on_its_page(tmp_path):
    text = write_library_page(tmp_path, Library(title="t", plants=[])).read_text(encoding="utf-8")
    assert "There is no plant" in text


def test_a_missing_thumbnail_is_no_fault(tmp_path):
    plant = replace(HOLLY, thumbnail=tmp_path / "gone.png")
    assert "no picture" in write_library_page(tmp_path, Library(title="t", plants=[plant])).read_text(encoding="utf-8")
