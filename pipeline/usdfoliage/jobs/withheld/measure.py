"""An asset laid over photographs that it was not made of, in pictures and figures."""

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage._native import refine_catmull_clark
from usdfoliage.asset.parts.branches import SurfaceMesh
from usdfoliage.capture.folder.listing import named
from usdfoliage.capture.folder.read import Capture, read_view
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.drawn_grids import draw_grids
from usdfoliage.geometry.picture_agreement import (
    NOTHING,
    PictureAgreement,
    find_outlines,
    find_vegetation,
    mean_agreement,
    measure_agreement,
)
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.models import read_branch_surface, read_models
from usdfoliage.jobs.report.pictures import leaf_palette, write_picture
from usdfoliage.jobs.report.table import ReportPicture, Row
from usdfoliage.leaf.model import LeafOrigin, Leaves
from usdfoliage.leaf.photographs.reprojection import draw_leaf_ids
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, remark

logger = logging.getLogger(__name__)

FIGURES = "withheld.json"  # the figures, beside the pictures
SCALE = 0.5  # of the photographs, in which they are compared: depth and leaves are hardly finer
GIVEN, VEGETATION, UNKNOWN = "given", "vegetation", "unknown"  # where the plant's pixels come from
MAX_GREEN_BORDER = 0.25  # of a border's pixels: of plants before other things up to 0.07, before lawns from 0.5 on
_PLACES_PX = ((0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5))  # of a pixel, from its centre
_BROWN = (110, 70, 40)  # of branches
_OUTLINE = (255, 255, 255)
_MASK_EDGE = (255, 0, 0)
_FILL = 0.65  # of a colour over the photograph


@dataclass(frozen=True, kw_only=True)
class MeasuredView:
    """One photograph that an asset was not made of."""

    name: str
    mask: str  # GIVEN, by a mask of the capture, VEGETATION, by the colour of its pixels, or UNKNOWN
    agreement: PictureAgreement | None  # None where the plant's pixels are unknown
    picture: str  # file in the report's folder: the photograph, and the asset over it


@dataclass(frozen=True, kw_only=True)
class MeasuredAsset:
    """An asset against all photographs that were withheld."""

    every: int
    views: tuple[MeasuredView, ...]
    leaves: int  # that were drawn: found or completed
    has_branches: bool
    remarks: tuple[Remark, ...]

    def as_json(self) -> dict[str, object]:
        """The figures as values: their mean, and those of each photograph whose pixels of the plant are known."""
        known = [view.agreement for view in self.views if view.agreement is not None]
        return {
            "hold_back": self.every,
            "leaves": self.leaves,
            "branches": self.has_branches,
            "mean": asdict(mean_agreement(known)) if known else None,
            "views": [
                {"name": view.name, "mask": view.mask, **({} if view.agreement is None else asdict(view.agreement))}
                for view in self.views
            ],
        }

    def rows(self) -> list[Row]:
        return list_figures(self.as_json())

    def pictures(self) -> list[ReportPicture]:
        return [ReportPicture(file=view.picture, caption=_caption(view)) for view in self.views]


def list_figures(figures: Mapping[str, object]) -> list[Row]:
    """What MeasuredAsset.as_json gives, as lines of a table: the mean of each figure, then every photograph."""
    views, mean = figures["views"], figures["mean"]
    if not isinstance(views, list):
        return []
    rows = []
    if isinstance(mean, dict):
        count = sum(view["mask"] != UNKNOWN for view in views)
        what = f"mean of {count} withheld photographs" if count > 1 else "of one withheld photograph"
        rows.append(Row(name="withheld photographs", value=_figures(mean), remark=what))
    masks = {GIVEN: "by its mask", VEGETATION: "by its green"}
    for view in views:
        if view["mask"] == UNKNOWN:
            rows.append(
                Row(name=view["name"], value="not measured", remark="which of its pixels show the plant is unknown")
            )
        else:
            rows.append(Row(name=view["name"], value=_figures(view), remark=masks[view["mask"]]))
    return rows


def find_plant_pixels(view: View) -> NDArray[np.bool_] | None:
    """(H, W) where a photograph shows the plant: its mask, or what is green; None where its surroundings are green too.

    The mask that isolation could draw of such a photograph from the plant's cloud is none to measure by: of a tree on a
    lawn it had an IoU of 0.49 to 0.54 with the true one.
    """
    if view.mask is not None:
        return view.mask
    green = find_vegetation(view.srgb)
    border = np.concatenate([green[0], green[-1], green[1:-1, 0], green[1:-1, -1]])
    return None if border.mean() > MAX_GREEN_BORDER else green


def _caption(view: MeasuredView) -> str:
    text = (
        f"{view.name}, of which nothing was made, and the asset over it: leaves in colours, branches brown, outlines "
        "white"
    )
    if view.agreement is None:
        return f"{text}. Its surroundings are green too: it is not measured."
    whose = {GIVEN: "its given mask", VEGETATION: "what is green in it"}[view.mask]
    return f"{text}; red is the edge of {whose}. {_figures(asdict(view.agreement))}"


def _figures(values: Mapping[str, float]) -> str:
    return (
        f"IoU {values['iou']:.3f}, precision {values['precision']:.3f}, recall {values['recall']:.3f}, edge precision "
        f"{values['edge_precision']:+.3f}, edge recall {values['edge_recall']:.3f}"
    )


def measure_by_withheld(
    asset: Path,
    capture: Capture,
    folder: Path,
    every: int,
    *,
    lost: Sequence[str] = (),
    threads: int = 0,
    progress: Progress | None = None,
) -> MeasuredAsset:
    """Lay an asset over photographs, and write withheld_NNN.jpg of each and withheld.json into an existing folder.

    Leaves that were found or completed are drawn from their 21 parameters, branches as their surface refined once. The
    plant's pixels are those of the photograph's mask, where the capture has one, else those that are green; where its
    surroundings are green too, the photograph is drawn over and not measured. All is compared at half the photograph's
    size, without lens distortion.

    Args:
        asset: The asset's folder, or its interface layer.
        capture: Of the photographs that were withheld.
        folder: Of pictures and figures.
        every: Of so many photographs one was withheld.
        lost: Names of photographs that were withheld and have no camera.
        threads: 0: one per core; the result is the same.
        progress: Called with photographs done, and their number.

    Raises:
        AssetError: The asset cannot be read.
        CaptureError: No photograph can be read.
    """
    models = read_models(asset)
    surface = read_branch_surface(asset)
    leaves = None if models.leaves is None else _drawn_leaves(models.leaves)
    quads_m = np.zeros((0, 2, 2, 3)) if surface is None else refine_once(surface)
    unit = capture.settings.metres_per_unit
    asset_from_world = models.asset_from_capture @ np.diag([1 / unit, 1 / unit, 1 / unit, 1.0])
    views: list[MeasuredView] = []
    unread: list[tuple[str, CaptureError]] = []
    for number, chosen in enumerate(capture.views):
        try:
            view = read_view(capture, number)
        except CaptureError as error:
            unread.append((chosen.name, error))
            continue
        small = _halved(view)
        ids = draw_asset(leaves, quads_m, _seen_from_asset(small.camera, asset_from_world), threads=threads)
        mask = find_plant_pixels(small)
        file = write_picture(folder / f"withheld_{number:03}.jpg", draw_over(small.srgb, ids, mask))
        kind = UNKNOWN if mask is None else VEGETATION if small.mask is None else GIVEN
        views.append(
            MeasuredView(
                name=chosen.name,
                mask=kind,
                agreement=None if mask is None else measure_agreement(ids, small.srgb, mask),
                picture=file,
            )
        )
        if progress is not None:
            progress(number + 1, len(capture.views))
    if not views:
        raise CaptureError(f"no photograph that was withheld can be read: {unread[0][1].text}", unread[0][1].remedy)
    made = MeasuredAsset(
        every=every,
        views=tuple(views),
        leaves=0 if leaves is None else len(leaves),
        has_branches=surface is not None,
        remarks=(*_remarks(lost, unread), *_describe_unknown(views)),
    )
    (folder / FIGURES).write_text(json.dumps(made.as_json(), indent=1) + "\n", encoding="utf-8")
    return made


def draw_asset(
    leaves: Leaves | None, quads_m: NDArray[np.float64], camera: Pinhole, *, threads: int = 0
) -> NDArray[np.int32]:
    """(H, W), what a camera sees of an asset: 0 branches, leaves from 1, NOTHING.

    A pixel shows the nearest of what is at its centre, and half a pixel beside, above and below it. So twigs thinner
    than a pixel stay whole, and silhouettes are up to half a pixel larger than what pixels' centres show.

    Args:
        leaves: In the camera's world; None for none.
        quads_m: (F, 2, 2, 3), the faces of branches.
        camera: Whose picture is drawn.
        threads: 0: one per core.
    """
    ids = np.full((camera.height_px, camera.width_px), NOTHING, np.int32)
    nearest_m = np.full(ids.shape, np.inf, np.float32)
    for across, down in _PLACES_PX:
        center = camera.center_px[0] - across, camera.center_px[1] - down
        moved = replace(camera, center_px=center)
        wood = draw_grids(quads_m, moved, threads=threads)
        layers = [(np.where(wood.ids >= 0, 0, NOTHING), wood.depth_m)]
        if leaves is not None and len(leaves):
            drawn = draw_leaf_ids(leaves, moved, threads=threads)
            layers.append((np.where(drawn.ids >= 0, drawn.ids + 1, NOTHING), drawn.depth_m))
        for layer, depth_m in layers:
            before = (layer != NOTHING) & (depth_m < nearest_m)
            ids[before], nearest_m[before] = layer[before], depth_m[before]
    return ids


def refine_once(surface: SurfaceMesh) -> NDArray[np.float64]:
    """(F, 2, 2, 3), the faces of a mesh after one step of Catmull and Clark's subdivision."""
    refined = refine_catmull_clark(
        surface.points_m,
        surface.face_counts,
        surface.face_vertices,
        crease_edges=np.zeros((0, 2), np.int32),
        crease_sharpness=np.zeros(0, np.float32),
        corner_vertices=np.zeros(0, np.int32),
        corner_sharpness=np.zeros(0, np.float32),
        levels=1,
        limit=False,
    )
    corners = refined.points[refined.faces]  # around each face
    return np.ascontiguousarray(corners[:, (0, 1, 3, 2)].reshape(-1, 2, 2, 3))


def draw_over(srgb: NDArray[np.uint8], ids: NDArray[np.int32], mask: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """(H, 2 W, 3): the photograph (H, W, 3), and beside it with a drawing (H, W) over it, and a mask's edge, if any."""
    colors = np.concatenate([[_BROWN], leaf_palette(max(int(ids.max(initial=0)), 0))]).astype(np.float64)
    over = srgb.copy()
    drawn = ids != NOTHING
    over[drawn] = np.rint((1 - _FILL) * srgb[drawn] + _FILL * colors[ids[drawn]]).astype(np.uint8)
    over[find_outlines(ids)] = _OUTLINE
    if mask is not None:
        lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(over, lines, -1, _MASK_EDGE, 1)
    return np.hstack([srgb, over])


def _drawn_leaves(leaves: Leaves) -> Leaves:
    """Those that photographs show: what is filled in is a guess that none of them can judge."""
    if leaves.origin is None:
        return leaves
    return leaves.take(leaves.origin <= LeafOrigin.COMPLETED)


def _halved(view: View) -> View:
    height, width = (max(1, round(side * SCALE)) for side in view.srgb.shape[:2])
    small = cv2.resize(view.srgb, (width, height), interpolation=cv2.INTER_AREA)
    mask = None
    if view.mask is not None:
        share = cv2.resize(view.mask.astype(np.uint8) * 255, (width, height), interpolation=cv2.INTER_AREA)
        mask = np.asarray(share > 127)
    return replace(
        view,
        camera=view.camera.resized(width, height),
        srgb=np.asarray(small, np.uint8),
        depth_m=np.zeros((height, width), np.float32),
        mask=mask,
    )


def _seen_from_asset(camera: Pinhole, asset_from_world: NDArray[np.float64]) -> Pinhole:
    """The same camera in the frame of the asset, which may be scaled against its world."""
    cam_from_asset = np.vstack([camera.cam_from_world, [0, 0, 0, 1]]) @ np.linalg.inv(asset_from_world)
    scale = float(np.cbrt(np.linalg.det(cam_from_asset[:3, :3])))
    return replace(camera, cam_from_world=cam_from_asset[:3] / scale)


def _remarks(lost: Sequence[str], unread: Sequence[tuple[str, CaptureError]]) -> tuple[Remark, ...]:
    """One for all photographs without a camera, and one for each that cannot be read, with its own reason."""
    reasons = [(named(lost), "no camera was found")] if lost else []
    reasons += [(named([name]), error.text) for name, error in unread]
    return tuple(
        remark("withheld-not-compared", f"{names}: withheld, but not compared: {reason}", subject=names)
        for names, reason in reasons
    )


def _describe_unknown(views: Sequence[MeasuredView]) -> tuple[Remark, ...]:
    names = [view.name for view in views if view.mask == UNKNOWN]
    if not names:
        return ()
    text = (
        f"{len(names)} of {len(views)} withheld photographs have no mask, and more than {MAX_GREEN_BORDER:.0%} of "
        "their border is green: which of what is green is the plant is not known, and they give no figures"
    )
    return (remark("withheld-surroundings-green", text, subject=named(names)),)
