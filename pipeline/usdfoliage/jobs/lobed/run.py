"""From a scan's file to the assets of its leaves on disk."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdfoliage import __version__
from usdfoliage.asset.asset_record import is_asset_folder
from usdfoliage.asset.packages.lobed_package import write_lobed_asset
from usdfoliage.asset.packages.lobed_poses import write_poses
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.errors import AssetError, PreviewError
from usdfoliage.files.hashing import hash_bytes, hash_file
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.jobs.lobed.model import ModelledLeaf, Scan, model_leaves, read_scan
from usdfoliage.jobs.lobed.report import measure_rows, write_lobed_report
from usdfoliage.jobs.lobed.request import LobedRequest
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, remark_missing_pictures, render_views
from usdfoliage.jobs.report.content import ReportContent
from usdfoliage.jobs.report.published import PublishedAsset
from usdfoliage.jobs.report.table import ReportView
from usdfoliage.leaf.lobed.deformation import BranchFunctions, bend_evenly
from usdfoliage.leaf.lobed.texture import build_texture
from usdfoliage.progress import StepProgress, follow_step
from usdfoliage.remarks import Remark, label_remarks

STEPS = ("scan", "model", "texture", "asset", "preview")
PREVIEW, POSES = "preview.png", "poses.png"
_COLUMNS = 3  # of the picture with six poses


@dataclass(frozen=True, kw_only=True, eq=False)
class _Place:
    """Where the asset of one leaf goes."""

    leaf: ModelledLeaf
    output: Path
    name: str


def make_lobed_assets(request: LobedRequest, progress: StepProgress | None = None) -> Sequence[PublishedAsset]:
    """Model the leaves of a scan and publish an asset of each; old assets stay until all of the new ones are whole.

    Raises:
        FoliageError: The input is unusable, or an output cannot be written; nothing was changed.
    """
    seconds: dict[str, float] = {}
    with follow_step("scan", seconds, progress):
        scan = read_scan(request)
    with follow_step("model", seconds, progress):
        leaves, remarks = model_leaves(scan, request)
    places = _places(request, scan, leaves)
    made = []
    with ExitStack() as open_folders:
        for place in places:
            folder = open_folders.enter_context(
                publish_folder(
                    place.output,
                    force=request.force,
                    origin=request.origin_of(place.name),
                    keep_old=request.keep_old,
                )
            )
            own = [*scan.remarks, *remarks, *place.leaf.remarks]
            made.append(_write(request, scan, place, folder, own, dict(seconds), progress))
    return made


def plan_lobed_assets(request: LobedRequest) -> str:
    """What make_lobed_assets would do, in lines, after checking the input; writes nothing."""
    scan = read_scan(request)
    count = len(scan.pieces.numbers)
    outputs = (
        [(request.output, request.name)] if count == 1 else [_numbered(request, number) for number in range(count)]
    )
    _refuse_asset(request, count)
    lines = [
        f"scan: {request.scan}, {scan.photo.width_px} x {scan.photo.height_px} px, read as {scan.photo.color_space}",
        f"mask: {scan.mask_source}, {count} {'leaf' if count == 1 else 'leaves'}",
        *label_remarks(scan.remarks, request.render_setting),
        f"settings: {', '.join(f'{name} {value}' for name, value in describe_settings(request).items())}",
        f"steps: {', '.join(STEPS if request.preview else STEPS[:-1])}",
    ]
    for output, name in outputs:
        origin = request.origin_of(name)
        lines.append(plan_folder(output, f"{name}.usda", request.force, origin=origin, keep_old=request.keep_old))
    return "\n".join(lines)


def describe_settings(request: LobedRequest) -> dict[str, str]:
    """Every setting that decides the result, by the name of its option."""
    size = request.size
    return {
        "mask": request.mask.name if request.mask else "of the scan",
        "dpi": "not given" if size.dpi is None else f"{size.dpi:g}",
        "width": "not given" if size.width_m is None else f"{size.width_m:g}",
        "height": "not given" if size.height_m is None else f"{size.height_m:g}",
        "subdivision": "yes" if request.asset_settings.subdivision else "no",
        "color-space": request.color_space or "as the file states",
        "seed": str(request.seed),
    }


def poses_of(leaf: ModelledLeaf) -> Sequence[tuple[str, BranchFunctions]]:
    """Six ways in which a report deforms a leaf."""
    branches = leaf.leaf.shape.branch_count
    lobes = np.radians(45.0) * np.where(np.arange(branches) % 2, 1, -1)
    keys = tuple(np.array([[0.0, float(angle)]]) for angle in lobes)
    rolled = tuple(np.array([[0.4, 0.0], [1.0, -np.radians(300)]]) for _ in range(branches))
    return (
        ("all branches bent by 60 degrees", bend_evenly(branches, bend_rad=np.radians(60))),
        ("the axis bent by 90 degrees", bend_evenly(branches, bend_rad=np.radians(90), only=0)),
        ("all branches twisted by 45 degrees", bend_evenly(branches, twist_rad=np.radians(45))),
        ("lobes bent up and down by 45 degrees", BranchFunctions(bend=keys)),
        ("the axis turned by 30 degrees", bend_evenly(branches, turn_rad=np.radians(30), only=0)),
        ("the tips of all branches rolled up", BranchFunctions(bend=rolled)),
    )


def _places(request: LobedRequest, scan: Scan, leaves: Sequence[ModelledLeaf]) -> Sequence[_Place]:
    _refuse_asset(request, len(scan.pieces.numbers))
    if len(scan.pieces.numbers) == 1:
        return [_Place(leaf=leaves[0], output=request.output, name=request.name)]
    numbered = [_numbered(request, leaf.number) for leaf in leaves]
    return [_Place(leaf=leaf, output=output, name=name) for leaf, (output, name) in zip(leaves, numbered, strict=True)]


def _numbered(request: LobedRequest, number: int) -> tuple[Path, str]:
    """Folder and name of the asset of one of several leaves."""
    return request.output / f"leaf_{number + 1:02d}", f"{request.name}_{number + 1:02d}"


def _refuse_asset(request: LobedRequest, count: int) -> None:
    """Several leaves are folders of OUT, which then is no asset itself."""
    if count > 1 and request.output.is_dir() and is_asset_folder(request.output):
        raise AssetError(
            f"{request.output} is an asset, and the {count} leaves of this scan are assets in a folder", "name another"
        )


def _write(
    request: LobedRequest,
    scan: Scan,
    place: _Place,
    folder: Path,
    remarks: Sequence[Remark],
    seconds: dict[str, float],
    progress: StepProgress | None,
) -> PublishedAsset:
    """Write the asset of a leaf with its report into folder."""
    leaf, remarks = place.leaf, list(remarks)
    provenance = Provenance(
        species=request.species,
        capture=request.scan.name,
        generator=f"usdfoliage {__version__}",
        seed=request.seed,
        settings=describe_settings(request),
        input_sha256=hash_bytes(*(hash_file(path) for path in (request.scan, request.mask) if path is not None)).hex(),
    )
    with follow_step("texture", seconds, progress):
        texture = build_texture(scan.photo.linear, leaf.mask)
    with follow_step("asset", seconds, progress):
        interface = write_lobed_asset(folder, place.name, leaf.leaf, texture, provenance, request.asset_settings)
        report_folder = folder / "report"
        report_folder.mkdir(exist_ok=True)
    views: Sequence[ReportView] = ()
    if request.preview:
        try:
            with follow_step("preview", seconds, progress):
                views = _draw(interface, report_folder, leaf)
        except PreviewError as error:
            remarks.append(remark_missing_pictures(error))
    report = ReportContent(
        name=place.name,
        capture=request.scan.name,
        generator=provenance.generator,
        remarks=remarks,
        render_setting=request.render_setting,
        settings=provenance.settings,
        views=views,
        seconds=seconds if request.times else {},
    )
    write_lobed_report(report_folder, report, leaf, scan.photo.linear)
    return PublishedAsset(
        asset=place.output / interface.name,
        report=place.output / "report" / "index.html",
        preview=place.output / "report" / views[0].file if views else None,
        remarks=tuple(remarks),
        rows=tuple(measure_rows(leaf)),
    )


def _draw(interface: Path, folder: Path, leaf: ModelledLeaf) -> Sequence[ReportView]:
    """Pictures of the flat leaf and of its poses in folder; PreviewError where they cannot be drawn."""
    settings = PreviewSettings(width_px=720, height_px=720)
    render_views(interface, [PreviewView(output=folder / PREVIEW)], settings)
    poses = poses_of(leaf)
    with temporary_folder("poses", PreviewError) as scratch:
        layer = scratch / "poses.usda"
        write_poses(layer, interface.resolve(), leaf.leaf, [functions for _, functions in poses], columns=_COLUMNS)
        view = PreviewView(output=folder / POSES, direction="three-quarter", orthographic=True)
        render_views(layer, [view], PreviewSettings(width_px=1280, height_px=960))
    names = "; ".join(name for name, _ in poses)
    return (
        ReportView(name="The textured leaf", file=PREVIEW),
        ReportView(name=f"Six poses, row after row: {names}", file=POSES),
    )
