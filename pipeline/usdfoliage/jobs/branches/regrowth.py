"""Branches that are grown, where the settings ask for it: instead of traced ones, in the crown, or as variations."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.foliage.species import Species
from usdfoliage.branch.growth.grow import GrownBranches
from usdfoliage.branch.growth.regrowth import RegrowthSettings, fill_hidden, regrow, vary_growth
from usdfoliage.branch.growth.settings import GrowthSettings
from usdfoliage.branch.tracing.reconstruct import TracedBranches
from usdfoliage.jobs.branches.warnings import check_growth
from usdfoliage.jobs.plant_cloud import PlantCloud
from usdfoliage.remarks import Remark, remark

TRACE, GROW = METHODS = ("trace", "grow")
MAX_VARIATIONS = 99
_SPACINGS = 0.7  # of the cloud, that an internode is at least: buds see no points across wider gaps


@dataclass(frozen=True, kw_only=True)
class RegrowthRequest:
    """What growth the user asked for, checked."""

    method: str = TRACE
    hidden: bool = False  # grow into what the cloud hides
    variations: int = 0
    settings: RegrowthSettings = field(default_factory=RegrowthSettings)

    def describe(self) -> dict[str, str]:
        """Settings by the names of their options; nothing of what was not asked for."""
        described = {"method": self.method}
        if self.hidden:
            described["fill-hidden"] = "yes"
        if self.variations:
            described["variations"] = str(self.variations)
        return described


def growth_settings(traced: TracedBranches, species: Species) -> GrowthSettings:
    """The plant's parameters: angles of the species, lengths and thickness as the cloud shows them."""
    return GrowthSettings(
        internode_m=max(traced.internode_m, _SPACINGS * traced.spacing_m),
        divergence_deg=math.degrees(species.roll_rad),
        branching_deg=math.degrees(species.branching_rad),
        allometry=AllometrySettings(exponent=traced.radii.exponent),
    )


def regrow_branches(
    traced: TracedBranches,
    plant: PlantCloud,
    request: RegrowthRequest,
    species: Species,
    seed: int,
    progress: Callable[[float], None] | None = None,
) -> tuple[TracedBranches, list[Remark]]:
    """The branches with what is asked for grown, and remarks on it; as they were traced where nothing is.

    Args:
        traced: As the cloud shows them.
        plant: The cloud.
        request: What grows.
        species: Whose angles growth has.
        seed: Of growth.
        progress: Called with how far it is, 0 to 1.
    """
    remarks: list[Remark] = []
    growth = growth_settings(traced, species)
    if request.method == GROW:
        grown = _regrow(traced, plant, growth, request, seed, progress)
        traced = replace(traced, skeleton=grown.skeleton)
        text = f"branches are grown from the roots through the cloud in {grown.cycles} cycles"
        remarks.append(remark("branches-grown", _with_shares(grown, text)))
        remarks.extend(check_growth(float(grown.reached.mean()), growth.internode_m))
    if request.hidden:
        filled = _fill(traced, plant, growth, request, seed, progress)
        traced = replace(traced, skeleton=filled.skeleton)
        if filled.grown:
            text = f"{filled.grown:,} branches are grown inside the crown, where the cloud shows none"
            remarks.append(remark("hidden-branches-grown", _with_shares(filled, text)))
        else:
            text = "the cloud hides nothing of the crown: no branches are grown inside it"
            remarks.append(remark("nothing-hidden", text))
    return traced, remarks


def vary_branches(
    traced: TracedBranches, plant: PlantCloud, request: RegrowthRequest, species: Species, seed: int
) -> Iterator[tuple[TracedBranches, int]]:
    """Plants like the one that was traced, grown through its cloud with slightly other parameters; each one's seed.

    What its cloud hides they fill as it does, where that is asked for.
    """
    growth = growth_settings(traced, species)
    for number in range(1, request.variations + 1):
        own = seed + number
        varied = vary_growth(growth, request.settings.variation, own)
        variation = replace(traced, skeleton=_regrow(traced, plant, varied, request, own, None).skeleton)
        if request.hidden:
            variation = replace(variation, skeleton=_fill(variation, plant, varied, request, own, None).skeleton)
        yield variation, own


def _regrow(
    traced: TracedBranches,
    plant: PlantCloud,
    growth: GrowthSettings,
    request: RegrowthRequest,
    seed: int,
    progress: Callable[[float], None] | None,
) -> GrownBranches:
    radius_m = float(traced.skeleton.radius_m[0])
    return regrow(plant.points_m, plant.roots_m, radius_m, growth, request.settings, seed, progress, traced.skeleton)


def _fill(
    traced: TracedBranches,
    plant: PlantCloud,
    growth: GrowthSettings,
    request: RegrowthRequest,
    seed: int,
    progress: Callable[[float], None] | None,
) -> GrownBranches:
    skeleton = traced.skeleton
    return fill_hidden(skeleton, plant.points_m, traced.spacing_m, growth, request.settings, seed, progress)


def _with_shares(grown: GrownBranches, text: str) -> str:
    return f"{text}; growth came to {100 * grown.reached.mean():.0f} % of the points, {grown.shed:,} branches were shed"
