"""Which leaves a plant gets: those that were found, where they were found, or leaves on the twigs of its branches."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.asset.leaf_representations import default_representations
from usdfoliage.asset.parts.leaf_part import BranchLeaves, LeafAssetSettings
from usdfoliage.branch.foliage.place import FoliageSettings as GrownSettings
from usdfoliage.branch.foliage.species import GENERIC, load_species
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.model_file import TracedPlant
from usdfoliage.errors import FoliageError
from usdfoliage.isolation.vegetation import MIN_EXCESS, green_excess
from usdfoliage.jobs.branches.foliage import (
    DRAWN_SPREAD,
    FITTED,
    TEMPLATE,
    FoliageRequest,
    grow_leaves,
)
from usdfoliage.jobs.plant.settings import BuildSettings
from usdfoliage.jobs.plant.stages.found_leaves import FoundLeaves, keep_found_leaves
from usdfoliage.jobs.plant.stages.models import CapturedLeaves, leafy_points
from usdfoliage.jobs.plant.stages.parts import known_species
from usdfoliage.jobs.report.table import Row
from usdfoliage.leaf.fill import FillSettings, fill_places
from usdfoliage.leaf.model import LeafOrigin, Leaves
from usdfoliage.leaf.shape.edits import slim_leaves
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.leaf.shape.variation import vary_colors
from usdfoliage.remarks import Remark, remark

_ACROSS, _ALONG = 5, 9  # points of a leaf at which its cover is measured
_NARROWEST = 0.1  # of a leaf's width: as slim as the points of a pod or a needle show it
_SURE = 0.5  # confidence, from which a leaf that was found stays where others are drawn on the twigs
_MOSTLY = 0.5  # of the points near leaves, from which on leaves are green ones
_NEAR = 0.25  # of a leaf's length, within which a point of the cloud is of it


@dataclass(frozen=True, kw_only=True, eq=False)
class ChosenFoliage:
    """The leaves of the plant, in its frame, and why these."""

    leaves: BranchLeaves | None
    kind: str
    remarks: tuple[Remark, ...]
    rows: tuple[Row, ...]  # on them, besides their number
    found: Leaves | None = None  # the leaves of the plant that were found, whichever it gets
    kept: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))  # its first, of those in the model
    explained: float | None = None  # share of the cloud's leaves that these cover; None where that is not known


def choose_foliage(
    captured: CapturedLeaves | None,
    traced: TracedPlant | None,
    settings: BuildSettings,
    plant_from_capture: NDArray[np.float64],
) -> ChosenFoliage:
    """The leaves of a plant, by the settings.

    Raises:
        FoliageError: Leaves are wanted that there are none of.
    """
    found = keep_found_leaves(captured, traced, plant_from_capture)
    explained = None
    if found.leaves is not None and traced is not None and traced.knows_leaves:
        leafy_m = traced.points_m[leafy_points(traced)]
        explained = leaf_cover(leafy_m, found.leaves) if len(leafy_m) else None
    chosen = _choose_of_found(captured, found, traced, settings, explained)
    return replace(chosen, remarks=(*found.remarks, *chosen.remarks), found=found.leaves, explained=explained)


def _choose_of_found(
    captured: CapturedLeaves | None,
    found: FoundLeaves,
    traced: TracedPlant | None,
    settings: BuildSettings,
    explained: float | None,
) -> ChosenFoliage:
    """The leaves of a plant of which these were found; arguments as choose_foliage has them."""
    wanted, placed = settings.foliage, found.leaves
    remarks: list[Remark] = []
    kind: str = wanted.kind
    if kind == "auto":
        kind, why = _choose(found, traced, settings, explained)
        remarks.append(remark("foliage-chosen", why))
    if kind == "none":
        return ChosenFoliage(leaves=None, kind=kind, remarks=tuple(remarks), rows=())
    if kind == "captured":
        if placed is None or captured is None:
            raise FoliageError("no leaf was found in the photographs", "set foliage.kind to species, or auto")
        chosen = _representations(settings, len(placed))
        leaves = BranchLeaves(
            leaves=placed,
            settings=LeafAssetSettings(representations=chosen),
            edits=captured.fitted.edits,
            appearance=captured.fitted.appearance,
        )
        return ChosenFoliage(leaves=leaves, kind=kind, remarks=tuple(remarks), rows=(), kept=found.kept)
    if kind == "filled":
        return replace(_fill(captured, placed, traced, settings, remarks), kept=found.kept)
    if traced is None:
        raise FoliageError(f"foliage.kind is {kind}, and there are no twigs for leaves", "set it to captured or auto")
    fitted = None
    if kind == "drawn" and captured is not None and placed is not None:
        fitted = replace(captured.fitted, leaves=placed)
    if kind == "drawn" and fitted is None:
        raise FoliageError("no leaf was found to draw from", "set foliage.kind to species, or auto")
    grown = grow_leaves(traced.skeleton, _request(settings, drawn=kind == "drawn"), fitted, settings.seed)
    if grown is None:
        raise FoliageError("no leaves were grown")
    if not len(grown.foliage.leaves):
        remarks.append(remark("no-leaf-on-twigs", "no leaf is on the few twigs that there are: the plant has none"))
        return ChosenFoliage(leaves=None, kind="none", remarks=tuple(remarks), rows=())
    origin = LeafOrigin.OF_SPECIES if fitted is None else LeafOrigin.FILLED_IN
    put = grown.foliage.leaves
    put = replace(put, origin=np.full(len(put), origin, np.int32))
    sure = np.zeros(0, np.int64)
    if wanted.kind == "auto" and placed is not None and placed.confidence is not None:
        sure = np.flatnonzero(placed.confidence >= _SURE)
    if placed is not None and len(sure):
        own = _as_found(placed.take(sure))
        put = join_leaves([own, put.take(~near_leaves(_middles(put), own))])
        text = f"{len(own):,} leaves that were found are probably right and stay where they are"
        remarks.append(remark("found-leaves-kept", text))
    foliage = replace(grown.foliage, leaves=put)
    return ChosenFoliage(
        leaves=foliage,
        kind=kind,
        remarks=(*remarks, *grown.remarks),
        rows=grown.mean_leaf_rows,
        kept=found.kept[sure],
    )


def leaves_on_twigs(
    skeleton: Skeleton, captured: CapturedLeaves | None, chosen: ChosenFoliage, settings: BuildSettings, seed: int
) -> BranchLeaves | None:
    """Leaves on the twigs of a variation of the plant, drawn from those that were found, or of the species.

    Args:
        skeleton: Of the variation.
        captured: The leaves that were found.
        chosen: Those of the plant itself; without any the variation has none.
        settings: Of the build.
        seed: Of the random choices.
    """
    if chosen.leaves is None:
        return None
    fitted = None
    if chosen.kind != "species" and captured is not None and chosen.found is not None and len(chosen.found):
        fitted = replace(captured.fitted, leaves=chosen.found)
    grown = grow_leaves(skeleton, _request(settings, drawn=fitted is not None), fitted, seed)
    if grown is None or not len(grown.foliage.leaves):
        return None
    put = grown.foliage.leaves
    origin = LeafOrigin.OF_SPECIES if fitted is None else LeafOrigin.FILLED_IN
    return replace(grown.foliage, leaves=replace(put, origin=np.full(len(put), origin, np.int32)))


def _request(settings: BuildSettings, *, drawn: bool) -> FoliageRequest:
    """Leaves on twigs: drawn from those that were found, or of the species."""
    return FoliageRequest(
        kind=FITTED if drawn else TEMPLATE,
        species=known_species(settings.plant.species) or load_species(GENERIC),
        length_m=settings.foliage.leaf_length_m,
        settings=replace(GrownSettings(), max_leaves=settings.foliage.max_leaves),
        representations=settings.plant.representations,
    )


def _as_found(leaves: Leaves) -> Leaves:
    """Leaves of no known origin, as of the method paper, are found ones; joined, they would count as filled in."""
    if leaves.origin is not None:
        return leaves
    return replace(leaves, origin=np.full(len(leaves), LeafOrigin.FOUND, np.int32))


def _middles(leaves: Leaves) -> NDArray[np.float64]:
    """(N, 3), the middle of each leaf's axis."""
    middle = np.array([[0.0, 0.5]])
    return np.asarray(evaluate_points(leaves.parameters, middle, placements=leaves.asset_from_leaf())).reshape(-1, 3)


def _fill(
    captured: CapturedLeaves | None,
    placed: Leaves | None,
    traced: TracedPlant | None,
    settings: BuildSettings,
    remarks: list[Remark],
) -> ChosenFoliage:
    """The leaves that were found, and wherever the cloud has leaves besides, others like the surest of them."""
    if captured is None or placed is None or traced is None or not leafy_points(traced).any():
        raise FoliageError(
            "foliage.kind is filled: that needs leaves that were found, and a cloud that shows which points are leaves"
        )
    rng = np.random.default_rng(settings.seed)
    sure = _surest(placed)
    length_m = settings.foliage.leaf_length_m or float(np.median(sure.length_m))
    leafy_m = traced.points_m[leafy_points(traced)]
    bare_m = leafy_m[~near_leaves(leafy_m, placed)]
    max_added = max(settings.foliage.max_leaves - len(placed), 1)
    settings_of_fill = FillSettings(max_leaves=max_added)
    places = fill_places(bare_m, traced.skeleton.points_m, length_m, rng, settings_of_fill, plant_m=traced.points_m)
    drawn = rng.integers(len(sure), size=len(places.base_m))
    full_length = places.length_m >= length_m  # a length measured from the points is not varied
    others = Leaves(
        parameters=_narrow(sure.parameters[drawn], places.width_m / places.length_m),
        base_m=places.base_m,
        orientation=places.orientation,
        length_m=np.where(full_length, sure.length_m[drawn] / float(np.median(sure.length_m)), 1.0) * places.length_m,
        phase=np.zeros(len(drawn)),
        color=None if sure.color is None else vary_colors(sure.color[drawn], len(drawn), rng, DRAWN_SPREAD),
        origin=np.full(len(drawn), LeafOrigin.FILLED_IN, np.int32),
    )
    leaves = join_leaves([_as_found(placed), others])
    text = f"{len(others):,} leaves were put beside {len(placed):,} that were found"
    chosen = _representations(settings, len(leaves))
    foliage = BranchLeaves(
        leaves=leaves,
        settings=LeafAssetSettings(representations=chosen),
        edits=captured.fitted.edits,
        appearance=captured.fitted.appearance,
    )
    return ChosenFoliage(leaves=foliage, kind="filled", remarks=(*remarks, remark("leaves-filled-in", text)), rows=())


def _narrow(parameters: NDArray[np.float64], width: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leaves (N, 7, 3) no wider than that (N,), in their lengths, where it is a number."""
    if not len(parameters):
        return parameters
    factors = np.nan_to_num(np.clip(width / leaf_width(parameters), _NARROWEST, 1), nan=1.0)
    return slim_leaves(parameters, factors)


def join_leaves(groups: Sequence[Leaves]) -> Leaves:
    """Leaves of several groups as one; what is not known of a leaf is guessed: no confidence, no view, filled in."""
    known = (
        ("confidence", 0.0, np.float64),
        ("residual_m", 0.0, np.float64),
        ("view", -1, np.int32),
        ("origin", LeafOrigin.FILLED_IN, np.int32),
    )
    joined: dict[str, NDArray[np.generic] | None] = {}
    for name, none, kind in known:
        arrays = [getattr(group, name) for group in groups]
        joined[name] = None
        if any(values is not None for values in arrays):
            joined[name] = np.concatenate(
                [np.full(len(g), none, kind) if v is None else v for g, v in zip(groups, arrays, strict=True)]
            )
    colors = [group.color for group in groups]
    count = sum(map(len, groups))
    return Leaves(
        parameters=np.concatenate([group.parameters for group in groups]),
        base_m=np.concatenate([group.base_m for group in groups]),
        orientation=np.concatenate([group.orientation for group in groups]),
        length_m=np.concatenate([group.length_m for group in groups]),
        phase=spread_phases(count),
        color=np.concatenate(colors) if all(color is not None for color in colors) else None,  # type: ignore[arg-type]
        **joined,  # type: ignore[arg-type]
    )


def near_leaves(points_m: NDArray[np.float64], leaves: Leaves) -> NDArray[np.bool_]:
    """(N,), which points lie near leaves."""
    if not len(points_m) or not len(leaves):
        return np.zeros(len(points_m), bool)
    places = grid_places(np.linspace(-1, 1, _ACROSS), np.linspace(0, 1, _ALONG))
    samples_m = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf()).reshape(-1, 3)
    away_m, _ = cKDTree(samples_m).query(points_m, distance_upper_bound=_NEAR * float(np.median(leaves.length_m)))
    return np.isfinite(away_m)


def leaf_cover(points_m: NDArray[np.float64], leaves: Leaves, srgb: NDArray[np.uint8] | None = None) -> float:
    """Which share of points (N, 3) lies near leaves; 0 without either.

    Of colours (N, 3), where leaves are green, those of the points that are green alone count: the cloud may show the
    wall behind a plant too.
    """
    if not len(points_m):
        return 0.0
    near = near_leaves(points_m, leaves)
    if srgb is not None and near.any():
        green = green_excess(srgb) > MIN_EXCESS
        if green[near].mean() >= _MOSTLY:
            near = near[green]
    return float(near.mean())


def _choose(
    found: FoundLeaves, traced: TracedPlant | None, settings: BuildSettings, explained: float | None
) -> tuple[str, str]:
    """The kind of leaves, and why; explained is the share of the cloud's leaves that those that were found cover."""
    if traced is None:
        if found.leaves is None:
            return "none", "the plant has neither branches nor leaves that could be found"
        return "captured", "leaves are where they were found: there are no branches to put others on"
    if traced.is_leafless:
        share = float(leafy_points(traced).mean())
        return "none", f"{100 * share:.0f} % of the cloud is leaves: the plant has none"
    count = 0 if found.leaves is None else len(found.leaves)
    if count:
        few = count < settings.foliage.min_drawn
        if explained is not None:
            text = f"{count} leaves that were found cover {100 * explained:.0f} % of the cloud's leaves"
            if explained >= settings.foliage.min_cover:
                return "captured", f"{text}: they are where they were found"
            if not few:
                return "filled", f"{text}: others like them are where the cloud has leaves besides"
        if traced.of_photographs:
            # A herb has few leaves and few twigs: others on these would look like leaves that someone saw.
            text = f"{count} leaves were found, and stems lead to {found.led_to} of them"
            return "captured", f"{text}: they are where they were found"
        if not few:
            return "drawn", f"the cloud does not show where leaves are: they are on the twigs, drawn from {count}"
    what = f"{count} leaves were found, too few to draw from" if count else "no leaf was found"
    return "species", f"{what}: the leaves are on the twigs, of {settings.plant.species or 'no species in particular'}"


def _surest(leaves: Leaves) -> Leaves:
    """The better half of leaves: what is guessed of the others is no model for more."""
    if leaves.confidence is None:
        return leaves
    best = np.argsort(-leaves.confidence, kind="stable")[: -(-len(leaves) // 2)]
    return leaves.take(np.sort(best))


def _representations(settings: BuildSettings, count: int) -> tuple[str, ...]:
    if settings.plant.representations is not None:
        return settings.plant.representations
    return default_representations(count)
