"""Refusing a cloud that is surely of no plant, before branches are traced through it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.tracing.cloud_shape import CloudKind, CloudShape, judge_cloud_shape
from usdfoliage.errors import FitError
from usdfoliage.remarks import Remedy, Setting

_ALL_THE_SAME: Remedy = (Setting(name="branches.make", value='"on"'), " to trace branches all the same")
_ROOT: Remedy = (Setting(name="branches.roots"), " where its stem is")


_UNJOINED = 0.6  # share of the branches, from which on nothing but the stem shows that they are any
_FEW = 20  # branches, of which that is no evidence


class NoPlantError(FitError):
    """The cloud is surely of no plant."""


def check_plant(points_m: NDArray[np.float64], roots_m: NDArray[np.float64], path: Path) -> None:
    """Refuse a cloud of walls, of bare ground or of a hedge.

    Args:
        points_m: (N, 3), Y up, without the ground that was found.
        roots_m: (R, 3).
        path: Of the cloud.

    Raises:
        NoPlantError: It is of one of these.
    """
    shape = judge_cloud_shape(points_m, roots_m)
    if shape.kind != CloudKind.PLANT:
        raise _explain(shape, path)


def check_traced(branches: int, unjoined: int, stem_seen: bool, path: Path) -> None:
    """Refuse a cloud in which neither a stem is seen nor branches that join.

    Args:
        branches: That were traced.
        unjoined: Of these, that no surface joins to their parents, where it may have as many faces as it takes.
        stem_seen: Whether the cloud shows a stem at a root, or round branches.
        path: Of the cloud.

    Raises:
        NoPlantError: It is of no plant, or shows too little of one.
    """
    if stem_seen or branches < _FEW or unjoined < _UNJOINED * branches:
        return
    raise NoPlantError(
        f"{path} shows no tree: no stem is seen at a root, as in a hedge, and {100 * unjoined / branches:.0f} % of the "
        f"branches that were traced do not join, {100 * _UNJOINED:.0f} % allowed",
        ("give a cloud of one plant, or ", *_ROOT, ", or ", *_ALL_THE_SAME),
    )


def _explain(shape: CloudShape, path: Path) -> NoPlantError:
    """What a cloud is of instead of a plant, by which figures, and what to do."""
    cut_out: Remedy = ("cut the plant out of it, or give ", *_ROOT, ", or ", *_ALL_THE_SAME)
    if shape.kind == CloudKind.HEDGE:
        return NoPlantError(
            f"{path} looks like a hedge: a block {shape.length_m:.2g} m long, {shape.width_m:.2g} m wide and "
            f"{shape.height_m:.2g} m high that is dense from end to end and from foot to top, without a trunk",
            ("give a cloud of one plant, or ", *_ROOT, ", or ", *_ALL_THE_SAME),
        )
    if shape.kind == CloudKind.GROUND:
        return NoPlantError(
            f"{path} looks like bare ground: {100 * shape.on_level:.0f} % of its points lie on level planes",
            (
                "give a cloud of a plant, and ",
                Setting(name="capture.toml:up_axis"),
                " if another of its axes is up, or ",
                *_ALL_THE_SAME,
            ),
        )
    if shape.kind == CloudKind.WALL:
        what = f"a wall: {100 * shape.on_walls:.0f} % of its points lie on an upright plane"
    else:
        what = (
            f"a building: {100 * shape.on_planes:.0f} % of its points lie on {shape.planes} large planes, "
            f"{100 * shape.on_walls:.0f} % on walls"
        )
    return NoPlantError(f"{path} looks like {what}", cut_out)
