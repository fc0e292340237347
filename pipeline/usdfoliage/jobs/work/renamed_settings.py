"""Settings that had another name in the version before: their old names are still read, with a warning."""

import copy
import dataclasses
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from usdfoliage.errors import FoliageError

logger = logging.getLogger(__name__)

# Old and new names, with the tables before them as in a plan. The next version does not read the old ones.
RENAMED_SETTINGS: Mapping[str, str] = {
    "capture.registration": "capture.pose_estimation",
    "capture.pose_estimation.least_features": "capture.pose_estimation.min_features",
    "capture.pose_estimation.least_matches": "capture.pose_estimation.min_matches",
    "capture.pose_estimation.neighbours": "capture.pose_estimation.neighbors",
    "capture.doubtful_poses": "capture.uncertain_poses",
    "capture.world.least_gps": "capture.world.min_gps",
    "capture.depth.segments.least_px": "capture.depth.segments.min_px",
    "isolation.strays": "isolation.outliers",
    "leaves.dense.coherence.least_own": "leaves.dense.coherence.min_own",
    "leaves.dense.coherence.least_others": "leaves.dense.coherence.min_others",
    "leaves.dense.patches.least_px": "leaves.dense.patches.min_px",
    "leaves.dense.patches.least_cosine": "leaves.dense.patches.min_cosine",
    "leaves.dense.claims.least_cosine": "leaves.dense.claims.min_cosine",
    "foliage.least_cover": "foliage.min_cover",
    "foliage.least_drawn": "foliage.min_drawn",
    "capture.depth.segments.least_share": "capture.depth.segments.min_share",
    "capture.depth.agreement.least_likelihood": "capture.depth.agreement.min_likelihood",
    "capture.cloud.least_views": "capture.cloud.min_views",
    "branches.most_points": "branches.max_points",
    "leaves.dense.least_confidence": "leaves.dense.min_confidence",
    "leaves.dense.rims.most_change": "leaves.dense.rims.max_change",
    "leaves.dense.points.most_per_leaf": "leaves.dense.points.max_per_leaf",
    "leaves.dense.first.least_quality": "leaves.dense.first.min_quality",
    "leaves.dense.second.least_quality": "leaves.dense.second.min_quality",
    "leaves.dense.third.least_quality": "leaves.dense.third.min_quality",
    "leaves.dense.last.least_quality": "leaves.dense.last.min_quality",
    "leaves.direction.visibility.least_spread": "leaves.direction.visibility.min_spread",
    "leaves.colors.visibility.least_spread": "leaves.colors.visibility.min_spread",
    "leaves.texture.most_pictures": "leaves.texture.max_pictures",
    "leaves.texture.visibility.least_spread": "leaves.texture.visibility.min_spread",
    "foliage.most_leaves": "foliage.max_leaves",
}


def with_new_names(table: Mapping[str, Any], defaults: object, path: Path) -> dict[str, Any]:
    """The tables of a settings file with old names replaced by the new ones; a warning is logged for each.

    It is no remark: remarks are about the input and the result of a run, and belong to a result, which is the same
    whichever name a setting has. Settings are read before there is a run, by some commands several times.

    Args:
        table: As the TOML file has it.
        defaults: The settings that the file changes: those of a build, or of one of its stages.
        path: The file, for messages.

    Raises:
        FoliageError: The file has a setting by both of its names.
    """
    renamed = copy.deepcopy(dict(table))
    for old, new in RENAMED_SETTINGS.items():
        for old_name, new_name in ((old, new), (old.partition(".")[2], new.partition(".")[2])):
            if has_setting(defaults, new_name):
                _rename(renamed, old_name, new_name, path)
                break
    return renamed


def has_setting(settings: object, name: str) -> bool:
    """Whether settings have a field of this name, with the tables before it, such as fit.tolerance."""
    inner = settings
    for part in name.split("."):
        if not dataclasses.is_dataclass(inner) or part not in {field.name for field in dataclasses.fields(inner)}:
            return False
        inner = getattr(inner, part)
    return True


def _rename(table: dict[str, Any], old: str, new: str, path: Path) -> None:
    inner, last = _inner_table(table, old)
    if inner is None or last not in inner:
        return
    target, new_last = _inner_table(table, new)
    if target is None or new_last in target:
        raise FoliageError(f"{old} is the old name of {new}, and both are there", f"remove {old} ({path})")
    target[new_last] = inner.pop(last)
    logger.warning(
        "the setting %s is called %s now, and the next version will not know the old name (%s)", old, new, path
    )


def _inner_table(table: dict[str, Any], name: str) -> tuple[dict[str, Any] | None, str]:
    """The table that a setting is in, None where the file does not have it, and the last part of the setting's name."""
    *places, last = name.split(".")
    inner: Any = table
    for place in places:
        inner = inner.get(place) if isinstance(inner, dict) else None
    return inner if isinstance(inner, dict) else None, last
