"""A crown from posed photographs and the cloud made of them, or from a cloud alone: the main jobs, on arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from usdfoliage.crown.captured_measures import (
    CapturedCrownMeasures,
    crown_volume,
    distance_from_points,
    draw_points,
    measure_view,
    point_spacing,
)
from usdfoliage.crown.color_map import ColorMapSettings
from usdfoliage.crown.crown_points import CrownCenter, CrownPointSettings, choose_crown_points, find_crown_center
from usdfoliage.crown.hull import HullSettings, fit_crown_hull
from usdfoliage.crown.model import CrownModel
from usdfoliage.crown.point_colors import gather_point_colors, shade_points
from usdfoliage.crown.seen_colors import SeenColorSettings, fill_unseen, gather_colors, stretch_colors
from usdfoliage.crown.texture import TextureSettings
from usdfoliage.crown.views import CrownView, ReducedView, reduce_view
from usdfoliage.errors import FitError
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.progress import Progress, StepProgress, follow_step
from usdfoliage.remarks import Remark, remark

CAPTURED_STEPS = ("points", "photographs", "hull", "colours", "texture", "measures")
CLOUD_STEPS = ("points", "hull", "colours", "measures")

MIN_SIZE, MAX_SIZE = 32, 4096  # texels a side, as for a crown of one photograph
_MAX_BYTES = 1 << 30  # of all reduced photographs together
_COVERED = 1.0  # distances to the sixth neighbour: what is between points closer than that is the plant as well
_PIXEL_BYTES = 9  # colour, depth, mask, sky
_MIN_KNOWN, _FEW_KNOWN = 0.1, 0.3  # share of the directions with points: refused below, and a warning
_AROUND, _AROUND_PX = 5.0, 256  # distance in reaches of the crown, and picture, of cameras that measure a cloud's


@dataclass(frozen=True, kw_only=True)
class CapturedCrownSettings:
    """Everything that decides what a crown of a capture becomes."""

    size: int = 256  # texels a side of a cubemap face
    seed: int = 0
    threads: int = 0  # 0: one per core; the result does not depend on it
    points: CrownPointSettings = field(default_factory=CrownPointSettings)
    hull: HullSettings = field(default_factory=HullSettings)

    def __post_init__(self) -> None:
        if not MIN_SIZE <= self.size <= MAX_SIZE:
            raise ValueError(f"the size must be from {MIN_SIZE} to {MAX_SIZE} texels, not {self.size}")
        if self.threads < 0:
            raise ValueError(f"threads must be 0, for all cores, or more, not {self.threads}")
        if not 0 <= self.seed < 2**63:  # an asset records it as int64
            raise ValueError(f"the seed must be 0 or positive and below 2^63, not {self.seed}")

    @property
    def colors(self) -> SeenColorSettings:
        return SeenColorSettings(color_map=ColorMapSettings(texture=TextureSettings(threads=self.threads)))


def reconstruct_captured_crown(
    points_m: NDArray[np.floating],
    views: Sequence[CrownView],
    settings: CapturedCrownSettings = CapturedCrownSettings(),
    *,
    foliage: NDArray[np.bool_] | None = None,
    asset_from_capture: NDArray[np.float64] | None = None,
    progress: StepProgress | None = None,
) -> tuple[CrownModel, CapturedCrownMeasures]:
    """Reconstruct a crown from the points of a plant and photographs around it.

    Photographs are read once, one at a time.

    Args:
        points_m: (N, 3), of the plant without ground, in the asset's frame: metres, Y up.
        views: Photographs with cameras in that frame.
        settings: What to make.
        foliage: (N,), which points are leaves; None: found from the plant's widths.
        asset_from_capture: (4, 4), kept in the model; the identity where None.
        progress: Called at each step.

    Raises:
        ValueError: Shapes do not fit each other, or points are not finite.
        FitError: Too few points, or no photograph shows the crown.
    """
    plant_m = _check_points(points_m, foliage)
    seconds: dict[str, float] = {}
    step = partial(follow_step, seconds=seconds, progress=progress)

    with step("points"):
        chosen = choose_crown_points(plant_m, settings.points, foliage)
        crown_m = plant_m[chosen.chosen]
        center = find_crown_center(crown_m, settings.points)
        reach_m = _reach(crown_m, center)
    with step("photographs") as report:
        reduced = _read_views(views, center.center_m, reach_m, settings.size, report)
        spacing_m = point_spacing(crown_m)
        reduced = [_cover(view, crown_m, spacing_m) for view in reduced]
        if not reduced:
            raise FitError(f"none of {len(views)} photographs shows the crown from outside")
    with step("hull"):
        hull = fit_crown_hull(crown_m, center.center_m, chosen.base_m, reduced, settings.size, settings.hull)
    with step("colours") as report:
        radius_m = hull.radius_m.astype(np.float32)
        colors = gather_colors(radius_m, center.center_m, reduced, settings.colors, report)
    with step("texture") as report:
        rng = np.random.default_rng(settings.seed)
        color, text = fill_unseen(colors, radius_m, center.center_m, reduced, rng, settings.colors, report)
    model = CrownModel(
        radius_m=radius_m,
        color=color,
        center_m=center.center_m,
        relief_weight=0.0,  # the relief is that of the points
        asset_from_photo=np.eye(4) if asset_from_capture is None else asset_from_capture,
    )
    with step("measures"):
        below_m = plant_m[plant_m[:, 1] < chosen.base_m]
        measured = tuple(
            measure_view(model, view, crown_m, below_m, int(texels), spacing_m)
            for view, texels in zip(reduced, colors.texels, strict=True)
        )
    remarks = [remark("crown-colors", text)]
    if len(reduced) < len(views):
        unused = f"{len(views) - len(reduced)} of {len(views)} photographs do not show the crown from outside"
        remarks.insert(0, remark("photographs-without-crown", f"{unused} and are not used"))
    measures = CapturedCrownMeasures(
        center=center,
        base_m=chosen.base_m,
        points=len(crown_m),
        outliers=chosen.outliers,
        known=hull.known,
        carved=hull.carved,
        seen=float(colors.seen.mean()),
        volume_m3=crown_volume(radius_m),
        distance_m=distance_from_points(model, crown_m),
        views=measured,
        remarks=tuple(remarks),
        seconds=seconds,
    )
    return model, measures


def reconstruct_cloud_crown(
    points_m: NDArray[np.floating],
    settings: CapturedCrownSettings = CapturedCrownSettings(),
    *,
    plain: tuple[float, float, float],
    colors: NDArray[np.floating] | None = None,
    foliage: NDArray[np.bool_] | None = None,
    asset_from_capture: NDArray[np.float64] | None = None,
    progress: StepProgress | None = None,
) -> tuple[CrownModel, CapturedCrownMeasures]:
    """Reconstruct a crown from the points of a plant alone: their hull, which nothing carves, and their colours.

    Args:
        points_m: As reconstruct_captured_crown.
        settings: What to make.
        plain: Linear Rec.709, colour of the crown's outside where its points have none.
        colors: (N, 3), the same, of the points; NaN where one has none.
        foliage: As reconstruct_captured_crown.
        asset_from_capture: Likewise.
        progress: Called at each step.

    Returns:
        The crown, and its measures: their views are of four cameras around it.

    Raises:
        ValueError: Shapes do not fit each other, or points are not finite.
        FitError: Too few points, in a plane, or in too few directions from the crown's centre.
    """
    plant_m = _check_points(points_m, foliage)
    if colors is not None and np.shape(colors) != plant_m.shape:
        raise ValueError(f"colors must be {plant_m.shape}, not {np.shape(colors)}")
    seconds: dict[str, float] = {}
    step = partial(follow_step, seconds=seconds, progress=progress)

    with step("points"):
        chosen = choose_crown_points(plant_m, settings.points, foliage)
        crown_m = plant_m[chosen.chosen]
        center = find_crown_center(crown_m, settings.points)
    with step("hull"):
        hull = fit_crown_hull(crown_m, center.center_m, chosen.base_m, (), settings.size, settings.hull)
        remarks = _check_directions(hull.known)
    with step("colours"):
        radius_m = hull.radius_m.astype(np.float32)
        own, text = _own_colors(None if colors is None else np.asarray(colors, np.float64)[chosen.chosen])
        if own is None:
            own = shade_points(radius_m, center.center_m, crown_m, plain)
        color, seen = gather_point_colors(radius_m, center.center_m, crown_m, own)
        color = stretch_colors(color, seen)
    model = CrownModel(
        radius_m=radius_m,
        color=color,
        center_m=center.center_m,
        relief_weight=0.0,
        asset_from_photo=np.eye(4) if asset_from_capture is None else asset_from_capture,
    )
    with step("measures"):
        around = _stand_around(center.center_m, _reach(crown_m, center))
        spacing_m = point_spacing(crown_m)
        measured = tuple(measure_view(model, view, crown_m, crown_m[:0], 0, spacing_m) for view in around)
    return model, CapturedCrownMeasures(
        center=center,
        base_m=chosen.base_m,
        points=len(crown_m),
        outliers=chosen.outliers,
        known=hull.known,
        carved=None,
        seen=float(seen.mean()),
        volume_m3=crown_volume(radius_m),
        distance_m=distance_from_points(model, crown_m),
        views=measured,
        remarks=(*remarks, remark("crown-colors", text)),
        seconds=seconds,
    )


def _check_directions(known: float) -> tuple[Remark, ...]:
    """A warning where a cloud has points in a small share of the directions.

    Raises:
        FitError: They are too few.
    """
    text = f"from the crown's centre there are points in {known:.0%} of the directions"
    remedy = "give a cloud from all sides, of one plant"
    if known < _MIN_KNOWN:
        raise FitError(f"{text}, {_MIN_KNOWN:.0%} needed", remedy)
    if known >= _FEW_KNOWN:
        return ()
    text = f"{text}; elsewhere its surface is a guess between them"
    return (remark("crown-directions-few", text, remedy=remedy),)


def _own_colors(colors: NDArray[np.float64] | None) -> tuple[NDArray[np.float64] | None, str]:
    """The colours of a crown's points (N, 3), None where they have none, and what the user should know of them."""
    colored = 0.0 if colors is None else float(np.isfinite(colors).all(axis=1).mean())
    if colors is None or colored == 0:
        return None, "the points have no colours that show leaves; the crown has one, darker where they lie deeper"
    if colored == 1:
        return colors, "the crown has the colours of its points"
    return colors, (
        f"the crown has the colours of {colored:.0%} of its points; the others are black, which is taken for no "
        "colour, and the crown has there what is around them"
    )


def _check_points(points_m: NDArray[np.floating], foliage: NDArray[np.bool_] | None) -> NDArray[np.float64]:
    plant_m: NDArray[np.float64] = np.asarray(points_m, np.float64)
    if plant_m.ndim != 2 or plant_m.shape[1] != 3 or not np.isfinite(plant_m).all():
        raise ValueError(f"points_m must be (N, 3) finite numbers, not {plant_m.shape}")
    if foliage is not None and foliage.shape != plant_m.shape[:1]:
        raise ValueError(f"foliage must be {plant_m.shape[:1]}, not {foliage.shape}")
    return plant_m


def _reach(crown_m: NDArray[np.float64], center: CrownCenter) -> float:
    return float(np.quantile(np.linalg.norm(crown_m - center.center_m, axis=1), 0.998))


def _stand_around(center_m: NDArray[np.float64], reach_m: float) -> list[ReducedView]:
    """Four level cameras without pictures, that show all of the crown."""
    views = []
    for name, (x, z) in {"front": (0, 1), "right": (1, 0), "back": (0, -1), "left": (-1, 0)}.items():
        place_m = center_m + _AROUND * reach_m * np.array([x, 0, z])
        turn = np.array([[z, 0, -x], [0, -1, 0], [-x, 0, -z]], np.float64)
        camera = Pinhole(
            width_px=_AROUND_PX,
            height_px=_AROUND_PX,
            focal_px=(_AROUND_PX * _AROUND / 2.4,) * 2,
            center_px=(_AROUND_PX / 2,) * 2,
            cam_from_world=np.column_stack([turn, -turn @ place_m]),
        )
        blank = np.zeros((_AROUND_PX, _AROUND_PX, 3), np.uint8)
        views.append(ReducedView(name=name, camera=camera, srgb=blank, mask=None, sky=None, depth_m=None))
    return views


def _read_views(
    views: Sequence[CrownView], center_m: NDArray[np.float64], reach_m: float, size: int, report: Progress
) -> list[ReducedView]:
    """Those of the views that show the crown, twice as fine as its texels, or as fine as memory allows."""
    max_px = int((_MAX_BYTES / _PIXEL_BYTES / max(len(views), 1)) ** 0.5)
    reduced = []
    for number, view in enumerate(views):
        small = reduce_view(view, center_m, reach_m, min(2 * size, max_px))
        if small is not None:
            reduced.append(small)
        report(number + 1, len(views))
    return reduced


def _cover(view: ReducedView, crown_m: NDArray[np.float64], spacing_m: float) -> ReducedView:
    """The view with where points of the crown are, for want of a mask."""
    if view.mask is not None:
        return view
    depth_m = float(np.median(view.camera.project(crown_m[:: max(1, len(crown_m) // 5000)])[1]))
    gap_px = _COVERED * spacing_m * view.camera.focal_px[0] / max(depth_m, 1e-9)
    return replace(view, covered=draw_points(crown_m, view.camera, gap_px))
