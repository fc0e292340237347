"""Draw an asset with Hydra Storm: one picture or a turntable.

ASSET is the folder of an asset, a look, which is drawn over its asset, or any USD file. The camera frames its bounds.
The light is that of a lookdev turntable, unless the file has lights. No display and no GPU are needed.

    usdfoliage preview assets/oak -o oak.png --turntable 24
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from usdfoliage.cli.options.setting_help import state_default
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.jobs.preview.pictures import (
        COMPLEXITIES,
        MAX_SIDE_PX,
        MIN_SIDE_PX,
        PURPOSES,
        PreviewSettings,
    )

    settings = PreviewSettings()
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "asset", metavar="ASSET", type=Path, help="The input is the folder of an asset, a look, or a USD file."
    )
    files.add_argument(
        "-o", "--output", metavar="PNG", type=Path, required=True, help="The picture is written to this PNG file."
    )
    files.add_argument(
        "--size",
        metavar=("W", "H"),
        type=int,
        nargs=2,
        default=(settings.width_px, settings.height_px),
        help=f"The picture has this width and height in pixels, from {MIN_SIDE_PX} to {MAX_SIDE_PX} each; the default "
        f"is {settings.width_px} {settings.height_px}.",
    )
    files.add_argument(
        "--turntable",
        metavar="FRAMES",
        type=int,
        help="Draw so many frames all around, 2 or more. They are written beside PNG with numbers in their names, and "
        "PNG becomes a sheet of all frames.",
    )
    camera = parser.add_argument_group("camera")
    camera.add_argument(
        "--view",
        choices=("front", "right", "back", "left", "top", "bottom", "three-quarter"),
        default="three-quarter",
        help="The camera stands on this side; the default is %(default)s.",
    )
    camera.add_argument("--camera", metavar="PATH", help="The picture is drawn with this camera of the file.")
    camera.add_argument(
        "--frame",
        type=float,
        metavar="TIME",
        help="Moving things are drawn at this time code. The default is the first one of the file.",
    )
    scene = parser.add_argument_group("what is drawn, and how")
    scene.add_argument(
        "--complexity",
        choices=tuple(COMPLEXITIES),
        default=settings.complexity,
        help="Subdivision surfaces are drawn this finely; the default is %(default)s.",
    )
    scene.add_argument(
        "--background",
        metavar="COLOR",
        nargs="+",
        help="The background has this colour: R G B as displayed, from 0 to 1 each, or transparent. The default is a "
        f"neutral grey, {state_default(settings.background)}.",
    )
    scene.add_argument(
        "--purpose",
        choices=PURPOSES,
        nargs="+",
        default=settings.purposes,
        help=f"Prims with these purposes are drawn; the default is {state_default(settings.purposes)}.",
    )
    scene.add_argument(
        "--variant",
        metavar="SET=NAME",
        action="append",
        default=[],
        help="This variant is selected on every prim that has the variant set, as in representation=mesh. Give this "
        "option once for each set.",
    )
    scene.add_argument(
        "--mute",
        metavar="LAYER",
        type=Path,
        action="append",
        default=[],
        help="This layer is left out. Give this option once for each layer.",
    )


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.asset.access import find_asset, refuse_in_asset

    outputs = [options.output]
    if options.turntable is not None and options.turntable >= 2:
        from usdfoliage.jobs.preview.pictures import turntable_frames

        outputs += turntable_frames(options.output, options.turntable)
    for output in outputs:
        refuse_in_asset(output)
    return Access(reads=(*find_asset(options.asset).reads, *options.mute), replaces=tuple(outputs))


def run(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from usdfoliage.asset.locate import find_interface
    from usdfoliage.asset.looks.look import try_composing
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.errors import PreviewError
    from usdfoliage.jobs.preview.pictures import (
        PreviewSettings,
        PreviewView,
        render_turntable,
        render_views,
    )

    handle_interrupts()
    if options.output.suffix.lower() != ".png":
        raise PreviewError(f"the picture is a PNG, so its name must end in .png ({options.output})")
    if options.turntable is not None and options.camera is not None:
        raise PreviewError("--turntable makes its own cameras", "leave out --camera")
    width_px, height_px = options.size
    try:
        settings = PreviewSettings(
            width_px=width_px,
            height_px=height_px,
            complexity=options.complexity,
            purposes=tuple(options.purpose),
            background=_parse_background(options.background),
            variants=tuple(_parse_variant(words) for words in options.variant),
            muted=tuple(options.mute),
            frame=options.frame,
        )
        if options.turntable is not None and options.turntable < 2:
            raise ValueError(f"a turntable needs at least 2 frames, not {options.turntable}")
    except ValueError as error:
        raise PreviewError(str(error)) from error
    usd_file = find_interface(options.asset)
    try_composing(usd_file)  # with limits, which the preview's interpreter has not
    with tqdm(total=options.turntable or 1, desc="preview", unit="frame", leave=False, disable=None) as bar:

        def progress(done: int, total: int) -> None:
            bar.update(done - bar.n)

        if options.turntable is not None:
            written = render_turntable(usd_file, options.output, options.turntable, settings, progress)
        else:
            view = PreviewView(output=options.output, direction=options.view, camera=options.camera)
            written = render_views(usd_file, [view], settings, progress)
    print(written[-1])
    return 0


def _parse_background(words: Sequence[str] | None) -> tuple[float, float, float] | None:
    """The colour that words name, None for transparent; raises ValueError."""
    from usdfoliage.jobs.preview.pictures import PreviewSettings

    if words is None:
        return PreviewSettings().background
    if list(words) == ["transparent"]:
        return None
    try:
        red, green, blue = (float(word) for word in words)
    except ValueError as error:
        raise ValueError(f"--background takes R G B from 0 to 1, or transparent, not {' '.join(words)!r}") from error
    return red, green, blue


def _parse_variant(words: str) -> tuple[str, str]:
    """The set and the variant that words name; raises ValueError."""
    name, equals, chosen = words.partition("=")
    if not (name and equals and chosen):
        raise ValueError(f"--variant takes SET=NAME, such as representation=mesh, not {words!r}")
    return name, chosen
