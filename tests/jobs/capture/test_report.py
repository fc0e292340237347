"""The report of a capture: remarks first, everything named, nothing that is not there."""

import errno
import json
import os
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.errors import WriteError
from usdfoliage.jobs.capture import overlap_pictures as overlap
from usdfoliage.jobs.capture import report as capture_report
from usdfoliage.jobs.capture.map_pictures import (
    NOTHING,
    depth_limits,
    draw_confidence,
    draw_depth,
    draw_normals,
    draw_shared,
    in_words,
)
from usdfoliage.jobs.capture.overlap_pictures import find_groups, find_links
from usdfoliage.jobs.capture.report import (
    CapturePhotograph,
    CaptureReport,
    DrawnMaps,
    capture_rows,
    check_capture,
    write_capture_report,
)
from usdfoliage.jobs.report.pictures import TURBO, color_values
from usdfoliage.jobs.report.timings import TIMINGS
from usdfoliage.remarks import remark

from tests.support.captures import LENS, look_at, ring, sphere_depth

VOID = {"meta", "img", "br", "input", "link", "hr"}


@pytest.fixture(autouse=True)
def _small_pictures(monkeypatch):
    monkeypatch.setattr(capture_report, "CLOUD_PX", 150)
    monkeypatch.setattr(overlap, "PLAN_PX", 150)


class Page(HTMLParser):
    """The links and the text of a page; ValueError for tags that do not fit together."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.files: set[str] = set()
        self.scripts = 0
        self.texts: list[str] = []
        self.feed(text)
        if self.open:
            raise ValueError(f"{self.open} are not closed")

    def handle_starttag(self, tag, attributes):
        self.scripts += tag == "script"
        self.files |= {value for name, value in attributes if name in ("src", "href")}
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if self.open.pop() != tag:
            raise ValueError(f"</{tag}> closes another")

    def handle_data(self, data):
        if not self.open or self.open[-1] != "style":
            self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


def some_cloud(count: int = 400) -> Cloud:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Cloud(
        points_m=0.5 * normals,
        normals=normals.astype(np.float32),
        srgb=rng.integers(0, 256, (count, 3), dtype=np.uint8),
        confidence=rng.uniform(0, 1, count).astype(np.float32),
        views=rng.integers(1, 4, count, dtype=np.int32),
    )


def some_maps(camera) -> DrawnMaps:
    depth_m = sphere_depth(camera, 0.5).astype(np.float32)
    size = depth_m.shape
    normals = np.zeros((*size, 3), np.float32)
    normals[depth_m > 0] = (0, 0, 1)
    return DrawnMaps(
        srgb=np.full((*size, 3), 90, np.uint8),
        depth_m=depth_m,
        normals=normals,
        confidence=np.full(size, 0.5, np.float32),
        mask=depth_m > 0,
    )


def some_report(count: int = 4, **changes: object) -> CaptureReport:
    photographs = []
    for number, (name, pose) in enumerate(ring(count).items()):
        camera = LENS.pinhole(pose)
        photographs.append(
            CapturePhotograph(
                name=name,
                camera=camera,
                sources=[other for other in (number - 1, number + 1) if 0 <= other < count],
                coverage=0.25 + 0.1 * (number % 5),
                read_maps=lambda camera=camera: some_maps(camera),
            )
        )
    report = CaptureReport(
        name="fern",
        capture="fern_photos",
        generator="usdfoliage 1",
        remarks=[remark("views-without-mask", "masks were not there")],
        photographs=photographs,
        cloud=some_cloud(),
        up=(0, 1, 0),
        poses_given=True,
        drawn=range(count),
        seconds={"depth": 2.0, "cloud": 1.0},
        settings={"quality": "normal"},
    )
    return replace(report, **changes)


def estimated(report: CaptureReport, errors: list[float], failed: str = "") -> CaptureReport:
    """The same as if the poses had been found."""
    photographs = [
        replace(photograph, error_px=error, points=100 * (number + 1))
        for number, (photograph, error) in enumerate(zip(report.photographs, errors, strict=True))
    ]
    if failed:
        photographs.append(CapturePhotograph(name="other.jpg", failure=failed))
    count = len(photographs)
    shared = np.zeros((count, count))
    for number in range(len(errors) - 1):
        shared[number, number + 1] = shared[number + 1, number] = 50 + number
    errors_px = np.random.default_rng(0).gamma(2, 0.3, 500)
    return replace(report, photographs=photographs, poses_given=False, shared=shared, errors_px=errors_px)


def write(folder: Path, report: CaptureReport) -> Page:
    written = write_capture_report(folder, report)
    assert written.page == folder / "index.html"
    parsed = Page(written.page.read_text(encoding="utf-8"))
    names = {path.name for path in folder.iterdir()}
    assert (TIMINGS in names) == bool(report.seconds)
    assert parsed.files == (names | {TIMINGS}) - {"index.html"}  # no more, no less
    for_plant = [(picture.file, picture.caption) for picture in written.pictures]
    sides = ("front", "right", "top") if len(report.cloud) else ()
    assert for_plant == [(f"cloud_{side}_colour.jpg", f"The cloud, {side}") for side in sides]
    assert parsed.files.issuperset(file for file, _ in for_plant)
    return parsed


# The page


def test_a_report_of_given_poses(tmp_path):
    page = write(tmp_path / "report", some_report())
    assert "400 points from 4 photographs of fern_photos" in page.text
    assert page.text.index("masks were not there") < page.text.index("The cloud")
    assert "Reprojection errors" not in page.text
    assert "given" in page.text
    assert "quality normal" in page.text
    times = (tmp_path / "report" / TIMINGS).read_text()
    written = json.loads(times.removeprefix("usdfoliageTimings(").removesuffix(");\n"))
    assert (written["seconds"], [row["stage"] for row in written["stages"]]) == (3.0, ["depth", "cloud"])
    for name in ("cloud_front_colour.jpg", "cloud_top_views.jpg", "view_003_normals.jpg", "plan.jpg", "shared.png"):
        picture = cv2.imread(str(tmp_path / "report" / name))
        assert picture is not None
        assert picture.std() > 1


def test_a_report_of_poses_that_were_found(tmp_path):
    report = estimated(some_report(), [0.5, 0.6, 0.5, 2.4], "it has 3 matches with others, 30 are needed")
    page = write(tmp_path, report)
    assert "1 of 5 photographs have no camera: other.jpg" in page.text
    assert "it has 3 matches with others, 30 are needed" in page.text
    assert "1 photograph with a reprojection error above 1.10 px, twice the median: 003.png" in page.text
    assert "Reprojection errors" in page.text
    assert "52 matches" in page.text
    assert page.text.index("have no camera") < page.text.index("The cloud")


def test_what_photographs_are_called_is_no_markup(tmp_path):
    report = some_report()
    evil = replace(report.photographs[0], name="<script>alert(1)</script>.jpg", remark="a & b")
    report = replace(
        report,
        name="<b>",
        photographs=[evil, *report.photographs[1:]],
        remarks=[remark("views-without-mask", '"><script>')],
    )
    page = write(tmp_path, report)
    assert page.scripts == write(tmp_path / "tame", some_report()).scripts == 2
    assert "<script>alert(1)</script>.jpg" in page.text
    assert "a & b" in page.text


@pytest.mark.parametrize(
    "report",
    [
        some_report(1),
        some_report(2, drawn=[]),
        some_report(cloud=some_cloud(0)),
        some_report(cloud=some_cloud(1)),
        some_report(0, photographs=[CapturePhotograph(name="a.jpg")], drawn=[]),
        some_report(0, photographs=[], cloud=some_cloud(0), drawn=[]),
        some_report(seconds={}, settings={}, remarks=[]),
        some_report(up=(0, 0, 1)),
    ],
    ids=["one", "none shown", "no points", "one point", "none registered", "nothing", "no remarks", "z up"],
)
def test_little_makes_a_report_as_well(tmp_path, report):
    write(tmp_path, report)


def test_the_same_run_gives_the_same_report(tmp_path):
    report = estimated(some_report(), [0.5, 0.6, 0.5, 0.4])
    written = []
    for name in ("a", "b"):
        write(tmp_path / name, report)
        written.append({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()})
    assert written[0] == written[1]


def test_maps_are_read_once_and_only_of_drawn_photographs(tmp_path):
    read: list[int] = []

    def reader(number, camera):
        read.append(number)
        return some_maps(camera)

    report = some_report(6, drawn=[0, 3])
    photographs = [
        replace(photograph, read_maps=lambda number=number, camera=photograph.camera: reader(number, camera))
        for number, photograph in enumerate(report.photographs)
    ]
    page = write(tmp_path, replace(report, photographs=photographs))
    assert read == [0, 3]
    assert "2 of 6 photographs with depth are shown" in page.text


def test_a_photograph_without_maps_cannot_be_drawn(tmp_path):
    report = some_report()
    without = replace(report.photographs[1], read_maps=None, sources=[])
    with pytest.raises(ValueError, match=r"001\.png has no camera or no maps"):
        write_capture_report(tmp_path, replace(report, photographs=[report.photographs[0], without], drawn=[1]))


def test_photographs_that_do_not_exist_are_not_called():
    report = some_report()
    with pytest.raises(ValueError, match="numbers from 0 to 3"):
        replace(report, drawn=[4])
    with pytest.raises(ValueError, match="numbers from 0 to 3"):
        replace(report, photographs=[*report.photographs[:3], replace(report.photographs[3], sources=[7])])
    with pytest.raises(ValueError, match=r"shared must be \(4, 4\)"):
        replace(report, shared=np.zeros((3, 3)))


def test_maps_may_be_fewer_and_of_another_size_than_their_photograph(tmp_path):
    report = some_report(2)
    camera = report.photographs[0].camera
    small = some_maps(camera)
    large = np.full((96, 128, 3), 90, np.uint8)
    enlarged = replace(report.photographs[0], read_maps=lambda: DrawnMaps(srgb=large, depth_m=small.depth_m))
    write(tmp_path, replace(report, photographs=[enlarged, report.photographs[1]]))
    assert not (tmp_path / "view_000_normals.jpg").exists()


def test_a_full_disk_is_reported(tmp_path, monkeypatch):
    def full(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(WriteError, match="No space left"):
        write_capture_report(tmp_path, some_report())
    assert not (tmp_path / "index.html").exists()


# Remarks


def test_a_report_has_a_remark_on_photographs_that_hang_together_with_none():
    report = estimated(some_report(5), [0.5] * 5)
    assert check_capture(report) == []
    assert report.shared is not None
    cut = report.shared.copy()
    cut[2, 3] = cut[3, 2] = 0
    (remark,) = check_capture(replace(report, shared=cut))
    assert remark.code == "photographs-in-groups"
    assert "fall into 2 groups that were not matched with each other, of 3, 2 photographs" in remark.text


def test_photographs_without_depth_are_named():
    report = some_report()
    bare = replace(report.photographs[2], coverage=0.0)
    (remark,) = check_capture(replace(report, photographs=[*report.photographs[:2], bare, report.photographs[3]]))
    assert remark.text == "1 photograph without any depth: 002.png"


def test_rows_have_the_figures():
    rows = {row.name: row.value for row in capture_rows(some_report())}
    assert rows["photographs"] == "4 of 4"
    assert rows["poses"] == "given"
    assert rows["points"] == "400"
    assert rows["depth"].startswith("40 (26.5 to 53.5) %") or rows["depth"].startswith("40 (")
    rows = {row.name: row.value for row in capture_rows(estimated(some_report(), [0.5, 0.5, 0.5, 0.5]))}
    assert rows["reprojection error"] == "0.5 (0.5 to 0.5) px"


def test_links_come_from_matches_or_from_sources():
    report = some_report(4)
    assert find_links(report.photographs, None) == {(0, 1): 2, (1, 2): 2, (2, 3): 2}
    shared = np.zeros((4, 4))
    shared[0, 3] = shared[3, 0] = 7
    links = find_links(report.photographs, shared)
    assert links == {(0, 3): 7}
    assert find_groups(report.photographs, links) == [[0, 3], [1], [2]]
    without = [report.photographs[0], CapturePhotograph(name="a.jpg"), *report.photographs[2:]]
    assert find_links(without, None) == {(2, 3): 2}
    assert find_groups(without, {}) == [[0], [2], [3]]


# Pictures


def test_near_is_red_and_far_is_blue():
    depth_m = np.array([[1.0, 2.0, 0.0]])
    picture = draw_depth(depth_m, (1.0, 2.0))
    assert picture[0, 0, 0] > 100 > picture[0, 0, 2]
    assert picture[0, 1, 2] > picture[0, 1, 0] - 40
    assert tuple(picture[0, 2]) == NOTHING
    assert (draw_depth(np.zeros((2, 2)), None) == NOTHING).all()


def test_limits_are_those_of_the_plant():
    depth_m = np.array([[1.0, 1.5, 2.0, 90.0, 0.0]])
    near, far = depth_limits(depth_m, np.array([[True, True, True, False, True]]))
    assert 1 <= near < far <= 2
    assert depth_limits(depth_m)[1] > 80
    assert depth_limits(depth_m, np.zeros((1, 5), bool))[1] > 80  # a mask without any depth
    assert depth_limits(np.zeros((2, 2))) is None


def test_normals_towards_the_camera_are_blue():
    camera = LENS.pinhole(look_at((0, 0, 2), (0, 0, 0)))
    normals = np.zeros((1, 4, 3))
    normals[0, :3] = [(0, 0, 1), (1, 0, 0), (0, 1, 0)]
    picture = draw_normals(normals, camera)
    np.testing.assert_allclose(picture[0, :3], [(128, 128, 255), (255, 128, 128), (128, 255, 128)], atol=1)
    assert tuple(picture[0, 3]) == NOTHING


def test_confidence_is_drawn_where_there_is_depth():
    picture = draw_confidence(np.array([[0.0, 1.0, 1.0]]), np.array([[True, True, False]]))
    assert picture[0, 0].sum() < picture[0, 1].sum()
    assert tuple(picture[0, 2]) == NOTHING


def test_a_matrix_has_a_square_for_each_pair():
    shared = np.zeros((10, 10))
    shared[2, 5] = 4
    picture = draw_shared(shared, 100)
    assert picture.shape == (100, 100, 3)
    assert tuple(picture[25, 55]) == tuple(color_values(np.array(1.0), 0, 1, cv2.COLORMAP_VIRIDIS))
    assert tuple(picture[55, 25]) == (255, 255, 255)
    assert draw_shared(np.zeros((0, 0))).size
    assert draw_shared(np.ones((2000, 2000))).shape == (2000, 2000, 3)


def test_colors_run_from_low_to_high():
    colors = color_values(np.array([-1.0, 0.0, 5.0, 9.0]), 0, 5, TURBO)
    assert (colors[0] == colors[1]).all()
    assert (colors[2] == colors[3]).all()
    assert not (colors[1] == colors[2]).all()
    assert np.isfinite(color_values(np.array([1.0]), 1, 1, TURBO)).all()


@pytest.mark.parametrize(
    ("length_m", "words"), [(1500, "1.5 km"), (2, "2 m"), (0.5, "50 cm"), (0.002, "2 mm"), (3e-5, "30 µm")]
)
def test_lengths_read_well(length_m, words):
    assert in_words(length_m) == words
