"""Leaves for an asset of branches: of a species, or as they were fitted to a capture."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.leaf_representations import (
    MAX_LEAVES_OF_ALL,
    check_memory,
    default_representations,
    note_bezier_alone,
    read_settings,
)
from usdfoliage.asset.parts.leaf_part import BranchLeaves, LeafAppearance
from usdfoliage.branch.foliage.place import FoliageSettings, LeafPlaces, place_leaves
from usdfoliage.branch.foliage.species import GENERIC, Species, describe_species, load_species
from usdfoliage.branch.model import Skeleton
from usdfoliage.jobs.fitted_leaves import FittedLeaves
from usdfoliage.jobs.report.table import Row
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.measures import leaf_area, leaf_width
from usdfoliage.leaf.shape.variation import VariationSettings, leaf_of_width, vary_colors, vary_leaves
from usdfoliage.remarks import Remark, Setting, remark

NONE, TEMPLATE, FITTED = KINDS = ("none", "template", "fitted")
FAR = 3.0  # times as long or as short as those of the species, from which on fitted leaves are spoken of
DRAWN_SPREAD = 0.3  # of how leaves differ in colour on a plant: by that those drawn from one leaf do
MEASURED = 4000  # leaves whose width and area are measured, evenly chosen


@dataclass(frozen=True, kw_only=True)
class FoliageRequest:
    """What leaves the user asked for, checked."""

    kind: str = NONE
    species: Species = field(default_factory=lambda: load_species(GENERIC))
    source: Path | None = None  # asset of the fitted leaves
    length_m: float | None = None  # of a leaf; None: that of the species, or of the fitted leaves
    form: NDArray[np.float64] | None = None  # (7, 3) that leaves vary around; None: one of the species' width
    settings: FoliageSettings = field(default_factory=FoliageSettings)
    representations: tuple[str, ...] | None = None  # None: as many as their number allows
    resolution: tuple[int, int] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class GrownLeaves:
    """Leaves on their twigs, and what the user should know of them."""

    foliage: BranchLeaves
    places: LeafPlaces  # of the same leaves
    remarks: tuple[Remark, ...]

    @property
    def rows(self) -> tuple[Row, ...]:
        """How many leaves there are, and the mean leaf, for report and terminal."""
        count = len(self.foliage.leaves)
        remark = f"on {self.places.shoots:,} shoots"
        return (Row(name="leaves", value=f"{count:,}", remark=remark), *self.mean_leaf_rows)

    @property
    def mean_leaf_rows(self) -> tuple[Row, ...]:
        """The size of the mean leaf; none without leaves."""
        leaves = self.foliage.leaves
        count = len(leaves)
        if not count:
            return ()
        some = leaves.take(np.arange(min(count, MEASURED)) * count // min(count, MEASURED))
        length_m, width_m = leaves.length_m.mean(), (leaf_width(some.parameters) * some.length_m).mean()
        area_m2 = (leaf_area(some.parameters) * some.length_m**2).mean()
        row = Row(
            name="mean leaf",
            value=f"{100 * length_m:.1f} cm long, {100 * width_m:.1f} cm wide",
            remark=f"{1e4 * area_m2:.1f} cm² each, {count * area_m2:.1f} m² in all",
        )
        return (row,)


def grow_leaves(
    skeleton: Skeleton,
    request: FoliageRequest,
    fitted: FittedLeaves | None,
    seed: int,
) -> GrownLeaves | None:
    """Leaves on the twigs of a skeleton as they were asked for; None for none.

    Args:
        skeleton: Of the plant.
        request: Which leaves.
        fitted: Those to draw from; None: leaves of the species.
        seed: Of the random choices.

    Raises:
        FoliageError: So many need more memory than there is.
    """
    if request.kind == NONE:
        return None
    rng = np.random.default_rng(seed)
    settings = request.settings if fitted is None else replace(request.settings, length=0.0)  # they differ themselves
    places = place_leaves(skeleton, request.species, rng, settings)
    remarks: list[Remark] = []
    if fitted is None:
        foliage = _of_species(places, request, rng)
    else:
        foliage = _of_fitted(places, fitted, request, rng)
        remarks += _check_length(fitted.leaves, request)
    count = len(places)
    if count < places.grown:
        text = f"{count:,} of {places.grown:,} leaves were kept, evenly over the plant"
        remedy = ("a higher ", Setting(name="foliage.max_leaves"), " keeps more")
        remarks.append(remark("leaves-left-out", text, remedy=remedy))
    if not count:
        remarks.append(remark("no-twig-for-leaves", "no twig is thin enough to carry leaves"))
    default_forms = default_representations(count)
    if request.representations is None and count > MAX_LEAVES_OF_ALL:
        remarks.append(note_bezier_alone())
    written = read_settings(request.representations or default_forms, request.resolution)
    check_memory(count, written)
    foliage = replace(foliage, settings=written)
    return GrownLeaves(foliage=foliage, places=places, remarks=tuple(remarks))


def describe_foliage(request: FoliageRequest) -> dict[str, str]:
    """Every setting of leaves that decides the result, by the name of its option."""
    described = {"foliage": request.kind}
    if request.kind != NONE or request.species.name != GENERIC:
        described["species-parameters"] = describe_species(request.species)
    if request.kind == NONE:
        return described
    described["leaves"] = request.source.name if request.source else "none"
    described["leaf-length"] = "auto" if request.length_m is None else f"{request.length_m:g}"
    described["most-leaves"] = str(request.settings.max_leaves)
    described["representation"] = " ".join(request.representations or ()) or "auto"
    described["resolution"] = " ".join(map(str, request.resolution or ())) or "auto"
    return described


def _of_species(places: LeafPlaces, request: FoliageRequest, rng: np.random.Generator) -> BranchLeaves:
    """Leaves of the species' proportions, varied as those of a spray."""
    species, amount = request.species, request.settings.variation
    longer = 1.0 if request.length_m is None else request.length_m / species.leaf_length_m
    mean = leaf_of_width(species.leaf_width) if request.form is None else request.form
    appearance = LeafAppearance(color=species.color)
    leaves = _leaves_at(
        places,
        vary_leaves(len(places), rng, VariationSettings(amount=amount), mean),
        longer * places.length_m,
        vary_colors(appearance.color, len(places), rng, amount),
    )
    return BranchLeaves(leaves=leaves, appearance=appearance)


def _of_fitted(
    places: LeafPlaces, fitted: FittedLeaves, request: FoliageRequest, rng: np.random.Generator
) -> BranchLeaves:
    """Leaves drawn from those of a capture: what was guessed is drawn seldom, what folds over itself never."""
    measured_leaves, amount = fitted.leaves, request.settings.variation
    sound = (measured_leaves.parameters[:, 2:5, 1] > 0).all(axis=1) & ~find_folds(measured_leaves.parameters)
    trust = sound if measured_leaves.confidence is None else sound * measured_leaves.confidence
    trust = np.asarray(trust, np.float64) if trust.any() else np.ones(len(measured_leaves))
    drawn = rng.choice(len(measured_leaves), len(places), p=trust / trust.sum())
    median_m = float(np.median(measured_leaves.length_m))
    length_m = measured_leaves.length_m[drawn] * (request.length_m or median_m) / median_m
    if measured_leaves.color is not None:
        color = vary_colors(measured_leaves.color[drawn], len(places), rng, DRAWN_SPREAD * amount)
    elif fitted.appearance.texture is None:
        color = vary_colors(fitted.appearance.color, len(places), rng, amount)
    else:
        color = None
    young = places.length_m / request.species.leaf_length_m
    leaves = _leaves_at(places, measured_leaves.parameters[drawn], young * length_m, color)
    return BranchLeaves(leaves=leaves, edits=fitted.edits, appearance=fitted.appearance)


def _leaves_at(
    places: LeafPlaces,
    parameters: NDArray[np.float64],
    length_m: NDArray[np.float64],
    color: NDArray[np.float64] | None,
) -> Leaves:
    return Leaves(
        parameters=parameters,
        base_m=places.base_m,
        orientation=places.orientation,
        length_m=length_m,
        phase=spread_phases(len(places)),
        color=color,
    )


def _check_length(leaves: Leaves, request: FoliageRequest) -> list[Remark]:
    """A capture whose scale is not known has leaves of any length."""
    median_m, expected_m = float(np.median(leaves.length_m)), request.species.leaf_length_m
    if request.length_m is not None or expected_m / FAR <= median_m <= expected_m * FAR:
        return []
    text = (
        f"the leaves of {request.source} are {100 * median_m:.3g} cm long, those of {request.species.name} "
        f"{100 * expected_m:.3g} cm"
    )
    remedy = ("give ", Setting(name="foliage.leaf_length_m"), " if their capture had no scale")
    return [remark("leaf-length-improbable", text, remedy=remedy)]
