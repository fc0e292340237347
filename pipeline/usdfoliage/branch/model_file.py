"""Branches in files that one stage hands on to others: what is drawn of them, and the cloud they were traced in."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage.build import BranchCage, DroppedBranch
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.branch.model import Skeleton
from usdfoliage.files.npz import read_arrays, reading_model, write_model

LEAFLESS = 0.05  # share of the cloud that is leaves, below which a plant has none
_CAGE = ("points_m", "ring", "faces", "st_m", "face_st", "curve", "order", "fork_faces", "fork_counts", "fork_curve")
_CLOUD = ("points_m", "wood", "plant_from_capture", "turned", "unjoined")
_FLAGS = ("knows_leaves", "of_photographs")


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchesModel:
    """What an asset draws of branches. The plant's frame: metres, Y up, the first root at the origin."""

    skeleton: Skeleton
    surfaces: BranchSurfaces
    color: tuple[float, float, float]  # of the bark, linear Rec.709
    growth: Mapping[str, float] = field(default_factory=dict)  # parameters that were measured, by the schema's names


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedPlant:
    """What the other parts must know of the branches. The plant's frame: metres, Y up, the first root at the origin."""

    points_m: NDArray[np.float64]  # (N, 3), the cloud without its ground
    wood: NDArray[np.bool_]  # (N,), points of branches; the others are of leaves
    knows_leaves: bool  # whether the cloud is dense enough to distinguish leaves from branches
    colors: NDArray[np.float64] | None  # (N, 3), red, green and blue, 0 to 255
    plant_from_capture: NDArray[np.float64]  # (4, 4), column vectors, from the capture's coordinates
    skeleton: Skeleton
    of_photographs: bool = False  # whether stems are lines in photographs, which the cloud does not show
    # Leaves that were found to which stems lead by what was taken for their apex.
    turned: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    # Leaves that were found to which no stem leads.
    unjoined: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))

    @property
    def is_leafless(self) -> bool:
        """Whether the cloud surely shows a plant without leaves."""
        return self.knows_leaves and float((~self.wood).mean()) < LEAFLESS


def write_branches_model(path: Path, model: BranchesModel) -> None:
    """Write branches to a .npz file, which appears whole; the same bytes for the same branches.

    Raises:
        WriteError: It cannot be written.
    """
    arrays = _pack_skeleton(model.skeleton)
    arrays |= _pack_cage("all", model.surfaces.whole)
    for order, cage in model.surfaces.by_order:
        arrays |= _pack_cage(str(order), cage)
    arrays["orders"] = np.array([order for order, _ in model.surfaces.by_order], np.int64)
    arrays["color"] = np.array(model.color, np.float64)
    arrays["growth_names"] = np.array(list(model.growth), np.str_)
    arrays["growth_values"] = np.array(list(model.growth.values()), np.float64)
    write_model(path, arrays)


def read_branches_model(path: Path) -> BranchesModel:
    """The branches that write_branches_model wrote.

    Raises:
        CaptureError: The file is missing or damaged.
    """
    with reading_model(path, "branches"):
        arrays = read_arrays(path)
        red, green, blue = map(float, arrays["color"])
        names, values = arrays["growth_names"].tolist(), arrays["growth_values"].tolist()
        orders = arrays["orders"].tolist()
        return BranchesModel(
            skeleton=_unpack_skeleton(arrays),
            surfaces=BranchSurfaces(
                whole=_unpack_cage("all", arrays),
                by_order=tuple((order, _unpack_cage(str(order), arrays)) for order in orders),
            ),
            color=(red, green, blue),
            growth=dict(zip(names, values, strict=True)),
        )


def write_traced_plant(path: Path, traced: TracedPlant) -> None:
    """Write a cloud with its branches to a .npz file, which appears whole; the same bytes for the same cloud.

    Raises:
        WriteError: It cannot be written.
    """
    arrays = {name: np.asarray(getattr(traced, name)) for name in _CLOUD}
    arrays |= {name: np.array(getattr(traced, name)) for name in _FLAGS}
    arrays["colors"] = np.zeros((0, 3), np.float32) if traced.colors is None else traced.colors.astype(np.float32)
    write_model(path, arrays | _pack_skeleton(traced.skeleton))


def read_traced_plant(path: Path) -> TracedPlant:
    """The cloud that write_traced_plant wrote.

    Raises:
        CaptureError: The file is missing or damaged.
    """
    with reading_model(path, "traced cloud"):
        arrays = read_arrays(path)
        count = len(arrays["points_m"])
        expected = {"points_m": (count, 3), "wood": (count,), "plant_from_capture": (4, 4)}
        wrong = [name for name, shape in expected.items() if arrays[name].shape != shape]
        if wrong or arrays["colors"].shape not in ((0, 3), (count, 3)):
            raise ValueError(f"{', '.join(wrong) or 'colors'} has the shape of no cloud")
        knows_leaves, of_photographs = (bool(arrays[name]) for name in _FLAGS)
        return TracedPlant(
            points_m=arrays["points_m"],
            wood=arrays["wood"],
            plant_from_capture=arrays["plant_from_capture"],
            turned=arrays["turned"],
            unjoined=arrays["unjoined"],
            knows_leaves=knows_leaves,
            of_photographs=of_photographs,
            colors=arrays["colors"].astype(np.float64) if len(arrays["colors"]) else None,
            skeleton=_unpack_skeleton(arrays),
        )


def _pack_skeleton(skeleton: Skeleton) -> dict[str, NDArray[Any]]:
    return {f"skeleton_{each.name}": getattr(skeleton, each.name) for each in fields(Skeleton)}


def _unpack_skeleton(arrays: Mapping[str, NDArray[Any]]) -> Skeleton:
    return Skeleton(**{each.name: arrays[f"skeleton_{each.name}"] for each in fields(Skeleton)})


def _pack_cage(name: str, cage: BranchCage) -> dict[str, NDArray[Any]]:
    arrays = {f"cage_{name}_{part}": np.asarray(getattr(cage, part)) for part in _CAGE}
    arrays[f"cage_{name}_dropped"] = np.array([each.curve for each in cage.dropped], np.int64)
    arrays[f"cage_{name}_reasons"] = np.array([each.reason for each in cage.dropped], np.str_)
    arrays[f"cage_{name}_loose"] = np.array(cage.loose, np.int64)
    return arrays


def _unpack_cage(name: str, arrays: Mapping[str, NDArray[Any]]) -> BranchCage:
    dropped, reasons = arrays[f"cage_{name}_dropped"].tolist(), arrays[f"cage_{name}_reasons"].tolist()
    return BranchCage(
        **{part: arrays[f"cage_{name}_{part}"] for part in _CAGE},
        dropped=tuple(
            DroppedBranch(curve=each, reason=DropReason(why)) for each, why in zip(dropped, reasons, strict=True)
        ),
        loose=tuple(arrays[f"cage_{name}_loose"].tolist()),
    )
