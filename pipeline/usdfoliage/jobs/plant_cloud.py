"""The cloud of a plant, as its branches are traced through it: upright, in metres, without ground, with its roots."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.tracing.cloud_cut import point_spacing
from usdfoliage.branch.tracing.ground import Ground, find_ground, no_ground
from usdfoliage.branch.tracing.noise_points import find_noise_points
from usdfoliage.branch.tracing.other_trees import find_other_trees
from usdfoliage.branch.tracing.outliers import find_ground_remains, find_outliers
from usdfoliage.branch.tracing.roots import RootSettings, find_roots
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.capture.cloud_files.read import CloudInput, CloudInputSettings, read_cloud_input
from usdfoliage.capture.cloud_files.thinning import PointThinner
from usdfoliage.capture.cloud_files.units import UNITS
from usdfoliage.capture.cloud_files.up_axis import find_cloud_up
from usdfoliage.errors import FitError, FoliageError
from usdfoliage.geometry.point_cells import cell_means, number_cells
from usdfoliage.geometry.up_turn import axis_vector, turn_to_y_up
from usdfoliage.jobs.no_plant import check_plant
from usdfoliage.progress import StepProgress, progress_in_step
from usdfoliage.remarks import Remark, Remedy, Setting, remark

MIN_POINTS = 50  # of a plant without its ground
_PLANT_M = (0.05, 130.0)  # height of a plant: below it seedlings, above it none
_CLOSEST = 0.3  # internodes: points closer together take time and show nothing more
_WORTH = 0.67  # share of the points that is left, above which a cloud stays as it is


@dataclass(frozen=True, kw_only=True)
class PlantCloudRequest:
    """Which cloud, and what the user knows of it."""

    path: Path
    roots: RootSettings
    given_roots: Sequence[tuple[float, float, float]] = ()  # in the cloud's own coordinates
    up: str | None = None  # an axis of the cloud; None: estimated from the cloud
    unit: str | None = None  # of UNITS; None: read from the file
    max_points: int = 400_000  # that branches are traced through
    internode_m: float | None = None  # None: from the height, as branches are traced
    has_ground: bool = True  # False: it was left out before, and what lies low is of the plant
    must_be_plant: bool = False  # refuse what is surely none, unless roots are given

    def describe(self) -> dict[str, str]:
        """Settings by the names of their options."""
        roots = ";".join(",".join(f"{c:.12g}" for c in place) for place in self.given_roots)
        return {
            "roots": roots or str(self.roots.count or "auto"),
            "up": self.up or "auto",
            "unit": self.unit or "auto",
            "most-points": str(self.max_points),
        }


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
        raise FoliageError(f"roots must be auto, a number above 0, or x,y,z, not {text!r}") from error
    if not all(len(place) == 3 and np.isfinite(place).all() for place in places):
        raise FoliageError(f"roots must be auto, a number above 0, or x,y,z, not {text!r}")
    return RootSettings(count=len(places)), tuple((place[0], place[1], place[2]) for place in places)


def read_up(text: str) -> str | None:
    """An axis, or None for auto; FoliageError for anything else."""
    if text == "auto":
        return None
    if not re.fullmatch(r"[+-]?[XYZxyz]", text):
        raise FoliageError(f"up must be auto or one of X, Y, Z, -X, -Y and -Z, not {text!r}")
    return text.upper()


def read_unit(text: str) -> str | None:
    """A unit, or None for auto; FoliageError for one that is not known."""
    if text == "auto":
        return None
    if text not in UNITS:
        raise FoliageError(f"unit must be auto or one of {', '.join(UNITS)}, not {text!r}")
    return text


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantCloud:
    """A cloud as branches are traced through it."""

    points_m: NDArray[np.float64]  # (N, 3), Y up, the first root at the origin, without ground
    colors: NDArray[np.float64] | None  # (N, 3), red, green, blue, 0 to 255, black: none; None where the file has none
    roots_m: NDArray[np.float64]  # (R, 3)
    asset_from_cloud: NDArray[np.float64]  # (4, 4), from the file's coordinates
    source: CloudInput
    ground: int  # points that were left out as ground
    remarks: tuple[Remark, ...]


def read_plant_cloud(request: PlantCloudRequest, progress: StepProgress | None = None) -> PlantCloud:
    """Read a cloud, turn it upright, leave out its ground and find the roots.

    Raises:
        CaptureError: The cloud cannot be used.
        FitError: Nothing is left without the ground, or a root is given that is nowhere near the plant.
        NoPlantError: The cloud must be of a plant, and surely is of none.
    """
    source = read_cloud_input(
        request.path,
        CloudInputSettings(metres_per_unit=None if request.unit is None else UNITS[request.unit]),
        progress_in_step("read", progress),
    )
    remarks = list(source.remarks)
    noise = find_noise_points(source.points_m)
    if noise.any():
        share = f"{int(noise.sum()):,} points ({100 * noise.mean():.0f} %)"
        text = f"{share} are strewn all over the box of the cloud, and left out as noise"
        remarks.append(remark("noise-left-out", text))
        kept_colors = None if source.colors is None else source.colors[~noise]
        source = replace(source, points_m=source.points_m[~noise], colors=kept_colors)
    if request.up is not None:
        axis = axis_vector(request.up)
    elif source.stated_vector is not None:
        axis = source.stated_vector
        text = f"up is the direction ({', '.join(f'{number:.3f}' for number in axis)}) that capture.toml states"
        remarks.append(remark("cloud-up", text))
    else:
        up = find_cloud_up(source.points_m, source.stated_up, source.format_up)
        axis = up.axis
        is_stated = up.sure and source.stated_up is not None  # what is found is wrong for some plants, however clear
        remedy: Remedy = () if is_stated else ("give ", Setting(name="capture.toml:up_axis"), " if that is wrong")
        if up.rare:
            remarks.append(remark("cloud-up-unusual", up.how, remedy=remedy))
        else:
            remarks.append(remark("cloud-up", up.how, remedy=remedy))
    turn = turn_to_y_up(axis)
    points_m = source.points_m @ turn.T
    ground = find_plant_ground(points_m) if request.has_ground else PlantGround(ground=no_ground(points_m))
    remarks += ground.remarks
    points_m = points_m[~ground.ground.points]
    colors = None if source.colors is None else source.colors[~ground.ground.points].astype(np.float64)
    outliers = find_outliers(points_m)
    if outliers.any():
        text = f"{int(outliers.sum()):,} points are far beside the plant and left out"
        remarks.append(remark("outliers-left-out", text))
        points_m = points_m[~outliers]
        colors = None if colors is None else colors[~outliers]
    _check_internode(points_m, request)
    close = len(points_m)
    points_m, colors, cell_m = _thin_plant(points_m, colors, request)
    if cell_m > 0:
        text = f"branches are traced through {len(points_m):,} points, one in {1000 * cell_m:.1f} mm"
        remarks.append(remark("cloud-thinned", text))
    if len(points_m) < MIN_POINTS:
        raise _explain_few(len(points_m), close, source, axis, request)
    if request.given_roots:
        given = np.array(request.given_roots) * source.metres_per_unit - source.origin_m
        roots_m = given @ turn.T
        _check_roots(roots_m, points_m, request)
        other = find_other_trees(
            points_m, roots_m, find_roots(points_m, ground=ground.ground.plane), point_spacing(points_m)
        )
        if other.any():
            text = f"{int(other.sum()):,} points are of other trees than that at the given root and left out"
            remarks.append(remark("other-trees-left-out", text))
            points_m = points_m[~other]
            colors = None if colors is None else colors[~other]
    else:
        roots_m = find_roots(points_m, request.roots, ground.ground.plane)
        if request.roots.count is not None and len(roots_m) < request.roots.count:
            remarks.append(remark("roots-missing", f"{len(roots_m)} of {request.roots.count} roots were found"))
        if request.must_be_plant:
            check_plant(points_m, roots_m, source.path)
    asset_from_cloud = np.eye(4)
    asset_from_cloud[:3, :3] = turn * source.metres_per_unit
    asset_from_cloud[:3, 3] = -turn @ source.origin_m - roots_m[0]
    return PlantCloud(
        points_m=points_m - roots_m[0],
        colors=colors,
        roots_m=roots_m - roots_m[0],
        asset_from_cloud=asset_from_cloud,
        source=source,
        ground=ground.in_plane,
        remarks=(*remarks, *check_height(float(np.ptp(points_m[:, 1])), source.metres_per_unit)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantGround:
    """The ground of a plant's cloud, what remains of it beside the plant among its points."""

    ground: Ground
    in_plane: int = 0  # of its points, those in its plane
    remarks: tuple[Remark, ...] = ()


def find_plant_ground(points_m: NDArray[np.float64]) -> PlantGround:
    """The ground of a cloud (N, 3), Y up, and remarks on what is left out with it."""
    ground = find_ground(points_m)
    in_plane = int(np.count_nonzero(ground.points))
    if not in_plane or ground.plane is None:
        return PlantGround(ground=ground)
    remarks = [remark("ground-left-out", f"{in_plane:,} points are ground and left out")]
    left = np.flatnonzero(~ground.points)
    remains = left[find_ground_remains(points_m[left], ground.plane)]
    if len(remains):
        text = f"{len(remains):,} points low and far beside the plant are ground too and left out"
        remarks.append(remark("ground-left-out", text))
    points = ground.points.copy()
    points[remains] = True
    return PlantGround(ground=replace(ground, points=points), in_plane=in_plane, remarks=tuple(remarks))


def _explain_few(
    left: int, close: int, source: CloudInput, axis: NDArray[np.float64], request: PlantCloudRequest
) -> FitError:
    """Why fewer points of a plant are left than can be traced, and what to do; close were left before thinning."""
    if close >= MIN_POINTS and request.internode_m is not None:
        described = f"an internode of {request.internode_m:g} m leaves {left} points of the plant, {MIN_POINTS} needed"
        return FitError(described, ("give a shorter ", Setting(name="branches.internode_m")))
    described = f"{left} points are left without the ground, {MIN_POINTS} needed ({source.path})"
    if check_height(float(np.ptp(source.points_m, axis=0).max()), source.metres_per_unit):
        for warning in check_height(float(np.ptp(source.points_m @ axis)), source.metres_per_unit):
            return FitError(f"{described}; {warning.text}", warning.remedy)
        return FitError(described)
    remedy = ("give a cloud of a plant, and ", Setting(name="capture.toml:up_axis"), " if another of its axes is up")
    return FitError(described, remedy)


def check_height(height_m: float, metres_per_unit: float) -> list[Remark]:
    """A warning where a cloud's plant is of no plant's height, with the units that give one.

    Args:
        height_m: Of the plant.
        metres_per_unit: The unit that the height was taken by.
    """
    min_m, max_m = _PLANT_M
    if min_m <= height_m <= max_m:
        return []
    heights_m = {name: height_m / metres_per_unit * size for name, size in UNITS.items()}
    likely = {name: own_m for name, own_m in heights_m.items() if min_m <= own_m <= max_m}
    remedy: Remedy = ("look at the cloud's unit",)
    if likely:
        units = [
            (Setting(name="capture.toml:metres_per_unit", value=f"{UNITS[name]:g}"), f" ({own_m:.3g} m high)")
            for name, own_m in likely.items()
        ]
        others = (part for unit in units[1:] for part in (" or ", *unit))
        remedy = ("its unit is probably another one; give ", *units[0], *others)
    height = f"{1000 * height_m:.3g} mm" if height_m < min_m else f"{height_m:,.0f} m"
    text = f"the plant is {height} high, {'lower' if height_m < min_m else 'higher'} than plants are"
    return [remark("plant-height-improbable", text, remedy=remedy)]


def _check_internode(points_m: NDArray[np.float64], request: PlantCloudRequest) -> None:
    """FitError where an internode is given that is longer than the plant is high: in another unit than metres."""
    height_m = float(np.ptp(points_m[:, 1])) if len(points_m) else 0.0
    if request.internode_m is not None and len(points_m) >= MIN_POINTS and request.internode_m > height_m:
        raise FitError(
            f"an internode of {request.internode_m:g} m is longer than the plant, which is {height_m:.2f} m high",
            ("give ", Setting(name="branches.internode_m"), " in metres"),
        )


def _thin_plant(
    points_m: NDArray[np.float64], colors: NDArray[np.float64] | None, request: PlantCloudRequest
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, float]:
    """As many points of the plant, without ground that would take their share, as show its twigs; side of their cells.

    A side of 0: all of them, as they were.
    """
    values = points_m
    if colors is not None:  # black is no colour, and none of what is mixed of several
        values = np.column_stack([points_m, colors, colors.any(axis=1)])
    cell_m = 0.0
    if len(points_m):
        internode_m = request.internode_m or BranchSettings().internode_of_height * float(np.ptp(points_m[:, 1]))
        if _CLOSEST * internode_m > 0:
            cell = number_cells(points_m, _CLOSEST * internode_m)
            if int(cell.max()) + 1 < _WORTH * len(points_m):
                cell_m = _CLOSEST * internode_m
                values = cell_means(values, cell)
                values[:, 3:6] /= np.where(values[:, 6:] > 0, values[:, 6:], 1)
    if len(values) > request.max_points:
        thinner = PointThinner(request.max_points)
        thinner.add(values[:, :3], None if colors is None else values[:, 3:6].astype(np.float32))
        thinned = thinner.finish()
        cell_m = thinned.cell
        values = thinned.points if thinned.colors is None else np.column_stack([thinned.points, thinned.colors])
    return values[:, :3], None if colors is None else values[:, 3:6], cell_m


def _check_roots(roots_m: NDArray[np.float64], points_m: NDArray[np.float64], request: PlantCloudRequest) -> None:
    """FitError for a root (R, 3) that is farther from points (N, 3) than these are high: of another unit or cloud."""
    away_m = np.asarray(cKDTree(points_m).query(roots_m)[0])
    for place, own_m in zip(request.given_roots, away_m.tolist(), strict=True):
        if own_m > np.ptp(points_m[:, 1]):
            described = ",".join(f"{c:.12g}" for c in place)
            raise FitError(
                f"the root {described} is {own_m:.1f} m from the nearest point of {request.path}",
                ("give ", Setting(name="branches.roots"), " in the cloud's own coordinates"),
            )
