"""Look at an asset in a window, and edit its leaves with sliders.

ASSET is the folder of an asset, a look, which is shown over its asset, or a USD file with plants. Drag with the left
button to orbit, with the middle button to pan, with the right button or the wheel to zoom (with Alt too, as in
usdview). F frames everything, and Ctrl+P saves a picture. Edits act at once and change no file. "Save look…" writes
them as a layer, as usdfoliage edit does.

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
        help="The input is the folder of an asset, a look, or a USD file.",
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


def declare(options: argparse.Namespace) -> Access:
    return reads_alone(options.asset, options.capture, options.script)  # the window asks where to write


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.errors import PreviewError
    from usdfoliage.jobs.preview.viewer import ViewerSettings, answer_requests, view_asset

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
    view_asset(options.asset, settings)
    return 0
