"""Tracing the branches of a cloud on disk, finely first; where that shows no stems, coarsely."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from usdfoliage.branch.tracing.free_axes import keep_free_branches, points_of_branches
from usdfoliage.branch.tracing.higher_feet import stands_on_stem
from usdfoliage.branch.tracing.radii import Radii
from usdfoliage.branch.tracing.reconstruct import TracedBranches, reconstruct_branches
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.errors import FitError
from usdfoliage.jobs.branches.known_stems import KnownStems, describe_known_stems
from usdfoliage.jobs.branches.warnings import FEW_ROUND, check_stems
from usdfoliage.jobs.plant_cloud import PlantCloud, PlantCloudRequest, read_plant_cloud
from usdfoliage.progress import StepProgress, follow_step, progress_of_shares
from usdfoliage.remarks import Remark, remark

_COARSER = 3.0  # times the internode: a herb's leaves are larger for its height than a tree's, and so is their noise
_LESS_WOOD = 0.7  # for that of a fine trace, wood of a coarse one that shows how much of the former was leaves
_THICKEST = 0.95  # quantile of the radii that are believed: single circles are wrong
# Remarks on how a cloud is traced, which does not concern a plant whose stems were found otherwise: what looks like a
# trunk in the cloud alone, and through which points and from which roots branches were traced.
_OF_TRACE = frozenset({"cloud-up", "cloud-thinned", "roots-missing"})
_SURELY_ROUND = 0.15  # share of the circles: traced coarsely, more of the leaves look round than traced finely


class NoStemsError(FitError):
    """The cloud shows neither a stem at a root nor round branches, as of a hedge or a wall of leaves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedCloud:
    """The cloud of a plant, and its branches."""

    plant: PlantCloud
    traced: TracedBranches
    remarks: tuple[Remark, ...]
    stems: KnownStems | None = None  # that were taken in place of those of the cloud


FindStems = Callable[[float], KnownStems | None]


def trace_cloud(
    cloud: PlantCloudRequest,
    settings: BranchSettings,
    seconds: dict[str, float],
    progress: StepProgress | None = None,
    *,
    needs_stems: bool = False,
    find_stems: FindStems | None = None,
    grows: bool = False,
) -> TracedCloud:
    """Read a cloud and trace its branches.

    Where leaves are large for the plant and stems thin, as of a herb, fine slices of noisy leaves look like twigs, but
    hardly one of them is round. Coarser slices separate them.

    Args:
        cloud: Which.
        settings: How.
        seconds: What each step took is added.
        progress: Called at each step.
        needs_stems: Where hardly a branch is round trace more coarsely, and refuse what shows no stems then either;
            not where points are too far apart to show leaves, and nobody knows whether there are any.
        find_stems: Where few branches are round, called with the radius in metres of the thickest stem that the cloud
            shows: stems that it finds are taken instead.
        grows: Whether branches will grow through the cloud, so that no remark names it as a remedy.

    Raises:
        NoStemsError: The cloud shows no stems.
        FoliageError: The cloud cannot be used, or has no branches.
    """
    found = _trace(cloud, settings, seconds, progress)
    believed, stems = _roundness(found)
    warnings = check_stems(believed, stems, found.traced.internode_m, grows)
    # Of points too far apart to show leaves circles are hardly known, whatever the plant is.
    unknown = settings.leaves == "auto" and not found.traced.knows_leaves
    if not needs_stems or (find_stems is None and unknown):
        return replace(found, remarks=(*found.remarks, *warnings))
    hardly_round = bool(warnings) or (believed < FEW_ROUND and not found.traced.wood.all())
    known = None
    if find_stems is not None and (hardly_round or believed < _SURELY_ROUND):
        known = find_stems(_thickest_m(found))
    if known is not None:
        return _with_stems(found, known)
    if settings.internode_m is None and hardly_round:
        coarse_m = _COARSER * found.traced.internode_m
        coarse_cloud = replace(cloud, internode_m=coarse_m)
        coarse = _trace(coarse_cloud, replace(settings, internode_m=coarse_m), seconds, progress)
        believed, _ = _roundness(coarse)
        fewer = coarse.traced.wood.mean() < _LESS_WOOD * found.traced.wood.mean()
        if believed >= _SURELY_ROUND and (warnings or fewer):
            text = f"traced finely hardly a branch is round; traced {_COARSER:g} times as coarsely, {believed:.0%} are"
            return replace(coarse, remarks=(*coarse.remarks, remark("traced-coarsely", text)))
    if not warnings:
        return found
    free = keep_free_branches(found.plant.points_m, found.traced.skeleton)
    if free is None:
        raise NoStemsError(warnings[0].text)
    wood = points_of_branches(found.plant.points_m, free, found.traced.spacing_m)
    text = (
        f"hardly a branch is round: of {len(found.traced.skeleton):,} that were traced {len(free)}, which stand free, "
        "are kept; how thick they are is estimated"
    )
    kept = remark("free-branches-kept", text)
    return replace(found, traced=replace(found.traced, skeleton=free, wood=wood), remarks=(*found.remarks, kept))


def _with_stems(found: TracedCloud, stems: KnownStems) -> TracedCloud:
    """The cloud with stems that were found otherwise: its first root is where the first of these comes out."""
    plant, known = found.plant, stems.skeleton
    asset_from_own = plant.asset_from_cloud @ np.linalg.inv(stems.own_from_cloud)
    scale = float(np.cbrt(np.linalg.det(asset_from_own[:3, :3])))
    points_m = known.points_m @ asset_from_own[:3, :3].T + asset_from_own[:3, 3]
    roots_m = points_m[known.first[known.parent_curve < 0]]
    moved = np.eye(4)
    moved[:3, 3] = -roots_m[0]
    plant = replace(
        plant,
        points_m=plant.points_m - roots_m[0],
        roots_m=roots_m - roots_m[0],
        asset_from_cloud=moved @ plant.asset_from_cloud,
    )
    skeleton = replace(known, points_m=points_m - roots_m[0], radius_m=scale * known.radius_m)
    wood = points_of_branches(plant.points_m, skeleton, found.traced.spacing_m)
    traced = replace(
        found.traced,
        skeleton=skeleton,
        radii=Radii(
            radius_m=skeleton.radius_m,
            believed=np.ones(len(skeleton.radius_m), bool),
            exponent=found.traced.radii.exponent,
            noise_m=found.traced.spacing_m,
        ),
        pieces=len(roots_m),
        wood=wood,
        knows_leaves=True,
        found_otherwise=True,
    )
    asset_from_own = moved @ asset_from_own
    remarks = tuple(each for each in found.remarks if each.code not in _OF_TRACE)
    return TracedCloud(
        plant=plant,
        traced=traced,
        remarks=(*remarks, *describe_known_stems(stems, asset_from_own)),
        stems=stems,
    )


def _trace(
    cloud: PlantCloudRequest, settings: BranchSettings, seconds: dict[str, float], progress: StepProgress | None
) -> TracedCloud:
    own: dict[str, float] = {}
    with follow_step("read", own, None):
        plant = read_plant_cloud(cloud, progress)
    with follow_step("branches", own, progress) as report:
        traced = reconstruct_branches(
            plant.points_m,
            plant.roots_m,
            settings,
            progress_of_shares(report),
            plant.colors,
        )
    for step, took in own.items():
        seconds[step] = seconds.get(step, 0.0) + took
    if not len(traced.skeleton):
        raise FitError(f"no branch was found in {len(plant.points_m):,} points ({plant.source.path})")
    return TracedCloud(plant=plant, traced=traced, remarks=plant.remarks)


def _thickest_m(found: TracedCloud) -> float:
    """Radius of the thickest stem whose circles are believed; 0 where none is."""
    radii = found.traced.radii
    return float(np.quantile(radii.radius_m[radii.believed], _THICKEST)) if radii.believed.any() else 0.0


def _roundness(found: TracedCloud) -> tuple[float, float]:
    """Shares of the circles that are believed, and of the roots that have a stem."""
    stems = [stands_on_stem(found.plant.points_m, root_m) for root_m in found.plant.roots_m]
    return float(found.traced.radii.believed.mean()), float(np.mean(stems))
