"""Tracing the branches of a cloud on disk, finely first; where that shows no stems, coarsely."""

from dataclasses import dataclass, replace

import numpy as np

from usdfoliage.branch.tracing.free_axes import keep_free_branches, points_of_branches
from usdfoliage.branch.tracing.higher_feet import stands_on_stem
from usdfoliage.branch.tracing.reconstruct import BranchSettings, TracedBranches, reconstruct_branches
from usdfoliage.errors import FitError
from usdfoliage.jobs.branches.warnings import FEW_ROUND, check_stems
from usdfoliage.jobs.plant_cloud import PlantCloud, PlantCloudRequest, read_plant_cloud
from usdfoliage.progress import StepProgress, follow_step, progress_of_shares
from usdfoliage.remarks import Remark, remark

_COARSER = 3.0  # times the internode: a herb's leaves are larger for its height than a tree's, and so is their noise
_LESS_WOOD = 0.7  # for that of a fine trace, wood of a coarse one that shows how much of the former was leaves
_SURELY_ROUND = 0.15  # share of the circles: traced coarsely, more of the leaves look round than traced finely


class NoStemsError(FitError):
    """The cloud shows neither a stem at a root nor round branches, as of a hedge or a wall of leaves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedCloud:
    """The cloud of a plant, and its branches."""

    plant: PlantCloud
    traced: TracedBranches
    remarks: tuple[Remark, ...]


def trace_cloud(
    cloud: PlantCloudRequest,
    settings: BranchSettings,
    seconds: dict[str, float],
    progress: StepProgress | None = None,
    *,
    needs_stems: bool = False,
) -> TracedCloud:
    """Read a cloud and trace its branches.

    Where leaves are large for the plant and stems thin, as of a herb, fine slices of noisy leaves look like twigs, but
    hardly one of them is round. Coarser slices separate them.

    Args:
        cloud: Which.
        settings: How.
        seconds: What each step took is added.
        progress: Called at each step.
        needs_stems: Where hardly a branch is round trace more coarsely, and refuse what shows no stems then either.

    Raises:
        NoStemsError: The cloud shows no stems.
        FoliageError: The cloud cannot be used, or has no branches.
    """
    found = _trace(cloud, settings, seconds, progress)
    believed, stems = _roundness(found)
    warnings = check_stems(believed, stems, found.traced.internode_m)
    if not needs_stems:
        return replace(found, remarks=(*found.remarks, *warnings))
    if settings.internode_m is None and (warnings or (believed < FEW_ROUND and not found.traced.wood.all())):
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


def _roundness(found: TracedCloud) -> tuple[float, float]:
    """Shares of the circles that are believed, and of the roots that have a stem."""
    stems = [stands_on_stem(found.plant.points_m, root_m) for root_m in found.plant.roots_m]
    return float(found.traced.radii.believed.mean()), float(np.mean(stems))
