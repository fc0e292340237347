"""What the method dense looks at: coherent depth, its surfaces, and the patches of them that may be leaves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.files.threads import map_threaded
from usdfoliage.leaf.photographs.outline_edges import EdgePicture, find_edges
from usdfoliage.leaf.points import LeafPoints, no_points
from usdfoliage.leaf.segmentation.dense.claims import (
    PointSettings,
    collect_points,
)
from usdfoliage.leaf.segmentation.dense.coherence import make_depth_coherent, nearest_views
from usdfoliage.leaf.segmentation.dense.foliage_color import index_colors
from usdfoliage.leaf.segmentation.dense.fragments import append_points
from usdfoliage.leaf.segmentation.dense.median_length import (
    free_share,
    gather_measure,
    ladder_of_radii,
    measure_median_length,
    measure_part_length,
)
from usdfoliage.leaf.segmentation.dense.open_sky import put_sky_far
from usdfoliage.leaf.segmentation.dense.overlap import Overlaps, measure_overlaps
from usdfoliage.leaf.segmentation.dense.parts import find_creases, find_steps, part_at_necks
from usdfoliage.leaf.segmentation.dense.patches import (
    LocalPlanes,
    Patches,
    find_patches,
    fit_planes_of_view,
    measure_patches,
)
from usdfoliage.leaf.segmentation.dense.rims import fill_rims
from usdfoliage.leaf.segmentation.dense.settings import DenseSegmentationSettings

FEW_POINTS = PointSettings(max_per_leaf=1000)  # enough for a proposal
MEASURED_VIEWS = 8  # that the median length is measured in
LENGTHS_AGREE = 1.7  # factor by which patches are longer than their parts, beyond which these are the leaves


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """What all passes look at."""

    views: Sequence[View]  # those with depth
    numbers: NDArray[np.int64]  # of each among all views
    depths_m: Sequence[NDArray[np.float32]]
    noise_m: float  # median
    footprint_m: float  # median, of a pixel
    tolerance_m: float  # between a leaf and its points
    planes: Sequence[LocalPlanes]
    patches: Sequence[Patches]
    colors: Sequence[NDArray[np.int32]]
    edges: Sequence[EdgePicture]
    median_m: float = 0.0  # how long a leaf is, as far as is known
    large: bool = False  # whether leaves are that many pixels long that details distinguish them
    misfit_m: float = 0.0  # that the surface of a leaf may be off its model


def measure_scene(
    views: Sequence[View],
    used: Sequence[int],
    settings: DenseSegmentationSettings,
    step: Callable[[], None],
    threads: int,
) -> Scene:
    """The views of these numbers, with coherent depth, its planes and patches; step is called twice for each."""
    chosen = [views[index] for index in used]
    coherent = make_depth_coherent(chosen, settings.coherence, lambda done, total: step(), threads=threads)
    noise_m = float(np.median(coherent.noise_m))
    footprint_m = float(
        np.median([_footprint(view, depth) for view, depth in zip(chosen, coherent.depth_m, strict=True)])
    )
    depths_m = put_sky_far(coherent.depth_m)

    def measure_view(number: int) -> tuple[LocalPlanes, Patches]:
        view, depth_m = chosen[number], depths_m[number]
        fitted = fit_planes_of_view(view, depth_m, noise_m, settings.patches, threads=1)
        return fitted, find_patches(view, depth_m, noise_m, settings.patches, planes=fitted, valid=view.mask, threads=1)

    planes, patches = [], []
    for fitted, found in map_threaded(measure_view, range(len(chosen)), threads=threads):
        planes.append(fitted)
        patches.append(found)
        step()
    return Scene(
        views=chosen,
        numbers=np.asarray(used, np.int64),
        depths_m=depths_m,
        noise_m=noise_m,
        footprint_m=footprint_m,
        tolerance_m=settings.plane_threshold_m or 3 * noise_m + 1.5 * footprint_m,
        planes=planes,
        patches=patches,
        colors=index_colors(chosen),
        edges=find_edges(chosen, settings.outlines, threads=threads),
    )


def fill_scene_rims(scene: Scene, settings: DenseSegmentationSettings, threads: int) -> Scene:
    """The scene with depth up to the edges that the photographs show."""

    def fill(number: int) -> tuple[NDArray[np.float32], LocalPlanes, Patches]:
        view, depth_m, planes = scene.views[number], scene.depths_m[number], scene.planes[number]
        noise_m, chosen = scene.noise_m, settings.patches
        # What a mask leaves out has rims too.
        around = find_patches(view, depth_m, noise_m, chosen, planes=planes, threads=1)
        filled_m = fill_rims(view.srgb, depth_m, planes, around, settings.rims)
        planes = fit_planes_of_view(view, filled_m, noise_m, chosen, threads=1)
        patches = find_patches(view, filled_m, noise_m, chosen, planes=planes, valid=view.mask, threads=1)
        return filled_m, planes, patches

    filled = map_threaded(fill, range(len(scene.views)), threads=threads)
    depths_m, planes, patches = zip(*filled, strict=True)
    return replace(scene, depths_m=depths_m, planes=planes, patches=patches)


def _footprint(view: View, depth_m: NDArray[np.float32]) -> float:
    """Metres that a pixel of median depth spans."""
    known = depth_m[depth_m > 0]
    return float(np.median(known)) / view.camera.focal_px[0] if len(known) else 0.0


def overlap_patches(scene: Scene, settings: DenseSegmentationSettings, threads: int) -> Overlaps:
    """Which patches of neighbouring views show the same."""
    cameras = [view.camera for view in scene.views]
    every = list(range(len(cameras)))
    neighbors = []
    for index in every:
        known = scene.depths_m[index][scene.depths_m[index] > 0]
        depth_m = float(np.median(known)) if len(known) else 1.0
        neighbors.append(nearest_views(cameras, index, every, depth_m, settings.coherence.neighbors))
    return measure_overlaps(
        scene.views,
        scene.depths_m,
        [found.labels for found in scene.patches],
        [len(found.pixels) for found in scene.patches],
        neighbors,
        4.0,
        scene.noise_m,
        threads=threads,
    )


def measure_length(scene: Scene, overlaps: Overlaps, settings: DenseSegmentationSettings, threads: int) -> float:
    """How long the median leaf is: of the patches, unless their parts give another length."""
    of_patches_m = measure_median_length(scene.patches, overlaps)
    if not scene.footprint_m > 0:
        return of_patches_m
    measured = np.unique(np.linspace(0, len(scene.views) - 1, min(MEASURED_VIEWS, len(scene.views))).astype(int))

    def part(number: int) -> list[Patches]:
        view, whole = scene.views[number], scene.patches[number]
        steps = find_steps(scene.planes[number], settings.parts.gap)
        return [
            measure_patches(
                view, scene.depths_m[number],
                part_at_necks(whole.labels, steps, radius_px, settings.patches.min_px),
                scene.noise_m, settings.patches, threads=1,
            )
            for radius_px in radii_px
        ]  # fmt: skip

    radii_px = ladder_of_radii(max(scene.views[0].depth_m.shape))
    parts = list(zip(*map_threaded(part, measured.tolist(), threads=threads), strict=True))
    of_parts_m = measure_part_length(parts, radii_px, scene.footprint_m)
    # Patches of leaves that touch are too long. Where parts are longer than patches, leaves are too small to be parted.
    too_long = of_parts_m is not None and of_patches_m > LENGTHS_AGREE * of_parts_m
    return of_parts_m if of_parts_m is not None and too_long else of_patches_m


def expect_length(scene: Scene, median_m: float, settings: DenseSegmentationSettings) -> Scene:
    """The scene, in which leaves are about so long."""
    misfit_m = settings.misfit * median_m
    return replace(
        scene, median_m=median_m, misfit_m=misfit_m, tolerance_m=max(scene.tolerance_m, settings.tolerance * misfit_m)
    )  # fmt: skip


def noise_with_misfit(scene: Scene, footprints: float, noises: float) -> float:
    """The noise at which so many footprints and noises are no less than a leaf may be off its model.

    Where pixels are small, it is not they that limit how well a leaf is met.
    """
    return max(scene.noise_m, (scene.misfit_m - footprints * scene.footprint_m) / noises if noises else 0.0)


def find_within(scene: Scene, number: int, allowed: NDArray[np.bool_], settings: DenseSegmentationSettings) -> Patches:
    """The patches of a view within allowed (H, W) and its mask."""
    view = scene.views[number]
    return find_patches(
        view, scene.depths_m[number], scene.noise_m, settings.patches, planes=scene.planes[number],
        valid=allowed if view.mask is None else allowed & view.mask, threads=1,
    )  # fmt: skip


def points_of_patches(
    scene: Scene, patches: Sequence[Patches], number: NDArray[np.integer], count: int, threads: int
) -> LeafPoints:
    """The points of count leaves, where number (P,) is whose each patch of all views is, from 1, or 0 for none."""
    first = np.concatenate([[0], np.cumsum([len(found.pixels) for found in patches])])
    labels = [
        np.concatenate([[0], number[first[index] : first[index + 1]]]).astype(np.int32)[found.labels]
        for index, found in enumerate(patches)
    ]
    return collect_points(
        scene.views, scene.depths_m, labels, count, settings=FEW_POINTS, noise_m=scene.noise_m,
        planes=scene.planes, threads=threads,
    )  # fmt: skip


def points_of_parts(scene: Scene, median_m: float, settings: DenseSegmentationSettings, threads: int) -> LeafPoints:
    """Parts of patches as leaves: leaves that touch are often one patch."""
    radii_px = [width * median_m / scene.footprint_m for width in settings.parts.wide] if scene.large else []

    def part(number: int) -> list[tuple[Patches, NDArray[np.bool_]]]:
        view, planes, whole = scene.views[number], scene.planes[number], scene.patches[number]
        creases = find_creases(planes.normals(view.camera, threads=1), settings.crease_deg, settings.patches.radius_px)
        found = [find_within(scene, number, ~creases, settings)]
        steps = find_steps(planes, settings.parts.gap)
        for radius_px in radii_px:
            labels = part_at_necks(whole.labels, steps, radius_px, settings.patches.min_px)
            found.append(
                measure_patches(view, scene.depths_m[number], labels, scene.noise_m, settings.patches, threads=1)
            )
        return [(one, _is_proper(one, whole, settings.part)) for one in found]

    points = no_points()
    # One way of parting after the other, since each gives a pixel to one part.
    for of_width in zip(*map_threaded(part, range(len(scene.views)), threads=threads), strict=True):
        parts, proper = [one for one, _ in of_width], np.concatenate([own for _, own in of_width])
        chosen = may_be_leaves(parts, median_m, 0.05, settings) & proper
        number = np.where(chosen, np.cumsum(chosen), 0)
        points = append_points(points, points_of_patches(scene, parts, number, int(chosen.sum()), threads))
    return points


def _is_proper(parts: Patches, whole: Patches, max_share: float) -> NDArray[np.bool_]:
    """(P,) parts that are less than most of the patch they are of: what is nearly all of it was tried as that."""
    parent = np.zeros(len(parts) + 1, np.int64)
    parent[parts.labels] = whole.labels
    size = np.concatenate([[0], whole.pixels])[parent[1:]]
    return np.asarray((parts.pixels < max_share * size) & (size > 0))


def may_be_leaves(
    patches: Sequence[Patches], median_m: float, min_free: float, settings: DenseSegmentationSettings
) -> NDArray[np.bool_]:
    """(P,), which patches of all views are about as large as a leaf and end freely somewhere."""
    length_m, width_m, area_m2 = (gather_measure(patches, name) for name in ("length_m", "width_m", "area_m2"))
    return np.asarray(
        (area_m2 > settings.piece_area * median_m**2)
        & (area_m2 < settings.whole * median_m**2)
        & (length_m > settings.piece_length * median_m)
        & (length_m < settings.whole * median_m)
        & (width_m > 0.08 * length_m)
        & (free_share(patches) > min_free)
    )
