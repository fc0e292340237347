"""Look at an asset in a window and edit its leaves, or draw a tree over a photograph.

ASSET is the folder of an asset, a look, which is shown over its asset, or a USD file with plants. Drag with the left
button to orbit, with the middle button to pan, with the right button or the wheel to zoom (with Alt too, as in
usdview). F frames everything, and Ctrl+P saves a picture. Edits act at once and change no file. "Save look…" writes
them as a layer, as usdfoliage edit does.

With a photograph in place of ASSET the window is one to draw in, for usdfoliage sketch. The left button draws around
the crown, the right button along branches; each stroke is traced at once. "Grow" (G) makes the tree beside it. The
strokes are saved beside the photograph, with the values of the sliders, and "Save asset…" makes of them what
usdfoliage sketch makes.

The program usdview has the same panel once usdfoliage env is set. A window needs a display, and PySide6 in
the preview's Python.
"""

import argparse
import sys
from pathlib import Path

from usdfoliage.cli.options.access import reads_alone
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.jobs.preview.viewer import ViewerSettings

    files = parser.add_argument_group("input and output")
    files.add_argument(
        "asset",
        metavar="ASSET",
        type=Path,
        nargs="?",
        help="The input is the folder of an asset, a look, or a USD file; or a photograph, to draw a tree over it.",
    )
    files.add_argument(
        "--capture",
        metavar="FOLDER",
        type=Path,
        help="The cloud and the cameras of this capture are shown over the asset.",
    )
    window = parser.add_argument_group("this run")
    window.add_argument(
        "--size",
        metavar=("W", "H"),
        type=int,
        nargs=2,
        default=(ViewerSettings.width_px, ViewerSettings.height_px),
        help="The window has this width and height in pixels, 200 or more each; the default is "
        f"{ViewerSettings.width_px} {ViewerSettings.height_px}.",
    )
    window.add_argument(
        "--script",
        metavar="JSON",
        type=Path,
        help="Do the actions of this file in the window, then close it. hydra_preview/README.md lists the actions.",
    )
    # usdview's plug-in asks what the window asks: the average leaf, and to write looks.
    parser.add_argument("--answer", action="store_true", help=argparse.SUPPRESS)


def is_photo(path: Path) -> bool:
    """Whether what is to be shown is a photograph."""
    from usdfoliage.capture.folder.listing import is_picture

    return is_picture(path.name) and not path.is_dir()


def declare(options: argparse.Namespace) -> Access:
    if options.asset is not None and is_photo(options.asset):
        return reads_alone(options.asset, options.script)  # the window asks where to write
    return reads_alone(options.asset, options.capture, options.script)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.remarks import render_for
    from usdfoliage.errors import PreviewError
    from usdfoliage.jobs.preview.viewer import ViewerSettings, answer_requests, view_asset
    from usdfoliage.jobs.sketch.window import draw_over_photo

    handle_interrupts()
    if options.answer:
        answer_requests(sys.stdin.buffer, sys.stdout.buffer)
        return 0
    if options.asset is None:
        raise PreviewError("name the asset to look at: its folder, its .usda, or a look")
    width_px, height_px = options.size
    try:
        settings = ViewerSettings(
            width_px=width_px, height_px=height_px, capture=options.capture, script=options.script
        )
    except ValueError as error:
        raise PreviewError(str(error)) from error
    if is_photo(options.asset):
        if options.capture is not None:
            raise PreviewError("--capture is shown over an asset, not over a photograph", "leave it out")
        draw_over_photo(options.asset, settings, render_setting=render_for("sketch"))
        return 0
    view_asset(options.asset, settings)
    return 0
