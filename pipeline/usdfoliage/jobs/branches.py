"""From a cloud on disk to an asset of branches."""

import argparse
import hashlib
import logging
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.branch_package import BranchAssetSettings, BranchSurfaces, write_branch_asset
from usdfoliage.asset.branches import SkeletonPrim
from usdfoliage.asset.plant import asset_name
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import publish_folder
from usdfoliage.branch.cage import BranchCage, BranchCageSettings, build_branch_cage
from usdfoliage.branch.ground import find_ground
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.reconstruct import BranchSettings, TracedBranches, reconstruct_branches
from usdfoliage.branch.roots import RootSettings, find_roots
from usdfoliage.capture.cloud_input import CloudInput, CloudInputSettings, read_cloud_input
from usdfoliage.capture.cloud_thinning import PointThinner
from usdfoliage.capture.cloud_up import axis_vector, find_cloud_up, turn_to_y_up
from usdfoliage.errors import FitError, FoliageError
from usdfoliage.jobs.branches_report import BranchesReport, branch_rows, write_branches_report
from usdfoliage.jobs.crown_report import Row
from usdfoliage.steps import StepProgress, follow_step

logger = logging.getLogger(__name__)

LEAST_POINTS = 50  # of a plant without its ground
_COARSER_ORDERS = (1, 2)  # variants of the surface
_CAGE = BranchCageSettings(axis_tolerance=0.1, longest_row=40.0)  # bends are those of points that were measured


@dataclass(frozen=True, kw_only=True)
class BranchesRequest:
    """What the user asked for, checked."""

    cloud: Path
    output: Path
    name: str
    settings: BranchSettings
    roots: RootSettings
    given_roots: Sequence[tuple[float, float, float]] = ()  # in the cloud's own coordinates
    up: str | None = None  # an axis of the cloud; None: told by the cloud
    metres_per_unit: float | None = None
    most_points: int = 400_000  # that branches are traced through
    species: str = ""
    seed: int = 0
    preview: bool = True
    force: bool = False

    @classmethod
    def from_options(cls, options: argparse.Namespace) -> "BranchesRequest":
        """The request that a command line makes; FoliageError for values that cannot be."""
        roots, given = read_roots(options.roots)
        if options.most_points < LEAST_POINTS:
            raise FoliageError(f"--most-points must be at least {LEAST_POINTS}, not {options.most_points}")
        try:
            settings = BranchSettings(internode_m=options.internode, leaves=options.cloud_leaves)
        except ValueError as error:
            raise FoliageError(f"--internode: {error}") from error
        return cls(
            cloud=options.cloud,
            output=options.output,
            name=asset_name(options.name or options.output.resolve().name),
            settings=settings,
            roots=roots,
            given_roots=given,
            up=read_up(options.up),
            metres_per_unit=read_unit(options.unit),
            most_points=options.most_points,
            species=options.species,
            seed=options.seed,
            preview=not options.no_preview,
            force=options.force,
        )


def read_roots(text: str) -> tuple[RootSettings, tuple[tuple[float, float, float], ...]]:
    """auto, a number of roots, or the places of some, in the cloud's coordinates: x,y,z or x,y,z;x,y,z.

    Raises:
        FoliageError: It is none of these.
    """
    if text == "auto":
        return RootSettings(), ()
    try:
        if re.fullmatch(r"\s*\d+\s*", text):
            return RootSettings(count=int(text)), ()
        places = tuple(tuple(float(part) for part in place.split(",")) for place in text.split(";"))
    except ValueError as error:
        raise FoliageError(f"--roots must be auto, a number above 0, or x,y,z, not {text!r}") from error
    if not all(len(place) == 3 and np.isfinite(place).all() for place in places):
        raise FoliageError(f"--roots must be auto, a number above 0, or x,y,z, not {text!r}")
    return RootSettings(count=len(places)), tuple((place[0], place[1], place[2]) for place in places)


def read_up(text: str) -> str | None:
    """An axis, or None for auto; FoliageError for anything else."""
    if text == "auto":
        return None
    if not re.fullmatch(r"[+-]?[XYZxyz]", text):
        raise FoliageError(f"--up must be auto or one of X, Y, Z, -X, -Y and -Z, not {text!r}")
    return text.upper()


_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}


def read_unit(text: str) -> float | None:
    """Metres in a unit, or None for auto; FoliageError for one that is not known."""
    if text == "auto":
        return None
    if text not in _UNITS:
        raise FoliageError(f"--unit must be auto or one of {', '.join(_UNITS)}, not {text!r}")
    return _UNITS[text]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantCloud:
    """A cloud as branches are traced through it."""

    points_m: NDArray[np.float64]  # (N, 3), Y up, the first root at the origin, without ground
    roots_m: NDArray[np.float64]  # (R, 3)
    asset_from_cloud: NDArray[np.float64]  # (4, 4), from the file's coordinates
    source: CloudInput
    ground: int  # points that were left out as ground
    notes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class MadeBranches:
    """What was written, and what the user should know of it."""

    asset: Path
    report: Path
    notes: tuple[str, ...]
    measures: tuple[Row, ...]
    seconds: dict[str, float]


def read_plant_cloud(request: BranchesRequest, progress: StepProgress | None = None) -> PlantCloud:
    """Read a cloud, turn it upright, leave out its ground and find the roots.

    Raises:
        CaptureError: The cloud cannot be used.
        FitError: Nothing is left without the ground.
    """
    source = read_cloud_input(
        request.cloud,
        CloudInputSettings(metres_per_unit=request.metres_per_unit),
        (lambda done, total: progress("read", done / max(total, 1))) if progress else None,
    )
    notes = list(source.notes)
    if request.up is not None:
        axis = axis_vector(request.up)
    else:
        up = find_cloud_up(source.points_m, source.stated_up, source.usual_up)
        axis = up.axis
        notes.append(up.how if up.sure else f"{up.how}; say it with --up if that is wrong")
    turn = turn_to_y_up(axis)
    points_m = source.points_m @ turn.T
    if len(points_m) > request.most_points:
        thinner = PointThinner(request.most_points)
        thinner.add(points_m, None)
        thinned = thinner.finish()
        points_m = thinned.points
        notes.append(f"branches are traced through {len(points_m):,} points, one in {1000 * thinned.cell:.1f} mm")
    ground = find_ground(points_m)
    if ground.points.any():
        notes.append(f"{int(ground.points.sum()):,} points are ground and left out")
    points_m = points_m[~ground.points]
    if len(points_m) < LEAST_POINTS:
        raise FitError(f"{len(points_m)} points are left without the ground, {LEAST_POINTS} needed ({source.path})")
    if request.given_roots:
        given = np.array(request.given_roots) * source.metres_per_unit - source.origin_m
        roots_m = given @ turn.T
    else:
        roots_m = find_roots(points_m, request.roots)
        if request.roots.count is not None and len(roots_m) < request.roots.count:
            notes.append(f"{len(roots_m)} of {request.roots.count} roots were found")
    asset_from_cloud = np.eye(4)
    asset_from_cloud[:3, :3] = turn * source.metres_per_unit
    asset_from_cloud[:3, 3] = -turn @ source.origin_m - roots_m[0]
    return PlantCloud(
        points_m=points_m - roots_m[0],
        roots_m=roots_m - roots_m[0],
        asset_from_cloud=asset_from_cloud,
        source=source,
        ground=int(ground.points.sum()),
        notes=tuple(notes),
    )


def make_branches_asset(request: BranchesRequest, progress: StepProgress | None = None) -> MadeBranches:
    """Trace the branches of a cloud and publish their asset; the old asset stays until the new one is whole.

    Raises:
        FoliageError: The input is unusable, or the output cannot be written; nothing was changed.
    """
    seconds: dict[str, float] = {}
    with publish_folder(request.output, force=request.force) as folder:
        start = time.perf_counter()
        plant = read_plant_cloud(request, progress)
        seconds["read"] = time.perf_counter() - start
        with follow_step("branches", seconds, progress) as tell:
            traced = reconstruct_branches(
                plant.points_m,
                plant.roots_m,
                request.settings,
                lambda name, share: tell(round(1000 * share), 1000),
            )
        if not len(traced.skeleton):
            raise FitError(f"no branch was found in {len(plant.points_m):,} points ({plant.source.path})")
        notes = [*plant.notes, *describe_leaves(traced, request.settings)]
        wood_m = plant.points_m[traced.wood]
        with follow_step("surface", seconds, progress):
            surfaces, dropped = build_surfaces(traced.skeleton)
            notes.extend(dropped)
        with follow_step("asset", seconds, progress):
            provenance = Provenance(
                species=request.species,
                capture=plant.source.path.name,
                generator=f"usdfoliage {__version__}",
                seed=request.seed,
                settings=describe_settings(request),
                input_sha256=hashlib.sha256(plant.source.path.read_bytes()).hexdigest(),
            )
            interface = write_branch_asset(
                folder,
                request.name,
                SkeletonPrim(skeleton=traced.skeleton, growth=growth_of(traced)),
                surfaces,
                provenance,
                plant.asset_from_cloud,
                BranchAssetSettings(),
            )
        report = BranchesReport(
            name=request.name,
            capture=plant.source.path.name,
            generator=provenance.generator,
            notes=notes,
            settings=provenance.settings,
            preview=request.preview,
        )
        (folder / "report").mkdir(exist_ok=True)
        rows = branch_rows(traced, surfaces.whole, wood_m)
        write_branches_report(folder / "report", interface, report, traced, wood_m, rows, seconds, progress)
    return MadeBranches(
        asset=request.output / interface.name,
        report=request.output / "report" / "index.html",
        notes=tuple(notes),
        measures=tuple(rows),
        seconds=seconds,
    )


def build_surfaces(skeleton: Skeleton) -> tuple[BranchSurfaces, list[str]]:
    """The surface of all branches and those of the lower orders, and what is not in it."""
    whole = build_branch_cage(skeleton, _CAGE)
    highest = int(skeleton.order.max())
    coarser: list[tuple[int, BranchCage]] = [
        (order, build_branch_cage(skeleton.up_to_order(order), _CAGE)) for order in _COARSER_ORDERS if order < highest
    ]
    notes = []
    reasons: dict[str, int] = {}
    for lost in whole.dropped:
        reasons[lost.why] = reasons.get(lost.why, 0) + 1
    if reasons:
        told = ", ".join(f"{count} {reason}" for reason, count in sorted(reasons.items(), key=lambda each: -each[1]))
        notes.append(f"{sum(reasons.values())} of {len(skeleton)} branches are in the skeleton alone: {told}")
    return BranchSurfaces(whole=whole, by_order=tuple(coarser)), notes


def describe_leaves(traced: TracedBranches, settings: BranchSettings) -> list[str]:
    """What the user should know of the cloud's leaves."""
    share = float(1 - traced.wood.mean())
    if share > 0:
        return [
            f"the cloud has leaves: {100 * share:.0f} % of its points are leaves and left out; "
            "say --cloud-leaves off if that is wrong"
        ]
    if settings.leaves == "auto" and not traced.knows_leaves:
        return [
            f"points are {1000 * traced.spacing_m:.0f} mm from their sixth neighbour, too far to tell leaves from "
            "wood: all are taken for wood; say --cloud-leaves on if the plant has leaves"
        ]
    return []


def growth_of(traced: TracedBranches) -> dict[str, float]:
    """What of the growth parameters was measured."""
    return {"internodeLength": traced.internode_m, "rootDiameter": float(2 * traced.skeleton.radius_m[0])}


def describe_settings(request: BranchesRequest) -> dict[str, str]:
    """Every setting that decides the result, by the name of its option."""
    roots = ";".join(",".join(f"{c:g}" for c in place) for place in request.given_roots)
    return {
        "roots": roots or str(request.roots.count or "auto"),
        "up": request.up or "auto",
        "internode": "auto" if request.settings.internode_m is None else f"{request.settings.internode_m:g}",
        "cloud-leaves": request.settings.leaves,
        "most-points": str(request.most_points),
        "seed": str(request.seed),
    }


def plan_branches_asset(request: BranchesRequest) -> str:
    """What make_branches_asset would do, in lines, after reading the cloud; writes nothing."""
    plant = read_plant_cloud(replace(request, preview=False))
    height_m = float(np.ptp(plant.points_m[:, 1]))
    lines = [
        f"cloud: {plant.source.path}, {plant.source.total:,} points; {len(plant.points_m):,} of the plant, "
        f"{height_m:.2f} m high",
        f"roots: {len(plant.roots_m)}",
        *(f"note: {note}" for note in plant.notes),
        f"settings: {', '.join(f'{name} {value}' for name, value in describe_settings(request).items())}",
        f"would {'replace' if request.output.exists() else 'write'}: {request.output / f'{request.name}.usda'}",
    ]
    return "\n".join(lines)
