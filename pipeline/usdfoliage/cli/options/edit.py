"""What the options of usdfoliage edit set, checked."""

import argparse
from collections.abc import Sequence
from typing import Any

from usdfoliage.asset.looks.lobed import LobedAsset
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.edits.edit import EditRequest
from usdfoliage.jobs.edits.lobed import LobedEditRequest
from usdfoliage.leaf.shape.edits import LeafEdits, Vector

EDIT_OPTIONS = ("width", "asymmetry", "axis1", "axis2", "bend", "silhouette", "curl", "jitter", "jitter_map", "look")


ROTATIONS = ("turn", "twist", "branch")  # of a leaf of several lobes alone, beside bend


def read_lobed_request(options: argparse.Namespace, found: LobedAsset) -> LobedEditRequest:
    """The request of a leaf of several lobes; FoliageError for values that cannot be."""
    refused = [name for name in EDIT_OPTIONS if name != "bend" and getattr(options, name) is not None]
    if refused:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in refused)
        raise FoliageError(f"{options.asset} is a leaf of several lobes, which has no {names}", "leave it out")
    if options.bend is None and options.turn is None and options.twist is None:
        raise FoliageError("no edit is named, so there is nothing to write", "name --bend, --turn or --twist")
    if options.bend is not None and len(options.bend) != 1:
        raise FoliageError(f"--bend of a leaf of several lobes takes one number of degrees, not {len(options.bend)}")
    try:
        return LobedEditRequest(
            asset=options.asset,
            found=found,
            output=options.output,
            turn_deg=options.turn or 0.0,
            bend_deg=options.bend[0] if options.bend else 0.0,
            twist_deg=options.twist or 0.0,
            branch=options.branch,
            prim=options.prim,
            force=options.force,
        )
    except ValueError as error:
        raise FoliageError(str(error)) from error


def read_edit_request(options: argparse.Namespace) -> EditRequest:
    """The request that a command line makes; FoliageError for values that cannot be."""
    refused = [f"--{name}" for name in ROTATIONS if getattr(options, name, None) is not None]
    if refused:
        raise FoliageError(f"{options.asset} has no leaf of several lobes for {', '.join(refused)}", "leave it out")
    given = [name for name in EDIT_OPTIONS if getattr(options, name) is not None]
    if not given:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in EDIT_OPTIONS)
        raise FoliageError("no edit is named, so there is nothing to write", f"name one or more of {names}")
    return EditRequest(
        asset=options.asset,
        output=options.output,
        edits=parse_edits(options),
        sets_jitter=options.jitter is not None,
        jitter_map=options.jitter_map,
        prim=options.prim,
        force=options.force,
        look=options.look,
    )


def parse_edits(options: argparse.Namespace) -> LeafEdits:
    """The edits that options name; asymmetry, bend and the axis points add up.

    Raises:
        FoliageError: A number is not finite or out of range, or a silhouette point is named wrongly or twice.
    """
    if options.bend is not None and len(options.bend) > 2:
        raise FoliageError(f"--bend takes Z, or Z1 and Z2 of the two axis points, not {len(options.bend)} numbers")
    x, y = options.asymmetry or (0.0, 0.0)
    heights = options.bend or (0.0,)
    points = ((heights[0], options.axis1), (heights[-1], options.axis2))
    axis1, axis2 = (
        _vector([a + b for a, b in zip((x, y, z), own or (0.0, 0.0, 0.0), strict=True)]) for z, own in points
    )
    changed: dict[str, Any] = {"axis1": axis1, "axis2": axis2}
    if options.width is not None:
        changed["width"] = options.width
    changed |= _read_silhouette(options.silhouette or ())
    if options.curl is not None:
        changed["curl"] = _vector(options.curl)
    if options.jitter is not None:
        changed["jitter_amplitude"], changed["jitter_frequency"] = options.jitter
    try:
        return LeafEdits(**changed)
    except ValueError as error:
        raise FoliageError(f"{error}; lengths are in leaf lengths") from error


def _read_silhouette(given: Sequence[Sequence[float]]) -> dict[str, Vector]:
    points: dict[str, Vector] = {}
    for numbers in given:
        text = " ".join(f"{number:g}" for number in numbers)
        if len(numbers) not in (3, 4):
            raise FoliageError(f"--silhouette takes POINT V X and at most Z besides, not {text}")
        if numbers[0] not in (1, 2, 3):
            raise FoliageError(f"--silhouette: the point is 1, 2 or 3, counted from the base, not {numbers[0]:g}")
        name = f"silhouette{numbers[0]:.0f}"
        if name in points:
            raise FoliageError(f"--silhouette names point {numbers[0]:.0f} twice", "add the numbers up")
        points[name] = _vector([*numbers[1:], 0.0][:3])
    return points


def _vector(numbers: Sequence[float]) -> Vector:
    x, y, z = numbers
    return x, y, z
