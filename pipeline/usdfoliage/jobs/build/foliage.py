"""Which leaves a plant gets: those that were found, where they were found, or leaves on the twigs of its branches."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.asset.branch_package import BranchLeaves
from usdfoliage.asset.package import REPRESENTATIONS, LeafAssetSettings
from usdfoliage.branch.foliage import FoliageSettings as GrownSettings
from usdfoliage.branch.species import GENERIC, load_species
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.branch_foliage import (
    FITTED,
    TEMPLATE,
    FoliageRequest,
    grow_leaves,
)
from usdfoliage.jobs.build.captured_leaves import CapturedLeaves
from usdfoliage.jobs.build.plant_stages import TracedPlant, known_species
from usdfoliage.jobs.build.settings import BuildSettings
from usdfoliage.jobs.crown_report import Row
from usdfoliage.jobs.leaf_asset import MOST_LEAVES_OF_ALL
from usdfoliage.jobs.leaf_change import move_leaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.surface import evaluate_points, grid_places

SURE = 0.5  # confidence of a leaf that counts
LEAFLESS = 0.05  # share of the cloud that is leaves, below which a plant has none
_ACROSS, _ALONG = 5, 9  # points of a leaf that its cover is told by
_NEAR = 0.25  # of a leaf's length, within which a point of the cloud is of it


@dataclass(frozen=True, kw_only=True, eq=False)
class ChosenFoliage:
    """The leaves of the plant, in its frame, and why these."""

    leaves: BranchLeaves | None
    kind: str
    notes: tuple[str, ...]
    rows: tuple[Row, ...]


def choose_foliage(
    captured: CapturedLeaves | None,
    traced: TracedPlant | None,
    settings: BuildSettings,
    plant_from_capture: NDArray[np.float64],
) -> ChosenFoliage:
    """The leaves of a plant, as the settings say.

    Raises:
        FoliageError: Leaves are wanted that there are none of.
    """
    wanted = settings.foliage
    notes: list[str] = []
    placed = None
    if captured is not None:
        moved = plant_from_capture @ np.linalg.inv(captured.own_from_capture)
        placed = move_leaves(captured.fitted.leaves, moved)
    kind: str = wanted.kind
    sure = 0 if placed is None else _count_sure(placed)
    if kind == "auto":
        kind, why = _choose(placed, sure, traced, settings)
        notes.append(why)
    if kind == "none":
        return ChosenFoliage(leaves=None, kind=kind, notes=tuple(notes), rows=())
    if kind == "captured":
        if placed is None or captured is None:
            raise FoliageError("no leaf was found in the photographs; set foliage.kind to species, or auto")
        chosen = _representations(settings, len(placed))
        leaves = BranchLeaves(
            leaves=placed,
            settings=LeafAssetSettings(representations=chosen),
            edits=captured.fitted.edits,
            look=captured.fitted.look,
        )
        return ChosenFoliage(leaves=leaves, kind=kind, notes=tuple(notes), rows=())
    if traced is None:
        raise FoliageError(f"foliage.kind is {kind}, and there are no twigs for leaves; set it to captured or auto")
    if kind == "drawn" and captured is None:
        raise FoliageError("no leaf was found to draw from; set foliage.kind to species, or auto")
    species = known_species(settings.plant.species) or load_species(GENERIC)
    request = FoliageRequest(
        kind=FITTED if kind == "drawn" else TEMPLATE,
        species=species,
        length_m=wanted.leaf_length_m,
        settings=replace(GrownSettings(), most_leaves=wanted.most_leaves),
        representations=settings.plant.representations,
    )
    fitted = captured.fitted if kind == "drawn" and captured is not None else None
    grown = grow_leaves(traced.skeleton, request, fitted, settings.seed, traced.lost.tolist())
    if grown is None:
        raise FoliageError("no leaves were grown")
    return ChosenFoliage(leaves=grown.foliage, kind=kind, notes=(*notes, *grown.notes), rows=grown.rows)


def leaf_cover(points_m: NDArray[np.float64], leaves: Leaves) -> float:
    """Which share of points (N, 3) lies near leaves; 0 without either."""
    if not len(points_m) or not len(leaves):
        return 0.0
    places = grid_places(np.linspace(-1, 1, _ACROSS), np.linspace(0, 1, _ALONG))
    samples_m = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf()).reshape(-1, 3)
    away_m, _ = cKDTree(samples_m).query(points_m, distance_upper_bound=_NEAR * float(np.median(leaves.length_m)))
    return float(np.isfinite(away_m).mean())


def _choose(placed: Leaves | None, sure: int, traced: TracedPlant | None, settings: BuildSettings) -> tuple[str, str]:
    """The kind of leaves, and why."""
    if traced is None:
        if placed is None:
            return "none", "the plant has neither branches nor leaves that could be found"
        return "captured", "leaves are where they were found: there are no branches to put others on"
    leafy_m = traced.points_m[~traced.wood]
    share = len(leafy_m) / max(len(traced.points_m), 1)
    has_leaves = share >= LEAFLESS or not traced.knows_leaves
    if placed is not None:
        cover = leaf_cover(leafy_m if has_leaves and len(leafy_m) else traced.points_m, placed)
        told = f"leaves that were found cover {100 * cover:.0f} % of the cloud's leaves"
        if cover >= settings.foliage.least_cover and sure >= settings.foliage.least_sure * len(placed):
            return "captured", f"{told}: they are where they were found"
        if has_leaves and sure >= settings.foliage.least_drawn:
            return "drawn", f"{told}: the leaves are on the twigs instead, drawn from {sure} that were found"
    if not has_leaves:
        return "none", f"{100 * share:.0f} % of the cloud is leaves: the plant has none"
    what = f"{sure} leaves were found, too few to draw from" if placed is not None else "no leaf was found"
    return "species", f"{what}: the leaves are on the twigs, of {settings.plant.species or 'no species in particular'}"


def _count_sure(leaves: Leaves) -> int:
    return len(leaves) if leaves.confidence is None else int((leaves.confidence >= SURE).sum())


def _representations(settings: BuildSettings, count: int) -> tuple[str, ...]:
    if settings.plant.representations is not None:
        return settings.plant.representations
    return tuple(REPRESENTATIONS) if count <= MOST_LEAVES_OF_ALL else ("bezier",)
