"""The quality report of a whole plant, as a supervisor reads it: its content, without its layout."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.contents import AssetFile
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.work.settings_file import list_lines

State = Literal["done", "warnings", "failed", "skipped"]


@dataclass(frozen=True, kw_only=True)
class ReportWarning:
    """Something to look at before the plant is accepted."""

    stage: str  # title of the stage it comes from; empty where it is about the whole
    text: str  # in plain words: what was found, and what was needed
    remedy: str = ""  # what to do
    severe: bool = False  # the result cannot be used as it is


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A picture with what it shows."""

    image: Path | NDArray[np.uint8]  # a file, or (H, W, 3) or (H, W, 4) sRGB; a missing file is reported in its place
    caption: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """A photograph, and the plant drawn from the same camera in the same size."""

    name: str  # of the photograph
    photograph: Path | NDArray[np.uint8]
    drawing: Path | NDArray[np.uint8]
    iou: float | None = None  # of the two silhouettes; None without a mask
    masks: str = ""  # what it is measured against: "given" or "drawn" ones
    remark: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Variant:
    """One representation or level of detail: how it looks and what it costs."""

    set: str  # the variant set: representation, lod
    name: str
    picture: Picture | None = None
    costs: Sequence[Row] = ()  # such as triangles, memory, size on disk
    is_default: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class StageReport:
    """What one stage did, in the order of the run."""

    name: str  # as the command line has it; the anchor of its section
    title: str
    sentence: str  # what it did
    state: State = "done"
    rows: Sequence[Row] = ()
    pictures: Sequence[Picture] = ()
    notes: Sequence[str] = ()  # less than a warning
    detail_report: str = ""  # its own report, as seen from this one's folder


@dataclass(frozen=True, kw_only=True)
class SettingLine:
    """A line of TOML."""

    text: str
    changed: bool = False  # it is not the default
    default: str = ""  # value of the default where it is changed; empty where there is none


@dataclass(frozen=True, kw_only=True)
class StageSettings:
    """The settings of a stage."""

    stage: str
    lines: Sequence[SettingLine]


@dataclass(frozen=True, kw_only=True)
class InputFile:
    """A file that the plant was made from."""

    name: str
    sha256: str
    size_bytes: int


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantReport:
    """The whole content of a plant's report; nothing in it differs between two runs of the same input."""

    name: str
    capture: str
    generator: str
    species: str = ""
    state: State = "done"
    verdict: str = ""  # one sentence; by the state and the warnings where it is empty
    warnings: Sequence[ReportWarning] = ()
    facts: Sequence[Row] = ()  # the key numbers: height, leaves, branches, crown radius, size on disk
    turntable: Sequence[Path | NDArray[np.uint8]] = ()  # frames of one turn, counterclockwise as seen from above
    comparisons: Sequence[Comparison] = ()
    variants: Sequence[Variant] = ()
    stages: Sequence[StageReport] = ()
    validated: bool = True  # False: the validators did not run, and no finding means nothing
    findings: Sequence[Finding] = ()
    files: Sequence[AssetFile] = ()
    settings: Sequence[StageSettings] = ()
    inputs: Sequence[InputFile] = ()
    versions: Sequence[Row] = ()

    def __post_init__(self) -> None:
        names = [stage.name for stage in self.stages]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ValueError(f"stages must have names of their own, not twice {', '.join(sorted(twice))}")


def mark_settings(stage: str, settings: object, defaults: object) -> StageSettings:
    """The settings of a stage, as format_settings writes them, with what differs from the defaults marked."""
    default_values = {line.name: line.value for line in list_lines(defaults) if line.name}
    lines = []
    for line in list_lines(settings):
        changed = bool(line.name) and default_values.get(line.name) != line.value
        default = default_values.get(line.name, "") if changed else ""
        lines.append(SettingLine(text=line.text, changed=changed, default=default))
    return StageSettings(stage=stage, lines=tuple(lines))


def judge(report: PlantReport) -> str:
    """The verdict in one sentence, for who gave none."""
    if report.verdict:
        return report.verdict
    if report.state == "failed":
        return "The plant was not built; what went wrong is below."
    if is_unusable(report):
        return "The plant was built, but should not be used as it is; what is wrong is below."
    if report.warnings:
        count = len(report.warnings)
        return f"The plant was built; {'one thing needs' if count == 1 else f'{count} things need'} a look."
    if not report.validated:
        return "The plant was built; it has not been validated."
    return "The plant was built, without warnings."


def is_unusable(report: PlantReport) -> bool:
    """Whether there is something that must be put right first: a severe warning, or an error of the validators."""
    severe = any(warning.severe for warning in report.warnings)
    return severe or any(finding.severity == "error" and not finding.accepted for finding in report.findings)
