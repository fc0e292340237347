"""Branches that are grown, where the settings ask for it: instead of traced ones, in the crown, or as variations."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from scipy.spatial import cKDTree

from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.distances import near_surface
from usdfoliage.branch.foliage.species import Species
from usdfoliage.branch.growth.envelope import Envelope, draw_envelope, measure_tree_place, warp_points, warp_skeleton
from usdfoliage.branch.growth.grow import GrownBranches
from usdfoliage.branch.growth.limbs import move_limbs
from usdfoliage.branch.growth.regrowth import (
    RegrowthSettings,
    draw_to_axes,
    fill_hidden,
    fill_rest,
    regrow,
    vary_growth,
)
from usdfoliage.branch.growth.seen_stems import fair_stems, thick_stems
from usdfoliage.branch.growth.settings import GrowthSettings
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.cloud_cut import point_spacing
from usdfoliage.branch.tracing.reconstruct import TracedBranches
from usdfoliage.errors import FitError
from usdfoliage.jobs.branches.warnings import REACHED, check_growth
from usdfoliage.jobs.plant_cloud import PlantCloud
from usdfoliage.remarks import Remark, Setting, remark

Method = Literal["trace", "grow"]
METHODS: tuple[Method, ...] = get_args(Method)
TRACE, GROW = METHODS
Fill = Literal["auto", "on", "off"]
_LONGER = 0.01  # of its length, by which a branch that grows on is longer than before
_LEAVES_OUT = 0.03  # share of the points, from which on what traced branches leave of a cloud is grown into
MAX_VARIATIONS = 99
MAX_SPREAD = 2.0
_SPACINGS = 0.7  # of the cloud, that an internode is at least: buds see no points across wider gaps
_DENSE_SPACINGS = 1.5  # that it is at most: shorter ones come nearer to points that are close together,
_FINEST = 0.4  # of the internode that branches are traced with, but no shorter
_STOUT = 0.2  # of the radius at the root, that it is at least: of a stem alone the height gives too short ones
_USED_SPACINGS, _USED = 2.5, 0.75  # and internodes, within which points around a node are used up
_REACHED_SPACINGS = 3.0  # from the surface of a branch, within which it has come to a point
_WIDEST_GAP = 0.5  # of the plant's height, that growth crosses
_TRIES = (1.0, 2.0, 4.0)  # times the internode, until growth comes to enough of the points


class IncompleteGrowthError(FitError):
    """Branches do not grow to enough of a cloud's points, with whatever internodes."""


@dataclass(frozen=True, kw_only=True)
class RegrowthRequest:
    """What growth the user asked for, checked."""

    method: Method = TRACE
    # Let traced limbs grow on into what they leave of the cloud; auto: where it does not show which points are leaves.
    fill: Fill = "off"
    hidden: bool = False  # grow into what the cloud hides
    variations: int = 0
    variation_spread: float = 1.0  # times what trees of a stand differ by; 0: within the plant's own outline
    internode_m: float | None = None  # that was asked for
    settings: RegrowthSettings = field(default_factory=RegrowthSettings)

    def __post_init__(self) -> None:
        if self.method not in METHODS or self.fill not in get_args(Fill):
            raise ValueError(f"method and fill must be of {', '.join((*METHODS, *get_args(Fill)))}")
        if not 0 <= self.variations <= MAX_VARIATIONS:
            raise ValueError(f"variations must be 0 to {MAX_VARIATIONS}, not {self.variations}")
        if not 0 <= self.variation_spread <= MAX_SPREAD:
            raise ValueError(f"variation_spread must be 0 to {MAX_SPREAD:g}, not {self.variation_spread:g}")

    def describe(self) -> dict[str, str]:
        """Settings by the names of their options; nothing of what was not asked for."""
        described: dict[str, str] = {"method": self.method}
        if self.fill != "off":
            described["fill"] = self.fill
        if self.hidden:
            described["fill-hidden"] = "yes"
        if self.variations:
            described["variations"] = str(self.variations)
            described["variation-spread"] = f"{self.variation_spread:g}"
        return described


def growth_settings(traced: TracedBranches, species: Species) -> GrowthSettings:
    """The plant's parameters: angles of the species, lengths and thickness as the cloud shows them."""
    return GrowthSettings(
        internode_m=max(traced.internode_m, _SPACINGS * traced.spacing_m),
        divergence_deg=math.degrees(species.roll_rad),
        branching_deg=math.degrees(species.branching_rad),
        allometry=AllometrySettings(exponent=traced.radii.exponent),
    )


def settings_for_cloud(
    growth: GrowthSettings, traced: TracedBranches, plant: PlantCloud, given_m: float | None = None
) -> GrowthSettings:
    """The parameters with lengths that follow the points, for a plant that grows through its whole cloud.

    Args:
        growth: As growth_settings has them.
        traced: Branches of the cloud.
        plant: The cloud.
        given_m: The internode that was asked for, which stays; None for one that follows the cloud.
    """
    growth = replace(growth, max_gap_m=_WIDEST_GAP * float(np.ptp(plant.points_m[:, 1])))
    if given_m is not None:
        return replace(growth, internode_m=given_m)
    spacing_m = _spacing_m(traced, plant)
    longest_m = max(_DENSE_SPACINGS * spacing_m, _FINEST * traced.internode_m)
    shortest_m = max(_SPACINGS * traced.spacing_m, _STOUT * float(traced.skeleton.radius_m[0]))
    internode_m = max(shortest_m, min(traced.internode_m, longest_m))
    return replace(growth, internode_m=internode_m, max_kill_m=max(_USED_SPACINGS * spacing_m, _USED * internode_m))


def _spacing_m(traced: TracedBranches, plant: PlantCloud) -> float:
    """Between the points of the cloud as it was read; branches may be traced through fewer."""
    return point_spacing(plant.source.points_m) or traced.spacing_m


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

    Raises:
        IncompleteGrowthError: A plant does not grow to enough of the points, and no internode was asked for.
    """
    remarks: list[Remark] = []
    growth = growth_settings(traced, species)
    if request.method == GROW:
        grown, internode_m = _grow_through(traced, plant, growth, request, seed, progress)
        traced = replace(traced, skeleton=grown.skeleton, internode_m=internode_m)
        text = f"branches are grown from the roots through the cloud in {grown.cycles} cycles"
        remarks.append(remark("branches-grown", _with_shares(grown, text)))
        remarks.extend(check_growth(float(grown.reached.mean()), internode_m))
    if request.fill == "on" or (request.fill == "auto" and not traced.knows_leaves):
        rest = _fill_rest(traced, plant, growth, request, seed, progress)
        before_m = traced.skeleton.lengths_m
        longer = int((rest.skeleton.lengths_m[: len(before_m)] > (1 + _LONGER) * before_m).sum())
        traced = replace(traced, skeleton=rest.skeleton)
        if rest.grown or longer:
            text = (
                f"{rest.grown:,} branches are grown into what others leave of the cloud, and {longer:,} grow on into it"
            )
            remarks.append(remark("rest-grown", _with_shares(rest, text)))
        elif rest.cycles:
            text = f"no branch comes to the {100 * (1 - rest.reached.mean()):.1f} % of the points that branches leave"
            remarks.append(remark("rest-out-of-reach", text))
        elif request.fill == "on":
            text = "branches leave nothing of the cloud: none is grown into it"
            remarks.append(remark("nothing-left", text))
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Variation:
    """A plant like another."""

    traced: TracedBranches
    seed: int
    reached: float  # share of the points of its own envelope that its branches come to


def vary_branches(
    traced: TracedBranches, plant: PlantCloud, request: RegrowthRequest, species: Species, seed: int
) -> Variation:
    """A plant like the one that was traced, grown through its cloud as that is in an envelope of its own.

    What its cloud hides it fills as that does, where it is asked for. Where spread is 0 the envelope is the plant's.
    """
    growth = growth_settings(traced, species)
    through = settings_for_cloud(growth, traced, plant, request.internode_m)
    if request.variation_spread > 0:
        # Traced through points far apart stems zigzag; those of a plant that is grown do not.
        fair = fair_stems(traced.skeleton, request.settings.fair * through.internode_m)
        traced = replace(traced, skeleton=fair)
    envelope = draw_envelope(request.settings.envelope, request.variation_spread, seed)
    thick_m = request.settings.thick * through.internode_m
    seen, cloud = vary_cloud(traced, plant, envelope, request, seed, thick_m)
    varied = vary_growth(_scaled(through, envelope.size), request.settings.variation, seed)
    stems = None
    if request.variation_spread > 0:
        stems = thick_stems(seen.skeleton, envelope.size * request.settings.stems * through.internode_m)
    near_m = envelope.size * _REACHED_SPACINGS * _spacing_m(traced, plant)
    grown, internode_m = _grow_well(seen, cloud, varied, request, seed, None, near_m, stems)
    variation = replace(seen, skeleton=grown.skeleton, internode_m=internode_m)
    if request.hidden:
        varied = vary_growth(_scaled(growth, envelope.size), request.settings.variation, seed)
        variation = replace(variation, skeleton=_fill(variation, cloud, varied, request, seed, None).skeleton)
    return Variation(traced=variation, seed=seed, reached=float(grown.reached.mean()))


def vary_cloud(
    traced: TracedBranches,
    plant: PlantCloud,
    envelope: Envelope,
    request: RegrowthRequest,
    seed: int,
    thick_m: float,
) -> tuple[TracedBranches, PlantCloud]:
    """Traced branches and their cloud, with limbs elsewhere, in another envelope; as they are where spread is 0.

    The bark of stems at least thick_m in radius is on their axes before, from which it would part otherwise.
    """
    spread, settings = request.variation_spread, request.settings
    if spread == 0:
        return traced, plant
    points_m = draw_to_axes(plant.points_m, traced.skeleton, thick_m)
    skeleton, points_m = move_limbs(traced.skeleton, points_m, settings.limbs, spread, seed)
    place = measure_tree_place(plant.points_m, plant.roots_m)
    cloud = replace(
        plant,
        points_m=warp_points(points_m, place, envelope),
        colors=None,
        roots_m=warp_points(plant.roots_m, place, envelope),
    )
    seen = replace(
        traced, skeleton=warp_skeleton(skeleton, place, envelope), spacing_m=envelope.size * traced.spacing_m
    )
    return seen, cloud


def _scaled(growth: GrowthSettings, factor: float) -> GrowthSettings:
    """The parameters of a plant so many times as large."""
    return replace(
        growth,
        internode_m=factor * growth.internode_m,
        max_kill_m=factor * growth.max_kill_m,
        max_gap_m=factor * growth.max_gap_m,
    )


def _grow_through(
    traced: TracedBranches,
    plant: PlantCloud,
    growth: GrowthSettings,
    request: RegrowthRequest,
    seed: int,
    progress: Callable[[float], None] | None,
) -> tuple[GrownBranches, float]:
    """A plant that grows to enough of the points, with the shortest internodes with which one does; these in metres."""
    finest = settings_for_cloud(growth, traced, plant, request.internode_m)
    near_m = _REACHED_SPACINGS * _spacing_m(traced, plant)
    grown, internode_m = _grow_well(traced, plant, finest, request, seed, progress, near_m)
    if request.internode_m is None and grown.reached.mean() < REACHED:
        raise _explain_incomplete(grown, plant, finest.max_gap_m)
    return grown, internode_m


def _grow_well(
    traced: TracedBranches,
    plant: PlantCloud,
    finest: GrowthSettings,
    request: RegrowthRequest,
    seed: int,
    progress: Callable[[float], None] | None,
    near_m: float,
    stems: Skeleton | None = None,
) -> tuple[GrownBranches, float]:
    """The plant that comes to enough of the points with the shortest internodes, or to the most; these in metres.

    It grows from the stems, or from its roots where there are none.
    """
    best: tuple[GrownBranches, float] | None = None
    for times in _TRIES if request.internode_m is None else _TRIES[:1]:
        internode_m = times * finest.internode_m
        max_kill_m = max(finest.max_kill_m, _USED * internode_m)
        tried = replace(finest, internode_m=internode_m, max_kill_m=max_kill_m)
        if stems is None:
            grown = _regrow(traced, plant, tried, request, seed, progress, near_m)
        else:
            grown = _grow_from(stems, plant, tried, near_m, request, seed)
        if best is None or grown.reached.mean() > best[0].reached.mean():
            best = grown, internode_m
        if grown.reached.mean() >= REACHED:
            break
    assert best is not None
    return best


def _grow_from(
    stems: Skeleton, plant: PlantCloud, growth: GrowthSettings, near_m: float, request: RegrowthRequest, seed: int
) -> GrownBranches:
    """Stems with what grows on them into the rest of the cloud."""
    # To what is nearer than a stub no branch grows that stays.
    own_m = max(near_m, growth.stub * growth.internode_m)
    grown = fill_rest(stems, plant.points_m, own_m, growth, request.settings, seed, keeps=False)
    reached_m = max(near_m, min(growth.max_kill * growth.internode_m, growth.max_kill_m))
    return replace(
        grown,
        reached=near_surface(plant.points_m, grown.skeleton, reached_m),
    )


def _explain_incomplete(grown: GrownBranches, plant: PlantCloud, max_gap_m: float) -> IncompleteGrowthError:
    """What growth did not come to, and what to do."""
    missed_m = plant.points_m[~grown.reached]
    gap_m = float(np.min(cKDTree(grown.skeleton.points_m).query(missed_m, workers=-1)[0]))
    crosses = f", and it crosses gaps of {max_gap_m:.2f} m" if gap_m > max_gap_m else ""
    return IncompleteGrowthError(
        f"growth came to {100 * grown.reached.mean():.0f} % of the points of {plant.source.path}, "
        f"{100 * REACHED:.0f} % needed; the nearest of the others is {gap_m:.2f} m from its branches{crosses}",
        (
            "give ",
            Setting(name="branches.roots"),
            " where stems are, or ",
            Setting(name="branches.internode_m"),
            " to accept what growth comes to, or trace the branches",
        ),
    )


def _regrow(
    traced: TracedBranches,
    plant: PlantCloud,
    growth: GrowthSettings,
    request: RegrowthRequest,
    seed: int,
    progress: Callable[[float], None] | None,
    near_m: float,
) -> GrownBranches:
    radius_m = float(traced.skeleton.radius_m[0])
    return regrow(
        plant.points_m,
        plant.roots_m,
        radius_m,
        growth,
        request.settings,
        seed,
        progress,
        traced.skeleton,
        near_m,
    )


def _fill_rest(
    traced: TracedBranches,
    plant: PlantCloud,
    growth: GrowthSettings,
    request: RegrowthRequest,
    seed: int,
    progress: Callable[[float], None] | None,
) -> GrownBranches:
    own = settings_for_cloud(growth, traced, plant, request.internode_m)
    near_m = _REACHED_SPACINGS * _spacing_m(traced, plant)
    min_left = _LEAVES_OUT if request.fill == "auto" else 0.0
    return fill_rest(traced.skeleton, plant.points_m, near_m, own, request.settings, seed, progress, min_left)


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
