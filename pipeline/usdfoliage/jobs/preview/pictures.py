"""Pictures of a USD file, drawn by Hydra Storm in the preview interpreter, a process of its own.

The request and the result are JSON files, pictures come back as linear EXR; hydra_preview/README.md describes both.
"""

import logging
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.locate import lost_layers, try_layer
from usdfoliage.asset.looks.look import open_root_layer, read_look
from usdfoliage.asset.packages.contents import irregular_files
from usdfoliage.errors import AssetError, PreviewError
from usdfoliage.files.atomic import write_whole_files
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.geometry.color import decode_srgb, encode_srgb
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.preview.recorder import run_recorder
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, remark

logger = logging.getLogger(__name__)


COMPLEXITIES: Mapping[str, float] = MappingProxyType({"low": 1.0, "medium": 1.1, "high": 1.2, "veryhigh": 1.3})
PURPOSES = ("default", "render", "proxy", "guide")

# (azimuth, elevation) in radians of where the camera stands: azimuth 0 before the front, growing towards +X.
DIRECTIONS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "front": (0.0, 0.0),
        "right": (math.pi / 2, 0.0),
        "back": (math.pi, 0.0),
        "left": (-math.pi / 2, 0.0),
        "top": (0.0, math.pi / 2),
        "bottom": (0.0, -math.pi / 2),
        "three-quarter": (math.radians(35.0), math.radians(12.0)),
        "turntable": (0.0, math.radians(8.0)),
    }
)

MIN_SIDE_PX = 16
MAX_SIDE_PX = 8192
MAX_PIXELS = 1 << 25  # Storm keeps about 60 bytes of each
MAX_SAMPLES = 64  # more change nothing that is seen
SHEET_WIDTH_PX = 1920


@dataclass(frozen=True, kw_only=True)
class PreviewSettings:
    """How the pictures are drawn."""

    width_px: int = 960
    height_px: int = 960
    complexity: str = "high"  # how finely subdivision surfaces are drawn
    samples: int = 4  # of a pixel; 1 has jagged edges and, without a GPU, takes a third of the time
    background: tuple[float, float, float] | None = (0.36, 0.37, 0.38)  # sRGB as displayed, 0 to 1; None: transparent
    purposes: tuple[str, ...] = ("default", "render")
    variants: tuple[tuple[str, str], ...] = ()  # (variant set, variant), selected on every prim that has the set
    muted: tuple[Path, ...] = ()  # layers that are left out
    even_light: bool = False  # the same from everywhere, for pictures that are lit where they are used
    frame: float | None = None  # time code; None: the stage's first
    stall_timeout_s: float = 300.0  # without a frame for so long, Storm is taken to hang
    time_limit_s: float = math.inf  # for all views

    def __post_init__(self) -> None:
        check_size(self.width_px, self.height_px)
        if self.complexity not in COMPLEXITIES:
            raise ValueError(f"complexity must be one of {', '.join(COMPLEXITIES)}, not {self.complexity!r}")
        if self.frame is not None and not math.isfinite(self.frame):
            raise ValueError(f"frame must be a time code, not {self.frame}")
        if not 1 <= self.samples <= MAX_SAMPLES:
            raise ValueError(f"samples must be 1 to {MAX_SAMPLES}, not {self.samples}")
        if self.background is not None and not all(0 <= c <= 1 for c in self.background):
            raise ValueError(f"background must be three numbers from 0 to 1, not {self.background}")
        check_purposes(self.purposes)


@dataclass(frozen=True, kw_only=True)
class PreviewView:
    """One picture: what is looked at from where."""

    output: Path  # PNG
    direction: str = "front"  # a key of DIRECTIONS
    turn_rad: float = 0.0  # added to the direction's azimuth
    camera: str | None = None  # path of a camera prim, which then decides instead of the direction
    orthographic: bool = False  # no perspective, so that silhouettes can be compared
    window: tuple[float, float, float, float] | None = None  # left, right, bottom, top of it, in the stage's unit
    size_px: tuple[int, int] | None = None  # (width, height), where it is not the settings'
    group: str | None = None  # perspective views of one group are drawn from one distance
    pinhole: Pinhole | None = None  # in the stage's frame and unit; decides instead of the direction, the size too
    variants: tuple[tuple[str, str], ...] | None = None  # instead of the settings'
    purposes: tuple[str, ...] | None = None  # likewise
    even_light: bool | None = None  # likewise
    frame: float | None = None  # likewise; where its camera stands is decided by the settings' frame all the same

    def __post_init__(self) -> None:
        if self.frame is not None and not math.isfinite(self.frame):
            raise ValueError(f"frame must be a time code, not {self.frame}")
        if self.purposes is not None:
            check_purposes(self.purposes)
        if self.direction not in DIRECTIONS:
            raise ValueError(f"direction must be one of {', '.join(DIRECTIONS)}, not {self.direction!r}")
        if self.window is not None:
            left, right, bottom, top = self.window
            if not self.orthographic or self.camera is not None or self.pinhole is not None:
                raise ValueError("a window needs an orthographic view and no camera")
            if not (left < right and bottom < top):
                raise ValueError(f"window must be (left, right, bottom, top), not {self.window}")
        if self.pinhole is not None:
            if self.camera is not None or self.size_px is not None:
                raise ValueError("a pinhole camera needs no camera prim and no size")
            check_size(self.pinhole.width_px, self.pinhole.height_px)
        if self.size_px is not None:
            check_size(*self.size_px)

    def picture_px(self, settings: PreviewSettings) -> tuple[int, int]:
        """Width and height of the picture."""
        if self.pinhole is not None:
            return self.pinhole.width_px, self.pinhole.height_px
        return self.size_px or (settings.width_px, settings.height_px)


def check_purposes(purposes: tuple[str, ...]) -> None:
    """Raises ValueError for none, or for names that are none of PURPOSES."""
    if set(purposes) - set(PURPOSES) or not purposes:
        raise ValueError(f"purposes must be some of {', '.join(PURPOSES)}, not {', '.join(purposes) or 'none'}")


def check_size(width_px: int, height_px: int) -> None:
    """Raises ValueError for a picture that is too small to show anything or too large for OpenGL."""
    if not (MIN_SIDE_PX <= width_px <= MAX_SIDE_PX and MIN_SIDE_PX <= height_px <= MAX_SIDE_PX):
        raise ValueError(f"a side must have {MIN_SIDE_PX} to {MAX_SIDE_PX} pixels, not {width_px} x {height_px}")
    if width_px * height_px > MAX_PIXELS:
        raise ValueError(f"{width_px} x {height_px} are more than {MAX_PIXELS} pixels; use smaller sides")


def remark_missing_pictures(error: PreviewError) -> Remark:
    """On a report without pictures of its asset, and why."""
    return remark("report-without-pictures", f"no pictures of the asset: {error.text}", remedy=error.remedy)


def render_views(
    usd_file: Path,
    views: Sequence[PreviewView],
    settings: PreviewSettings = PreviewSettings(),
    progress: Progress | None = None,
) -> list[Path]:
    """Draw views of a USD file, all by one start of the preview interpreter.

    All pictures are put in place after the last one is drawn, so a failure leaves older ones as they were.

    Returns:
        The outputs of the views, in their order.

    Raises:
        ValueError: No views.
        PreviewError: The interpreter or OpenGL is missing or failed, or the file cannot be drawn or shows nothing.
        WriteError: A picture cannot be written.
    """
    if not views:
        raise ValueError("there are no views to draw")
    pictures = draw_views(usd_file, views, settings, progress)
    encoded = [encode_png(finish_picture(picture, settings.background)) for picture in pictures]
    outputs = [view.output for view in views]
    write_whole_files(list(zip(outputs, encoded, strict=True)))
    return outputs


def render_turntable(
    usd_file: Path,
    output: Path,
    frames: int,
    settings: PreviewSettings = PreviewSettings(),
    progress: Progress | None = None,
) -> list[Path]:
    """Draw the asset from all around: frames NAME_000.png … beside output NAME.png, which is the contact sheet.

    Returns:
        The frames in order, then the sheet.

    Raises:
        ValueError: frames is below 2.
        PreviewError: As render_views.
    """
    if frames < 2:
        raise ValueError(f"a turntable needs at least 2 frames, not {frames}")
    views = [
        PreviewView(output=frame, direction="turntable", turn_rad=2 * math.pi * number / frames, group="turntable")
        for number, frame in enumerate(turntable_frames(output, frames))
    ]
    pictures = draw_views(usd_file, views, settings, progress)
    sheet = encode_png(finish_picture(arrange_sheet(pictures), settings.background))
    encoded = [encode_png(finish_picture(picture, settings.background)) for picture in pictures]
    outputs = [*(view.output for view in views), output]
    write_whole_files(list(zip(outputs, [*encoded, sheet], strict=True)))
    return outputs


def turntable_frames(output: Path, frames: int) -> list[Path]:
    """The files of a turntable's frames, beside the sheet."""
    digits = max(3, len(str(frames - 1)))
    return [output.with_name(f"{output.stem}_{number:0{digits}}{output.suffix}") for number in range(frames)]


def draw_views(
    usd_file: Path,
    views: Sequence[PreviewView],
    settings: PreviewSettings,
    progress: Progress | None = None,
) -> list[NDArray[np.float32]]:
    """What Storm draws: for each view (height, width, 4) float32, linear Rec.709, premultiplied by alpha, row 0 on top.

    Raises:
        PreviewError: As render_views.
        AssetError: It is a look whose asset is missing.
    """
    if not usd_file.is_file():
        raise PreviewError(f"no such file ({usd_file})")
    with temporary_folder("preview", PreviewError) as work:
        drawn = file_to_draw(usd_file, work)
        _refuse_irregular(drawn, usd_file)
        request = _build_request(drawn, views, settings, work)
        started = time.monotonic()
        try:
            result = run_recorder(request, work, settings.stall_timeout_s, progress, settings.time_limit_s)
        except PreviewError as error:
            raise type(error)(f"{error.text}{_describe_lost_layers(usd_file)}", error.remedy) from error
        logger.info(
            "Storm (USD %s) drew %d views in %.1f s", result["usd_version"], len(views), time.monotonic() - started
        )
        scale = result["scale"]
        pictures = [  # one after another: each is as many times larger
            _read_view(work / f"{number}.exr", view, settings, scale, usd_file) for number, view in enumerate(views)
        ]
    if result["complexity"] < COMPLEXITIES[settings.complexity]:
        logger.warning(
            "curved surfaces are drawn more coarsely than the complexity %s, which Storm could not hold (%s)",
            settings.complexity,
            usd_file,
        )
    if result["lighter"]:
        logger.warning(
            "there is so much to draw that plants are drawn as their %s; select a variant of %s for another form (%s)",
            result["lighter"],
            "level" if result["lighter"] == "relief" else "lod",
            usd_file,
        )
    empty = [view for view, picture in zip(views, pictures, strict=True) if not picture[..., 3].any()]
    if len(empty) == len(views) and any(view.camera is None and view.pinhole is None for view in views):
        raise PreviewError(f"Storm drew nothing, though its bound is in the picture ({usd_file})")
    for view in empty:  # as a flat thing is from its edge
        place = "a pinhole camera" if view.pinhole is not None else view.camera or view.direction
        logger.warning("nothing is to be seen from %s (%s)", place, usd_file)
    return pictures


def _read_view(
    path: Path, view: PreviewView, settings: PreviewSettings, scale: int, usd_file: Path
) -> NDArray[np.float32]:
    """What Storm has drawn of a view, so many times larger, in the view's own size."""
    picture = _read_exr(path)
    expected = (*(scale * side for side in _drawn_px(view, settings)[::-1]), 4)
    if picture.shape != expected:
        raise PreviewError(f"Storm drew {picture.shape}, not {expected} as asked ({usd_file})")
    size_px = view.picture_px(settings)
    return picture if size_px == picture.shape[1::-1] else _resize(picture, size_px)


def finish_picture(picture: NDArray[np.float32], background: tuple[float, float, float] | None) -> NDArray[np.uint8]:
    """An 8-bit sRGB picture: (H, W, 3) over a background (sRGB, 0 to 1), or (H, W, 4) with straight alpha for None."""
    alpha = np.clip(picture[..., 3:], 0.0, 1.0)
    if background is None:
        straight = picture[..., :3] / np.maximum(alpha, 1e-6)
        finished = np.concatenate([encode_srgb(straight), alpha], axis=-1)
    else:
        behind = decode_srgb(np.array(background, np.float32))
        finished = encode_srgb(picture[..., :3] + (1 - alpha) * behind)
    return np.asarray(np.rint(np.clip(finished, 0.0, 1.0) * 255), np.uint8)


def arrange_sheet(pictures: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
    """A contact sheet: pictures of one size (H, W, 4) in rows, from left to right, shrunk to 1920 pixels at most."""
    import cv2

    columns = math.ceil(math.sqrt(len(pictures)))
    rows = math.ceil(len(pictures) / columns)
    height, width = pictures[0].shape[:2]
    scale = min(1.0, SHEET_WIDTH_PX / (columns * width))
    tile = max(1, round(width * scale)), max(1, round(height * scale))
    sheet = np.zeros((rows * tile[1], columns * tile[0], 4), np.float32)
    for number, picture in enumerate(pictures):
        row, column = divmod(number, columns)
        small = cv2.resize(picture, tile, interpolation=cv2.INTER_AREA)
        sheet[row * tile[1] : (row + 1) * tile[1], column * tile[0] : (column + 1) * tile[0]] = small
    return sheet


def encode_png(picture: NDArray[np.uint8]) -> bytes:
    """PNG bytes of (H, W, 3) RGB or (H, W, 4) RGBA."""
    import cv2

    order = cv2.COLOR_RGB2BGR if picture.shape[2] == 3 else cv2.COLOR_RGBA2BGRA
    _, data = cv2.imencode(".png", cv2.cvtColor(picture, order))
    return bytes(data)


def file_to_draw(usd_file: Path, work: Path) -> Path:
    """A look shows nothing by itself: for one, a layer in work that shows it over its asset."""
    layer, _ = try_layer(usd_file)
    if layer is None or read_look(layer) is None:  # the recorder reports what is wrong with a file that is no USD
        return usd_file
    drawn = work / f"{usd_file.stem}.usda"
    open_root_layer(usd_file).Export(str(drawn))
    return drawn


def _refuse_irregular(drawn: Path, usd_file: Path) -> None:
    """Refuse what has a pipe or a device for a texture: Storm would wait for it; usd_file is what the user names."""
    try:
        found = irregular_files(drawn)
    except AssetError:
        return  # the recorder reports a layer that cannot be read
    for file, reason in found:
        raise PreviewError(f"{usd_file} needs {file}, which cannot be read: {reason}", "put a regular file there")


def _describe_lost_layers(usd_file: Path) -> str:
    """The first file that a stage lacks and Storm drew on without, in words that follow an error."""
    layer, _ = try_layer(usd_file)
    lost = next(lost_layers(layer), None) if layer is not None else None
    return f"; it needs {lost[0]}, which cannot be read: {lost[1]}" if lost else ""


def _build_request(
    usd_file: Path, views: Sequence[PreviewView], settings: PreviewSettings, work: Path
) -> dict[str, Any]:
    dome = work / "dome.exr"
    write_dome(dome, even=settings.even_light)
    requested: list[dict[str, Any]] = []
    for number, view in enumerate(views):
        width_px, height_px = _drawn_px(view, settings)
        azimuth_rad, elevation_rad = DIRECTIONS[view.direction]
        entry: dict[str, Any] = {
            "exr": str(work / f"{number}.exr"),
            "width_px": width_px,
            "height_px": height_px,
            "azimuth_rad": azimuth_rad + view.turn_rad,
            "elevation_rad": elevation_rad,
            "orthographic": view.orthographic,
        }
        if view.camera is not None:
            entry["camera"] = view.camera
        if view.pinhole is not None:
            entry["pinhole"] = _describe_pinhole(view.pinhole, height_px)
        if view.window is not None:
            entry["window"] = view.window
        if view.group is not None:
            entry["group"] = view.group
        if view.variants is not None:
            entry["variants"] = dict(view.variants)
        if view.purposes is not None:
            entry["purposes"] = list(view.purposes)
        if view.even_light is not None:
            entry["light"] = "even" if view.even_light else ""
        if view.frame is not None:
            entry["frame"] = view.frame
        requested.append(entry)
    return {
        "usd_file": str(usd_file.resolve()),
        **({} if settings.frame is None else {"frame": settings.frame}),
        "complexity": COMPLEXITIES[settings.complexity],
        "samples": settings.samples,
        "purposes": list(settings.purposes),
        "variants": dict(settings.variants),
        "muted": [str(layer.resolve()) for layer in settings.muted],
        "dome_texture": str(dome),
        **({"light": "even"} if settings.even_light else {}),
        "views": requested,
    }


def _drawn_px(view: PreviewView, settings: PreviewSettings) -> tuple[int, int]:
    """Width and height of what Storm draws: its pixels are square, those of a pinhole camera need not be."""
    width_px, height_px = view.picture_px(settings)
    if view.pinhole is not None:
        height_px = max(1, round(height_px * view.pinhole.focal_px[0] / view.pinhole.focal_px[1]))
    return width_px, height_px


def _describe_pinhole(pinhole: Pinhole, drawn_height_px: int) -> dict[str, Any]:
    x_px, y_px = pinhole.center_px
    return {
        "focal_px": pinhole.focal_px[0],
        "center_px": [x_px, y_px * drawn_height_px / pinhole.height_px],
        "cam_from_stage": pinhole.cam_from_world.tolist(),
    }


def _resize(picture: NDArray[np.float32], size_px: tuple[int, int]) -> NDArray[np.float32]:
    import cv2

    return np.asarray(cv2.resize(picture, size_px, interpolation=cv2.INTER_AREA), np.float32)


def write_dome(path: Path, *, even: bool = False) -> None:
    """A soft overcast sky over dim ground, or the same light from everywhere, as a latitude-longitude picture."""
    import OpenEXR

    # Storm filters it in time that grows with the fourth power of its size: without a GPU, 5 s for 64 rows; nothing in
    # it is finer than these show.
    rows, columns = 16, 32
    height = np.sin(np.pi * (0.5 - (np.arange(rows) + 0.5) / rows))  # sine of the elevation of each row
    # CIE overcast sky (Moon and Spencer 1942): (1 + 2 sin e) / 3; below the horizon, ground that reflects a quarter.
    radiance = np.where(height > 0, (1 + 2 * height) / 3, 0.25 * 7 / 9)
    blend = np.clip(height / 0.1 * 0.5 + 0.5, 0, 1)  # a soft horizon, without ringing in the prefiltered light
    radiance = np.where(np.abs(height) < 0.1, 0.25 * 7 / 9 * (1 - blend) + 0.4 * blend, radiance)
    if even:
        radiance = np.ones(rows)
    picture = np.repeat(np.repeat(radiance[:, None, None], columns, axis=1), 3, axis=2).astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": picture}).write(str(path))


def _read_exr(path: Path) -> NDArray[np.float32]:
    import OpenEXR

    with OpenEXR.File(str(path)) as file:
        return np.asarray(file.channels()["RGBA"].pixels, np.float32)
