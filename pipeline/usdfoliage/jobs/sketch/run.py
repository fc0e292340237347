"""From a photograph on disk and the strokes over it to the assets of its trees."""

from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.materials.texels import write_texels
from usdfoliage.asset.packages.cards import DrawPictures
from usdfoliage.asset.packages.plant_package import PlantAssetSettings, write_plant_asset
from usdfoliage.asset.parts.leaf_part import BranchLeaves
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.branch.foliage.species import describe_species
from usdfoliage.capture.folder.images import Photo, read_photo
from usdfoliage.capture.folder.masks import clean_mask, read_mask
from usdfoliage.capture.mask_proposal.propose import MaskProposal, propose_mask
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.files.hashing import hash_bytes, hash_file
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.jobs.leaf_picture import GivenLeaf, describe_leaf, read_given_leaf
from usdfoliage.jobs.report.published import PublishedAsset
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.sketch.model import (
    SketchModel,
    SketchModelSettings,
    apply_choices,
    choices_of,
    model_tree,
    to_display,
)
from usdfoliage.jobs.sketch.report import DrawnTree, SketchReport, draw_tree, write_sketch_report
from usdfoliage.progress import StepProgress, follow_step
from usdfoliage.remarks import (
    Argument,
    Remark,
    RenderSetting,
    Setting,
    as_plan_setting,
    label_remarks,
    merge_remarks,
    remark,
)
from usdfoliage.sketch.choices import SketchChoices
from usdfoliage.sketch.foliage import find_sky, share_around
from usdfoliage.sketch.foliage_evidence import measure_evidence
from usdfoliage.sketch.proposal import complete_proposal, propose_strokes
from usdfoliage.sketch.strokes import (
    OUTSIDE,
    Strokes,
    TreeStrokes,
    check_roots,
    check_strokes,
    name_tree,
    read_strokes,
    strokes_beside,
    write_strokes,
)

STEPS = ("tree", "surface", "leaves", "motion", "crown", "asset", "preview")
_CLEAR = 0.6  # confidence of a proposed mask, from which on only its top is completed before the sky
_UNCERTAIN = 0.5  # confidence, below which a proposal is to be looked at
_SMALL = 0.025  # of the picture: bark that passes for crowns covers up to .018, the smallest crown of a tree .037
_SOME_SKY = 0.03  # of the picture: of 34 photographs of whole trees the barest of sky shows .09
STROKES = "strokes.json"  # in the asset's folder
_MIN_SPREAD = 4  # of 255, from the darkest to the brightest pixels


@dataclass(frozen=True, kw_only=True)
class SketchRequest:
    """What the user asked for, checked."""

    photo: Path
    output: Path
    name: str
    strokes: Path | None = None  # None: proposed
    mask: Path | None = None  # of the crown, in place of its stroke
    tape_m: tuple[float, float, float, float, float] | None = None  # x and y of two places, and metres between them
    color_space: str | None = None
    species: str = ""
    leaf: Path | None = None  # picture of a leaf, or an asset of leaves; None for leaves of the species
    settings: SketchModelSettings = field(default_factory=SketchModelSettings)
    choices: SketchChoices = field(default_factory=SketchChoices)  # over those settings, and over those of the strokes
    force: bool = False
    keep_old: bool = False
    preview: bool = True
    times: bool = True
    render_setting: RenderSetting = as_plan_setting

    @property
    def origin(self) -> AssetOrigin:
        """Of the asset."""
        return AssetOrigin(name=self.name, command="sketch", source=self.photo.resolve().name)


@dataclass(frozen=True, kw_only=True, eq=False)
class SketchInput:
    """A photograph, the strokes over it, and the settings with what was chosen for them."""

    photo: Photo
    strokes: Strokes
    settings: SketchModelSettings
    remarks: tuple[Remark, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class TreeFolders:
    """Where the files of a tree are written."""

    asset: Path
    report: Path


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenTree:
    """A tree in its folders, before it is published."""

    interface: Path
    model: SketchModel
    drawn: DrawnTree
    remarks: tuple[Remark, ...]
    rows: tuple[Row, ...]


def read_sketch_input(request: SketchRequest) -> SketchInput:
    """Read the photograph and the strokes over it, or propose strokes.

    Raises:
        FoliageError: A file cannot be used, they do not fit each other, or no tree is found.
    """
    strokes = None if request.strokes is None else read_strokes(request.strokes)
    settings = _settings_of(request, SketchChoices() if strokes is None else strokes.choices)
    if request.leaf is not None:
        settings = replace(settings, leaf=read_given_leaf(request.leaf, request.output))
    photo = read_photo(request.photo, request.color_space)
    srgb = to_display(photo.linear)
    _require_picture(srgb, request.photo)
    if request.tape_m is not None:
        _require_inside(request.tape_m[:4], photo)
    remarks = list(photo.remarks)
    if strokes is not None:
        name = str(request.strokes)
        if request.mask is not None and len(strokes.trees) > 1:
            raise CaptureError(
                f"a mask is the crown of one tree, and {name} has {len(strokes.trees)}",
                "leave the mask out, or all trees but one",
            )
        check_strokes(strokes, photo.width_px, photo.height_px, name)
        check_roots(strokes, find_sky(srgb, settings.tree.seed), name)
    if request.mask is not None:
        given = read_mask(request.mask, photo.linear.shape, photo.orientation)
        cleaned = clean_mask(given)
        remarks += cleaned.remarks
        proposed = propose_strokes(cleaned.mask, srgb)
        drawn = strokes.trees[0].branches_px if strokes is not None and len(strokes.trees) == 1 else ()
        tree = replace(proposed, branches_px=drawn or proposed.branches_px)
        strokes = _strokes_of(photo, tree)
    if strokes is None:
        proposal, proposed = propose_tree(photo, srgb, settings.tree.seed)
        text = f"the strokes are proposals (confidence {proposal.confidence:.2f}); {proposal.remark}"
        beside = strokes_beside(request.photo).name
        remedy = f"correct {STROKES} in the asset's folder, and put it beside the photograph as {beside}"
        if proposal.confidence < _UNCERTAIN:
            remarks.append(remark("strokes-uncertain", text, remedy=remedy))
        else:
            remarks.append(remark("strokes-proposed", text, remedy=remedy))
        strokes = _strokes_of(photo, proposed)
    kept = choices_of(settings)
    if request.tape_m is not None:
        kept = replace(kept, height_m=None)
    return SketchInput(photo=photo, strokes=replace(strokes, choices=kept), settings=settings, remarks=tuple(remarks))


def propose_tree(photo: Photo, srgb: NDArray[np.uint8], seed: int) -> tuple[MaskProposal, TreeStrokes]:
    """The crown that the colours of a photograph show, and strokes around it and up its stem.

    Args:
        photo: As read_photo has read it.
        srgb: (H, W, 3), the same, display-encoded.
        seed: Of the colours.

    Raises:
        CaptureError: It shows no crown, or neither one that is clear nor any sky.
    """
    proposal = propose_mask(photo.linear, seed=seed)
    sky = find_sky(srgb, seed)
    if proposal.confidence < _UNCERTAIN and float(sky.mean()) < _SOME_SKY:
        raise CaptureError(
            f"{photo.path} shows no tree clearly: no sky is behind it, and the likeliest crown has a confidence of "
            f"{proposal.confidence:.2f}, {_UNCERTAIN:g} needed",
            f"draw strokes around its crown and along its stem, as {strokes_beside(photo.path).name}",
        )
    mask = complete_proposal(proposal.mask, srgb, sky, only_top=proposal.confidence >= _CLEAR)
    if proposal.confidence < _CLEAR:
        _require_foliage(proposal, mask, srgb, sky, photo.path)
    return proposal, propose_strokes(mask, srgb)


def _require_foliage(
    proposal: MaskProposal, mask: NDArray[np.bool_], srgb: NDArray[np.uint8], sky: NDArray[np.bool_], photo: Path
) -> None:
    """CaptureError for a crown (H, W) that nothing but its colour proposes, as one of bark or of a wall."""
    small = cv2.resize(mask.astype(np.uint8), sky.shape[::-1], interpolation=cv2.INTER_AREA) > 0
    evidence = measure_evidence(srgb, mask, share_around(small, sky))
    share = float(proposal.mask.mean())
    if evidence.is_ruled:
        why = f"the likeliest crown has edges along two directions, as bark and walls have ({evidence})"
    elif proposal.confidence < _UNCERTAIN and not evidence.has_sky:
        why = f"no sky is beside the likeliest crown, whose confidence is {proposal.confidence:.2f}"
    elif proposal.confidence < _UNCERTAIN and share < _SMALL:
        why = f"the likeliest crown covers {100 * share:.1f} % of it, {100 * _SMALL:g} % are needed"
    else:
        return
    raise CaptureError(
        f"{photo} shows no tree clearly: {why}",
        f"draw strokes around its crown and along its stem, as {strokes_beside(photo).name}",
    )


def _settings_of(request: SketchRequest, of_strokes: SketchChoices) -> SketchModelSettings:
    """The settings of a request, under those of the strokes' file, under what was chosen for this run."""
    try:
        return apply_choices(request.settings, request.choices.over(of_strokes))
    except ValueError as error:
        try:
            apply_choices(request.settings, of_strokes)
        except ValueError:
            raise CaptureError(f"{request.strokes}: settings: {error}", "correct the value") from error
        raise FoliageError(str(error)) from error


def _require_picture(srgb: NDArray[np.uint8], photo: Path) -> None:
    """CaptureError for a photograph that shows nothing."""
    dark, bright = np.percentile(srgb[::4, ::4], (1, 99), axis=(0, 1))
    spread = float(np.max(bright - dark))
    if spread < _MIN_SPREAD:
        raise CaptureError(
            f"{photo} shows nothing: its pixels differ by {spread:.0f} of 255, at least {_MIN_SPREAD} are needed",
            "name a photograph of a tree",
        )


def _require_inside(tape_px: tuple[float, ...], photo: Photo) -> None:
    """CaptureError for a tape that is not of this photograph."""
    slack = OUTSIDE * max(photo.width_px, photo.height_px)
    for x, y in (tape_px[:2], tape_px[2:]):
        if not (-slack <= x <= photo.width_px + slack and -slack <= y <= photo.height_px + slack):
            raise CaptureError(
                f"the tape's place x {x:g}, y {y:g} is outside of {photo.path}, which has {photo.width_px} x "
                f"{photo.height_px} pixels",
                "give two places of this photograph",
            )


def _strokes_of(photo: Photo, tree: TreeStrokes) -> Strokes:
    return Strokes(image=photo.path.name, width_px=photo.width_px, height_px=photo.height_px, trees=(tree,))


def make_sketch_asset(request: SketchRequest, progress: StepProgress | None = None) -> PublishedAsset:
    """Make the trees of a photograph and publish their assets; an old asset stays until the new one is whole.

    Raises:
        FoliageError: The input is unusable, or the output cannot be written; nothing was changed.
    """
    given = read_sketch_input(request)
    if len(given.strokes.trees) == 1:
        with _publish(request) as folder:
            return _make_tree(folder, request, given, progress)
    made = []
    with ExitStack() as until_all_are_made:  # a tree that cannot be made leaves none of the others behind
        for number, tree in enumerate(given.strokes.trees, 1):
            name = name_tree(number)
            own = replace(request, name=name, output=request.output / name)
            folder = until_all_are_made.enter_context(_publish(own))
            of_tree = replace(given, strokes=replace(given.strokes, trees=(tree,)))
            made.append(_make_tree(folder, own, of_tree, progress))
    return PublishedAsset(
        asset=made[0].asset,
        report=made[0].report,
        preview=made[0].preview,
        remarks=merge_remarks(*(each.remarks for each in made)),
        rows=tuple(row for each in made for row in each.rows),
    )


def _publish(request: SketchRequest) -> AbstractContextManager[Path]:
    """publish_folder of a request."""
    return publish_folder(request.output, force=request.force, origin=request.origin, keep_old=request.keep_old)


def _make_tree(
    folder: Path, request: SketchRequest, given: SketchInput, progress: StepProgress | None
) -> PublishedAsset:
    """Write one tree into a folder that will take the place of the request's output."""
    folders = TreeFolders(asset=folder, report=folder / "report")
    tree = write_tree(folders, request, given, _provenance(request, given.settings), progress=progress)
    report = request.output / "report"
    return PublishedAsset(
        asset=request.output / tree.interface.name,
        report=report / "index.html",
        preview=report / tree.drawn.sides[0].file if tree.drawn.sides else None,
        remarks=tree.remarks,
        rows=tree.rows,
    )


def write_tree(
    folders: TreeFolders,
    request: SketchRequest,
    given: SketchInput,
    provenance: Provenance,
    *,
    written: PlantAssetSettings = PlantAssetSettings(),
    pictures: DrawPictures | None = None,
    progress: StepProgress | None = None,
) -> WrittenTree:
    """Make a tree of a photograph, and write its asset and its report; nothing is published.

    Args:
        folders: That of the asset exists.
        request: What the user asked for.
        given: The photograph, and the strokes over one tree.
        provenance: Written into the asset.
        written: How the asset is written.
        pictures: Draws the asset's own pictures, as write_plant_asset takes it.
        progress: Called at each step.

    Raises:
        FoliageError: The strokes hold no tree, or a file cannot be written.
    """
    seconds: dict[str, float] = {}
    settings = given.settings
    if request.tape_m is not None:
        x1, y1, x2, y2, metres = request.tape_m
        scaled = replace(settings.tree, metres_per_px=metres / float(np.hypot(x2 - x1, y2 - y1)))
        settings = replace(settings, tree=scaled)
    model = model_tree(given.photo.linear, given.strokes.trees[0], settings, seconds, progress)
    leaf = settings.leaf
    with follow_step("asset", seconds, progress), temporary_folder("leaf") as work:
        interface = write_plant_asset(
            folders.asset,
            request.name,
            provenance=provenance,
            asset_from_capture=model.asset_from_photo,
            branches=model.branches,
            foliage=_with_texels(model.foliage, leaf, work),
            crown=model.crown,
            crown_leaf=None if leaf is None else leaf.picture,
            settings=written,
            pictures=pictures,
        )
        strokes = given.strokes
        if request.tape_m is not None:  # whose places are of this run; the height gives the same scale again
            strokes = replace(strokes, choices=replace(strokes.choices, height_m=model.tree.height_m))
        write_strokes(folders.asset / STROKES, strokes)
    remarks = [*given.remarks, *model.remarks, *_remark_broad_leaves(request, model)]
    folders.report.mkdir(exist_ok=True)
    rows = sketch_rows(model)
    drawn = draw_tree(interface if request.preview else None, model, folders.report, remarks, progress)
    report = SketchReport(
        name=request.name,
        photo=request.photo.name,
        generator=f"usdfoliage {__version__}",
        rows=rows,
        settings=describe_settings(request, given.settings),
        remarks=tuple(remarks),
        render_setting=request.render_setting,
        seconds=seconds if request.times else {},
    )
    write_sketch_report(folders.report, report, model, drawn)
    return WrittenTree(interface=interface, model=model, drawn=drawn, remarks=tuple(remarks), rows=rows)


def _with_texels(foliage: BranchLeaves | None, leaf: GivenLeaf | None, work: Path) -> BranchLeaves | None:
    """The leaves with the texture of a leaf that a picture shows, as a file in the folder work."""
    if foliage is None or leaf is None or leaf.texels is None:
        return foliage
    texture = work / "leaf.png"
    write_texels(texture, leaf.texels)
    return replace(foliage, appearance=replace(foliage.appearance, texture=texture))


def _remark_broad_leaves(request: SketchRequest, model: SketchModel) -> list[Remark]:
    """That a tree of no named species has broad leaves, where it has leaves."""
    if request.species or request.leaf is not None or model.foliage is None:
        return []
    text = "no species is named, and the leaves are broad ones; the photograph does not decide their form"
    remedy = ("name ", Setting(name="plant.species"), ", or give ", Argument(name="leaf"), ", as for needles")
    return [remark("leaves-broad", text, remedy=remedy)]


def plan_sketch_asset(request: SketchRequest) -> str:
    """What make_sketch_asset would do, in lines, after checking the input; writes nothing.

    Raises:
        FoliageError: A file cannot be used.
    """
    would = plan_folder(
        request.output, f"{request.name}.usda", request.force, origin=request.origin, keep_old=request.keep_old
    )
    given = read_sketch_input(request)
    described = describe_settings(request, given.settings)
    return "\n".join(
        [
            f"photo: {request.photo}, {given.photo.width_px} x {given.photo.height_px} px",
            f"strokes: {request.strokes or 'proposed'}, trees {len(given.strokes.trees)}",
            *label_remarks(given.remarks, request.render_setting),
            f"settings: {', '.join(f'{name} {value}' for name, value in described.items())}",
            f"steps: {', '.join(STEPS if request.preview else STEPS[:-1])}",
            would,
        ]
    )


def sketch_rows(model: SketchModel) -> tuple[Row, ...]:
    """The figures of a tree, for report and terminal."""
    tree = model.tree
    skeleton = model.branches.skeleton.skeleton
    height_m = float(np.ptp(skeleton.points_m[:, 1]))
    faces = len(model.branches.surfaces.whole.faces)
    rows = [
        Row(name="height", value=f"{height_m:.2f} m"),
        Row(
            name="branches",
            value=f"{len(skeleton):,}",
            remark=f"{len(tree.traced.branches):,} of the photograph; {faces:,} faces",
        ),
    ]
    if model.foliage is not None:
        rows.append(Row(name="leaves", value=f"{len(model.foliage.leaves):,}"))
    if len(tree.grown.cost_px) > 1:
        first, last = tree.grown.cost_px[0], tree.grown.cost_px[-1]
        rows.append(Row(name="growth", value=f"{first:.1f} to {last:.1f} px", remark="from the leaves of the picture"))
    return tuple(rows)


def describe_settings(request: SketchRequest, settings: SketchModelSettings) -> dict[str, str]:
    """Every setting that decides the result, by the name of its option."""
    return {
        "strokes": request.strokes.name if request.strokes else "proposed",
        **(
            {"height": f"{settings.tree.height_m:g}"}
            if request.tape_m is None
            else {"tape": " ".join(f"{value:g}" for value in request.tape_m)}
        ),
        "mask": request.mask.name if request.mask else "none",
        "depth": f"{settings.tree.depth:g}",
        "gravity": f"{settings.tree.growth.gravity:g}",
        "species": settings.species.name,
        "species-parameters": describe_species(settings.species),
        **describe_leaf(request.leaf),
        "leaf-length": "auto" if settings.leaf_length_m is None else f"{settings.leaf_length_m:g}",
        "density": f"{settings.density:g}",
        "most-leaves": str(settings.max_leaves),
        "most-faces": str(settings.max_faces),
        "representation": " ".join(settings.representations or ()) or "auto",
        **settings.motion.describe(),
        "seed": str(settings.tree.seed),
        "color-space": request.color_space or "as the file states",
    }


def _provenance(request: SketchRequest, settings: SketchModelSettings) -> Provenance:
    return Provenance(
        species=request.species,
        capture=request.photo.name,
        generator=f"usdfoliage {__version__}",
        seed=settings.tree.seed,
        settings=describe_settings(request, settings),
        input_sha256=_fingerprint(request.photo, settings.leaf),
    )


def _fingerprint(photo: Path, leaf: GivenLeaf | None) -> str:
    """Of the photograph, and of the leaf that was given."""
    if leaf is None:
        return hash_file(photo).hex()
    return hash_bytes(hash_file(photo), leaf.picture.rgba.tobytes(), leaf.parameters.tobytes()).hex()
