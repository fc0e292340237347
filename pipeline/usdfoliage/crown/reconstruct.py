"""A crown from posed photographs and the cloud made of them: the main job, on arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.crown.captured_measures import (
    CapturedCrownMeasures,
    crown_volume,
    distance_from_points,
    draw_points,
    measure_view,
)
from usdfoliage.crown.color_map import ColorMapSettings, Progress
from usdfoliage.crown.crown_points import CrownPointSettings, choose_crown_points, find_crown_center
from usdfoliage.crown.hull import HullSettings, fit_crown_hull
from usdfoliage.crown.model import CrownModel
from usdfoliage.crown.seen_colors import SeenColorSettings, fill_unseen, gather_colors
from usdfoliage.crown.texture import TextureSettings
from usdfoliage.crown.views import CrownView, ReducedView, reduce_view
from usdfoliage.errors import FitError
from usdfoliage.steps import StepProgress, follow_step

CAPTURED_STEPS = ("points", "photographs", "hull", "colours", "texture", "measures")

MIN_SIZE, MAX_SIZE = 32, 4096  # texels a side, as for a crown of one photograph
_HELD_BYTES = 1 << 30  # of all reduced photographs together
_COVERED = 1.0  # distances to the sixth neighbour: what is between points closer than that is the plant as well
_PIXEL_BYTES = 9  # colour, depth, mask, sky


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
        foliage: (N,), which points are leaves; None: told from the plant's widths.
        asset_from_capture: (4, 4), kept in the model; the identity where None.
        progress: Told of each step.

    Raises:
        ValueError: Shapes do not fit each other, or points are not finite.
        FitError: Too few points, or no photograph shows the crown.
    """
    plant_m: NDArray[np.float64] = np.asarray(points_m, np.float64)
    if plant_m.ndim != 2 or plant_m.shape[1] != 3 or not np.isfinite(plant_m).all():
        raise ValueError(f"points_m must be (N, 3) finite numbers, not {plant_m.shape}")
    if foliage is not None and foliage.shape != plant_m.shape[:1]:
        raise ValueError(f"foliage must be {plant_m.shape[:1]}, not {foliage.shape}")
    seconds: dict[str, float] = {}
    step = partial(follow_step, seconds=seconds, progress=progress)

    with step("points"):
        chosen = choose_crown_points(plant_m, settings.points, foliage)
        crown_m = plant_m[chosen.chosen]
        center = find_crown_center(crown_m, settings.points)
        reach_m = float(np.quantile(np.linalg.norm(crown_m - center.center_m, axis=1), 0.998))
    with step("photographs") as report:
        reduced = _read_views(views, center.center_m, reach_m, settings.size, report)
        reduced = [_cover(view, crown_m) for view in reduced]
        if not reduced:
            raise FitError(f"none of {len(views)} photographs shows the crown from outside")
    with step("hull"):
        hull = fit_crown_hull(crown_m, center.center_m, chosen.base_m, reduced, settings.size, settings.hull)
    with step("colours") as report:
        radius_m = hull.radius_m.astype(np.float32)
        colors = gather_colors(radius_m, center.center_m, reduced, settings.colors, report)
    with step("texture") as report:
        rng = np.random.default_rng(settings.seed)
        color, told = fill_unseen(colors, radius_m, center.center_m, reduced, rng, settings.colors, report)
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
            measure_view(model, view, crown_m, below_m, int(texels))
            for view, texels in zip(reduced, colors.texels, strict=True)
        )
    notes = [told] if len(reduced) == len(views) else [_tell_left_out(len(views), len(reduced)), told]
    measures = CapturedCrownMeasures(
        center=center,
        base_m=chosen.base_m,
        points=len(crown_m),
        strays=chosen.strays,
        known=hull.known,
        carved=hull.carved,
        seen=float(colors.seen.mean()),
        volume_m3=crown_volume(radius_m),
        distance_m=distance_from_points(model, crown_m),
        views=measured,
        notes=tuple(notes),
        seconds=seconds,
    )
    return model, measures


def _read_views(
    views: Sequence[CrownView], center_m: NDArray[np.float64], reach_m: float, size: int, report: Progress
) -> list[ReducedView]:
    """Those of the views that show the crown, twice as fine as its texels, or as fine as memory allows."""
    most_px = int((_HELD_BYTES / _PIXEL_BYTES / max(len(views), 1)) ** 0.5)
    reduced = []
    for number, view in enumerate(views):
        small = reduce_view(view, center_m, reach_m, min(2 * size, most_px))
        if small is not None:
            reduced.append(small)
        report(number + 1, len(views))
    return reduced


def _cover(view: ReducedView, crown_m: NDArray[np.float64]) -> ReducedView:
    """The view with where points of the crown are, for want of a mask."""
    if view.mask is not None:
        return view
    some = crown_m[:: max(1, len(crown_m) // 5000)]
    spacing_m = float(np.median(cKDTree(crown_m).query(some, k=[7], workers=-1)[0]))
    depth_m = float(np.median(view.camera.project(some)[1]))
    gap_px = _COVERED * spacing_m * view.camera.focal_px[0] / max(depth_m, 1e-9)
    return replace(view, covered=draw_points(crown_m, view.camera, gap_px))


def _tell_left_out(total: int, used: int) -> str:
    return f"{total - used} of {total} photographs do not show the crown from outside and are not used"
