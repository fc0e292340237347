"""Reports of a plant that was never built, and the text of a page, for tests of pages."""

from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.asset.packages.contents import AssetFile
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.jobs.plant.pages.report import (
    Comparison,
    InputFile,
    Picture,
    PlantReport,
    ReportWarning,
    StageReport,
    Variant,
    mark_settings,
)
from usdfoliage.jobs.report.table import Row


@dataclass(frozen=True)
class _FitSettings:
    rounds: int = 3


@dataclass(frozen=True)
class _Settings:
    seed: int = 0
    fit: _FitSettings = field(default_factory=_FitSettings)


def flat_picture(color: tuple[int, int, int], size: tuple[int, int] = (300, 400)) -> NDArray[np.uint8]:
    """(H, W, 3) of one colour."""
    return np.full((*size, 3), color, np.uint8)


def write_png(path: Path, picture: NDArray[np.uint8]) -> Path:
    path.write_bytes(cv2.imencode(".png", picture[..., ::-1])[1].tobytes())
    return path


def full_report(folder: Path) -> PlantReport:
    """A report with everything in it; the photographs are red, the drawings blue."""
    photograph = write_png(folder / "photograph.png", flat_picture((200, 30, 30)))
    drawing = write_png(folder / "drawing.png", flat_picture((30, 30, 200)))
    turn = [write_png(folder / f"turn_{n}.png", flat_picture((60 * n, 120, 40), (240, 320))) for n in range(4)]
    return PlantReport(
        name="holly",
        capture="holly_2024",
        generator="usdfoliage test",
        species="Ilex aquifolium",
        warnings=[
            ReportWarning(stage="Leaves", text="14 of 380 leaves did not fit", remedy="Look at their report."),
            ReportWarning(stage="Capture", text="The scale is not known.", severe=True),
        ],
        facts=[Row(name="height", value="1.84 m"), Row(name="leaves", value="365", remark="median 68 mm long")],
        turntable=turn,
        comparisons=[
            Comparison(name="000.jpg", photograph=photograph, drawing=drawing, iou=0.8125, masks="drawn"),
            Comparison(name="001.jpg", photograph=photograph, drawing=flat_picture((30, 30, 200))),
        ],
        variants=[
            Variant(
                set="lod",
                name=name,
                picture=Picture(image=drawing, caption=name),
                costs=[Row(name="triangles", value="70,080")],
                is_default=name == "leaves",
            )
            for name in ("leaves", "both", "crown")
        ],
        stages=[
            StageReport(name="capture", title="Capture", sentence="Read 10 photographs."),
            StageReport(
                name="leaves",
                title="Leaves",
                state="warnings",
                sentence="Found leaves.",
                rows=[Row(name="leaves", value="365")],
                pictures=[Picture(image=photograph, caption="Fitted leaves.")],
                notes=["There were no masks."],
                detail_report="leaves/index.html",
            ),
        ],
        findings=[
            Finding(severity="warning", validator="v:Rule", error="E", path="/holly", message="looks odd"),
            Finding(severity="info", validator="v:Rule", error="E", path="/holly", message="is known", accepted="old"),
        ],
        files=[AssetFile(path="holly.usda", size_bytes=10_500), AssetFile(path="payload/x.usdc", size_bytes=2_000_000)],
        settings=[mark_settings("leaves", _Settings(fit=_FitSettings(rounds=4)), _Settings())],
        inputs=[InputFile(name="images/000.jpg", sha256="ab" * 32, size_bytes=123)],
        versions=[Row(name="OpenUSD", value="26.11")],
    )


class Tags(HTMLParser):
    """Every tag with its attributes, and the text outside of scripts and style sheets."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._within = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._within = tag if tag in ("script", "style") else self._within

    def handle_endtag(self, tag):
        self._within = "" if tag == self._within else self._within

    def handle_data(self, data):
        self.text += "" if self._within else data
