"""Storm's pictures of a finished plant: all around, from the photographs' own cameras, and in every variant."""

import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.asset.packages.contents import interface_of
from usdfoliage.asset.publish_file import publish_written
from usdfoliage.capture.folder.read import Capture, read_view
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError, PreviewTimeoutError
from usdfoliage.geometry.picture_agreement import silhouette_iou
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.plant.pages.cameras import choose_cameras, frame_box
from usdfoliage.jobs.plant.pages.report import Comparison
from usdfoliage.jobs.preview.pictures import (
    DIRECTIONS,
    PreviewSettings,
    PreviewView,
    draw_views,
    encode_png,
    finish_picture,
    render_views,
)
from usdfoliage.jobs.report.pictures import shrink_camera, shrink_to, write_picture
from usdfoliage.jobs.report.table import choose_evenly
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, remark

MAX_FRAMES = 3600  # of a turntable, a tenth of a degree apart
SHAPES = (0.8, 1.6)  # width by height that pictures of narrow and of wide plants have at most


@dataclass(frozen=True, kw_only=True)
class PictureSettings:
    """How large and how many the pictures of a plant are."""

    turntable_frames: int = 24  # The turntable has this many pictures of a full turn. Range: 2 to 3600.
    turntable_px: int = 640  # A picture of the turntable is this wide and high. Unit: pixels. Range: 16 to 8192.
    thumbnail_px: int = 512  # The thumbnail is this wide and high. Unit: pixels. Range: 16 to 8192.
    comparisons: int = 6  # The asset is compared with at most this many photographs. Range: 0 or more.
    comparison_px: int = 1100  # The longer side of a comparison has this size. Unit: pixels. Range: 16 to 8192.
    cards: bool = True  # true draws six pictures of the asset for applications that draw it as cards.
    card_px: int = 512  # The longer side of a card has this size. Unit: pixels. Range: 16 to 8192.
    variant_px: int = 420  # The picture of each variant is this wide and high. Unit: pixels. Range: 16 to 8192.
    samples: int = 2  # Each pixel is drawn with this many samples. Range: 1 to 64.
    complexity: str = "medium"  # Storm divides curved surfaces this finely: low, medium, high or veryhigh.
    # All pictures of one kind are drawn within this time. If the first ones are not, the others are not tried. Unit:
    # seconds. Range: above 0.
    time_limit_s: float = 300.0

    def __post_init__(self) -> None:
        if not 2 <= self.turntable_frames <= MAX_FRAMES:
            raise ValueError(f"turntable_frames must be 2 to {MAX_FRAMES}, not {self.turntable_frames}")
        if not self.time_limit_s > 0:
            raise ValueError(f"time_limit_s must be above 0, not {self.time_limit_s:g}")
        if self.comparisons < 0:
            raise ValueError(f"comparisons must be 0 or more, not {self.comparisons}")
        self.preview(self.turntable_px)
        self.preview(self.thumbnail_px)
        self.preview(self.comparison_px)
        self.preview(self.variant_px)
        self.preview(self.card_px)

    def preview(self, side_px: int) -> PreviewSettings:
        """How a square picture is drawn; ValueError for what cannot be."""
        return PreviewSettings(
            width_px=side_px,
            height_px=side_px,
            samples=self.samples,
            complexity=self.complexity,
            stall_timeout_s=self.time_limit_s,
            time_limit_s=self.time_limit_s,
        )


@dataclass(frozen=True, kw_only=True)
class DrawnComparisons:
    """Photographs beside pictures of the plant."""

    comparisons: tuple[Comparison, ...] = ()
    remarks: tuple[Remark, ...] = ()  # on photographs that cannot be read


@dataclass(frozen=True, kw_only=True)
class DrawnVariant:
    """The picture of one variant."""

    set: str
    name: str
    picture: Path
    is_default: bool


def draw_turntable(
    asset: Path,
    shape: AssetShape,
    folder: Path,
    settings: PictureSettings = PictureSettings(),
    progress: Progress | None = None,
) -> list[Path]:
    """Draw turntable_000.png … into folder, all by one start of Storm; returns them in their order.

    Raises:
        PreviewError: As render_views.
        AssetError: It is no asset.
    """
    interface, _ = interface_of(asset)
    count = settings.turntable_frames
    size_px = _fit_shape(shape, settings.turntable_px)
    views = [
        PreviewView(
            output=folder / f"turntable_{number:03}.png",
            direction="turntable",
            turn_rad=2 * math.pi * number / count,
            group="turntable",
            size_px=size_px,
        )
        for number in range(count)
    ]
    return render_views(interface, views, settings.preview(settings.turntable_px), progress)


def thumbnail_view(shape: AssetShape, output: Path, settings: PictureSettings) -> PreviewView:
    """What a thumbnail shows: the plant in a square, seen from a quarter."""
    return _three_quarter(shape, output, (settings.thumbnail_px,) * 2)


def draw_variants(
    asset: Path,
    shape: AssetShape,
    folder: Path,
    settings: PictureSettings = PictureSettings(),
    progress: Progress | None = None,
) -> list[DrawnVariant]:
    """Draw every variant of every set from one place, all by one start of Storm; those of a set with one are left out.

    The other sets stay as the asset has them, but for representations, which are drawn with leaves alone where that
    can be chosen.

    Raises:
        PreviewError: As render_views.
        AssetError: It is no asset.
    """
    interface, _ = interface_of(asset)
    size_px = _fit_shape(shape, settings.variant_px)
    chosen = [(variant_set, name) for variant_set, names in shape.variants.items() if len(names) > 1 for name in names]
    if not chosen:
        return []
    views = []
    for variant_set, name in chosen:
        selections = [(variant_set, name)]
        if variant_set == "representation" and "leaves" in shape.variants.get("lod", ()):
            selections.append(("lod", "leaves"))
        # A crown is a proxy where leaves are drawn too, and is what `both` is about.
        purposes = ("default", "render", "proxy") if name == "both" else ("default", "render")
        view = _three_quarter(shape, folder / f"variant_{variant_set}_{name}.png", size_px)
        views.append(replace(view, variants=tuple(selections), purposes=purposes))
    try:
        pictures = render_views(interface, views, settings.preview(settings.variant_px), progress)
    except PreviewTimeoutError as error:
        text = f"the variants were not all drawn within {settings.time_limit_s:g} s"
        raise PreviewTimeoutError(text, error.remedy) from error
    return [
        DrawnVariant(set=variant_set, name=name, picture=picture, is_default=shape.selections.get(variant_set) == name)
        for (variant_set, name), picture in zip(chosen, pictures, strict=True)
    ]


def draw_comparisons(
    asset: Path,
    shape: AssetShape,
    capture: Capture,
    folder: Path,
    settings: PictureSettings = PictureSettings(),
    progress: Progress | None = None,
) -> DrawnComparisons:
    """Draw the plant from the cameras of photographs that see it from all sides, and put the photographs beside.

    Writes view_NNN_photograph.jpg, without lens distortion, and view_NNN_plant.png, of one size, into folder; NNN is
    the photograph's number in capture.views. Where a photograph has a mask, the silhouettes are compared. Photographs
    that cannot be read are left out, with a remark.

    Raises:
        PreviewError: As render_views.
        AssetError: It is no asset, or a picture cannot be written.
    """
    interface, _ = interface_of(asset)
    unit = capture.settings.metres_per_unit
    asset_from_world = shape.asset_from_capture @ np.diag([1 / unit, 1 / unit, 1 / unit, 1.0])
    views: dict[int, View] = {}
    remarks = []
    for number in _choose(capture, shape, asset_from_world, settings.comparisons):
        try:
            views[number] = read_view(capture, number)
        except CaptureError as error:
            name = capture.views[number].name
            text = f"{name} is not compared: {error.text}"
            remarks.append(remark("photographs-not-compared", text, subject=name, remedy=error.remedy))
    if not views:
        return DrawnComparisons(remarks=tuple(remarks))
    cameras = [shrink_to_stage(view.camera, settings.comparison_px, asset_from_world) for view in views.values()]
    names = [f"view_{number:03}" for number in views]
    wanted = [
        PreviewView(output=folder / f"{name}_plant.png", pinhole=camera)
        for name, camera in zip(names, cameras, strict=True)
    ]
    preview = settings.preview(settings.comparison_px)
    pictures = draw_views(interface, wanted, preview, progress)
    compared = []
    for name, view, chosen_view, picture in zip(names, views.values(), wanted, pictures, strict=True):
        photograph = folder / f"{name}_photograph.jpg"
        folder.mkdir(parents=True, exist_ok=True)
        write_picture(photograph, shrink_to(view.srgb, settings.comparison_px))
        png = encode_png(finish_picture(picture, preview.background))
        publish_written(chosen_view.output, partial(Path.write_bytes, data=png))
        iou = None if view.mask is None or not view.mask.any() else compare_silhouettes(view.mask, picture[..., 3])
        compared.append(Comparison(name=view.name, photograph=photograph, drawing=chosen_view.output, iou=iou))
    return DrawnComparisons(comparisons=tuple(compared), remarks=tuple(remarks))


def compare_silhouettes(mask: NDArray[np.bool_], alpha: NDArray[np.float32]) -> float:
    """Intersection over union of a photograph's mask (H, W) and a drawing's opacity (h, w), at the drawing's size."""
    height, width = alpha.shape
    small = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) >= 0.5
    return silhouette_iou(small, alpha >= 0.5)


def shrink_to_stage(camera: Pinhole, longest_px: int, stage_from_world: NDArray[np.float64]) -> Pinhole:
    """The camera of a shrunk picture, in a frame (4, 4) that is turned, moved and may be scaled against its world.

    A camera sees the same of a plant that is scaled from where it stands: its own axes are scaled back.
    """
    shrunk = shrink_camera(camera, longest_px, stage_from_world)
    scale = float(np.cbrt(np.linalg.det(shrunk.cam_from_world[:, :3])))
    return replace(shrunk, cam_from_world=shrunk.cam_from_world / scale)


def _choose(capture: Capture, shape: AssetShape, asset_from_world: NDArray[np.float64], max_count: int) -> list[int]:
    """Photographs whose cameras see the plant from different sides; evenly chosen where its size is unknown."""
    if shape.extent_m is None:
        return choose_evenly(len(capture.views), max_count)
    cameras = [
        shrink_to_stage(view.lens.pinhole(view.cam_from_world), 1000, asset_from_world) for view in capture.views
    ]
    return choose_cameras(cameras, shape.extent_m, max_count)


def _fit_shape(shape: AssetShape, side_px: int) -> tuple[int, int]:
    """Width and height of a picture that a plant fills as it turns, with so many pixels as a square of that side."""
    if shape.extent_m is None:
        return side_px, side_px
    wide, high, deep = shape.extent_m[1] - shape.extent_m[0]
    proportion = float(np.clip(math.hypot(wide, deep) / max(high, 1e-9), *SHAPES))
    return round(side_px * math.sqrt(proportion)), round(side_px / math.sqrt(proportion))


def _three_quarter(shape: AssetShape, output: Path, size_px: tuple[int, int]) -> PreviewView:
    """From a quarter; with one camera for all variants, whose bounds may differ, where the asset has its extent."""
    if shape.extent_m is None:
        return PreviewView(output=output, direction="three-quarter", size_px=size_px)
    azimuth_rad, elevation_rad = DIRECTIONS["three-quarter"]
    return PreviewView(output=output, pinhole=frame_box(shape.extent_m, azimuth_rad, elevation_rad, size_px))
