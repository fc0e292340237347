"""The index of a library of plants: what was built of many captures, with links to each plant's own report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.publish_file import publish_text
from usdfoliage.jobs.report.page import render_page
from usdfoliage.jobs.report.page_pictures import PagePicture, embed_picture
from usdfoliage.remarks import Remedy, RenderSetting, as_plan_setting, write_remedy

THUMBNAIL_PX = 320
QUALITY = 75  # there may be hundreds of them

PlantState = Literal["built", "warnings", "failed", "skipped"]
# The worst first, as the page sorts them.
STATES: dict[PlantState, str] = {
    "failed": "failed",
    "warnings": "built, with warnings",
    "skipped": "skipped",
    "built": "built",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class LibraryPlant:
    """One plant of a library."""

    name: str
    state: PlantState
    capture: str = ""
    species: str = ""
    thumbnail: Path | NDArray[np.uint8] | None = None
    height_m: float | None = None
    leaves: int | None = None
    branches: int | None = None
    size_bytes: int | None = None  # of the asset on disk
    message: str = ""  # of what failed, why it was skipped, or the first warning
    remedy: Remedy = ()  # what to do
    warnings: int = 0
    report: str = ""  # the plant's report, as seen from the library's folder; empty where there is none
    asset: str = ""  # its interface layer, likewise

    def sentence(self, render: RenderSetting) -> str:
        """Message and remedy; render writes a setting as the reader sets it."""
        return f"{self.message}; {write_remedy(self.remedy, render)}" if self.remedy else self.message


@dataclass(frozen=True, kw_only=True, eq=False)
class Library:
    """All plants of a batch."""

    title: str
    plants: Sequence[LibraryPlant]
    generator: str = ""
    notes: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class _Tile:
    """A plant with its picture."""

    plant: LibraryPlant
    remedy: str  # with the settings of a plan
    picture: PagePicture | None


@dataclass(frozen=True, kw_only=True)
class _StateCount:
    state: PlantState
    words: str
    count: int


def write_library_page(folder: Path, library: Library) -> Path:
    """Write index.html into folder, which is made if need be; returns the page.

    The page holds its pictures; only the links lead out of it. The same library gives the same bytes.

    Raises:
        WriteError: The page cannot be written; what was there is unchanged.
    """
    plants = sorted(library.plants, key=lambda plant: (plant.name.casefold(), plant.name))
    tiles = [
        _Tile(
            plant=plant,
            remedy=write_remedy(plant.remedy, as_plan_setting),
            picture=None if plant.thumbnail is None else embed_picture(plant.thumbnail, THUMBNAIL_PX, QUALITY),
        )
        for plant in plants
    ]
    counts = [
        _StateCount(state=state, words=words, count=sum(plant.state == state for plant in plants))
        for state, words in STATES.items()
    ]
    page = render_page(
        "library.html",
        "library.css",
        "library.js",
        library=library,
        tiles=tiles,
        counts=[count for count in counts if count.count],
        words=STATES,
        ranks={state: rank for rank, state in enumerate(STATES)},
    )
    index = folder / "index.html"
    publish_text(index, page)
    return index
