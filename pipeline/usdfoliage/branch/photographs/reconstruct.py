"""From posed photographs to places on stems, and to one skeleton of them: the one page of this folder."""

import logging
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.photographs.distances import DistanceSettings, LinePoints, choose_views, find_distances
from usdfoliage.branch.photographs.evidence import EvidenceSettings, collect_evidence
from usdfoliage.branch.photographs.join_settings import JoinSettings
from usdfoliage.branch.photographs.joined import JoinedStems
from usdfoliage.branch.photographs.joining import join_stems
from usdfoliage.branch.photographs.lines import LineSettings, find_lines
from usdfoliage.branch.photographs.no_stems import NoStems
from usdfoliage.branch.photographs.seen_lines import SeenLines, place_lines
from usdfoliage.branch.photographs.stem_points import MergeSettings, StemPoints, merge_lines
from usdfoliage.capture.view import View
from usdfoliage.progress import StepProgress

logger = logging.getLogger(__name__)

_MIN_VIEWS = 2  # in which a line must be seen
_EVERY = 2  # one middle of so many along a line has its distance looked for: they are a pixel apart
_OF_LEAF = -3.0  # logarithm of the odds of what lies on a leaf that was found


@dataclass(frozen=True, kw_only=True)
class PhotographedStemSettings:
    """How stems are found in photographs."""

    lines: LineSettings = field(default_factory=LineSettings)
    distances: DistanceSettings = field(default_factory=DistanceSettings)
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    merge: MergeSettings = field(default_factory=MergeSettings)
    join: JoinSettings = field(default_factory=JoinSettings)
    mask_px: int = 4  # Stems are looked for up to this far beside the mask of the plant. Range: 0 or more.
    on_leaf: float = 6.0  # Footprints of a pixel, within which a line lies on a leaf that was found. Range: 0 or more.

    def __post_init__(self) -> None:
        if self.mask_px < 0 or self.on_leaf < 0:
            raise ValueError(f"mask_px and on_leaf must not be below 0, not {self.mask_px} and {self.on_leaf:g}")


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundLeafPlaces:
    """Leaves that were found before, as stems are joined to them; in the world of the views."""

    bases_m: NDArray[np.float64]  # (L, 3)
    apices_m: NDArray[np.float64]  # (L, 3)
    certainty: NDArray[np.float64]  # (L,), 0.5 to 1, the probability that the base is the base
    blades_m: NDArray[np.float64]  # (B, 3), places on their blades, without what is near their ends

    @classmethod
    def none(cls) -> "FoundLeafPlaces":
        nowhere = np.zeros((0, 3))
        return cls(bases_m=nowhere, apices_m=nowhere, certainty=np.zeros(0), blades_m=nowhere)


def reconstruct_stems(
    views: Sequence[View],
    box_m: NDArray[np.float64],
    leaves: FoundLeafPlaces,
    settings: PhotographedStemSettings = PhotographedStemSettings(),
    progress: StepProgress | None = None,
    *,
    threads: int = 0,
) -> JoinedStems | NoStems:
    """The stems of a plant, joined from the soil to its leaves; or why photographs show none.

    Args:
        views: The photographs, in a world with Y up; depth shows what is hidden.
        box_m: (2, 3), lowest and highest corner of where the plant is; it stands on the lower side.
        leaves: That were found.
        settings: How.
        progress: Called with what is done, and how far it is.
        threads: That work at a time; 0: one per core. The result is the same.
    """
    if len(views) < _MIN_VIEWS:
        return NoStems.FEW_PHOTOGRAPHS
    stems = find_stem_points(views, box_m, settings, progress, threads=threads)
    if not len(stems):
        return NoStems.NO_LINES
    if len(leaves.blades_m):
        reach_m = settings.on_leaf * stems.footprint_m
        away_m = cKDTree(leaves.blades_m).query(stems.points_m, distance_upper_bound=reach_m)[0]
        stems = stems.with_odds(np.where(away_m < reach_m, _OF_LEAF, stems.odds))
    joined = join_stems(
        stems,
        leaves.bases_m,
        float(box_m[0, 1]),
        settings.join,
        apices_m=leaves.apices_m,
        certainty=leaves.certainty,
    )
    if progress is not None:
        progress("stems", 1.0)
    return NoStems.NOT_JOINED if joined is None else joined


def find_stem_points(
    views: Sequence[View],
    box_m: NDArray[np.float64],
    settings: PhotographedStemSettings = PhotographedStemSettings(),
    progress: StepProgress | None = None,
    *,
    threads: int = 0,
) -> StemPoints:
    """Places on stems, by lines that several photographs show; arguments as reconstruct_stems takes them.

    Raises:
        ValueError: There is no view.
    """
    if not views:
        raise ValueError("stems are looked for in one view or more, not in 0")
    report = progress or (lambda name, share: None)
    seen: list[SeenLines] = []
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        for each in pool.map(lambda view: _lines_of(view, settings), views):
            seen.append(each)
            report("stems", 0.4 * len(seen) / len(views))
        middle_m = box_m.mean(axis=0)

        def look(number: int) -> LinePoints:
            others = [seen[each] for each in choose_views(seen, number, middle_m, settings.distances)]
            return find_distances(_some_of(seen[number]), others, box_m, settings.distances)

        found: list[LinePoints] = []
        for points in pool.map(look, range(len(views))):
            found.append(points)
            report("stems", 0.4 + 0.4 * len(found) / len(views))
    points_m = np.concatenate([each.points_m for each in found])
    along, radius_m = (np.concatenate([getattr(each, name) for each in found]) for name in ("along", "radius_m"))
    view = np.repeat(np.arange(len(views)), [len(each) for each in found])
    cameras = [each.camera for each in views]
    away_m = [
        float(np.linalg.norm(camera.position_m - middle_m)) * own.pixel_rad
        for camera, own in zip(cameras, seen, strict=True)
    ]
    footprint_m = float(np.median(away_m))
    evidence = collect_evidence(
        points_m, along, radius_m, seen, cameras, [each.depth_m for each in views], settings.evidence
    )
    stems = merge_lines(points_m, along, radius_m, view, evidence, footprint_m, settings.merge)
    logger.info("%d places of lines, %d on what may be stems", len(points_m), len(stems))
    report("stems", 0.9)
    return stems


def _lines_of(view: View, settings: PhotographedStemSettings) -> SeenLines:
    mask = view.mask
    if mask is not None and settings.mask_px:  # which may have lost what is thin
        side = 2 * settings.mask_px + 1
        mask = cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    return place_lines(find_lines(view.srgb, mask, settings.lines), view.camera)


def _some_of(seen: SeenLines) -> SeenLines:
    """Every other middle of each line."""
    first = np.flatnonzero(np.diff(seen.line, prepend=-1))
    place = np.arange(len(seen)) - np.repeat(first, np.diff(np.append(first, len(seen))))
    return seen.take(place % _EVERY == 0)
