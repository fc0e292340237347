"""From the edits that a user names to a look on disk."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdfoliage.asset.locate import require_leaves, select_representation
from usdfoliage.asset.looks.look import check_look_output, open_asset, write_look_layer
from usdfoliage.asset.looks.plain import open_under_layer
from usdfoliage.asset.materials.jitter_map import read_jitter_map
from usdfoliage.asset.packages.contents import interface_of, prototype_segments, representations, require_plant
from usdfoliage.asset.parts.leaf_primvars import read_edits, read_jitter_map_path
from usdfoliage.errors import AssetError, FoliageError
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits, Vector, compose_edits, jitter_silhouette
from usdfoliage.leaf.shape.mesh import MAX_SEGMENTS
from usdfoliage.remarks import Argument, Remark, remark

Value = float | Vector

MIN_SEGMENTS_A_CYCLE = 8  # of a silhouette; with fewer the faster waves of the jitter show as slower ones
MAX_NUMBER = 1e3  # of any number of an edit


@dataclass(frozen=True, kw_only=True)
class EditRequest:
    """What the user asked for, checked."""

    asset: Path
    output: Path
    edits: LeafEdits
    sets_jitter: bool  # else that of the asset stays
    jitter_map: Path | None
    prim: str | None
    force: bool = False
    look: Path | None = None  # a layer whose edits are taken, whoever wrote it


@dataclass(frozen=True, kw_only=True)
class Change:
    """One edit, as it was and as the look makes it."""

    name: str
    before: Value
    after: Value

    def __str__(self) -> str:
        return f"{self.name}: {show_value(self.after)} (was {show_value(self.before)})"


@dataclass(frozen=True, kw_only=True)
class PlannedLook:
    """The content of a look that is not yet written."""

    edits: LeafEdits  # in the end
    prim: str | None
    changes: tuple[Change, ...]  # against what ASSET shows
    remarks: tuple[Remark, ...]
    jitter_map: Path | None = None  # None: that of the asset stays


def plan_look(request: EditRequest) -> PlannedLook:
    """The content of the look that a request asks for; writes nothing.

    Raises:
        FoliageError: The asset cannot be read or has no leaves, an edit leads out of its range, the jitter map
            cannot be used, or the look cannot be written there.
    """
    if request.jitter_map is not None:
        read_jitter_map(request.jitter_map)
    interface, look = interface_of(request.asset)
    stage = open_asset(request.asset)
    if representations(require_plant(stage, request.asset)):
        select_representation(stage, "bezier")
    leaves = require_leaves(stage, request.asset)
    before = read_edits(leaves[0])
    start, jitter_map = before, request.jitter_map
    if request.look is not None:
        under = open_under_layer(request.asset, request.look, request.prim)
        taken = require_leaves(under, request.asset)[0]
        start = read_edits(taken)
        own_map, taken_map = read_jitter_map_path(leaves[0]), read_jitter_map_path(taken)
        if start == before and taken_map == own_map:
            raise AssetError(
                f"{request.look} edits no leaves of {request.asset}",
                ("name the asset that it is made for, or with ", Argument(name="prim"), " the placement that it edits"),
            )
        jitter_map = jitter_map or (taken_map if taken_map != own_map else None)
    try:
        after = compose_edits(start, request.edits)
    except ValueError as error:
        raise FoliageError(f"{error}; the asset has edits already") from error
    after = jitter_silhouette(
        after,
        *(
            (request.edits.jitter_amplitude, request.edits.jitter_frequency)
            if request.sets_jitter
            else (start.jitter_amplitude, start.jitter_frequency)
        ),
    )
    _check_range(after, request.asset)
    check_look_output(request.output, interface, force=request.force)
    changes = tuple(
        Change(name=name, before=getattr(before, name), after=value)
        for name, value in changed_edits(after, before).items()
    )
    remarks = []
    if request.jitter_map is not None and not after.jitter_amplitude:
        text = "the jitter map shows nothing while the amplitude is 0"
        remedy = ("give ", Argument(name="jitter", value="A F"), " too")
        remarks.append(remark("jitter-map-without-jitter", text, remedy=remedy))
    if not changes and jitter_map is None:
        text = "these edits change nothing: the asset has them already, or they are neutral"
        remarks.append(remark("edits-change-nothing", text))
    remarks += _check_jitter(after, prototype_segments(leaves[0]))
    prim = request.prim if request.prim is not None or look is None else look.prim_path or None
    return PlannedLook(edits=after, prim=prim, changes=changes, remarks=tuple(remarks), jitter_map=jitter_map)


def write_look(request: EditRequest) -> PlannedLook:
    """Write the look; it appears whole or not at all, and the asset stays as it is.

    Raises:
        FoliageError: As plan_look, or the look cannot be written.
    """
    planned = plan_look(request)
    write_look_layer(
        request.output, request.asset, planned.edits, planned.jitter_map, planned.prim, force=request.force
    )
    return planned


def _check_jitter(edits: LeafEdits, segments: int | None) -> list[Remark]:
    """A remark where bezier's prototype is too coarse for the jitter, which a look cannot change."""
    if segments is None or not edits.jitter_amplitude or edits.jitter_frequency * MIN_SEGMENTS_A_CYCLE <= segments:
        return []
    text = f"bezier shows a coarser wave than {edits.jitter_frequency:g} cycles"
    room = f"each silhouette of its prototype has {segments} segments, enough for {segments // MIN_SEGMENTS_A_CYCLE}"
    text = f"{text}{' until baked' if segments < MAX_SEGMENTS else ''}: {room}"
    return [remark("jitter-finer-than-mesh", text)]


def _check_range(edits: LeafEdits, asset: Path) -> None:
    for name, value in changed_edits(edits).items():
        if np.abs(value).max() > MAX_NUMBER:
            raise FoliageError(
                f"{name} of {asset} would be {show_value(value)}, {MAX_NUMBER:g} is the most",
                "numbers are leaf lengths, most often below 1",
            )


def changed_edits(edits: LeafEdits, start: LeafEdits = NEUTRAL) -> dict[str, Value]:
    """The edits that differ from start, by the names of LeafEdits."""
    return {
        name: getattr(edits, name)
        for name in LeafEdits.__dataclass_fields__
        if getattr(edits, name) != getattr(start, name)
    }


def show_value(value: Value) -> str:
    """An edit's number or numbers."""
    return f"{value:g}" if isinstance(value, float) else " ".join(f"{number:g}" for number in value)
