"""From a photograph's file to an asset on disk."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.packages.leaf_package import AssetSettings, write_crown_asset
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.capture.folder.images import Photo, read_photo
from usdfoliage.capture.folder.masks import CleanMask, clean_mask, read_mask
from usdfoliage.capture.mask_proposal.propose import propose_mask
from usdfoliage.crown.leaf_picture import LeafPicture
from usdfoliage.errors import AssetError, FoliageError, PreviewError
from usdfoliage.files.hashing import hash_bytes, hash_file
from usdfoliage.jobs.crown.photograph import STEPS, CrownSettings, reconstruct_crown
from usdfoliage.jobs.crown.photograph_report import measure_rows, write_crown_report
from usdfoliage.jobs.crown.written import describe_mesh_size
from usdfoliage.jobs.leaf_picture import describe_leaf, read_leaf_picture
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, remark_missing_pictures, render_views
from usdfoliage.jobs.report.content import ReportContent
from usdfoliage.jobs.report.published import PublishedAsset
from usdfoliage.jobs.report.table import ReportView
from usdfoliage.progress import StepProgress, progress_in_step
from usdfoliage.remarks import Argument, Remark, RenderSetting, as_plan_setting, label_remarks, remark

# Pictures of the report: (title, direction, file).
VIEWS = (
    ("Front", "front", "preview.png"),
    ("Three-quarter", "three-quarter", "preview_three_quarter.png"),
    ("Right side", "right", "preview_right.png"),
    ("Back", "back", "preview_back.png"),
    ("Top", "top", "preview_top.png"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownRequest:
    """What the user asked for, checked."""

    photo: Path
    mask: Path | None
    output: Path
    name: str
    settings: CrownSettings
    tangent: str
    tangent_map: NDArray[np.float64] | None
    asset_settings: AssetSettings
    leaf: Path | None = None  # picture of a leaf, or an asset of leaves; None for a plain leaf
    color_space: str | None = None
    species: str = ""
    force: bool = False
    keep_old: bool = False  # what is replaced stays in a folder beside the new asset
    preview: bool = True
    times: bool = True  # whether the report shows how long each step took
    render_setting: RenderSetting = as_plan_setting  # how the report writes settings

    @property
    def origin(self) -> AssetOrigin:
        """Of the asset."""
        return AssetOrigin(name=self.name, command="crown", source=self.photo.resolve().name)


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownInput:
    """A photograph and the crown in it."""

    photo: Photo
    mask: NDArray[np.bool_]
    foliage: NDArray[np.bool_]
    proposed: bool
    remarks: tuple[Remark, ...]


def read_crown_input(request: CrownRequest) -> CrownInput:
    """Read photograph and mask; propose a mask where none is given.

    Raises:
        CaptureError, FitError: see read_photo, read_mask, clean_mask and propose_mask.
    """
    photo = read_photo(request.photo, request.color_space)
    remarks = list(photo.remarks)
    if request.mask is not None:
        given = read_mask(request.mask, photo.linear.shape, photo.orientation)
    elif photo.alpha is not None:
        given = photo.alpha >= 0.5
        remarks.append(remark("mask-of-alpha", "the mask is the photograph's alpha channel"))
    else:
        proposal = propose_mask(photo.linear, seed=request.settings.seed)
        given = proposal.mask
        text = f"the mask is a proposal (confidence {proposal.confidence:.2f}); {proposal.remark}"
        remarks.append(remark("mask-proposed", text))
    try:
        crown: CleanMask = clean_mask(given)
    except FoliageError as error:
        raise type(error)(f"{error.text} ({request.mask or request.photo})", error.remedy) from error
    proposed = request.mask is None and photo.alpha is None
    remarks += crown.remarks
    return CrownInput(photo=photo, mask=crown.mask, foliage=crown.foliage, proposed=proposed, remarks=tuple(remarks))


def make_crown_asset(request: CrownRequest, progress: StepProgress | None = None) -> PublishedAsset:
    """Reconstruct the crown and publish its asset; the old asset stays until the new one is whole.

    Raises:
        FoliageError: The input is unusable, or the output cannot be written; nothing was changed.
    """
    with publish_folder(
        request.output, force=request.force, origin=request.origin, keep_old=request.keep_old
    ) as folder:
        leaf = None if request.leaf is None else read_leaf_picture(request.leaf, request.output)
        given = read_crown_input(request)
        model, measures = reconstruct_crown(
            given.photo.linear, given.mask, request.settings, request.tangent_map, progress, given.foliage
        )
        provenance = Provenance(
            species=request.species,
            capture=request.photo.name,
            generator=f"usdfoliage {__version__}",
            seed=request.settings.seed,
            settings=describe_settings(request),
            input_sha256=_fingerprint(request, leaf),
        )
        interface = write_crown_asset(folder, request.name, model, provenance, request.asset_settings, leaf)
        remarks = list(given.remarks)
        if given.proposed:
            proposal = request.output / f"{request.name}_mask_proposal.png"
            _write_mask(folder / proposal.name, given.mask)
            _check_not_edited(proposal, folder / proposal.name, request.force)
            remedy = ("correct it and give it with ", Argument(name="mask"))
            remarks.append(
                remark(
                    "mask-proposal-kept", f"the proposed mask is {proposal.name} in the asset's folder", remedy=remedy
                )
            )
        report_folder = folder / "report"
        report_folder.mkdir(exist_ok=True)
        views: list[ReportView] = []
        if request.preview:
            try:
                views = _draw(interface, report_folder, progress)
            except PreviewError as error:
                remarks.append(remark_missing_pictures(error))
        report = ReportContent(
            name=request.name,
            capture=request.photo.name,
            generator=provenance.generator,
            remarks=remarks,
            render_setting=request.render_setting,
            settings=provenance.settings,
            views=views,
            seconds=measures.seconds if request.times else {},
        )
        write_crown_report(report_folder, report, model, measures, given.photo.linear, given.mask)
        _keep_mask(request, folder)
    return PublishedAsset(
        asset=request.output / interface.name,
        report=request.output / "report" / "index.html",
        preview=request.output / "report" / views[0].file if views else None,
        remarks=tuple(remarks),
        rows=tuple(measure_rows(model, measures)),
    )


def plan_crown_asset(request: CrownRequest) -> str:
    """What make_crown_asset would do, in lines, after checking the input; writes nothing."""
    would = plan_folder(
        request.output, f"{request.name}.usda", request.force, origin=request.origin, keep_old=request.keep_old
    )
    if request.leaf is not None:
        read_leaf_picture(request.leaf, request.output)
    given = read_crown_input(request)
    photo = given.photo
    rows, columns = np.nonzero(given.mask)
    lines = [
        f"photo: {request.photo}, {photo.width_px} x {photo.height_px} px, read as {photo.color_space}",
        f"mask: {request.mask or 'proposed'}, crown {np.ptp(columns) + 1} x {np.ptp(rows) + 1} px",
        *label_remarks(given.remarks, request.render_setting),
        f"settings: {', '.join(f'{name} {value}' for name, value in describe_settings(request).items())}",
        f"steps: {', '.join(STEPS)}{', preview' if request.preview else ''}",
        would,
    ]
    return "\n".join(lines)


def describe_settings(request: CrownRequest) -> dict[str, str]:
    """Every setting that decides the result, by the name of its option."""
    settings = request.settings
    return {
        "size": str(settings.size),
        "height": f"{settings.height_m:g}",
        "tangent": request.tangent if request.tangent_map is None else Path(request.tangent).name,
        "relief": f"{settings.relief:g}",
        "pyramid": "laplacian" if settings.band_pass else "gaussian",
        "copies": str(settings.copies),
        "mesh-size": describe_mesh_size(request.asset_settings, settings.size),
        **describe_leaf(request.leaf),
        "mask": request.mask.name if request.mask else "proposed",
        "color-space": request.color_space or "as the file states",
        "seed": str(settings.seed),
    }


def _draw(interface: Path, folder: Path, progress: StepProgress | None) -> list[ReportView]:
    """Pictures of the asset in folder; PreviewError where they cannot be drawn."""
    views = [PreviewView(output=folder / file, direction=direction) for _, direction, file in VIEWS]
    settings = PreviewSettings(width_px=720, height_px=720)
    render_views(interface, views, settings, progress_in_step("preview", progress))
    return [ReportView(name=title, file=file) for title, _, file in VIEWS]


def _write_mask(path: Path, mask: NDArray[np.bool_]) -> None:
    good, encoded = cv2.imencode(".png", mask.astype(np.uint8) * 255)
    if not good:
        raise AssetError(f"the proposed mask could not be encoded ({path})")
    path.write_bytes(encoded.tobytes())


def _check_not_edited(old: Path, new: Path, force: bool) -> None:
    """Refuse to replace a proposal that the user has worked on since."""
    if old.is_file() and not force and old.read_bytes() != new.read_bytes():
        raise AssetError(
            f"{old} is not what this photograph proposes: it was edited, or belongs to another",
            ("give it with ", Argument(name="mask"), ", or replace it with ", Argument(name="force")),
        )


def _keep_mask(request: CrownRequest, folder: Path) -> None:
    """A mask that lies in the folder that is replaced, as a corrected proposal does, comes along."""
    if request.mask is not None and request.mask.resolve().is_relative_to(request.output.resolve()):
        kept = folder / request.mask.resolve().relative_to(request.output.resolve())
        if not kept.exists():  # else it is one that every run writes anew
            kept.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(request.mask, kept)


def _fingerprint(request: CrownRequest, leaf: LeafPicture | None) -> str:
    given = [hash_file(path) for path in (request.photo, request.mask) if path is not None]
    if request.tangent_map is not None:
        given.append(request.tangent_map.tobytes())
    if leaf is not None:
        given.append(leaf.rgba.tobytes())
    return hash_bytes(*given).hex()
