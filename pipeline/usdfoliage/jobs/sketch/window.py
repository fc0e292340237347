"""The window in which strokes are drawn over a photograph, and the tree of them grows."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usdfoliage.branch.foliage.species import GENERIC, load_species
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.errors import PreviewError
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.jobs.preview.pictures import write_dome
from usdfoliage.jobs.preview.recorder import find_interpreter
from usdfoliage.jobs.preview.viewer import ViewerSettings
from usdfoliage.jobs.preview.window import read_script, require_display, run_window
from usdfoliage.jobs.report.pictures import write_picture
from usdfoliage.jobs.sketch.model import MAX_DENSITY, MAX_LEAF_LENGTH_M, MIN_DENSITY, SketchModelSettings
from usdfoliage.jobs.sketch.session import DrawingSession, answer_drawing
from usdfoliage.remarks import RenderSetting, as_plan_setting
from usdfoliage.sketch.strokes import check_strokes, format_strokes, read_strokes, strokes_beside


@dataclass(frozen=True, kw_only=True)
class Slider:
    """A value of a tree that the window lets somebody choose."""

    name: str  # in the settings of a file of strokes
    label: str
    low: float
    high: float
    default: float | None  # None: the tree has its own, which the window calls auto
    lowest: float  # that may be typed
    highest: float
    decimals: int = 2
    unit: str = ""
    tip: str = ""


def sliders_of(settings: SketchModelSettings) -> tuple[Slider, ...]:
    """The sliders, which stand at these settings."""
    tree = settings.tree
    return (
        Slider(
            name="height_m",
            label="Height",
            low=0.5,
            high=40,
            default=tree.height_m,
            lowest=0.01,
            highest=1000,
            decimals=1,
            unit=" m",
            tip="From the root to the top",
        ),
        Slider(
            name="density",
            label="Density",
            low=0.1,
            high=3,
            default=settings.density,
            lowest=MIN_DENSITY,
            highest=MAX_DENSITY,
            tip="So many times the leaves of the species",
        ),
        Slider(
            name="depth",
            label="Depth",
            low=0.2,
            high=2.5,
            default=tree.depth,
            lowest=0.1,
            highest=5,
            tip="The crown is deeper than it is wide by this factor",
        ),
        Slider(
            name="gravity",
            label="Gravity",
            low=-1,
            high=1,
            default=tree.growth.gravity,
            lowest=-1,
            highest=1,
            tip="Branches that the photograph does not show hang at 1 and rise at -1",
        ),
        Slider(
            name="leaf_length_m",
            label="Leaf length",
            low=0.01,
            high=0.3,
            default=settings.leaf_length_m,
            lowest=0.001,
            highest=MAX_LEAF_LENGTH_M,
            decimals=3,
            unit=" m",
            tip="Mean length of a leaf; auto takes that of the photograph",
        ),
        Slider(
            name="seed",
            label="Seed",
            low=0,
            high=999,
            default=tree.seed,
            lowest=0,
            highest=2**31 - 1,
            decimals=0,
            tip="Another number gives another tree of the same strokes",
        ),
    )


def draw_over_photo(
    photo: Path,
    settings: ViewerSettings = ViewerSettings(),
    color_space: str | None = None,
    render_setting: RenderSetting = as_plan_setting,
) -> None:
    """Show a window to draw strokes over a photograph in, until it is closed. Strokes beside the photograph are loaded.

    Args:
        photo: The photograph.
        settings: Size and script of the window.
        color_space: Of the photograph; None: as the file states.
        render_setting: How remedies name settings, in the window and in reports of assets that it makes.

    Raises:
        FoliageError: The photograph or its strokes cannot be used, or there is no preview interpreter, no display, no
            OpenGL, or the window failed.
    """
    read = read_photo(photo, color_space)
    beside = strokes_beside(photo)
    drawn: dict[str, Any] | None = None
    if beside.is_file():
        strokes = read_strokes(beside)
        check_strokes(strokes, read.width_px, read.height_px, str(beside))
        drawn = json.loads(format_strokes(strokes))
    python = find_interpreter()
    require_display()
    model_settings = SketchModelSettings(species=load_species(GENERIC))
    with temporary_folder("sketch", PreviewError) as work:
        session = DrawingSession(
            photo=read, color_space=color_space, work=work, settings=model_settings, render_setting=render_setting
        )
        write_picture(work / "photo.png", session.srgb)
        write_dome(work / "dome.exr")
        request = {
            "photo": str(work / "photo.png"),
            "head": session.head,
            "strokes": drawn,
            "strokes_path": str(beside),
            "sliders": [vars(each) for each in sliders_of(model_settings)],
            "file": str(photo),
            "title": photo.name,
            "dome_texture": str(work / "dome.exr"),
            "script": read_script(settings.script) if settings.script else None,
            "width_px": settings.width_px,
            "height_px": settings.height_px,
        }
        run_window(python, request, work, lambda requests, replies: answer_drawing(session, requests, replies))
