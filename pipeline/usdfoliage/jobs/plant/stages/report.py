"""The last tasks of a plant: pictures of the finished asset, its validation, and the report."""

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from usdfoliage import __version__
from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.asset.packages.contents import AssetFile, interface_of, list_files
from usdfoliage.asset.provenance import PACKAGES, VALIDATION_PACKAGES, package_versions
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import ValidationReport, validate_asset
from usdfoliage.capture.cloud_files.leaf_points import renumber_leaf_points
from usdfoliage.capture.folder.read import read_capture
from usdfoliage.errors import PreviewError, PreviewTimeoutError
from usdfoliage.files.json import read_json
from usdfoliage.files.npz import read_arrays
from usdfoliage.jobs.leaves.cloud_run import POINTS_FILE
from usdfoliage.jobs.plant.asset_facts import AssetFacts, read_asset_facts
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.pages.pictures import draw_comparisons, draw_turntable, draw_variants
from usdfoliage.jobs.plant.pages.report import (
    Comparison,
    InputFile,
    Picture,
    PlantReport,
    ReportWarning,
    StageReport,
    StageSettings,
    State,
    Variant,
    mark_settings,
)
from usdfoliage.jobs.plant.pages.report_html import write_plant_report
from usdfoliage.jobs.plant.settings import SKETCH_SETTINGS, STAGE_SETTINGS, BuildSettings
from usdfoliage.jobs.plant.stages.assemble import ASSET_FOLDER, LEAF_NUMBERS
from usdfoliage.jobs.plant.stages.isolate import has_drawn_masks, plant_capture
from usdfoliage.jobs.plant.stages.models import REPORT_FOLDER
from usdfoliage.jobs.plant.store import ResultFile, copy_tree
from usdfoliage.jobs.plant.summary import StageSummary, read_summary, write_summary
from usdfoliage.jobs.plant.tasks import (
    ASSET,
    BRANCHES,
    CLOUD,
    COMPARISONS,
    CROWN,
    ISOLATION,
    LEAVES,
    POSES,
    SKETCH,
    TURNTABLE,
    VARIANTS,
    WITHHELD,
)
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.sketch.report import OVER_PHOTOGRAPH, PHOTOGRAPH
from usdfoliage.jobs.withheld.measure import FIGURES
from usdfoliage.remarks import Remark, infos_of, merge_remarks, remark, warnings_of

FINISHED = "finished"  # the whole asset, in the result of the report
VERDICT = "verdict.json"  # beside it: the findings of validation, key numbers, and the report's first lines
_PICTURES, _COMPARED = "pictures", "compared.json"

TITLES: dict[str, tuple[str, str]] = {  # of stages in the report, and what each did
    POSES: ("Cameras", "Where each photograph was taken from."),
    CLOUD: ("Depth and cloud", "The depth of every photograph, and one coloured cloud of all of them."),
    ISOLATION: ("Isolation", "What of the cloud and of the photographs is the plant, and what was left out."),
    BRANCHES: ("Branches", "Skeleton, radii and surface of the branches, traced through the cloud."),
    LEAVES: ("Leaves", "Single leaves found in the photographs and fitted."),
    CROWN: ("Crown", "The crown as seen from its centre: how far it reaches, and its colours."),
    SKETCH: ("Tree", "Leaves and branches that the strokes mark in the photograph, and a tree that grew from them."),
    ASSET: ("Plant", "All parts in one frame, in one asset."),
    WITHHELD: ("Withheld photographs", "The asset over photographs that it was not made of."),
}


def turn_plant(call: StageCall) -> tuple[ResultFile, ...]:
    """Pictures from all around."""

    def draw() -> tuple[Remark, ...]:
        draw_turntable(
            _asset_of(call), _shape_of(call), call.out / _PICTURES, call.settings.pictures, call.report_parts
        )
        return ()

    return _draw(call, draw)


def compare_plant(call: StageCall) -> tuple[ResultFile, ...]:
    """Pictures from the photographs' own cameras, beside the photographs, with the masks that the parts are made by."""

    def draw() -> tuple[Remark, ...]:
        capture = read_capture(plant_capture(call))
        masks = "drawn" if has_drawn_masks(call) else "given"
        compared = draw_comparisons(
            _asset_of(call),
            _shape_of(call),
            capture,
            call.out / _PICTURES,
            call.settings.pictures,
            call.report_parts,
        )
        pictures = [
            {
                "name": each.name,
                "photograph": Path(str(each.photograph)).name,
                "drawing": Path(str(each.drawing)).name,
                "iou": each.iou,
                "masks": "" if each.iou is None else masks,
            }
            for each in compared.comparisons
        ]
        (call.out / _COMPARED).write_text(json.dumps(pictures, indent=1))
        return compared.remarks

    return _draw(call, draw)


def show_variants(call: StageCall) -> tuple[ResultFile, ...]:
    """A picture of every variant."""

    def draw() -> tuple[Remark, ...]:
        drawn = draw_variants(
            _asset_of(call), _shape_of(call), call.out / _PICTURES, call.settings.pictures, call.report_parts
        )
        pictures = [
            {"set": each.set, "name": each.name, "picture": each.picture.name, "default": each.is_default}
            for each in drawn
        ]
        (call.out / _COMPARED).write_text(json.dumps(pictures, indent=1))
        return ()

    return _draw(call, draw)


def report_plant(call: StageCall) -> tuple[ResultFile, ...]:
    """The finished asset with its report, validated."""
    finished = call.out / FINISHED
    finished.mkdir()
    copy_tree(_asset_of(call), finished, link=True)
    report_folder = finished / "report"
    report_folder.mkdir(exist_ok=True)
    profile = read_profile(call.request.profile or default_profile())
    validated = validate_asset(finished, profile)
    asset = read_asset_facts(call.asset_result)
    report = _collect(call, finished, validated, asset)
    write_plant_report(report_folder, report)
    _copy_details(call, report_folder)
    withheld = read_json(call.result_of(WITHHELD) / FIGURES) if call.has(WITHHELD) else None
    if withheld is not None:
        shutil.copyfile(call.result_of(WITHHELD) / FIGURES, report_folder / FIGURES)
    errors = validated.open_errors
    verdict = {
        "errors": errors,
        "height_m": asset.height_m,
        "leaves": asset.leaves,
        "branches": asset.branches,
        "remarks": [each.as_json() for each in _collect_remarks(call)],
        "withheld": withheld,
        "facts": [asdict(row) for row in (*report.facts, _validation_row(validated))],
    }
    (call.out / VERDICT).write_text(json.dumps(verdict, indent=1, ensure_ascii=True))
    write_summary(call.out, StageSummary())
    return ()


def _collect_remarks(call: StageCall) -> tuple[Remark, ...]:
    """The remarks of every stage, each once. Warnings come first, above all of parts that could not be made."""
    names = [name for name in (*TITLES, TURNTABLE, COMPARISONS, VARIANTS) if call.has(name)]
    summaries = sorted((read_summary(call.result_of(name)) for name in names), key=lambda each: not each.failure)
    remarks = merge_remarks(*(summary.remarks for summary in summaries))
    return (*warnings_of(remarks), *infos_of(remarks))


def _collect(call: StageCall, finished: Path, validated: ValidationReport, asset: AssetFacts) -> PlantReport:
    summaries = {name: read_summary(call.result_of(name)) for name in TITLES if call.has(name)}
    warnings = [
        ReportWarning(stage=TITLES[name][0], text=text, severe=bool(summary.failure))
        for name, summary in summaries.items()
        for text in summary.warning_texts()
    ]
    warnings += [
        ReportWarning(stage="Pictures", text=text)
        for text in dict.fromkeys(
            text
            for name in (TURNTABLE, COMPARISONS, VARIANTS)
            if call.has(name)
            for text in read_summary(call.result_of(name)).warning_texts()
        )
    ]
    interface, _ = interface_of(finished)
    layers, others, _missing = list_files(interface)
    files = [*layers, *others]
    turntable = sorted((call.result_of(TURNTABLE) / _PICTURES).glob("*.png")) if call.has(TURNTABLE) else []
    return PlantReport(
        name=call.request.name,
        capture=call.inputs.source.resolve().name,
        generator=f"usdfoliage {__version__}",
        species=call.settings.plant.species,
        state="warnings" if warnings or validated.open_errors else "done",
        warnings=sorted(warnings, key=lambda warning: not warning.severe),
        facts=_facts(asset, files),
        turntable=turntable,
        comparisons=_read_comparisons(call),
        variants=_read_variants(call),
        stages=[_stage(call, name, summary) for name, summary in summaries.items()],
        findings=validated.findings,
        files=files,
        settings=_settings(call),
        inputs=[
            InputFile(name=name, sha256=digest, size_bytes=call.inputs.files[name].stat().st_size)
            for name, digest in call.inputs.digests
        ],
        versions=[
            Row(name=name, value=version)
            for name, version in package_versions((*PACKAGES, *VALIDATION_PACKAGES)).items()
        ],
    )


def _facts(asset: AssetFacts, files: Sequence[AssetFile]) -> list[Row]:
    """The key numbers."""
    rows = []
    if asset.height_m is not None:
        rows.append(Row(name="height", value=f"{asset.height_m:.2f} m"))
    if asset.width_m is not None:
        rows.append(Row(name="width", value=f"{asset.width_m:.2f} m"))
    rows += asset.count_rows()
    size = sum(file.size_bytes for file in files)
    rows.append(Row(name="size", value=f"{size / 1e6:.1f} MB", remark=f"{len(files)} files"))
    rows.append(Row(name="levels of detail", value=", ".join(asset.shape.variants.get("lod", ())) or "none"))
    rows.append(Row(name="representations", value=", ".join(asset.shape.variants.get("representation", ())) or "none"))
    return rows


def _validation_row(validated: ValidationReport) -> Row:
    counts = ((validated.count(severity), severity) for severity in ("error", "warning"))
    return Row(name="validation", value=", ".join(f"{n} {what}{'s' * (n != 1)}" for n, what in counts))


def _copy_details(call: StageCall, folder: Path) -> None:
    """The stages' own reports, each in a folder of its own."""
    for name in TITLES:
        detail = read_summary(call.result_of(name)).detail if call.has(name) else ""
        if detail:
            copy_tree((call.result_of(name) / detail).parent, folder / name, link=True)
    points, numbers = folder / LEAVES / POINTS_FILE, call.asset_result / LEAF_NUMBERS
    if points.is_file() and numbers.is_file():  # the asset has not all of the leaves that were found
        renumber_leaf_points(points, read_arrays(numbers)["number"])


def _stage(call: StageCall, name: str, summary: StageSummary) -> StageReport:
    title, sentence = TITLES[name]
    state: State = "failed" if summary.failure else "warnings" if summary.warning_texts() else "done"
    folder = call.result_of(name)
    return StageReport(
        name=name,
        title=title,
        sentence=sentence,
        state=state,
        rows=summary.rows,
        pictures=[Picture(image=folder / picture.file, caption=picture.caption) for picture in summary.pictures],
        notes=summary.info_texts(),
        detail_report=f"{name}/index.html" if summary.detail else "",
    )


def _read_comparisons(call: StageCall) -> list[Comparison]:
    if call.has(SKETCH):
        return _compare_sketch(call)
    folder = call.result_of(COMPARISONS) if call.has(COMPARISONS) else None
    if folder is None or not (folder / _COMPARED).is_file():
        return []
    return [
        Comparison(
            name=each["name"],
            photograph=folder / _PICTURES / each["photograph"],
            drawing=folder / _PICTURES / each["drawing"],
            iou=each["iou"],
            masks=each["masks"],
        )
        for each in json.loads((folder / _COMPARED).read_text())
    ]


def _compare_sketch(call: StageCall) -> list[Comparison]:
    """The photograph of a sketch, and its tree drawn over the same frame; none without Storm."""
    folder = call.result_of(SKETCH) / REPORT_FOLDER
    photograph, drawing = folder / PHOTOGRAPH, folder / OVER_PHOTOGRAPH
    if not drawing.is_file():
        return []
    return [Comparison(name=call.inputs.source.name, photograph=photograph, drawing=drawing)]


def _read_variants(call: StageCall) -> list[Variant]:
    folder = call.result_of(VARIANTS) if call.has(VARIANTS) else None
    if folder is None or not (folder / _COMPARED).is_file():
        return []
    return [
        Variant(
            set=each["set"],
            name=each["name"],
            picture=Picture(image=folder / _PICTURES / each["picture"], caption=f"{each['set']} = {each['name']}"),
            is_default=each["default"],
        )
        for each in json.loads((folder / _COMPARED).read_text())
    ]


def _settings(call: StageCall) -> list[StageSettings]:
    settings, defaults = call.settings, BuildSettings()
    tables = SKETCH_SETTINGS if call.has(SKETCH) else STAGE_SETTINGS
    return [mark_settings(name, getattr(settings, name), getattr(defaults, name)) for name in tables]


def _asset_of(call: StageCall) -> Path:
    return call.asset_result / ASSET_FOLDER


def _shape_of(call: StageCall) -> AssetShape:
    return read_asset_facts(call.asset_result).shape


def _draw(call: StageCall, draw: Callable[[], Sequence[Remark]]) -> tuple[ResultFile, ...]:
    """Draw pictures, which may have remarks; without Storm there are none, and the report has a remark about it."""
    (call.out / _PICTURES).mkdir()
    try:
        if not read_asset_facts(call.asset_result).is_drawable:
            seconds = call.settings.pictures.time_limit_s
            raise PreviewTimeoutError(f"its thumbnail was not drawn within {seconds:g} s, and no other is tried")
        summary = StageSummary(remarks=tuple(draw()))
    except PreviewError as error:
        text = f"there are no pictures of the asset: {error.text}"
        summary = StageSummary(remarks=(remark("pictures-missing", text, remedy=error.remedy),), poor=True)
    write_summary(call.out, summary)
    return ()
