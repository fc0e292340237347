"""Which points of a cloud are of branches: looked for again and again, each time without the leaves that were found."""

import logging

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.tracing.cloud_cut import (
    cut_cloud,
    point_spacing,
    points_in_thick_branches,
    sections_on_stems,
)
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.branch.tracing.wood import MAX_SURE, caution_with_colors, choose_wood, wood_features, wood_odds
from usdfoliage.branch.tracing.wood_colors import blur_colors, color_odds
from usdfoliage.branch.tracing.wood_facts import learned_wood_odds
from usdfoliage.geometry.point_cells import cell_means
from usdfoliage.progress import StepProgress

logger = logging.getLogger(__name__)


def find_wood(
    points_m: NDArray[np.float64],
    roots_m: NDArray[np.float64],
    internode_m: float,
    spacing_m: float,
    settings: BranchSettings,
    colors: NDArray[np.number] | None,
    report: StepProgress,
) -> NDArray[np.intp]:
    """(W,) points that are of wood."""
    blurred = None
    wood = np.arange(len(points_m))
    sure = np.zeros(len(points_m), bool)
    for turn in range(settings.wood.max_turns):
        report("wood", 0.5 + 0.2 * turn / settings.wood.max_turns)
        # Without the leaves slices are other ones, and wood is easier to distinguish from the leaves that are still
        # there.
        apart_m = (point_spacing(points_m[wood]) if turn else spacing_m) or spacing_m
        cut = cut_cloud(points_m[wood], roots_m, internode_m, apart_m, settings, search=True)
        stems = sections_on_stems(cut)
        features = wood_features(points_m, cut.sections, cut.spacing_m)
        odds = wood_odds(features)
        if settings.leaves == "auto" and turn == 0:
            share = choose_wood(cut.sections, odds + settings.wood.caution, stems, cut.spacing_m).share
            logger.info("%.0f %% of the sections' length look like wood", 100 * share)
            if share >= settings.wood.leafless:
                break
        # Neither alone: what was learned of trees is mistaken where a herb's noise is as large as its leaves.
        learned = learned_wood_odds(points_m, cut.sections, cut.spacing_m, features)
        odds = settings.wood.learned * learned + (1 - settings.wood.learned) * np.clip(odds, -MAX_SURE, MAX_SURE)
        found = choose_wood(cut.sections, odds + settings.wood.caution, stems, cut.spacing_m)
        logger.info("%.0f %% of the sections' length is wood", 100 * found.share)
        if turn == 0:
            sure = points_in_thick_branches(cut, settings)
            blurred = None if colors is None else blur_colors(points_m, colors, spacing_m)
        if blurred is not None:
            taken = np.zeros(len(points_m), bool)
            taken[wood] = found.sections[cut.sections.section] | sure[wood]
            colored = color_odds(blurred, taken)[wood]
            by_color = cell_means(colored[:, None], cut.sections.section)[:, 0]
            odds = odds + caution_with_colors(colored, settings.wood) + settings.wood.color_weight * by_color
            found = choose_wood(cut.sections, odds, stems, cut.spacing_m)
            logger.info("with colours %.0f %%", 100 * found.share)
            # What geometry alone would drop of a noisy cloud's wood is thin: long paths of few points, that colours
            # spared.
            if turn and found.sections[cut.sections.section].mean() >= settings.wood.settled:
                break
        kept = found.sections[cut.sections.section] | sure[wood]
        if kept.sum() < 2:
            break
        wood = wood[kept]
        if found.share >= settings.wood.settled:
            break
    return wood
