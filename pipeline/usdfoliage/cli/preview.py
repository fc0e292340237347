"""Draw an asset in Hydra Storm: one picture, or a turntable.

ASSET is an asset folder, a look, which is shown over its asset, or any USD file. It is framed by its bounds and lit
like a turntable of a lookdev department, unless the file brings lights of its own. No display and no GPU are needed.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("asset", metavar="ASSET", type=Path, help="asset folder, look, or a USD file")
    parser.add_argument("-o", "--output", metavar="PNG", type=Path, required=True, help="the picture to write")
    parser.add_argument(
        "--turntable",
        metavar="N",
        type=int,
        help="N frames all around, PNG_000 and so on beside the output, which becomes their contact sheet",
    )
    parser.add_argument("--size", metavar=("W", "H"), type=int, nargs=2, default=(960, 960), help="pixels (960 960)")
    parser.add_argument(
        "--view",
        choices=("front", "right", "back", "left", "top", "bottom", "three-quarter"),
        default="three-quarter",
        help="where the camera stands (%(default)s)",
    )
    parser.add_argument("--camera", metavar="PATH", help="look through this camera of the file instead")
    parser.add_argument(
        "--complexity",
        choices=("low", "medium", "high", "veryhigh"),
        default="high",
        help="how finely subdivision surfaces are drawn (%(default)s)",
    )
    parser.add_argument(
        "--background",
        metavar="COLOR",
        nargs="+",
        help="R G B as displayed, 0 to 1 each, or: transparent (a neutral grey)",
    )
    parser.add_argument(
        "--purpose",
        choices=("default", "render", "proxy", "guide"),
        nargs="+",
        default=("default", "render"),
        help="what is drawn (default render)",
    )
    parser.add_argument(
        "--variant",
        metavar="SET=NAME",
        action="append",
        default=[],
        help="show this variant, such as representation=mesh, wherever there is the set; may be repeated",
    )
    parser.add_argument("--frame", type=float, metavar="TIME", help="of what moves, as a time code (the first)")
    parser.add_argument(
        "--mute", metavar="LAYER", type=Path, action="append", default=[], help="leave this layer out; may be repeated"
    )


def run(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from usdfoliage.asset.locate import find_interface
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
