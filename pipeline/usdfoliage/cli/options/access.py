"""What commands read and write, by their options: declared before anything starts, and checked by the gate.

A command that runs in a child with limits (usdfoliage.cli.box) declares there: the parent opens no USD, and no command
writes before its gate. This module is read by every command, so that it imports nothing heavy itself.
"""

import argparse
from pathlib import Path

from usdfoliage.files.write_gate import Access


def given(*paths: Path | None) -> tuple[Path, ...]:
    """Those that were given."""
    return tuple(path for path in paths if path is not None)


def reads_alone(*paths: Path | None) -> Access:
    """Of a command that writes nothing."""
    return Access(reads=given(*paths))


def parts_of_capture(source: Path) -> tuple[Path, ...]:
    """What is read of a folder of photographs or of a capture, whose results stand beside its photographs."""
    from usdfoliage.capture.folder.listing import CAMERAS, IMAGES, MASKS
    from usdfoliage.capture.folder.settings import FILE_NAME

    if not (source / IMAGES).is_dir():
        return (source,)
    return tuple(path for name in (IMAGES, MASKS, CAMERAS, FILE_NAME) if (path := source / name).exists())


def parts_of_photograph(photo: Path) -> tuple[Path, ...]:
    """A photograph of a tree, and the strokes beside it."""
    from usdfoliage.sketch.strokes import find_strokes

    return given(photo, find_strokes(photo))


def parts_of_build(source: Path | None, output: Path | None) -> tuple[Path, ...]:
    """What a build reads of its input, as parts_of_input, with the strokes beside a single photograph."""
    from usdfoliage.capture.folder.listing import is_picture, parts_of_input

    if source is not None and is_picture(source.name) and source.is_file():
        return parts_of_photograph(source)
    return parts_of_input(source, output)


def declare_build(options: argparse.Namespace) -> Access:
    """Of a build, or of a step of one."""
    from usdfoliage.jobs.plant.work_folder import find_work_folder

    reads = given(options.plan, options.profile)
    if options.capture is not None:
        reads += parts_of_build(options.capture, options.output)
    if options.output is None:
        return Access(reads=reads)
    return Access(reads=reads, replaces=(options.output,), fills=(find_work_folder(options.work, options.output),))
