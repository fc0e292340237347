"""Leaves that were found, put into their place as an asset with a report: those of photographs and of a cloud."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from usdfoliage import __version__
from usdfoliage.asset.leaf_representations import check_memory, default_representations
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.parts.leaf_part import LeafAppearance, LeafAssetSettings
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import publish_folder
from usdfoliage.errors import PreviewError
from usdfoliage.files.hashing import digest_files
from usdfoliage.jobs.leaves.page import ReportFrame, measure_rows
from usdfoliage.jobs.leaves.request import LeavesRequest
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, remark_missing_pictures, render_views
from usdfoliage.jobs.report.table import Row, WrittenReport
from usdfoliage.jobs.withheld.measure import MeasuredAsset
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.model_file import LeavesModel
from usdfoliage.leaf.segmentation.model import Step
from usdfoliage.progress import Progress, StepProgress, follow_step
from usdfoliage.remarks import Remark

REPORT = "report"  # folder in the asset


class FoundAny(Protocol):
    """Leaves that were found, before anything is written."""

    @property
    def leaves(self) -> Leaves:
        """In the plant's frame."""

    @property
    def model(self) -> LeavesModel:
        """What a later stage needs of them."""

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What the user should know of them."""

    @property
    def seconds(self) -> Mapping[str, float]:
        """By step."""

    @property
    def steps(self) -> Sequence[Step]:
        """What each step left."""


Found = TypeVar("Found", bound=FoundAny)


@dataclass(frozen=True, kw_only=True)
class MadeLeaves:
    """What was written, and what the user should know of it."""

    asset: Path
    report: Path
    representations: Sequence[str]
    remarks: tuple[Remark, ...]
    steps: Sequence[Step]
    measures: Sequence[Row]
    withheld: MeasuredAsset | None = None  # the asset against photographs that were withheld


@dataclass(frozen=True, kw_only=True, eq=False)
class RunFacts:
    """What happened to leaves after they were found, for their report."""

    remarks: Sequence[Remark]
    seconds: Mapping[str, float]  # by step
    previews: Sequence[str] = ()  # Storm's pictures in the report's folder, in the order in which they were chosen
    withheld: MeasuredAsset | None = None  # the asset against photographs that were withheld


@dataclass(frozen=True, kw_only=True, eq=False)
class LeavesSource(Generic[Found]):
    """What is done in one way where leaves are of photographs, and in another where they are of a cloud."""

    find: Callable[[LeavesRequest, StepProgress | None], Found]
    # Writes the asset into a folder, which has one for the report; returns the interface layer.
    write_asset: Callable[[Path, LeavesRequest, Found, LeafAssetSettings], Path]
    # Which pictures Storm draws into the report's folder, and how; none where the user wants none.
    choose_previews: Callable[[Path, LeavesRequest, Found], tuple[Sequence[PreviewView], PreviewSettings]]
    write_report: Callable[[Path, LeavesRequest, Found, RunFacts], WrittenReport]
    # Measures the interface by what was withheld, with pictures in the report's folder; None: nothing can be withheld.
    measure: Callable[[Path, LeavesRequest, Path, Progress], MeasuredAsset] | None = None


def publish_leaves(
    request: LeavesRequest, source: LeavesSource[Found], progress: StepProgress | None = None
) -> MadeLeaves:
    """Find leaves and publish their asset; the old asset stays until the new one is whole.

    Raises:
        FoliageError: The input is unusable, or the output cannot be written; nothing was changed.
    """
    with publish_folder(
        request.output, force=request.force, origin=request.origin, keep_old=request.keep_old
    ) as folder:
        found = source.find(request, progress)
        seconds = dict(found.seconds)
        report = folder / REPORT
        with follow_step("asset", seconds, progress):
            settings = LeafAssetSettings(representations=choose_representations(request, len(found.leaves)))
            check_memory(len(found.leaves), settings)
            report.mkdir()
            interface = source.write_asset(folder, request, found, settings)
        remarks = list(found.remarks)
        views, how = source.choose_previews(report, request, found)
        previews: list[str] = []
        if request.preview and len(found.leaves) and views:
            with follow_step("preview", seconds, progress) as advance:
                try:
                    render_views(interface, views, how, advance)
                    previews = [view.output.name for view in views]
                except PreviewError as error:
                    remarks.append(remark_missing_pictures(error))
        withheld = None
        if request.hold_back and source.measure is not None:
            with follow_step("withheld", seconds, progress) as advance:
                withheld = source.measure(interface, request, report, advance)
            remarks += withheld.remarks
        if progress:
            progress("report", 0.0)
        facts = RunFacts(remarks=remarks, seconds=seconds, previews=previews, withheld=withheld)
        source.write_report(report, request, found, facts)
    return MadeLeaves(
        asset=request.output / interface.name,
        report=request.output / REPORT / "index.html",
        representations=settings.representations,
        remarks=tuple(remarks),
        steps=found.steps,
        measures=measure_rows(found.leaves),
        withheld=withheld,
    )


def write_found_asset(
    folder: Path,
    request: LeavesRequest,
    found: FoundAny,
    settings: LeafAssetSettings,
    appearance: LeafAppearance,
    *,
    source: Path,
    described: Mapping[str, str],
    inputs: Sequence[Path],
) -> Path:
    """Write the asset of leaves in its own frame into folder; returns its interface layer.

    Args:
        folder: Of the asset.
        request: What was asked for.
        found: The leaves.
        settings: Which representations.
        appearance: Colour and texture.
        source: The capture's folder, or the cloud's file, whose name the asset states.
        described: Settings that it states.
        inputs: Files whose digest it states.
    """
    provenance = Provenance(
        species=request.species,
        capture=source.resolve().name,
        generator=f"usdfoliage {__version__}",
        seed=request.seed,
        settings=described,
        input_sha256=digest_files(inputs),
    )
    return write_leaf_asset(
        folder,
        request.name,
        found.leaves,
        provenance,
        settings,
        appearance=appearance,
        asset_from_capture=found.model.asset_from_capture,
    )


def frame_report(request: LeavesRequest, source: str, described: Mapping[str, str], facts: RunFacts) -> ReportFrame:
    """What the report states of a run; source is the name of the capture, or of the cloud's file."""
    return ReportFrame(
        name=request.name,
        source=source,
        generator=f"usdfoliage {__version__}",
        remarks=facts.remarks,
        render_setting=request.render_setting,
        settings=described,
        seconds=facts.seconds if request.times else {},
    )


def choose_representations(request: LeavesRequest, count: int) -> tuple[str, ...]:
    """Those asked for; else all of them for as many leaves as anything opens."""
    if request.representations is not None:
        return request.representations
    return default_representations(count)
