import base64
import hashlib
import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.errors import AssetError
from usdfoliage.jobs.plant.pages.report import (
    Comparison,
    Picture,
    PlantReport,
    ReportWarning,
    SettingLine,
    StageReport,
    StageSettings,
    judge,
    mark_settings,
)
from usdfoliage.jobs.plant.pages.report_html import write_plant_report
from usdfoliage.jobs.report.environment import clean_text, in_bytes, link_to
from usdfoliage.jobs.report.page_pictures import embed_picture
from usdfoliage.jobs.report.timings import TaskTiming, Timings, write_timings

from tests.support.plant_reports import Tags, flat_picture, full_report

NASTY = "<script>alert(1)</script>\"' onerror=x {{ 7*7 }} </style>&amp;"
BARE = PlantReport(name="holly", capture="c", generator="usdfoliage")


def test_the_page_has_everything_and_the_warnings_first(tmp_path):
    page = write_plant_report(tmp_path / "report", full_report(tmp_path))
    assert page == tmp_path / "report" / "index.html"
    text = Tags(page.read_text(encoding="utf-8")).text
    words = ["holly", "not be used", "The scale is not known", "14 of 380", "1.84 m", "70,080", "IoU 0.812", "000.jpg"]
    words += [
        "Read 10 photographs",
        "Found leaves",
        "no masks",
        "0.812, against drawn masks",
        "looks odd",
        "10.5 kB",
        "2.01 MB",
        "rounds = 4",
    ]
    words += ["default: 3", "ab" * 32, "26.11"]
    assert [one for one in words if one not in text] == []
    order = ["The scale is not known", "14 of 380", "1.84 m", "IoU 0.812", "Read 10", "Found leaves", "looks odd"]
    order += ["holly.usda", "seed = 0", "26.11"]
    assert [text.index(one) for one in order] == sorted(text.index(one) for one in order)


def test_it_is_one_file_that_asks_for_nothing_else(tmp_path):
    page = write_plant_report(tmp_path / "report", full_report(tmp_path))
    assert [path.name for path in page.parent.iterdir()] == ["index.html"]
    parsed = Tags(page.read_text(encoding="utf-8"))
    sources = [attributes[key] for _, attributes in parsed.tags for key in ("src", "href") if key in attributes]
    assert {source[:5] for source in sources if not source.startswith("#")} == {"data:", "./lea"}
    assert "http:" not in page.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
    assert "https:" not in page.read_text(encoding="utf-8")


def test_its_policy_names_its_own_script_and_style_and_no_other(tmp_path):
    page = write_plant_report(tmp_path, full_report(tmp_path)).read_text(encoding="utf-8")
    policy = next(attributes["content"] for tag, attributes in Tags(page).tags if "http-equiv" in attributes)
    for tag in ("script", "style"):
        (element,) = re.findall(f"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(element.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy


def test_the_same_report_gives_the_same_bytes(tmp_path):
    first = write_plant_report(tmp_path / "a", full_report(tmp_path)).read_bytes()
    second = write_plant_report(tmp_path / "b", full_report(tmp_path)).read_bytes()
    assert first == second


def test_whatever_names_hold_is_text(tmp_path):
    report = full_report(tmp_path)
    stage = replace(report.stages[1], title=NASTY, sentence=NASTY, notes=[NASTY], detail_report=f"x/{NASTY}")
    nasty = replace(
        report,
        name=NASTY,
        capture=NASTY,
        species=NASTY,
        generator=NASTY,
        verdict=NASTY,
        warnings=[ReportWarning(stage=NASTY, text=NASTY, remedy=NASTY)],
        comparisons=[replace(one, name=NASTY, remark=NASTY) for one in report.comparisons],
        variants=[replace(one, set=NASTY, name=NASTY) for one in report.variants],
        stages=[replace(stage, pictures=[Picture(image=flat_picture((1, 2, 3)), caption=NASTY)])],
        findings=[Finding(severity="error", validator=NASTY, error=NASTY, path=NASTY, message=NASTY, where=NASTY)],
        files=[replace(one, path=NASTY) for one in report.files],
        inputs=[replace(one, name=NASTY) for one in report.inputs],
        settings=[StageSettings(stage=NASTY, lines=[SettingLine(text=f'a = "{NASTY}"', changed=True)])],
    )
    plain = Tags(write_plant_report(tmp_path / "plain", report).read_text(encoding="utf-8"))
    escaped = Tags(write_plant_report(tmp_path / "nasty", nasty).read_text(encoding="utf-8"))
    assert [tag for tag, _ in escaped.tags].count("script") == [tag for tag, _ in plain.tags].count("script") == 1
    assert not any("onerror" in attributes for _, attributes in escaped.tags)
    assert escaped.text.count(NASTY) >= 20


@pytest.mark.parametrize("name", ["a\udcff\udcfe.jpg", "\x00\x1b[31m", "\u202egpj.exe", "日本語 😀", "\ud800"])
def test_names_that_are_no_text_can_be_written(tmp_path, name):
    report = full_report(tmp_path)
    comparison = Comparison(name=name, photograph=Path(name.replace("\x00", "")), drawing=flat_picture((0, 0, 0)))
    report = replace(report, name=name, comparisons=[comparison])
    text = Tags(write_plant_report(tmp_path, report).read_bytes().decode("utf-8")).text
    assert clean_text(name) in text
    assert not set(text) & {"\x00", "\x1b", "\u202e"}


@given(st.text(st.characters(codec=None)))  # lone surrogates too
def test_any_text_can_be_encoded_once_it_is_clean(text):
    clean_text(text).encode("utf-8")


@given(st.text(st.characters(codec=None), min_size=1))
def test_a_link_never_leads_to_another_kind_of_address(name):
    link = link_to(name)
    assert link.startswith("./")
    assert not set(link) & set(" :?#<>\"'\\")


def test_a_link_keeps_the_bytes_of_a_name():
    assert link_to("b\udcff/ä b.html") == "./b%FF/%C3%A4%20b.html"


def test_a_report_of_next_to_nothing_names_what_is_missing(tmp_path):
    text = Tags(write_plant_report(tmp_path, replace(BARE, validated=False)).read_text(encoding="utf-8")).text
    expected = [
        "No stage warned",
        "no turntable",
        "did not run",
        "No file is recorded",
        "No settings",
        "not been validated",
    ]
    assert [one for one in expected if one not in text] == []
    assert "Against the photographs" not in text


def test_missing_and_damaged_pictures_are_reported(tmp_path):
    damaged = tmp_path / "damaged.png"
    damaged.write_bytes(b"\x89PNG no more")
    empty = tmp_path / "empty.jpg"
    empty.touch()
    pictures = [Picture(image=path, caption="c") for path in (damaged, empty, tmp_path / "gone.png", tmp_path)]
    stage = StageReport(name="s", title="S", sentence="Did.", pictures=pictures)
    report = replace(BARE, stages=[stage], turntable=[tmp_path / "gone.png", damaged])
    text = Tags(write_plant_report(tmp_path / "r", report).read_text(encoding="utf-8")).text
    for name in ("damaged.png", "empty.jpg", "gone.png", tmp_path.name):
        assert f"The picture {name} is missing." in text
    assert "no turntable" in text


def test_pictures_are_shrunk_and_keep_their_colours():
    embedded = embed_picture(flat_picture((200, 30, 30), (400, 800)), 200)
    assert (embedded.width, embedded.height) == (200, 100)
    data = np.frombuffer(base64.b64decode(embedded.uri.partition(",")[2]), np.uint8)
    read = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert read.shape == (100, 200, 3)
    assert np.abs(read.astype(int) - (200, 30, 30)).max() < 8


def test_a_transparent_picture_has_no_fringe_when_shrunk():
    picture = np.zeros((64, 64, 4), np.uint8)  # black where there is nothing
    picture[:, :33] = (250, 250, 250, 255)  # half of a small pixel
    embedded = embed_picture(picture, 32, quality=100)
    read = cv2.imdecode(np.frombuffer(base64.b64decode(embedded.uri.partition(",")[2]), np.uint8), cv2.IMREAD_UNCHANGED)
    edge = read[10, 16]
    assert 100 < edge[3] < 156
    assert edge[:3].min() > 235


@pytest.mark.parametrize("picture", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((4, 4, 2), np.uint8)])
def test_arrays_that_are_no_pictures_are_refused(picture):
    with pytest.raises(ValueError, match="must be"):
        embed_picture(picture, 100)


def test_stages_of_one_name_are_refused():
    stage = StageReport(name="leaves", title="Leaves", sentence="")
    with pytest.raises(ValueError, match="leaves"):
        replace(BARE, stages=[stage, stage])


def test_what_differs_from_the_defaults_is_marked():
    @dataclass(frozen=True)
    class Older:
        a: int = 2

    @dataclass(frozen=True)
    class Table:
        a: int = 1
        new: int = 5

    @dataclass(frozen=True)
    class Settings:
        a: int = 1
        b: int = 2
        t: Older | Table = Table()
        word: str = "x = 1"

    marked = mark_settings("s", Settings(), Settings(b=3, t=Older(), word="auto"))
    assert [(line.text, line.default) for line in marked.lines if line.changed] == [
        ("b = 2", "3"),
        ('word = "x = 1"', '"auto"'),
        ("a = 1", "2"),
        ("new = 5", ""),
    ]
    assert [line.text for line in marked.lines] == [
        "a = 1",
        "b = 2",
        'word = "x = 1"',
        "",
        "[t]",
        "a = 1",
        "new = 5",
    ]
    assert not any(line.changed for line in mark_settings("s", Settings(), Settings()).lines)


def test_the_verdict_follows_what_was_found():
    warned = replace(BARE, warnings=[ReportWarning(stage="", text="t")])
    error = Finding(severity="error", validator="v", error="", path="/", message="m")
    assert "without warnings" in judge(BARE)
    assert "one thing needs a look" in judge(warned)
    assert "should not be used" in judge(replace(warned, warnings=[ReportWarning(stage="", text="t", severe=True)]))
    assert "should not be used" in judge(replace(BARE, findings=[error]))
    assert "without warnings" in judge(replace(BARE, findings=[replace(error, accepted="known")]))
    assert "was not built" in judge(replace(BARE, state="failed"))
    assert judge(replace(BARE, verdict="Fine.")) == "Fine."


def test_times_are_beside_the_report_and_not_in_it(tmp_path):
    report = full_report(tmp_path)
    before = write_plant_report(tmp_path, report).read_bytes()
    timings = Timings(
        executor=NASTY,
        seconds=12.5,
        stages=[TaskTiming(stage="leaves", seconds=3.25, cached=True)],
        tasks=[TaskTiming(stage="leaves", name="a\udcff\u2028</script>", seconds=1.0)],
    )
    path = write_timings(tmp_path, timings)
    assert path.name == "timings.js"
    assert write_plant_report(tmp_path, report).read_bytes() == before
    code = path.read_text(encoding="ascii")
    assert "<" not in code
    assert re.fullmatch(r"usdfoliageTimings\(.*\);\n", code, re.DOTALL)
    written = json.loads(code.removeprefix("usdfoliageTimings(").removesuffix(");\n"))
    assert written["executor"] == NASTY
    assert written["tasks"][0]["name"] == "a�\u2028</script>"


def test_an_unwritable_folder_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(AssetError, match=r"index\.html was not written"):
        write_plant_report(tmp_path / "file", BARE)


@pytest.mark.parametrize(
    ("size", "words"),
    [(0, "0 bytes"), (999, "999 bytes"), (1000, "1 kB"), (999_600, "1 MB"), (2_340_000_000, "2.34 GB")],
)
def test_sizes_in_the_unit_in_which_they_read_well(size, words):
    assert in_bytes(size) == words
